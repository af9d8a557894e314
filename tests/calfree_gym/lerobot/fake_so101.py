"""A fake SO-101 with the interface of LeRobot's `Robot`, on a virtual clock: the same run is the same twice.

What is tested may use no more of it than of a real one; the rest is for tests: worlds, faults, the truth.
"""

from contextlib import suppress
from dataclasses import dataclass

import mujoco
import numpy as np

from tests.calfree_gym.lerobot import tags as printed
from tests.calfree_gym.lerobot.so101 import BALL, MOTORS, STEP, TICK, Plant
from tests.calfree_gym.lerobot.webcam import HEIGHT, WIDTH, Scene, State, Webcam
from tests.calfree_gym.lerobot.worlds import CAMERAS, SPREAD, World

LIMITS = (0, 4095)
GONE = "Failed to sync read 'Present_Position' on ids=[1, 2, 3, 4, 5, 6] after 3 tries. "
NO_PACKET = ConnectionError(GONE + "[TxRxResult] There is no status packet!")
OVERLOAD = RuntimeError("Failed to write 'Goal_Position' on id_=3. [RxPacketError] Overload error!")


SAG = np.radians([0.3, 2.2, 3.2, 0.6, 0.0, 0.0])
"""How far joints sink at home, at most: home is where the arm has sunk to, and it sinks below that."""
AWAY = (0.0, 0.0, -1.0)
"""Where the object is while it is in somebody's hand."""


@dataclass
class Config:
    """As LeRobot's `SO101FollowerConfig`."""

    id: str = "fake"
    use_degrees: bool = True
    max_relative_target: float | None = None
    disable_torque_on_disconnect: bool = True


@dataclass
class Calibration:
    """As LeRobot's `MotorCalibration`."""

    homing_offset: int
    range_min: int
    range_max: int


class Bus:
    """As LeRobot's `FeetechMotorsBus`: six motors as the factory made them, in ticks.

    Attributes:
        calibration: What the host knows of motors; nothing, before it is read.
        error: Raised by whatever is asked, in place of an answer.
    """

    def __init__(self, plant, world):
        self.plant, self.world = plant, world
        self.offsets = np.zeros(len(MOTORS), int)
        self.calibration, self.error = {}, None

    def _answer(self):
        if self.error:
            raise self.error

    def _zeros(self):
        return self.world.zeros - self.offsets

    def ticks(self):
        """Where motors stand (6,), as their encoders tell it."""
        self._answer()
        at = self._zeros() + self.world.signs * self.plant.angles / TICK
        return np.round(at).astype(int) % 4096

    def send(self, goals):
        """Tells motors, by name, to go to ticks."""
        self._answer()
        for name, ticks in goals.items():
            i = MOTORS.index(name)
            ticks = min(max(ticks, LIMITS[0]), LIMITS[1])
            self.plant.targets[i] = self.world.signs[i] * (ticks - self._zeros()[i]) * TICK

    def read_calibration(self):
        self._answer()
        return {
            name: Calibration(int(offset), *LIMITS) for name, offset in zip(MOTORS, self.offsets, strict=True)
        }

    def sync_read(self, what, motors=None, normalize=True):
        assert what == "Present_Position"
        ticks = dict(zip(MOTORS, self.ticks().tolist(), strict=True))
        ticks = {name: ticks[name] for name in motors or MOTORS}
        return self.degrees(ticks) if normalize else ticks

    def degrees(self, ticks):
        if not self.calibration:
            raise RuntimeError("FakeBus has no calibration registered.")
        return {name: (value - sum(LIMITS) / 2) * 360 / 4095 for name, value in ticks.items()}

    def set_half_turn_homings(self, motors=None):
        for name in motors or MOTORS:
            i = MOTORS.index(name)
            self.offsets[i] += self.ticks()[i] - 2047
            self.calibration.pop(name, None)


class NoPlaceError(RuntimeError):
    """A world in which cameras do not see what they must: nothing that an agent did."""


class FakeSO101:
    """The robot, at home, in the world of a seed.

    Args:
        seed: Of its world, its cameras' noise, and where objects are placed.
        power: A file that tells, also after this process has ended, whether motors have torque.
        tags: Whether it has printed tags in place of balls.
    """

    name = "fake_so101"

    def __init__(self, seed=0, power=None, tags=False):
        self.config = Config()
        self._connected, self._power, self._tags = False, power, tags
        drawn, self._places, self._knocks, self._mixing = (
            np.random.default_rng([seed, n]) for n in (53, 54, 55, 56)
        )
        cameras, self._spread = (printed.CAMERAS, printed.SPREAD) if tags else (CAMERAS, SPREAD)
        self.plant, self.world = Plant(tags), World.drawn(drawn, cameras)
        self._home = self.plant.home
        while not self._seen_from(self._home):
            self.world = World.drawn(drawn, cameras)
        self.bus = Bus(self.plant, self.world)
        self._scene, self._time = Scene(self.world, tags), 0.0
        made = zip(("left", "right"), (0.06, 0.12), (0.0, 0.013), self.world.k1, strict=True)
        self.cameras = {name: Webcam(name, [seed, i], *rest) for i, (name, *rest) in enumerate(made)}
        self.hidden, self.swapped, self.mixed = set(), False, 0.0
        self._torque(True)
        self.sleep(0.3)

    # What LeRobot's `Robot` has.

    @property
    def action_features(self):
        return {f"{name}.pos": float for name in MOTORS}

    @property
    def observation_features(self):
        return self.action_features | dict.fromkeys(self.cameras, (HEIGHT, WIDTH, 3))

    @property
    def is_connected(self):
        return self._connected

    def connect(self, calibrate=True):
        if calibrate:
            raise EOFError("LeRobot asks to be calibrated, on stdin")
        self._torque(False)
        self._connected = True
        self._torque(True)

    def disconnect(self):
        self._asked("disconnect")
        self._connected = False
        if self.config.disable_torque_on_disconnect:
            self._torque(False)

    def __del__(self):
        with suppress(Exception):
            if self.is_connected:
                self.disconnect()

    def get_observation(self):
        self._asked("get_observation")
        self.sleep(0.008)
        at = self.bus.sync_read("Present_Position")
        return {f"{name}.pos": value for name, value in at.items()} | self._frames()

    def send_action(self, action):
        self._asked("send_action")
        self.sleep(0.002)
        goals = {key.removesuffix(".pos"): value for key, value in action.items() if key.endswith(".pos")}
        if getattr(self.config, "max_relative_target", None) is not None:
            most, at = self.config.max_relative_target, self.bus.sync_read("Present_Position")
            goals = {name: at[name] + min(max(goal - at[name], -most), most) for name, goal in goals.items()}
        self.bus.send({name: int(goal * 4095 / 360 + sum(LIMITS) / 2) for name, goal in goals.items()})
        return {f"{name}.pos": goal for name, goal in goals.items()}

    def _asked(self, what):
        if not self._connected:
            raise ConnectionError(f"FakeSO101 is not connected: {what}")

    def _frames(self):
        frames = {}
        for name, camera in self.cameras.items():
            (other,) = (each for each in self.cameras.values() if each is not camera)
            wrong = self.swapped or self._mixing.random() < self.mixed
            frames[name] = camera.latest(self._time, other if wrong else None, self._scene)
        return frames

    def _torque(self, on):
        self.plant.powered = on
        if self._power is not None:
            self._power.write_text("on" if on else "off")

    # Time, which goes by where something waits.

    def clock(self):
        return self._time

    def sleep(self, seconds):
        for _ in range(max(1, round(seconds / STEP))):
            self.plant.step()
            self._time += STEP
            for camera in self.cameras.values():
                camera.expose(self._time, self._state)

    def _state(self):
        plant = self.plant
        seen = plant.data.qpos.copy(), plant.data.mocap_pos.copy(), frozenset(self.hidden)
        return State(self._time, plant.speed, *seen)

    # What only tests know, and do.

    def place_object(self):
        """Puts the object where the gripper can be, and both cameras see all balls, then and from home."""
        home = self.plant.data
        home.mocap_pos[0] = AWAY
        self.sleep(STEP)
        for _ in range(2000):
            angles = self.plant.home.copy()
            angles[:5] += self._places.uniform(-self._spread, self._spread, 5) * np.pi / 4
            posed = self.plant.posed(angles)
            point = posed.site("grip").xpos.copy()
            away = np.linalg.norm(point - home.site("grip").xpos) > 0.03
            if (
                away
                and point[2] > 0.03
                and not posed.ncon
                and self._see(posed, point)
                and self._see(home, point)
            ):
                home.mocap_pos[0] = point
                self.sleep(0.6)
                return
        raise NoPlaceError("there is no place for the object")

    def _see(self, data, *points):
        """Whether both cameras see the gripper's marks, and the object's at these points."""
        if self._tags:
            return printed.see_tags(self.plant.model, data, self.world, *points)
        balls = np.array([*points, *(data.geom(name).xpos for name in ("gripper_1", "gripper_2"))])
        inside = all(map(self.world.shows, balls))
        return inside and all(
            apart(at, balls) > 2.5 * BALL and all(self._open(data, at, ball) for ball in balls)
            for at in self.world.positions
        )

    def _seen_from(self, home):
        """Whether both cameras see the gripper from home (6,), and where the arm sags there."""
        return all(self._see(self.plant.posed(home + share * SAG)) for share in (0, 0.5, 1))

    def _open(self, data, at, ball):
        """Whether no part of the arm stands between a camera and most of a ball."""
        return all(
            not 0 <= self._hit(data, at, ball + edge) < np.linalg.norm(ball - at) - 1.5 * BALL
            for edge in 0.5 * BALL * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
        )

    def _hit(self, data, at, point):
        """How far from a camera something stands on the way to a point, in m; -1 where nothing does."""
        way = point - at
        geom = np.zeros(1, np.int32)
        return mujoco.mj_ray(self.plant.model, data, at, way / np.linalg.norm(way), None, 1, -1, geom, None)

    def knock(self, metres=0.03, degrees=5.0):
        """Moves both cameras by so much; from home they still see the gripper."""
        before = self.world.positions, self.world.axes
        self.plant.data.mocap_pos[0] = AWAY
        for _ in range(2000):
            self.world.positions, self.world.axes = (each.copy() for each in before)
            for camera in range(2):
                self.world.knocked(camera, self._knocks, metres, degrees)
            if self._seen_from(self._home):
                return
        raise NoPlaceError("no knock leaves the gripper in view from home")

    def shift_zero(self, degrees=10.0):
        """A motor's horn slips, of the first four: at the same ticks its joint stands elsewhere.

        From home cameras still see the gripper.
        """
        self.plant.data.mocap_pos[0] = AWAY
        for i, sign in self._knocks.permutation([(i, sign) for i in range(4) for sign in (-1, 1)]):
            home = self._home.copy()
            home[i] += sign * np.radians(degrees)
            if self._seen_from(home):
                self._home = home
                self.world.zeros[i] -= self.world.signs[i] * sign * np.radians(degrees) / TICK
                self.plant.targets[i] += sign * np.radians(degrees)
                self.sleep(1.0)
                return
        raise NoPlaceError("from home the gripper is seen nowhere else")

    def grip(self):
        """The gripper point (3,) in m."""
        return self.plant.data.site("grip").xpos.copy()

    def distance_mm(self):
        """Between gripper point and object."""
        return 1000 * float(np.linalg.norm(self.grip() - self.plant.data.mocap_pos[0]))

    def goals_ahead(self):
        """How far motors' goals are from where they stand (6,), in degrees."""
        return np.degrees(self.plant.targets - self.plant.angles)

    def jam(self, motor):
        """A motor that does not move any more, whatever it is told."""
        self.plant.jammed.add(MOTORS.index(motor))

    def weaken(self, motor, degrees):
        """A motor that sinks so far below where it is told to be."""
        self.plant.weak[MOTORS.index(motor)] = np.radians(degrees)

    def free(self, motor):
        self.plant.jammed.discard(MOTORS.index(motor))


def apart(at, balls):
    """How far balls (n, 3) are from each other's lines of sight, seen from a camera, at least; in m."""
    ways = balls - at
    depths = np.linalg.norm(ways, axis=1)
    gaps = (ways / depths[:, None])[:, None] - (ways / depths[:, None])[None]
    return (np.linalg.norm(gaps, axis=-1) * depths)[np.triu_indices(len(balls), 1)].min()
