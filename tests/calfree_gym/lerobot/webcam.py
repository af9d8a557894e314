"""A cheap webcam on the bench's virtual clock: late, with dropped and repeated frames."""

from dataclasses import dataclass, field
from functools import cache, lru_cache

import cv2
import mujoco
import numpy as np

from calfree_gym.rendering.renderer import Renderer, View
from tests.calfree_gym.lerobot.so101 import BALLS, model

WIDTH, HEIGHT, RATE = 640, 480, 30.0
LOST = 0.05
"""Share of frames that are dropped or repeated."""
BLUR_PX, NOISE, JPEG = 0.8, 3.0, 70
EXPOSURE, WHITE = 0.15, 0.03
"""How far gain and the colours' balance wander, as shares."""
MARGIN = 64


@dataclass
class State:
    """What a camera sees at one moment."""

    time: float
    speed: float
    qpos: np.ndarray
    mocap: np.ndarray
    hidden: frozenset


class Frame:
    """A picture that is drawn where somebody looks at it, for drawing takes longer than all else."""

    shape, dtype = (HEIGHT, WIDTH, 3), np.dtype(np.uint8)

    def __init__(self, draw):
        self._draw, self._picture = draw, None

    def __array__(self, dtype=None, copy=None):
        if self._picture is None:
            self._picture = self._draw()
        return self._picture


@dataclass
class Webcam:
    """One camera: what it shows at a time, as LeRobot's `read_latest` has it.

    Attributes:
        name: Of the camera in the model.
        seed: Of its noise, which frames are lost, and how light wanders.
        delay, phase: Of its pipeline and of its first exposure, in s.
        k1: Of its lens.
        states: What was to be seen at the latest exposures, by the frame's number.
        looked: When frames that somebody looked at were exposed, and how fast the arm was then.
    """

    name: str
    seed: list
    delay: float
    phase: float
    k1: float
    states: dict = field(default_factory=dict)
    looked: list = field(default_factory=list)

    def __post_init__(self):
        self.unplugged = self.frozen = self.copies = False
        self.losing = 0
        self._frame = self._number = None
        self._waves, self._grain = sensor(*self.seed)

    def expose(self, time, state):
        """Keeps what is to be seen where a frame is exposed between the last time and this one."""
        number = int((time - self.phase) * RATE)
        if number not in self.states:
            self.states[number] = state()
            self.states.pop(number - 24, None)

    def latest(self, time, other, scene):
        """The frame that has come last.

        Args:
            time: Of the clock.
            other: A camera whose pictures are shown in place of its own, or None.
            scene: Draws.
        """
        if self.unplugged:
            raise TimeoutError(
                f"OpenCVCamera({self.name}) latest frame is too old: 512.3 ms (max allowed: 500 ms)."
            )
        if self.frozen:
            return self._copy() if self.copies else self._frame
        number = int((time - self.delay - self.phase) * RATE)
        shown = number
        if self.losing:
            self.losing -= number != self._number
            shown = self._number if self._number is not None else number
        while self._lost(shown) == "dropped":
            shown -= 1
        if self._frame is None or shown != self._number:
            self._number = shown
            exposed = shown - (self._lost(shown) == "repeated")
            self._frame = Frame(lambda: (other or self).draw(exposed, scene, self))
        return self._frame

    def _copy(self):
        picture = self._frame
        return Frame(lambda: np.array(picture))

    def _lost(self, number):
        draw = np.random.default_rng([*self.seed, number % 2**32]).random()
        return "dropped" if draw < LOST / 2 else "repeated" if draw < LOST else ""

    def draw(self, number, scene, of):
        """The picture that was exposed under a number, for a camera that shows it."""
        state = self.states[max(k for k in self.states if k <= max(number, min(self.states)))]
        of.looked.append((state.time, state.speed))
        light = scene.light(self.name, self.k1, state)
        rng = np.random.default_rng([*self.seed, 1, number % 2**32])
        waves = np.sin(self._waves[:, 0] + state.time / 1.1) + np.sin(self._waves[:, 1] + state.time / 0.27)
        gain = 1 + EXPOSURE / 2 * waves[0]
        y, x = rng.integers(0, MARGIN, 2)
        image = light * (gain * (1 + WHITE / 2 * waves[1:])).astype(np.float32)
        image += NOISE * self._grain[y : y + HEIGHT, x : x + WIDTH]
        bgr = np.clip(image, 0, 255).astype(np.uint8)[..., ::-1]
        _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG])
        return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])


class Scene:
    """Draws what cameras of a world see, through a lens, before sensors add their own.

    Args:
        world: Where the cameras are.
        tags: Whether the arm has tags in place of balls.
    """

    def __init__(self, world, tags=False):
        self._world, self._tags = world, tags
        self._maps = {}

    def light(self, camera, k1, state):
        """What reaches a camera's sensor (HEIGHT, WIDTH, 3), in grey levels."""
        drawing = renderer(self._tags)
        model, data = drawing.model, drawing.data
        self._world.put_into(model)
        data.qpos[:], data.mocap_pos[:] = state.qpos, state.mocap
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        for mark in BALLS:
            model.geom(mark).rgba[3] = mark not in state.hidden
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera(camera).id
        ((image, _),) = drawing.draw([View(view, WIDTH, HEIGHT)], (0,), shadows=False)
        focal = HEIGHT / 2 / np.tan(np.radians(model.camera(camera).fovy[0]) / 2)
        maps = self._lens(k1, focal)
        bent = cv2.remap(image[::-1], *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return cv2.GaussianBlur(bent, (0, 0), BLUR_PX).astype(np.float32)

    def _lens(self, k1, focal):
        """Where each pixel's light comes from, to first order."""
        if (k1, focal) not in self._maps:
            y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
            x, y = (x - WIDTH / 2) / focal, (y - HEIGHT / 2) / focal
            bend = 1 - k1 * (x * x + y * y)
            maps = (x * bend * focal + WIDTH / 2, y * bend * focal + HEIGHT / 2)
            self._maps[k1, focal] = tuple(each.astype(np.float32) for each in maps)
        return self._maps[k1, focal]


@lru_cache(4)
def sensor(*seed):
    """How light wanders (4, 2), and the noise of its pixels, of which each picture shows a part."""
    rng = np.random.default_rng(seed)
    waves, size = rng.uniform(0, 2 * np.pi, (4, 2)), (HEIGHT + MARGIN, WIDTH + MARGIN)
    return waves, (rng.normal(0, 1, (*size, 1)) + rng.normal(0, 0.5, (*size, 3))).astype(np.float32)


@cache
def renderer(tags):
    """One for all benches: what draws is not what moves."""
    drawn = model(tags)
    return Renderer(drawn, mujoco.MjData(drawn), WIDTH)
