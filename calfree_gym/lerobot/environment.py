"""A real arm that LeRobot drives, and two of its cameras, as the Gymnasium environment that agents know."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from calfree_gym.errors import check_positive, check_whole
from calfree_gym.lerobot import knowledge
from calfree_gym.lerobot.faults import ArmError, saved
from calfree_gym.lerobot.frames import Frames
from calfree_gym.lerobot.mixed_cameras import MixedCameras
from calfree_gym.lerobot.motors import AHEAD, FASTEST, Motors, Tick
from calfree_gym.lerobot.robot import (
    LeRobot,
    check_limits,
    check_most_ahead,
    checked_cameras,
    checked_motors,
    read_encoders,
)
from calfree_gym.lerobot.torque import Torque
from calfree_gym.picture_reach import (
    PATIENCE,
    Array,
    PairTracker,
    PictureLook,
    PictureReach,
    Pictures,
    numbers,
)
from calfree_gym.vision import Marks

SLOWLY = 0.25
"""Share of the speed with which the arm goes to a home where it does not stand. Choice: nobody knows what is
on the way."""


@dataclass(frozen=True)
class ReachRecord:
    """One reach, as it has ended.

    Attributes:
        reached: Whether the rendezvous was seen.
        motions: How many it took.
        px: The image distance at its end, in the worse camera, where the longer side of an image is 512 px.
        seconds: That it took, the object placed.
        stopped: Motors that stayed back in it: they have met something, or their stops.
        before: What was seen from home.
        after: What was seen at its end.
    """

    reached: bool
    motions: int
    px: float
    seconds: float
    stopped: tuple[str, ...]
    before: PictureLook
    after: PictureLook


class LeRobotReachEnv(PictureReach):
    """Reaching with any robot of LeRobot's that is told positions, as in `CalFree/Reach-v0`.

    Nothing is calibrated, neither the arm nor its cameras. One step streams goals at limited speed, waits
    until the arm has settled, and looks at pictures that are newer than that. **There is no limit of forces,
    and no check for collisions.** Keep the switch of the motors' power in your hand.

    Registers are what motors were told, for motors sag and have play: 1 is `unit` degrees from home. A motor
    that stayed back far more than it usually does has met something, or a stop; its goal is where it stands
    then, and its register says so.

    Where something goes wrong, the arm holds: motors keep their torque and their last goals, also when this
    process ends, however it ends. `release` takes the torque away.

    - A frame that is dropped or repeated is waited for.
    - A mark that is not seen, a picture of the other camera, a motor that stays back: the agent sees it and
      goes back. After three motions `ArmError`, with both pictures saved; for a mark, once it is not seen
      where it was seen before: the arm may hide it elsewhere.
    - A camera that is gone or frozen, a bus that does not answer, overload, a motor that sinks: `ArmError` at
      once. Ctrl-C and any other exception come through; the arm holds, too.

    After an error `reset` begins anew.

    Attributes:
        home: Where motors stand at registers zero (m,), in degrees.
        over: Whether the last motion has ended the reach.

    Args:
        robot: Has the interface of `lerobot.robots.Robot`; connected if it is not yet.
        cameras: Names of two of its cameras, left and right.
        marks: What gripper and object are seen by: `Marks`, a YAML file of them, or a tracker.
        motors: Names of those that move; by default all but the gripper's.
        home: Where each motor stands at home, in degrees as LeRobot has them, or a file that `save` wrote; by
            default where it stands now. The arm goes to another one slowly, and so it goes home after an
            error.
        unit: Degrees of one register: so far from home motors go, either way.
        speed: Degrees a second, at most; a motor that was stuck may snap by up to 8 degrees.
        tolerance_px: Image distance of the rendezvous, where the longer side of an image is 512 px. Less
            than the 4 px of `CalFree/Reach-v0`: some 2 mm, where cameras see an arm of 40 cm whole.
        max_motions: A reach is cut off after so many.
        place_object: Has the next object placed, the arm at home; by default it asks, and waits for Enter.
        on_tick: Called 20 times a second with what was observed, and the action that was sent upon it.

    Raises:
        ConnectionError: LeRobot finds no robot, at this port.
        ValueError: An argument is not allowed, the robot has no such motor or camera or cannot be driven, or
            a motor cannot go so far from home. Nothing has moved.
    """

    def __init__(
        self,
        robot: LeRobot,
        cameras: Sequence[str],
        marks: Marks | str | Path | PairTracker | None = None,
        motors: Sequence[str] | None = None,
        home: Mapping[str, float] | str | Path | None = None,
        unit: float = 45.0,
        speed: float = 60.0,
        tolerance_px: float = 3.0,
        max_motions: int = 40,
        place_object: Callable[[], Any] | None = None,
        on_tick: Tick | None = None,
    ) -> None:
        check_positive("unit", unit, 180)
        check_positive("speed", speed, FASTEST)
        check_whole("max_motions", max_motions, 1, 10**6)
        names, shown = checked_motors(robot, motors), checked_cameras(robot, cameras)
        check_most_ahead(robot, AHEAD)
        sizes = np.array([robot.observation_features[camera][1::-1] for camera in shown], float)
        super().__init__(len(names), marks, tolerance_px, max_motions, sizes / sizes.max(1, keepdims=True))
        self.unit, self._speed = float(unit), float(speed)
        self._place_object = place_object or (lambda: input("Place the object, then press Enter: "))
        self._robot, self._torque = robot, Torque(robot)
        self._connects = not robot.is_connected
        if self._connects:
            robot.connect(calibrate=False)
        self._encoders = read_encoders(robot, names)
        self._frames, self._mixed = Frames(shown), MixedCameras()
        self._motors = Motors(robot, names, self._frames.note, on_tick)
        if isinstance(home, str | Path):
            self._set_home(self._known(None, home)[1])
        else:
            self._set_home(self._motors.here if home is None else _home(home, names))
        self._marks = self._marks_in(shown)
        self._own: dict[str, Array] = {}
        self._others: tuple[bool, ...] = ()
        self._back: list[str] = []
        self._stopped: dict[str, None] = {}
        self.over = False
        self._learned: WeakKeyDictionary[Any, int] = WeakKeyDictionary()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Goes home, has the object placed, and looks; where a mark is not seen, has it placed anew.

        Raises:
            ArmError: The arm cannot go on; or a mark is not seen wherever the object was placed, three times.
        """
        super().reset(seed=seed)
        self._stopped, self.over = {}, False
        if not self._begun:
            self._mixed = MixedCameras()
        with self._holding():
            self._go_home()
            for _ in range(PATIENCE):
                self._place_object()
                self._go_home()  # motors may have been without power meanwhile
                for _ in range(PATIENCE):
                    first = self._first_look()
                    if not (wrong := "; ".join(self._wrong().values())):
                        self._first, self._began = self._now, self._motors.clock()
                        return first
                warnings.warn(f"{wrong}: place the object anew", stacklevel=2)
            raise self._error(wrong)

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """See `PictureReach`.

        Raises:
            ArmError: The arm cannot go on, and holds.
        """
        with self._holding():
            step = super().step(action)
        self.over = step[2] or step[3]
        return step

    def reaches(self, agent: Any, count: int) -> Iterator[ReachRecord]:
        """Lets an agent of this environment reach so many times, learning; yields one record a reach.

        Raises:
            ArmError: The arm cannot go on, and holds.
            ValueError: What the agent has learned is of another home, or of an unknown one.
        """
        for _ in range(count):
            if agent.num_timesteps != self._learned.get(agent, 0):
                raise ValueError(
                    f"the agent has learned in {agent.num_timesteps} motions from a home that is not known "
                    "here; load it by the environment's `load`, from a file that its `save` has written"
                )
            try:
                agent.learn(self._max_motions, lambda _: not self.over)
            finally:
                self._learned[agent] = agent.num_timesteps
            look, seconds = self._now, self._motors.clock() - self._began
            reached = bool(look.visible.all() and look.px <= self._tolerance_px)
            yield ReachRecord(
                reached, self.motions, look.px, seconds, tuple(self._stopped), self._first, look
            )

    def save(self, agent: Any, path: str | Path) -> None:
        """Writes what an agent knows, and where home is, by encoders: whatever is calibrated meanwhile.

        Raises:
            OSError: The file cannot be written.
        """
        home = dict(zip(self._motors.names, self.home.tolist(), strict=True))
        knowledge.save(path, agent, home, self._motors.others, self._encoders, self.unit)

    def load(self, agent: Any, path: str | Path) -> None:
        """Reads what `save` wrote into an agent, and takes its home: the next `reset` goes there, slowly.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: It is none of those, or of another agent, other motors or another unit; or a motor
                cannot go so far from that home.
        """
        known, home = self._known(agent, path)
        agent.load(known)
        self._set_home(home)
        self._begun = False
        self._learned[agent] = agent.num_timesteps

    @property
    def doing(self) -> str:
        """What happens now: "standing", "streaming", "settling" or "looking"."""
        return self._motors.doing

    def close(self) -> None:
        """Ends, and leaves the arm where it is: its motors keep their torque."""
        super().close()
        if self._connects and self._robot.is_connected:
            self._robot.disconnect()

    def release(self, confirm: Callable[[str], Any] = input) -> None:
        """Takes the torque from all motors and disconnects the robot, once somebody supports the arm.

        Args:
            confirm: Asks her, and waits; where it raises, the arm goes on to hold.

        Raises:
            ArmError: The robot is not connected; call this before `close`.
        """
        self._torque.release(confirm)

    def _known(self, agent: Any, path: str | Path) -> tuple[knowledge.SavedKnowledge, Array]:
        """What an agent saved, and home (m,), which is allowed."""
        motors = self._motors
        known, home = knowledge.load(path, agent, motors.names, motors.others, self._encoders, self.unit)
        try:
            check_limits(self._encoders, motors.names, home, motors.here, self.unit)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error
        return known, home

    def _set_home(self, home: Array) -> None:
        check_limits(self._encoders, self._motors.names, home, self._motors.here, self.unit)
        self.home, self._new_home = home, True

    def _go_home(self) -> None:
        self._new_home |= self._motors.take_over()
        speed = self._speed * (SLOWLY if self._new_home else 1.0)
        for _ in range(PATIENCE):
            if not self._go_to(np.zeros_like(self.registers), speed) and not self.registers.any():
                self._new_home = False
                return
        off = self._back or [name for name, at in zip(self._motors.names, self.registers, strict=True) if at]
        raise self._error(f"on the way home motor {', '.join(off)} stays back: free it, or let it bear less")

    def _move(self, words: Array) -> None:
        self._moved = bool(words.any())
        self._go_to(np.clip(self.registers + words, -1, 1), self._speed)

    def _go_to(self, registers: Array, speed: float) -> bool:
        """Whether a motor stayed back on the way to registers (m,)."""
        back = self._motors.go_to(self.home + self.unit * registers, speed)
        self.registers = (self._motors.goal - self.home) / self.unit
        self._back = [name for name, stays in zip(self._motors.names, back, strict=True) if stays]
        self._stopped |= dict.fromkeys(self._back)
        return bool(self._back)

    def _pictures(self) -> Pictures:
        self._motors.doing = "looking"
        self._frames.settle(self._motors.clock())
        while (pictures := self._frames.newer(self._motors.clock())) is None:
            self._motors.tick(self._motors.goal)
        return pictures

    def _seen(self) -> PictureLook:
        """Looks. Where a picture is of the other camera, nothing is seen in it."""
        pictures = self._pictures()
        self._others = self._mixed(self._frames.pictures)
        for name, picture, other in zip(self._frames.cameras, pictures, self._others, strict=True):
            if not other:
                self._own[name] = picture
        left, right = self._own.values()
        points, visible = self._tracker(left, right)
        self._now = PictureLook(pictures, points, visible & ~np.tile(self._others, 2))
        return self._now

    def _wrong(self) -> dict[str, str]:
        others = {
            name: f"camera {name} shows what the other one has shown: have they changed places?"
            for name, other in zip(self._frames.cameras, self._others, strict=True)
            if other
        }
        return (others or super()._wrong()) | {name: f"motor {name} stays back" for name in self._back}

    def _error(self, what: str) -> ArmError:
        return ArmError(what, saved(self._frames.pictures))

    @contextmanager
    def _holding(self) -> Iterator[None]:
        """Whatever is raised inside, the arm holds."""
        try:
            yield
        except BaseException as error:
            self._begun, self._new_home = False, True
            self._motors.hold()
            if not isinstance(error, ArmError):
                error.add_note("The arm holds: its motors keep their torque.")
            raise


def _home(home: Mapping[str, float], names: Sequence[str]) -> Array:
    """Home (m,) of these motors.

    Raises:
        ValueError: It is no number of each.
    """
    if not isinstance(home, Mapping) or set(home) != set(names):
        raise ValueError(f"home is {home!r}; it must map each of {', '.join(names)} to degrees")
    return numbers("home holds", [home[name] for name in names], len(names))
