"""A robot of your own, two cameras, and no calibration: write three functions, and agents reach.

Run as it is, the simulator stands in for the robot: it goes to registers and gives pictures, no more.
"""

import argparse
import math
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from threading import Thread
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from calfree_gym.errors import check_positive, check_whole
from calfree_gym.image import CAMERAS
from calfree_gym.picture_reach import Array, PairTracker, PictureReach, numbers
from calfree_gym.vision import Marks

BEYOND = 0.1
"""How far noise may take registers beyond -1 and 1, at most (choice)."""
ENOUGH = 20
"""Motions of a motor before anything is said of its registers (choice)."""
FINEST_STEP = 1e-4
"""Steps of registers that are found (choice): a motor with 16 bits a turn."""
UNSURE = 0.005
"""The largest standard error of a shortfall that is told (choice)."""


class LostCameraError(RuntimeError):
    """A camera gives no picture. Nothing moves until both do."""


class RegisterErrors(NamedTuple):
    """How a robot tells registers, one number a motor (m,), in units of registers.

    All are nan of a motor that has not been asked to move in `ENOUGH` motions.

    Attributes:
        noise: Standard deviation of where a motor says it stands after a motion.
        step: Registers are told in such steps; 0 where none as large as `FINEST_STEP` were found.
        shortfall: Share of a motion that is not executed; nan where motions were too small to be sure.
    """

    noise: Array
    step: Array
    shortfall: Array


class OwnRobot(PictureReach):
    """Reaching, as agents know it: control words in, image points and registers out.

    `go_to` and `take_pictures` are called in one thread, which is not the main one; `place_object` is called
    by `reset`. Where a function gives what is not allowed, fails or hangs, or a mark is lost, an error says
    so before anything moves any further.

    Args:
        motors: How many.
        go_to: Sends the motors to registers (m,), waits until the arm stands still, and tells these
            registers; of a motor that stopped well short of them, where it stands. Make that its goal, too,
            or it pushes on against what stopped it. Sag and play are no stop: where motors tell every degree
            that they sag, words seem not to be executed, and the arm sinks.
            Registers are what a motor is set to, in units of your own: 0 at home, within -1 to 1. Nobody
            needs to know what they mean.
        take_pictures: What both cameras see now: two RGB images (h, w, 3), uint8. OpenCV's are BGR: turn
            their last axis round, `frame[..., ::-1]`. Of a camera that gives none, None.
        place_object: Has the next object placed, where both cameras see it; called before each trial, and
            waited for as long as it takes.
        marks: What gripper and object are seen by: the colours of your balls, which `python -m
            calfree_gym.vision pick` learns from a picture (`Marks`, or their file); or a tracker, such as
            `TagTracker()` for printed tags.
        tolerance_px: Image distance of the rendezvous, where the longer side of an image is 512 px. Less
            than the 4 px of `CalFree/Reach-v0`: some 2 mm, where cameras see an arm of 40 cm whole.
        most_motions: A trial is cut off after so many.
        greatest_motion: No register is asked to change by more at once; words are clipped, and the way home
            is divided. Begin with a small one, such as 0.05.
        patience: Seconds in which `go_to` and `take_pictures` must end.
    """

    def __init__(
        self,
        motors: int,
        go_to: Callable[[Array], Array],
        take_pictures: Callable[[], tuple[Array, Array]],
        place_object: Callable[[], None],
        marks: Marks | str | PairTracker | None = None,
        tolerance_px: float = 3.0,
        most_motions: int = 60,
        greatest_motion: float = 1.0,
        patience: float = 30.0,
    ) -> None:
        check_positive("greatest_motion", greatest_motion, 1)
        check_positive("patience", patience, 1e6)
        check_whole("motors", motors, 1, 100)
        check_whole("most_motions", most_motions, 1, 10**6)
        super().__init__(motors, marks, tolerance_px, most_motions)
        self._go_to, self._take_pictures, self._place_object = go_to, take_pictures, place_object
        self._greatest_motion, self._patience = greatest_motion, patience
        self._told: list[tuple[Array, Array, Array]] = []
        self._known = True
        self._calls: SimpleQueue[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = SimpleQueue()
        self._hangs = ""
        Thread(target=self._work, daemon=True).start()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Goes home, where registers are about 0, and begins the next trial.

        The first time nobody knows where the robot stands: bring it home before.

        Raises:
            RuntimeError: It does not come home.
        """
        super().reset(seed=seed)
        self._begun = False
        self._pictures()
        if not self._known:
            self._go_by(np.zeros_like(self.registers))
        off = np.abs(self.registers)
        for _ in range(max(1, math.ceil(off.max() / self._greatest_motion))):
            self._go_by(-self.registers)
        if (np.abs(self.registers) > np.maximum(off / 2, BEYOND)).any():
            raise RuntimeError(f"the robot does not come home: its registers are {self.registers}")
        self._place_object()
        return self._first_look()

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """One motion: control words (m,) are added to the registers.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun, or there was an error since.
            ValueError: The words are no numbers (m,), or a function gave what is not allowed.
            LostCameraError: A camera gives no picture.
            LostMarkError: For three motions a mark was not seen, and now not where it was seen before.
            TimeoutError: A function hangs.
        """
        return super().step(action)

    def _move(self, words: Array) -> None:
        asked, before = self._go_by(words)
        self._told.append((asked - before, self.registers - asked, self.registers))

    @property
    def register_errors(self) -> RegisterErrors | None:
        """How the robot tells its registers, by the motions of all trials; None before there are any."""
        return None if not self._told else _register_errors(*np.swapaxes(self._told, 0, 1))

    def _go_by(self, words: Array) -> tuple[Array, Array]:
        """Changes registers by (clipped) words; those that were asked for, and those before."""
        before, most = self.registers, self._greatest_motion
        asked = np.clip(before + np.clip(words, -most, most), -1, 1)
        self.registers, self._known = asked, False  # where go_to fails, the robot is at these or on its way
        told = self._call(self._go_to, asked.copy(), patience=self._patience)
        self.registers, self._known = numbers("go_to told", told, len(before), 1 + BEYOND), True
        wanted, executed = asked - before, self.registers - before
        self._moved = bool((2 * executed * wanted > wanted**2).any())  # more than half of a word
        return asked, before

    def _pictures(self) -> list[Array]:
        try:
            found = self._call(self._take_pictures, patience=self._patience)
        except Exception as error:
            if self._hangs:
                raise
            raise LostCameraError(f"take_pictures failed: {error!r}") from error
        allowed = "allowed: two RGB images, arrays (h, w, 3) of uint8"
        pictures: list[Any] = [None] * 2 if found is None else list(found) if np.iterable(found) else [found]
        if len(pictures) != 2:
            raise ValueError(f"take_pictures gave {found!r:.200}; {allowed}")
        for camera, picture in zip(CAMERAS, pictures, strict=True):
            if picture is None:
                raise LostCameraError(f"take_pictures gave None as the {camera} picture; {allowed}")
            shape, kind = np.shape(picture), getattr(picture, "dtype", type(picture).__name__)
            if kind != np.uint8 or len(shape) != 3 or shape[2] != 3:
                raise ValueError(f"take_pictures gave a {camera} picture {shape} of {kind}; {allowed}")
        return pictures

    def _call(self, function: Callable[..., Any], *arguments: Any, patience: float) -> Any:
        if self._hangs:
            raise TimeoutError(f"{self._hangs} still hangs: mend it, and make the environment anew")
        result: Future[Any] = Future()
        self._calls.put((result, function, arguments))
        try:
            return result.result(patience)
        except TimeoutError:
            if result.done():  # it has ended meanwhile, or raised it
                return result.result()
            self._hangs = getattr(function, "__name__", repr(function))
            raise TimeoutError(f"{self._hangs} has not ended after {patience:g} s (patience)") from None

    def _work(self) -> None:
        while True:
            result, function, arguments = self._calls.get()
            try:
                result.set_result(function(*arguments))
            except BaseException as error:
                result.set_exception(error)


def _register_errors(words: Array, missed: Array, told: Array) -> RegisterErrors:
    """By motions of `words` (n, m) that ended at registers `told` (n, m), by `missed` from where they should.

    Medians, so what meets a stop now and then changes little.
    """
    found = []
    for by, off, at in zip(words.T, missed.T, told.T, strict=True):
        by, off, at = (values[by != 0] for values in (by, off, at))
        if len(by) < ENOUGH:
            found.append((math.nan,) * 3)
            continue
        shortfall = _median(-off / by, np.abs(by))
        rest = np.abs(off + shortfall * by)
        noise = _spread(rest)
        for _ in range(3):
            noise = _spread(rest[rest <= 4 * noise])  # the others met a stop
        step = _step(at)
        rounded = noise > step / 20  # else the words were multiples themselves
        sure = 1.25 * noise <= UNSURE * math.sqrt(by @ by)  # the standard error of a median
        found.append((noise, step if rounded else 0.0, shortfall if sure else math.nan))
    return RegisterErrors(*np.array(found).T)


def _spread(rest: Array) -> float:
    """The standard deviation of normal numbers by their absolute values."""
    return 1.4826 * float(np.median(rest))


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(weights[order]), weights.sum() / 2)])


def _step(values: Array) -> float:
    """The largest number of which all differences of values are multiples, by Euclid's algorithm."""
    small, step = FINEST_STEP / 20, 0.0
    for gap in np.diff(np.unique(values)):
        while gap > small:
            step, gap = gap, abs(step - gap * round(step / gap))
    return step if step >= FINEST_STEP else 0.0


class StandIn:
    """The simulator in place of a robot and its cameras.

    Args:
        seed: Of the world, and of the noise.
        register_noise: Standard deviation of the registers that it tells.
        register_step: It tells them in such steps; 0: exactly.
        shortfall: Share of each motion that it leaves out.
    """

    def __init__(
        self, seed: int, register_noise: float = 0.0, register_step: float = 0.0, shortfall: float = 0.0
    ) -> None:
        self._env: Any = gym.make(
            "calfree_gym:CalFree/Reach-v0",
            observation="rgb",
            image_size=512,
            camera_mount="stand",
            dynamics="kinematic",
            terminate_on_success=False,
            max_episode_steps=10**6,
            disable_env_checker=True,
        )
        self._env.reset(seed=seed)
        self._look, _ = self._env.reset()
        self._rng = np.random.default_rng(seed)
        self._noise, self._step, self._executed = register_noise, register_step, 1 - shortfall

    def place_object(self) -> None:
        """Puts the next object somewhere."""
        self._look, _ = self._env.reset()

    def go_to(self, registers: Array) -> Array:
        """Goes there, by motions of one word at most, and tells where the motors stand."""
        way = self._executed * (registers - self._look["observation"])
        for words in (way / 2, way / 2):  # from one end to the other
            self._look, *_ = self._env.step(words.astype(np.float32))
        told = self._look["observation"] + self._noise * self._rng.normal(size=len(registers))
        return np.asarray(np.round(told / self._step) * self._step if self._step else told, float)

    def take_pictures(self) -> tuple[Array, Array]:
        """Of both cameras."""
        return self._look["left_image"], self._look["right_image"]


def main() -> None:
    """Lets an agent reach for objects, learning on, and tells in how many motions."""
    try:
        import calfree_agents as agents
    except ModuleNotFoundError:  # its name in the repository
        import agents

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--agent", default="memory")
    parser.add_argument("--motions", type=int, default=60, help="in all")
    parser.add_argument("--seed", type=int, default=0, help="of the world, which nobody knows")
    parser.add_argument("--greatest-motion", type=float, default=1.0, help="in registers")
    for name in ("register-noise", "register-step", "shortfall"):
        parser.add_argument(f"--{name}", type=float, default=0.0, help="of the robot that is simulated")
    parser.add_argument("--registers", action="store_true", help="tell how the robot tells its registers")
    given = parser.parse_args()
    robot = StandIn(given.seed, given.register_noise, given.register_step, given.shortfall)
    functions = robot.go_to, robot.take_pictures, robot.place_object
    env = OwnRobot(3, *functions, greatest_motion=given.greatest_motion)
    watched = gym.wrappers.RecordEpisodeStatistics(env)
    agents.make(given.agent, watched).learn(given.motions)
    print("motions of each reach:", *watched.length_queue)
    if given.registers:
        print("registers:", env.register_errors)


if __name__ == "__main__":
    main()
