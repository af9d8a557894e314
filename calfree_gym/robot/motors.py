"""Motors: what they execute of words, where their joints stand, and what registers tell.

A motor's register is the sum of the words sent to it since home, within its end stops. The position of its
joint follows its shaft through a smooth, strictly monotone curve that no controller knows:

    position = home + zero error + sign * gain * span * (t + curvature * t * (t**2 - 1))
    t = s + depth * period / (2 pi) * (sin(2 pi s / period + phase) - sin(phase))

The shaft's turn s is the register. Where motors are coupled, as by a belt that runs over the next joint, the
registers are means of two shafts' turns, with weights whose magnitudes add to 1; the last motor's next is the
first:

    register = (1 - |coupling|) * s + coupling * s of the next

A shaft stops where its joint does: its own motor gives way then, and the others go on. Where the gear
ripples, t may pass +-1, beyond which that curve is straight. Where home and zero error lie beyond a stop,
home is at that stop. Then backlash and motions that do not repeat exactly keep a motor from going where it is
sent.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.streams import MotionNumbers

if TYPE_CHECKING:
    from calfree_gym.world.value import World

_GRID, _NEWTON_STEPS = 64, 4
"""Of the curve's inverse: from the middle of one of so many parts, Newton's steps are exact to rounding
(guards)."""
_SETTLING = 100
"""Steps, for shafts of which one is stopped: exact to rounding with the largest coupling (a guard)."""
_RIPPLE_DIVISIONS = 10
"""So often it is divided where the gear ripples, as Newton's steps may leave it: exact to rounding (a
guard)."""


def curve_inverse(values: Array, curvature: Array) -> Array:
    """Registers in [-1, 1] at which r + curvature * r * (r**2 - 1) is `values`; beyond the ends, the end."""
    values = np.minimum(np.maximum(values, -1.0), 1.0)
    ends = np.linspace(-1.0, 1.0, _GRID + 1)[1:-1, None]
    part = (ends + curvature * ends * (ends**2 - 1) <= values[..., None, :]).sum(-2)
    register = (2 * part + 1) / _GRID - 1
    for _ in range(_NEWTON_STEPS):
        square = register * register
        error = register + curvature * register * (square - 1) - values
        register = register - error / (1 + curvature * (3 * square - 1))
        register = np.minimum(np.maximum(register, -1.0), 1.0)
    return register


class MotorMap(OfWorlds):
    """The motor maps of N worlds, one row each.

    Attributes:
        shape: (N, m).
        lowest, highest: Turns (N, m) at which each shaft stops.

    Args:
        rows: N.
        robot: The arm.
    """

    of_world: ClassVar[tuple[str, ...]] = (
        *("_rest", "_curvature", "_linear", "_cubic", "_of_angles", "_rate", "_phase", "_swing"),
        *("_coupling", "_shafts", "lowest", "highest"),
    )

    def __init__(self, rows: int, robot: Robot) -> None:
        self._robot = robot
        self._ends = (robot.stops + np.stack([robot.stop_margin, -robot.stop_margin], -1)).T
        motors = len(robot.motors)
        self.shape = rows, motors
        self._rest = np.zeros((rows, motors))
        self._linear = np.ones((rows, motors))
        self._cubic = np.zeros((rows, motors))
        self._curvature = np.zeros((rows, motors))
        self._rate, self._phase, self._swing = (np.zeros((rows, motors)) for _ in range(3))
        self._of_angles = np.stack([robot.rest(np.zeros(len(robot.joints)))] * rows)
        self._coupling, self._shafts = np.zeros((rows, motors)), np.tile(np.eye(motors), (rows, 1, 1))
        self._ripples = self._couples = False
        self.lowest = np.full((rows, motors), -1.0)
        self.highest = np.full((rows, motors), 1.0)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the motors of `world`."""
        robot, motors = self._robot, len(self._robot.motors)
        scale = world.motor_sign * world.motor_gain * robot.span
        rest = robot.home + world.joint_zeros[:motors]
        self._rest[row] = np.minimum(np.maximum(rest, self._ends[0]), self._ends[1])
        self._curvature[row] = world.motor_curvature
        self._linear[row] = scale * (1 - world.motor_curvature)
        self._cubic[row] = scale * world.motor_curvature
        self._of_angles[row] = robot.rest(world.joint_zeros)
        period, self._phase[row], depth = world.gear_ripple.T
        self._rate[row], self._swing[row] = 2 * np.pi / period, depth * period / (2 * np.pi)
        self._coupling[row] = world.motor_coupling
        self._shafts[row] = np.linalg.inv(self.registers_of(np.eye(motors), row).T)
        self.note_worlds()
        ends = self._inverse((self._ends - self._rest[row]) / scale, row)
        self.lowest[row], self.highest[row] = ends.min(0), ends.max(0)

    def note_worlds(self) -> None:
        """See `OfWorlds`."""
        self._ripples, self._couples = bool(self._swing.any()), bool(self._coupling.any())

    def positions(self, registers: Array, rows: Rows) -> Array:
        """Positions of the motors' joints (n, m), in rad or m, at `registers` (n, m) of the given rows."""
        return self.driven(self._turns(registers, rows), rows)

    def driven(self, shafts: Array, rows: Rows) -> Array:
        """Positions of the motors' joints (n, m) where their shafts have turned so far (n, m)."""
        return np.asarray(self._rest[rows] + self._travel(shafts, rows))

    def within_stops(self, goal: Array, rows: Rows) -> Array:
        """Registers (n, m) that stops allow, where motors were sent to `goal` (n, m)."""
        lowest, highest = self.lowest[rows], self.highest[rows]
        shafts = self._turns(goal, rows)
        stopped = np.minimum(np.maximum(shafts, lowest), highest)
        if not self._couples:
            return stopped
        free_rows = np.asarray((stopped == shafts).all(-1, keepdims=True))
        if free_rows.all():
            return goal
        coupling = self._coupling[rows]
        for _ in range(_SETTLING):
            free = (goal - coupling * np.roll(stopped, -1, -1)) / (1 - np.abs(coupling))
            stopped = np.minimum(np.maximum(free, lowest), highest)
        return np.where(free_rows | (stopped == free), goal, self.registers_of(stopped, rows))

    def _turns(self, registers: Array, rows: Rows) -> Array:
        """How far the shafts have turned (n, m) at `registers` (n, m)."""
        if not self._couples:
            return registers
        return np.asarray((self._shafts[rows] * registers[:, None, :]).sum(-1))

    def registers_of(self, shafts: Array, rows: Rows | int) -> Array:
        """Registers (n, m) where shafts have turned so far (n, m)."""
        coupling = self._coupling[rows]
        return np.asarray((1 - np.abs(coupling)) * shafts + coupling * np.roll(shafts, -1, -1))

    def _travel(self, shafts: Array, rows: Rows | int) -> Array:
        """How far the joints (n, m) have come from home."""
        linear, cubic = self._linear[rows], self._cubic[rows]
        if not self._ripples:
            return np.asarray(shafts * (linear + cubic * (shafts * shafts)))
        swing, phase = self._swing[rows], self._phase[rows]
        turned = shafts + swing * (np.sin(self._rate[rows] * shafts + phase) - np.sin(phase))
        bent = np.where(swing > 0, np.clip(turned, -1.0, 1.0), turned)
        return np.asarray(bent * (linear + cubic * (bent * bent)) + (turned - bent) * (linear + 3 * cubic))

    def angles(self, positions: Array, rows: Rows) -> Array:
        """Positions of all joints (n, ..., j) where the motors' are at `positions` (n, ..., m)."""
        rest = self._of_angles[rows]
        return self._robot.angles(positions, rest if positions.ndim == 2 else rest[:, None])

    def joints(self, registers: Array, rows: Rows) -> Array:
        """Positions of all joints (n, j) at `registers` (n, m) of the given rows."""
        return self.angles(self.positions(registers, rows), rows)

    def registers(self, positions: Array, row: int) -> Array:
        """Registers (m,) at which the motors' joints of a row are at `positions` (m,)."""
        return self.registers_of(self.shafts(positions, row), row)

    def shafts(self, positions: Array, row: int) -> Array:
        """How far the shafts of a row have turned (m,) where the motors' joints are at `positions` (m,)."""
        return self._inverse((positions - self._rest[row]) / (self._linear[row] + self._cubic[row]), row)

    def _inverse(self, values: Array, row: int) -> Array:
        """Turns (..., m) of shafts at which joints of a row have come so many spans (..., m) from home."""
        found = curve_inverse(values, self._curvature[row])
        if not self._swing[row].any():
            return found
        low, width, scale = np.full_like(found, -1.0), 2.0, self._linear[row] + self._cubic[row]
        shares = (np.arange(1, _GRID) / _GRID).reshape(-1, *[1] * found.ndim)
        for _ in range(_RIPPLE_DIVISIONS):
            below = self._travel(low + width * shares, row) / scale <= values
            low, width = low + width / _GRID * below.sum(0), width / _GRID
        return np.where(self._swing[row] > 0, low + width / 2, found)

    def reaches(self, positions: Array, register: float, rows: Rows) -> Flags:
        """Which positions (n, m) shafts reach (n,) that turn at most so far; registers are then no larger."""
        travel = positions - self._rest[rows]
        ends = np.full_like(travel, register)
        there, back = self._travel(ends, rows), self._travel(-ends, rows)
        furthest = np.where(travel * there > 0, there, back)  # a gear that ripples goes farther one way
        return np.all(np.abs(travel) <= np.abs(furthest), axis=-1)


class Registers(OfWorlds):
    """The registers of N arms, one row each, and those at which their joints stand.

    A motor executes a word up to its longest motion, less its shortfall. Its register counts that, up to the
    stops, and is told with noise and in steps. Words within the dead zone leave the joint where it is: from
    there it goes on with the next larger word, and home is home.

    Attributes:
        executed: Sums (N, m) of what was executed since home, in [-1, 1].
        joints: Registers (N, m) at which the joints stand, likewise.
        bound: Registers are told within +- this.

    Args:
        motors: The motor maps of the N worlds.
        bound: See above.
    """

    state_names: ClassVar[tuple[str, ...]] = ("joints",)  # what was executed is state of the arms
    of_world: ClassVar[tuple[str, ...]] = ("_longest", "_gain", "_factor", "_dead_zone", "_noise", "_step")

    def __init__(self, motors: MotorMap, bound: float) -> None:
        self._motors, self.bound = motors, bound
        shape = motors.shape
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
        self.note_worlds()

    def note_worlds(self) -> None:
        """See `OfWorlds`."""
        ones, zeros = (self._longest, self._factor, self._gain), (self._dead_zone, self._noise, self._step)
        self._exact = all((each == 1).all() for each in ones) and not any(each.any() for each in zeros)

    def check_fits(self, world: World) -> None:
        """Raises where registers of a world go beyond the bound.

        Raises:
            ValueError: They do; says how far.
        """
        if world.register_bound > self.bound:
            raise ValueError(
                f"World.word_gain is {world.word_gain.tolist()}: registers would go to "
                f"+-{world.register_bound:g}; this environment observes them within +-{self.bound:g}, as in "
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
        exact = self._exact and not np.count_nonzero(self.joints != self.executed)  # faster than any
        before, sent = self.executed[rows], words
        if not exact:
            longest = self._longest[rows]
            sent = np.minimum(np.maximum(words, -longest), longest) * self._factor[rows]
        after = joints = self._motors.within_stops(before + sent, rows)
        if not exact:
            stood = self.joints[rows]
            along = np.where(stood == before, after, stood + (after - before))
            joints = np.where(np.abs(words) <= self._dead_zone[rows], stood, along)
            joints = self._motors.within_stops(joints, rows)
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
        told = np.minimum(np.maximum(told, -self.bound), self.bound)
        if (stepped := self._step > 0).any():
            step = np.where(stepped, self._step, 1.0)
            most = np.floor(self.bound / step)
            told = np.where(stepped, step * np.clip(np.rint(told / step), -most, most) + 0.0, told)
        return told


class MotorErrors(OfWorlds):
    """The errors of the motors of N worlds, one row each.

    Backlash is a play: the joint stays where it is until the motor has gone through the gap, and then lags
    behind by half of it. Repeatability is noise that every motion of a motor, the way home included, draws
    anew; a motor that does not move stays where it is.

    Args:
        rows: N.
        motors: m.
    """

    state_names: ClassVar[tuple[str, ...]] = ("_sent", "_joint", "_noise")
    of_world: ClassVar[tuple[str, ...]] = ("_half_gap", "_deviation")

    def __init__(self, rows: int, motors: int) -> None:
        self._half_gap = np.zeros((rows, motors))
        self._deviation = np.zeros((rows, motors))
        self._sent, self._joint, self._noise = (np.zeros((rows, motors)) for _ in range(3))
        self._numbers = MotionNumbers(rows, "repeatability", (motors,), normal=True)
        self._before = self._joint, self._noise
        self._errs = False

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._numbers.seed(row, seed)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the errors of `world`."""
        self._half_gap[row], self._deviation[row] = world.backlash / 2, world.repeatability
        self.note_worlds()

    def note_worlds(self) -> None:
        """See `OfWorlds`."""
        self._errs = bool(self._half_gap.any() or self._deviation.any())

    @property
    def _exact(self) -> bool:
        """Whether all joints go where they are sent, and stand there."""
        return not (
            self._errs or np.count_nonzero(self._noise) or np.count_nonzero(self._joint != self._sent)
        )

    def stopped(self, row: int, positions: Array, share: float) -> None:
        """The motors of `row` came no farther in the last motion than this share of their way.

        Args:
            row: The row.
            positions: Where they would have been sent (m,) to stand there.
            share: Of the way.
        """
        exact = self._exact
        self._sent[row] = positions
        if exact:
            self._joint[row] = positions
            return
        for part, before in zip((self._joint, self._noise), self._before, strict=True):
            part[row] = before[row] + share * (part[row] - before[row])

    def at_home(
        self, rows: Rows, positions: Array, trials: NDArray[np.int64], motions: NDArray[np.int64]
    ) -> Array:
        """Where joints (n, m) stand that were sent home to `positions` (n, m): in the middle of the gap.

        Args:
            rows: Which rows.
            positions: Of their motors' joints at home.
            trials: The trial of all rows (N,).
            motions: Their motion of the trial (N,).
        """
        self._sent[rows] = self._joint[rows] = positions
        if self._exact:
            return positions
        self._noise[rows] = (self._deviation * self._numbers.at(trials, motions))[rows]
        return np.asarray(positions + self._noise[rows])

    def after_a_motion(
        self, rows: Rows, positions: Array, trials: NDArray[np.int64], motions: NDArray[np.int64]
    ) -> Array:
        """Where joints (n, m) come to rest whose motors were sent to `positions` (n, m).

        Args:
            rows: Which rows.
            positions: Where their motors were sent.
            trials: The trial of all rows (N,).
            motions: Their motion of the trial (N,).
        """
        if self._exact:
            self._sent[rows] = self._joint[rows] = positions
            return positions
        self._before = self._joint.copy(), self._noise.copy()
        half_gap, moved = self._half_gap[rows], positions != self._sent[rows]
        self._sent[rows] = positions
        self._joint[rows] = np.clip(self._joint[rows], positions - half_gap, positions + half_gap)
        drawn = (self._deviation * self._numbers.at(trials, motions))[rows]
        self._noise[rows] = np.where(moved, drawn, self._noise[rows])
        return np.asarray(self._joint[rows] + self._noise[rows])
