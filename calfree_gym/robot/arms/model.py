"""What follows from an arm's MJCF, its gripper and its motors: names, ranges, home, and where things are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from calfree_gym.errors import near_misses
from calfree_gym.geometry import Array, Flags
from calfree_gym.robot.arms.chain import BALL, FREE, HINGE, SLIDE, Chain, path_to
from calfree_gym.robot.arms.mjcf import compiled
from calfree_gym.robot.arms.movemaster import AIM as MOVEMASTER_TARGET
from calfree_gym.robot.arms.movemaster import CAMERA_POSITION as MOVEMASTER_POSITION
from calfree_gym.robot.arms.robot import HINGE_SPEED, SLIDE_SPEED, Mounts, Rig, Robot, Scene
from calfree_gym.robot.arms.scene import build

HINGE_MARGIN = 0.01
"""A hinge's motor stops this far (rad) before the joint does."""
SLIDE_MARGIN = 0.005
"""A slide's, as a share of its span."""
WORK_SHARE = 0.4
"""Objects need no joint farther from home than this share of its span: so registers of 0.9 reach them also
with half of the built robot's gain."""
WORK_MARGIN = 0.04
"""Nor nearer to a stop than this share of its range, unless home is."""
POSTURES = 500
"""So many drawn postures tell where the work space is."""
MARK = 0.010
"""Radius of the RV-M2's marks (m)."""
MOVEMASTER_SIZE = 0.23
"""Root mean square distance (m) of the RV-M2's objects from their middle."""
FEWEST, MOST = 3, 7
"""Motors of an arm."""
NO_RANGE = np.pi
"""A hinge without limits turns this far (rad) from zero, either way."""


class ArmModel(Robot):
    """An arm as its model describes it.

    Attributes:
        spec: The model as given.
        model: The same, compiled.
        gripper: ("site" or "body", name) of the gripper point.
        base: Name of the body where the chain starts.
        motors: Names of the motors' joints, m of them.
        links: Names of the bodies behind the base whose distance from the body before is a length, l of them.
        slides: Which motors (m,) slide.
        stops: Lowest and highest position (m, 2) of the motors' joints, in rad or m.
        home: Their positions at home (m,).
        home_qpos: Of all joints (nq,).
        joints: Names of the motors' joints: each has a zero.
        stop_margin, span, lowest, highest, rig, candidates, built_home, speeds: See `Robot`.

    Args:
        text: MJCF.
        gripper: Name of a site or body.
        motors, home, base: As in `Arm`.

    Raises:
        ValueError: As in `Arm`.
    """

    ambiguous = True
    candidates = 400

    def __init__(
        self,
        text: str,
        gripper: str,
        motors: Sequence[str] | None,
        home: str | Mapping[str, float] | None,
        base: str | None,
    ) -> None:
        self.spec, self.model = compiled(text)
        model = self.model
        self.gripper, holder, self._at = self._gripper_point(gripper)
        path = path_to(model, holder)
        self.base = self._base(base, path, gripper)
        behind = path[[model.body(body).name for body in path].index(self.base) :]
        self._motors = self._motor_ids(motors, behind)
        self.motors = tuple(self._name("jnt", joint) for joint in self._motors)
        self.slides: Flags = np.array([model.jnt_type[joint] == SLIDE for joint in self._motors])
        self.stops = np.array([self._stops(joint) for joint in self._motors])
        self._links = [body for body in behind[1:] if np.linalg.norm(model.body_pos[body]) > 0]
        self.links = tuple(self._name("body", body) for body in self._links)
        self.lengths = np.linalg.norm(model.body_pos[self._links], axis=1)
        self.home_qpos = self._home_qpos(home)
        self._chains: dict[str, Chain] = {}
        self._chain = Chain(model, holder, self._motors, self._links, self.home_qpos)
        if home is None:
            self.home_qpos[self.qpos_of_motors] = self._best_posture()
        self.home = self.built_home = self.home_qpos[self.qpos_of_motors]
        self._refuse_loops()
        self.joints = self.motors
        self.span = np.maximum(self.home - self.stops[:, 0], self.stops[:, 1] - self.home)
        self.stop_margin = np.where(self.slides, SLIDE_MARGIN * self.span, HINGE_MARGIN)
        self.speeds = np.where(self.slides, SLIDE_SPEED, HINGE_SPEED)
        inner = WORK_MARGIN * (self.stops[:, 1] - self.stops[:, 0])
        self.lowest = np.maximum(
            self.home - WORK_SHARE * self.span, np.minimum(self.stops[:, 0] + inner, self.home)
        )
        self.highest = np.minimum(
            self.home + WORK_SHARE * self.span, np.maximum(self.stops[:, 1] - inner, self.home)
        )
        self.rig = self._rig()

    @property
    def qpos_of_motors(self) -> Array:
        """Where the motors' positions stand in qpos (m,)."""
        return np.asarray(self.model.jnt_qposadr[self._motors])

    @property
    def home_by_name(self) -> dict[str, float]:
        """Positions at home of all hinges and slides, by name."""
        kinds = self.model.jnt_type
        return {
            self._name("jnt", joint): float(self.home_qpos[self.model.jnt_qposadr[joint]])
            for joint in range(self.model.njnt)
            if kinds[joint] in (HINGE, SLIDE)
        }

    @property
    def bodies(self) -> list[str]:
        """See `Robot`."""
        first = int(self.model.jnt_bodyid[self._motors[0]])
        ids = [first, *(body for body in range(1, self.model.nbody) if body != first)]
        return [self._name("body", body) for body in ids]

    def rest(self, zeros: Array) -> Array:
        """See `Robot`: nothing."""
        return np.zeros(0)

    def angles(self, positions: Array, rest: Array) -> Array:
        """See `Robot`: no other joint moves."""
        return positions

    def gripper_position(self, angles: Array, lengths: Array) -> Array:
        """See `Robot`."""
        position, axes = self._chain.frames(angles, lengths / self.lengths)
        return position + axes @ self._at

    def within(self, points: Array) -> Flags:
        """See `Robot`: all that `lowest` and `highest` bound."""
        return np.ones(points.shape[:-1], bool)

    def frames(self, body: str, angles: Array, lengths: Array) -> tuple[Array, Array]:
        """See `Robot`."""
        if body not in self._chains:
            last = self.model.body(body).id
            self._chains[body] = Chain(self.model, last, self._motors, self._links, self.home_qpos)
        return self._chains[body].frames(angles, lengths / self.lengths)

    def scene(self, mounts: Mounts) -> Scene:
        """See `Robot`."""
        return build(self.spec, self.motors, self.gripper, mounts, self.home_qpos, MARK * self.rig.scale)

    def stretch(self, body_positions: Array, lengths: Array) -> None:
        """See `Robot`."""
        built = self.model.body_pos[self._links]
        body_positions[self._links] = built * (lengths / self.lengths)[:, None]

    def _rig(self) -> Rig:
        """Two cameras above and beside the work space, as far from it, for its size, as the RV-M2's."""
        shares = np.random.default_rng(1).random((POSTURES, len(self.motors)))
        reached = self.gripper_position(self.lowest + shares * (self.highest - self.lowest), self.lengths)
        target = np.median(reached, axis=0)
        size = float(np.sqrt(np.square(reached - target).sum(-1).mean()))
        base = self.frames(self.base, self.home, self.lengths)[0]
        ahead = (target - base) * [1, 1, 0]
        far = float(np.linalg.norm(ahead))
        ahead = ahead / far if far > 0.1 * size else np.array([1.0, 0.0, 0.0])
        aside, up = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
        scale = size / MOVEMASTER_SIZE
        back, side, above = np.abs(MOVEMASTER_POSITION[0] - MOVEMASTER_TARGET)
        position = [target + scale * (above * up - back * ahead + sign * side * aside) for sign in (1, -1)]
        return Rig(np.array(position), target, scale)

    def _gripper_point(self, name: str) -> tuple[tuple[str, str], int, Array]:
        model = self.model
        sites, bodies = self._names("site"), self._names("body")[1:]
        if name in sites:
            site = model.site(name).id
            return ("site", name), int(model.site_bodyid[site]), model.site_pos[site].copy()
        if name in bodies:
            return ("body", name), model.body(name).id, np.zeros(3)
        raise ValueError(
            f"the arm has no site or body {name!r}{near_misses(name, [*sites, *bodies])} for a gripper; its "
            f"sites: {_list(sites)}; its bodies: {_list(bodies)}"
        )

    def _base(self, base: str | None, path: list[int], gripper: str) -> str:
        names = [self._name("body", body) for body in path]
        if not names:
            raise ValueError(f"the gripper {gripper!r} is fixed in the room; nothing moves it")
        if base is None:
            return names[0]
        if base not in names:
            raise ValueError(
                f"base is {base!r}{near_misses(base, names)}; the bodies on the way to the gripper "
                f"{gripper!r} are {', '.join(names)}"
            )
        return base

    def _motor_ids(self, motors: Sequence[str] | None, behind: list[int]) -> list[int]:
        model = self.model
        chain = [joint for joint in range(model.njnt) if model.jnt_bodyid[joint] in behind]
        movable = [joint for joint in chain if model.jnt_type[joint] in (HINGE, SLIDE)]
        names = {self._name("jnt", joint): joint for joint in movable}
        if motors is None:
            found = movable
        elif isinstance(motors, str) or len(set(motors)) != len(list(motors)):
            raise ValueError(f"motors is {motors!r}; it must be a list of different joints' names")
        else:
            found = [self._motor(name, names, chain) for name in motors]
        if not FEWEST <= len(found) <= MOST:
            raise ValueError(
                f"{len(found)} motors, {_list([self._name('jnt', j) for j in found])}; an arm has {FEWEST} to "
                f"{MOST}. motors= chooses among {_list(list(names))}, and base= where the chain starts"
            )
        return found

    def _motor(self, name: str, movable: Mapping[str, int], chain: list[int]) -> int:
        if name in movable:
            return movable[name]
        allowed = f"allowed: {_list(list(movable))}"
        if name not in self._names("jnt"):
            raise ValueError(f"the arm has no joint {name!r}{near_misses(name, movable)}; {allowed}")
        joint = self.model.joint(name).id
        if joint in chain:
            kind = {FREE: "free", BALL: "ball"}[int(self.model.jnt_type[joint])]
            raise ValueError(
                f"the motor {name!r} is a {kind} joint; a motor is a hinge or a slide; {allowed}"
            )
        raise ValueError(
            f"the motor {name!r} is not between the base {self.base!r} and the gripper {self.gripper[1]!r}; {allowed}"
        )

    def _stops(self, joint: int) -> tuple[float, float]:
        model, name = self.model, self._name("jnt", joint)
        if model.jnt_limited[joint]:
            low, high = (float(stop) for stop in model.jnt_range[joint])
            if low < high:
                return low, high
            raise ValueError(f"the motor {name!r} ranges from {low:g} to {high:g}; it cannot move")
        if model.jnt_type[joint] == SLIDE:
            raise ValueError(f"the motor {name!r} slides without limits; give its joint a range")
        return -NO_RANGE, NO_RANGE

    def _home_qpos(self, home: str | Mapping[str, float] | None) -> Array:
        model = self.model
        if isinstance(home, str):
            keys = self._names("key")
            if home not in keys:
                raise ValueError(
                    f"the arm has no keyframe {home!r}{near_misses(home, keys)}; it has {_list(keys)}"
                )
            qpos = model.key_qpos[keys.index(home)].copy()
        else:
            qpos = self._within_ranges(model.qpos0)
            for name, value in (home or {}).items():
                if name not in self._names("jnt") or model.jnt_type[model.joint(name).id] not in (
                    HINGE,
                    SLIDE,
                ):
                    hinges = [
                        n for j, n in enumerate(self._names("jnt")) if model.jnt_type[j] in (HINGE, SLIDE)
                    ]
                    raise ValueError(
                        f"home names {name!r}{near_misses(name, hinges)}; its hinges and slides: {_list(hinges)}"
                    )
                qpos[model.joint(name).qposadr[0]] = _number(name, value)
        if home is not None:
            for name, value, (low, high) in zip(
                self.motors, qpos[self.qpos_of_motors], self.stops, strict=True
            ):
                if not low <= value <= high:
                    raise ValueError(f"home has {name!r} at {value:g}; its range is {low:g} to {high:g}")
        return qpos

    def _within_ranges(self, qpos: Array) -> Array:
        """Joint positions (nq,), where those beyond a limit are at it."""
        model, within = self.model, qpos.copy()
        for joint in np.flatnonzero(model.jnt_limited & np.isin(model.jnt_type, (HINGE, SLIDE))):
            at = model.jnt_qposadr[joint]
            within[at] = np.clip(within[at], *model.jnt_range[joint])
        return within

    def _best_posture(self, draws: int = 2_000) -> Array:
        """Of drawn postures (m,) the one in which motors move the gripper most in its stiffest direction.

        Each motor's effect is that of its range, and counts less near a stop: so home is where the gripper
        can go anywhere, and no motor is near its end.
        """
        low, high = self.stops.T
        shares = np.random.default_rng(0).uniform(0.15, 0.85, (draws, len(low)))
        joints, step = low + shares * (high - low), 1e-4 * (high - low)
        at = self.gripper_position(joints, self.lengths)
        effects = [
            (self.gripper_position(joints + step * unit, self.lengths) - at) / 1e-4
            for unit in np.eye(len(low))
        ]
        room = 1 - np.abs(2 * shares - 1)
        singular = np.linalg.svd(np.stack(effects, -1) * room[:, None], compute_uv=False)
        return np.asarray(joints[singular[:, -1].argmax()])

    def _refuse_loops(self) -> None:
        """Raises where the model ties a motor to anything else: then other joints move with it."""
        model = self.model
        for i in np.flatnonzero(model.eq_active0):
            first, second = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
            if model.eq_type[i] == mujoco.mjtEq.mjEQ_JOINT:
                tied = {first, second} & set(self._motors)
            elif model.eq_type[i] in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
                if model.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
                    first, second = (int(model.site_bodyid[site]) for site in (first, second))
                if (model.body_mocapid[[first, second]] >= 0).any():
                    continue
                ways = [set(path_to(model, body)) for body in (first, second)]
                moved = {joint: int(model.jnt_bodyid[joint]) for joint in self._motors}
                tied = {joint for joint, body in moved.items() if body in ways[0] ^ ways[1]}
            else:
                continue
            if tied:
                names = _list([self._name("jnt", joint) for joint in sorted(tied)])
                raise ValueError(
                    f"the model's equality {model.equality(i).name or int(i)!r} ties the motor {names} to other "
                    "parts, which would have to move with it; only open chains of motors are supported"
                )

    def _name(self, kind: str, index: int) -> str:
        return self._names(kind)[index]

    def _names(self, kind: str) -> list[str]:
        """Names of all elements of a kind; an unnamed one is called by its place."""
        objects = {"jnt": "joint"}.get(kind, kind)
        count = {
            "jnt": self.model.njnt,
            "body": self.model.nbody,
            "site": self.model.nsite,
            "key": self.model.nkey,
        }
        of: Any = getattr(self.model, objects)
        return [of(i).name or f"{objects}_{i}" for i in range(count[kind])]


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise ValueError(f"home has {name!r} at {value!r}; it must be a number, in rad or, for a slide, in m")
    return float(value)


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
