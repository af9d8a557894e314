"""Robots to train with: thousands of wild worlds side by side, in closed form, on one device.

Where the gripper is and what both cameras see are differentiable functions of the registers, those of the
kinematic environment; training follows the gradient through them.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calfree_gym.image import IMAGE_UNIT

from .network import chosen

MOUNTS = ("waist", "stand")
MOTORS = 3
SHAPES = {"achieved_goal": [4], "desired_goal": [4], "observation": [4 + MOTORS], "words": [MOTORS]}
"""Of what the robots observe and are sent, see `observation_format`."""
OBJECTS = 24
"""Drawn for each world; its trials take at random one that both cameras see from home."""
FAR = 3.0
"""True image points are cut to this many image units (a guard): a camera behind a point sees it anywhere."""
TOLERANCE = 4 * IMAGE_UNIT
"""Image distance of the rendezvous that ends a trial: that of `Reach-v0`."""
BORDER = 16 * IMAGE_UNIT
"""Objects are placed, and changed cameras see the gripper at home, so far inside the images: as in the
environment."""
NOISE_PX = 3.0
"""Up to so much noise is added to that of the world, in a tenth of the lives. Choice, as all numbers here."""
DROPOUT = 0.2
"""In a tenth of the lives, points are lost with a probability up to this."""
AIM, SHIFT, ZOOM = math.radians(25), 0.1, 0.25
"""A camera that is changed turns its view by up to so much (rad). Half of them move by about so much (m),
half zoom by up to e to the power of so much, and a third roll by any angle."""


class Worlds(NamedTuple):
    """What is hidden of n robots: wild worlds of the built arm, as its closed form needs them.

    Attributes:
        turning: 1 where the cameras turn with the waist, 0 where they stand in the room (n,).
        rest, linear, cubic: At register r a motor's joint is at rest + linear r + cubic r³ (n, 3), in rad.
        lowest, highest: Registers at which the motors stop (n, 3).
        wrist: Sum of the angles of J2 to J4 (n,), in rad.
        links: Lengths in m (n, 5).
        position: Optical centres (n, 2, 3) in m, in the frame of the mount.
        axes: Of the cameras, as columns (n, 2, 3, 3).
        focal, principal, k1: Of their images and lenses (n, 2), (n, 2, 2), (n, 2), in image units.
        noise: Of an image coordinate (n,), in image units.
        objects: Places of objects (n, k, 3) in m.
    """

    turning: Tensor
    rest: Tensor
    linear: Tensor
    cubic: Tensor
    lowest: Tensor
    highest: Tensor
    wrist: Tensor
    links: Tensor
    position: Tensor
    axes: Tensor
    focal: Tensor
    principal: Tensor
    k1: Tensor
    noise: Tensor
    objects: Tensor

    def joints(self, registers: Tensor) -> Tensor:
        """Angles of J1 to J3 (n, 3) at registers (n, 3)."""
        return self.rest + registers * (self.linear + self.cubic * registers.square())

    def gripper(self, joints: Tensor) -> Tensor:
        """Where the gripper is (n, 3) in m."""
        base, shoulder, upper_arm, forearm, hand = self.links.unbind(1)
        waist, upper, fore = joints[:, 0], joints[:, 1], joints[:, 1] + joints[:, 2]
        grip = fore + (self.wrist - fore).clamp(-WRIST, WRIST)
        radius = shoulder + upper_arm * upper.cos() + forearm * fore.cos() + hand * grip.cos()
        height = base + upper_arm * upper.sin() + forearm * fore.sin() + hand * grip.sin()
        return torch.stack([radius * waist.cos(), radius * waist.sin(), height], 1)

    def images(self, points: Tensor, joints: Tensor) -> tuple[Tensor, Tensor]:
        """Image points (n, p, 2, 2) of points (n, p, 3) in both cameras, and which are seen (n, p, 2)."""
        turn = (self.turning * joints[:, 0])[:, None]
        x, y, z = points.unbind(2)
        points = torch.stack([turn.cos() * x + turn.sin() * y, turn.cos() * y - turn.sin() * x, z], 2)
        way = points[:, :, None] - self.position[:, None]
        right, up, back = (way[..., None] * self.axes[:, None]).sum(3).unbind(3)
        depth = torch.where(back.abs() < 1e-6, 1e-6, -back)
        flat = torch.stack([right, -up], 3) / depth[..., None]
        bend = self.k1[:, None] * flat.square().sum(3)
        found = flat * ((1 + bend) * self.focal[:, None])[..., None] + self.principal[:, None]
        seen = (depth > 0) & (bend > -1 / 3) & (found.detach().abs().amax(3) <= 1)
        return found, seen

    def seen_from_home(self) -> tuple[Tensor, Tensor]:
        """Whether both cameras see the gripper (n,), and which objects (n, k), with the arm at home."""
        points = torch.cat([self.gripper(self.rest)[:, None], self.objects], 1)
        images, seen = self.images(points, self.rest)
        seen = (seen & (images.abs().amax(3) <= 1 - BORDER)).all(2)
        return seen[:, 0], seen[:, 1:]

    def of(self, rows: Tensor) -> Self:
        """Some of them, in this order."""
        return type(self)(*(each[rows] for each in self))


WRIST = math.radians(110)
"""Where J4 stops (rad), either way."""


def draw_worlds(count: int, mount: str, first_seed: int) -> dict[str, NDArray[np.float32]]:
    """The fields of `Worlds`, those of the environment's wild worlds of so many seeds from the first one on.

    Where motors stop is found by sending them there.
    """
    env: Any = gym.make_vec(
        "calfree_gym:CalFree/Reach-v0",
        num_envs=count,
        world="wild",
        camera_mount=mount,
        dynamics="kinematic",
        terminate_on_success=False,
    ).unwrapped
    env.reset(seed=list(range(first_seed, first_seed + count)))
    ends = []
    for sign in (1, -1):
        for _ in range(2):
            observation, *_ = env.step(np.full((count, MOTORS), sign, np.float32))
        ends.append(observation["observation"][:, 4:])
    objects = [env.reset()[1]["truth"]["object"] for _ in range(OBJECTS)]
    worlds = {name: np.stack([getattr(world, name) for world in env.worlds]) for name in FIELDS}
    robot = env.arms.robot
    scale = worlds["motor_sign"] * worlds["motor_gain"] * robot.span
    drawn = {
        "turning": np.full(count, mount == "waist"),
        "rest": robot.home + worlds["joint_zeros"][:, :MOTORS],
        "linear": scale * (1 - worlds["motor_curvature"]),
        "cubic": scale * worlds["motor_curvature"],
        "lowest": ends[1],
        "highest": ends[0],
        "wrist": worlds["joint_zeros"][:, 1:].sum(1) - np.pi / 2,
        "links": worlds["link_lengths"],
        "position": worlds["camera_position"],
        "axes": _axes(worlds["camera_orientation"]),
        "focal": worlds["focal_length"] * IMAGE_UNIT,
        "principal": worlds["principal_point"] * IMAGE_UNIT,
        "k1": worlds["lens_k1"],
        "noise": worlds["point_noise"] * IMAGE_UNIT,
        "objects": np.stack(objects, 1),
    }
    return {name: values.astype(np.float32) for name, values in drawn.items()}


FIELDS = (
    *("camera_position", "camera_orientation", "focal_length", "principal_point", "lens_k1", "point_noise"),
    *("link_lengths", "joint_zeros", "motor_sign", "motor_gain", "motor_curvature"),
)
"""Of a `World` that are read."""


def _axes(orientation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes (..., 3, 3), as columns, of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(orientation, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def worlds_on(device: torch.device, drawn: Mapping[str, NDArray[np.float32]]) -> Worlds:
    """Drawn worlds on a device."""
    return Worlds(**{name: torch.as_tensor(drawn[name]).to(device) for name in Worlds._fields})


class Look(NamedTuple):
    """What is observed of n robots, and what only a trainer knows of them.

    Attributes:
        points: Measured image points (n, 4, 2): gripper left, right, object left, right.
        visible: Which of them are seen now (n, 4).
        registers: Executed sums of words since home (n, 3), in the life's own order and with its signs.
        true_points: Noise-free image points (n, 4, 2).
        reached: Whether a rendezvous is observed (n,).
    """

    points: Tensor
    visible: Tensor
    registers: Tensor
    true_points: Tensor
    reached: Tensor


class _Life(NamedTuple):
    """What else befalls n robots: order and signs of motors (n, 3), further noise and dropout (n,)."""

    order: Tensor
    sign: Tensor
    noise: Tensor
    dropout: Tensor


class TrainingRobots:
    """n robots, each in a life of its own: trials in one world, with an object of its own each.

    Attributes:
        robots: n.
        trials: Begun in the life (n,).
        motions: Of the trial (n,).

    Args:
        worlds: Of which each life is in one, drawn at random.
        robots: n.
    """

    def __init__(self, worlds: Worlds, robots: int) -> None:
        self._pool, self.robots = worlds, robots
        self._device = worlds.noise.device
        self._rows = torch.arange(robots, device=self._device)
        everywhere = self._rows >= 0
        self._world = worlds.of(self._rows % len(worlds.noise))
        self._life = self._drawn_life()
        self.trials = torch.zeros_like(self._rows)
        self.motions = torch.zeros_like(self._rows)
        self._registers = torch.zeros(robots, MOTORS, device=self._device)
        self._object = torch.zeros(robots, 3, device=self._device)
        self._last = torch.zeros(robots, 4, 2, device=self._device)
        self.begin_lives(everywhere)

    def begin_lives(self, where: Tensor) -> None:
        """Begins a life in another world where (n,) so marked."""
        count = len(self._pool.noise)
        there = self._pool.of(torch.randint(count, (self.robots,), device=self._device))
        self._world = chosen(where, there, self._world)
        self._seen = self._world.seen_from_home()[1]
        self._life = chosen(where, self._drawn_life(), self._life)
        self.trials = torch.where(where, 0, self.trials)
        self.begin_trials(where)

    def _drawn_life(self) -> "_Life":
        n = self.robots
        return _Life(
            order=torch.argsort(self._uniform(n, MOTORS), 1),
            sign=torch.where(self._uniform(n, MOTORS) < 0.5, -1.0, 1.0),
            noise=self._some(0.1, n) * self._uniform(n) * NOISE_PX * IMAGE_UNIT,
            dropout=self._some(0.1, n) * self._uniform(n) * DROPOUT,
        )

    def begin_trials(self, where: Tensor) -> None:
        """Sends robots home and places their next objects, which both cameras see, where (n,) so marked."""
        self._registers = torch.where(where[:, None], 0, self._registers)
        self._last = torch.where(where[:, None, None], 0, self._last)
        self.trials, self.motions = self.trials + where, torch.where(where, 0, self.motions)
        which = (self._uniform(*self._seen.shape) * self._seen).argmax(1)
        self._object = torch.where(where[:, None], self._world.objects[self._rows, which], self._object)

    def change_cameras(self, where: Tensor) -> None:
        """Changes a camera where (n,) so marked, if both then see the gripper at home and most objects."""
        n, old = self.robots, self._world
        one = torch.nn.functional.one_hot(torch.randint(2, (n,), device=self._device), 2)[:, :, None]
        turn = self._uniform(n, 1) * AIM * torch.nn.functional.normalize(self._normal(n, 2))
        roll = self._some(1 / 3, n) * (2 * self._uniform(n) - 1) * math.pi
        turned = _rotation(torch.cat([turn, torch.zeros_like(roll)[:, None]], 1)) @ _rotation(
            torch.stack([torch.zeros_like(roll), torch.zeros_like(roll), roll], 1)
        )
        zoom = (self._some(0.5, n) * (2 * self._uniform(n) - 1) * ZOOM).exp()
        shift = self._some(0.5, n)[:, None] * SHIFT * self._normal(n, 3) / 3**0.5
        new = old._replace(
            axes=torch.where(one[..., None] > 0, old.axes @ turned[:, None], old.axes),
            focal=torch.where(one[:, :, 0] > 0, old.focal * zoom[:, None], old.focal),
            position=old.position + one * shift[:, None],
        )
        gripper, seen = new.seen_from_home()
        serves = where & gripper & (seen.float().mean(1) >= 0.5)
        self._world = chosen(serves, new, old)
        self._seen = torch.where(serves[:, None], seen, self._seen)

    def move(self, words: Tensor, where: Tensor) -> None:
        """Executes one motion of control words (n, 3), where (n,) so marked."""
        ours = torch.zeros_like(words).scatter(1, self._life.order, words * self._life.sign)
        after = torch.minimum(torch.maximum(self._registers + ours, self._world.lowest), self._world.highest)
        self._registers = torch.where(where[:, None], after, self._registers)
        self.motions = self.motions + where

    def look(self) -> Look:
        """What is observed now. A point that is not seen stays where it was seen last in the trial."""
        world, n = self._world, self.robots
        joints = world.joints(self._registers)
        images, seen = world.images(torch.stack([world.gripper(joints), self._object], 1), joints)
        true, seen = images.reshape(n, 4, 2), seen.reshape(n, 4)
        noise = (world.noise + self._life.noise)[:, None, None] * self._normal(n, 4, 2)
        seen = seen & (self._uniform(n, 4) >= self._life.dropout[:, None])
        self._last = torch.where(seen[:, :, None], (true + noise).clamp(-1, 1), self._last)
        far = (self._last[:, :2] - self._last[:, 2:]).detach().square().sum(2).amax(1)
        return Look(
            points=self._last,
            visible=seen,
            registers=self._registers.gather(1, self._life.order) * self._life.sign,
            true_points=true.clamp(-FAR, FAR),
            reached=seen.all(1) & (far <= TOLERANCE**2),
        )

    def detach(self) -> None:
        """Lets no gradient flow to earlier motions."""
        self._registers, self._last = cut(self._registers), cut(self._last)

    def _uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, device=self._device)

    def _normal(self, *shape: int) -> Tensor:
        return torch.randn(shape, device=self._device)

    def _some(self, share: float, count: int) -> Tensor:
        return (self._uniform(count) < share).float()


def cut(tensor: Tensor) -> Tensor:
    """The same tensor, at which a gradient ends; it takes one, so that all windows compile alike."""
    tensor = tensor.detach()
    return tensor.requires_grad_() if tensor.is_floating_point() else tensor


def _rotation(vectors: Tensor) -> Tensor:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3)."""
    x, y, z = vectors.unbind(1)
    zero = torch.zeros_like(x)
    skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).view(-1, 3, 3)
    return torch.linalg.matrix_exp(skew)
