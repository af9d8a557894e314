"""What motors execute of control words, and what their registers tell of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.motors.map import MotorMap
from calfree_gym.streams import MotionNumbers

if TYPE_CHECKING:
    from calfree_gym.world import World


class Registers:
    """The registers of N arms, one row each, and those at which their joints stand.

    A motor executes a word up to its longest motion, less its shortfall. Its register counts that, up to the
    stops, and is told with noise and in steps. Words within the dead zone leave the joint where it is: from
    there it goes on with the next larger word, and home is home.

    Attributes:
        executed: Sums (N, m) of what was executed since home, in [-1, 1].
        joints: Registers (N, m) at which the joints stand, likewise.

    Args:
        motors: The motor maps of the N worlds.
        bound: Registers are told within +- this.
    """

    state_names: ClassVar[tuple[str, ...]] = ("joints",)  # what was executed is state of the arms

    def __init__(self, motors: MotorMap, bound: float) -> None:
        self._motors, self._bound = motors, bound
        shape = motors.lowest.shape
        self.executed, self.joints = np.zeros(shape), np.zeros(shape)
        self._stood = np.zeros((2, *shape))
        self._longest, self._factor, self._gain = (np.ones(shape) for _ in range(3))
        self._dead_zone, self._noise, self._step = (np.zeros(shape) for _ in range(3))
        self._exact = True
        self._numbers = MotionNumbers(shape[0], "register_noise", shape[1:], normal=True)

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._numbers.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the registers of `world`."""
        self._longest[row], self._gain[row] = world.longest_motion, world.word_gain
        self._factor[row] = (1 - world.shortfall) * world.word_gain
        self._dead_zone[row], self._noise[row] = world.dead_zone, world.register_noise
        self._step[row] = world.register_step
        ones, zeros = (self._longest, self._factor, self._gain), (self._dead_zone, self._noise, self._step)
        self._exact = all((each == 1).all() for each in ones) and not any(each.any() for each in zeros)

    def check_fits(self, world: World) -> None:
        """Raises where registers of a world go beyond the bound.

        Raises:
            ValueError: They do; says how far.
        """
        if world.register_bound > self._bound:
            raise ValueError(
                f"World.word_gain is {world.word_gain.tolist()}: registers would go to "
                f"+-{world.register_bound:g}; this environment observes them within +-{self._bound:g}, as in "
                "the worlds that it was made with"
            )

    def home(self, rows: Rows) -> Array:
        """Zero for `rows`; positions (n, m) of the motors' joints there."""
        self.executed[rows] = self.joints[rows] = 0.0
        return self._motors.positions(self.joints[rows], rows)

    def depart(self, rows: Rows) -> None:
        """Keeps from where the next motion of `rows` begins, for `stop`."""
        for stood, registers in zip(self._stood, (self.executed, self.joints), strict=True):
            stood[rows] = self._motors.positions(registers[rows], rows)

    def move(self, rows: Rows, words: Array) -> Array:
        """Executes control words (n, m): positions (n, m) to which the motors' joints are sent."""
        lowest, highest = self._motors.lowest[rows], self._motors.highest[rows]
        exact = self._exact and not (self.joints != self.executed).any()
        before, sent = self.executed[rows], words
        if not exact:
            longest = self._longest[rows]
            sent = np.minimum(np.maximum(words, -longest), longest) * self._factor[rows]
        after = joints = np.minimum(np.maximum(before + sent, lowest), highest)
        if not exact:
            stood = self.joints[rows]
            along = np.where(stood == before, after, stood + (after - before))
            joints = np.where(np.abs(words) <= self._dead_zone[rows], stood, along)
            joints = np.minimum(np.maximum(joints, lowest), highest)
        self.executed[rows], self.joints[rows] = after, joints
        return self._motors.positions(joints, rows)

    def stop(self, row: int, share: float) -> Array:
        """The motion of `row` ended at this share of its way: positions (m,) that send its joints there."""
        rows = np.array([row])
        for stood, registers in zip(self._stood, (self.executed, self.joints), strict=True):
            end = self._motors.positions(registers[rows], rows)[0]
            registers[row] = self._motors.registers(stood[row] + share * (end - stood[row]), row)
        return self._motors.positions(self.joints[rows], rows)[0]

    def in_words(self, registers: Array) -> Array:
        """Registers (N, m) in [-1, 1] as sums of words."""
        return registers / self._gain

    def told(self, trials: NDArray[np.int64], motions: NDArray[np.int64]) -> Array:
        """Registers (N, m) as delivered.

        Args:
            trials: The trial of all rows (N,).
            motions: Their motion of the trial (N,).
        """
        if self._exact:
            return self.executed.copy()
        told = self.in_words(self.executed)
        if self._noise.any():
            told = told + self._noise * self._numbers.at(trials, motions)
        told = np.minimum(np.maximum(told, -self._bound), self._bound)
        if (stepped := self._step > 0).any():
            step = np.where(stepped, self._step, 1.0)
            most = np.floor(self._bound / step)
            told = np.where(stepped, step * np.clip(np.rint(told / step), -most, most) + 0.0, told)
        return told
