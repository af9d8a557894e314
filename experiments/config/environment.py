"""Which environment, with which arm, and how it is made: its id, and the arguments of its task."""

import math
from collections.abc import Mapping
from dataclasses import fields
from importlib import import_module
from numbers import Real
from typing import Annotated, Any, Literal, Self

import gymnasium
from gymnasium.envs.registration import load_env_creator
from pydantic import Field, ValidationInfo, field_validator, model_validator

import calfree_gym
from calfree_gym import Arm
from calfree_gym.engine.config import LARGEST_POOL, MOST_TOLERANCE
from calfree_gym.errors import near_misses
from calfree_gym.robot.arms.arm import MOVEMASTER_NAME, digest_of, robot_of
from calfree_gym.robot.arms.chain import SLIDE
from calfree_gym.robot.docking.base import MARKS, MOST_CAMERAS
from calfree_gym.robot.grasping.shapes import check_shape
from calfree_gym.world import DISTRIBUTIONS
from experiments.config.model import Model, known

DIGEST = "digest"
"""Only what results say of an arm has this key."""


def as_arm(given: Mapping[str, Any]) -> Arm:
    """The arm that a mapping means: the arguments of `Arm`, and `home_degrees`.

    These are of hinges, and are put over a mapping `home`.
    """
    arguments = dict(given)
    degrees = arguments.pop("home_degrees", None)
    if degrees is not None:
        home = arguments.get("home") or {}
        if not isinstance(degrees, Mapping):
            raise ValueError(f"home_degrees is {degrees!r}; it must be a mapping of joints to degrees")
        if not isinstance(home, Mapping):
            raise ValueError(
                f"home is the keyframe {home!r}, and home_degrees is given too; give one of them"
            )
        arguments["home"] = {**home, **{joint: _radians(joint, value) for joint, value in degrees.items()}}
    arm = Arm.from_dict(arguments)
    for joint in degrees or ():
        if arm.robot.model.joint(joint).type[0] == SLIDE:
            raise ValueError(f"home_degrees names {joint!r}, which slides; give it under home, in m")
    return arm


def is_told(arm: str | Mapping[str, Any]) -> bool:
    """Whether this is what results say of an arm, and no arm that can be built."""
    return isinstance(arm, Mapping) and DIGEST in arm


def as_told(arm: Mapping[str, Any]) -> dict[str, Any]:
    """What results say of an arm: its model's name and digest, and its arguments; no file and no folder."""
    if is_told(arm):
        return dict(arm)
    made = Arm.from_dict(arm)
    told = {name: value for name, value in arm.items() if name != "assets"}
    return told | {
        "model": made.robot.spec.modelname,
        "motors": list(made.robot.motors),
        DIGEST: made.digest,
    }


def digest(arm: Mapping[str, Any]) -> str:
    """The digest of what `Arm.to_dict` or `as_told` returned."""
    return str(arm[DIGEST]) if is_told(arm) else digest_of(arm)


def _ids() -> tuple[str, ...]:
    return tuple(env_id for env_id in gymnasium.registry if env_id.startswith("CalFree/"))


def _radians(joint: str, degrees: Any) -> float:
    if isinstance(degrees, bool) or not isinstance(degrees, Real):
        raise ValueError(f"home_degrees has {joint!r} at {degrees!r}; it must be a number, in degrees")
    return math.radians(degrees)


OF_ALL = frozenset({"id", "max_episode_steps"})
"""What every environment takes, whatever its task."""


class EnvironmentConfig(Model):
    """The arguments of `gymnasium.make`."""

    later = frozenset(
        {"observation", "occlusion", "shape", "orientation", "clearance", "pool"}
        | {"base", "cameras", "marks", "goal"}
    )

    id: Annotated[str, known(_ids)]
    world: Annotated[str, known(lambda: DISTRIBUTIONS)]
    arm: str | dict[str, Any] = MOVEMASTER_NAME
    camera_mount: str | Annotated[tuple[str, str], Field(strict=False)] = "waist"
    observation: Literal["points", "vision"] = "points"
    occlusion: bool = False
    shape: str | dict[str, Any] | None = None
    orientation: Literal["lying", "any"] = "lying"
    clearance: float = Field(2.0, gt=0)
    base: Literal["differential", "omni"] = "differential"
    cameras: int = Field(1, ge=1, le=MOST_CAMERAS)
    marks: int = Field(len(MARKS), ge=2, le=len(MARKS))
    goal: Literal["marks", "shown"] = "marks"
    tolerance_px: float = Field(4.0, gt=0, lt=MOST_TOLERANCE)
    dynamics: Literal["physics", "kinematic"] = "physics"
    max_episode_steps: int = Field(60, gt=0, le=10**6)
    redraw: Literal["never", "trial"] = "never"
    pool: int | None = Field(None, gt=0, le=LARGEST_POOL)
    terminate_on_success: bool = True
    keep_in_view: bool = True

    @model_validator(mode="before")
    @classmethod
    def _of_its_task(cls, data: Any) -> Any:
        """Tolerance and dynamics of its task, where none are given; an unknown id is an error of its own."""
        if not isinstance(data, dict) or (env_id := data.get("id")) not in _ids():
            return data
        usual = _usual(env_id)
        known = {name: field.default for name, field in cls.model_fields.items() if name not in OF_ALL}
        foreign = [name for name in known.keys() - usual.keys() if data.get(name, known[name]) != known[name]]
        of = {name: next(_class_of(each).task for each in _ids() if name in _usual(each)) for name in foreign}
        for other in sorted({*of.values()} - {_class_of(env_id).task}):
            found = sorted(name for name in of if of[name] == other)
            raise ValueError(f"{', '.join(found)} is of {other}ing; {env_id} has none")
        for name in foreign:
            raise ValueError(f"{name} is {data[name]!r}; in {env_id} it is always {known[name]!r}")
        own = {name: usual[name] for name in ("tolerance_px", "dynamics") if name in usual}
        return {**own, **data}

    @model_validator(mode="after")
    def _pool_of_drawn_worlds(self) -> Self:
        if self.pool is not None and self.redraw != "trial":
            raise ValueError(f"pool is {self.pool}, so redraw must be 'trial'; it is {self.redraw!r}")
        return self

    @field_validator("shape")
    @classmethod
    def _known_shape(cls, value: str | dict[str, Any] | None) -> str | dict[str, Any] | None:
        check_shape(value)
        return value

    @field_validator("arm")
    @classmethod
    def _as_value(cls, value: str | dict[str, Any]) -> str | dict[str, Any]:
        """An arm's mapping, `home_degrees` among its keys, as the plain dict of the `Arm` that it means.

        What results say of an arm stays as it is: its files may be elsewhere.
        """
        if isinstance(value, dict):
            return value if is_told(value) else as_arm(value).to_dict()
        if value != MOVEMASTER_NAME:
            hint = near_misses(value, [MOVEMASTER_NAME])
            raise ValueError(
                f"unknown{hint}; allowed: {MOVEMASTER_NAME}, or for an arm of your own a mapping, "
                "such as {model: mine.xml, gripper: tip}"
            )
        return value

    @field_validator("camera_mount")
    @classmethod
    def _known_mount(cls, value: str | tuple[str, str], info: ValidationInfo) -> str | tuple[str, str]:
        if "arm" in info.data and not is_told(info.data["arm"]):
            robot_of(info.data["arm"]).mounts(value)
        return value

    @property
    def privileged(self) -> tuple[str, ...]:
        """All that its argument `tell` can add."""
        task = "dock" if self.task == "dock" else "reach"
        return tuple(import_module(f"calfree_gym.tasks.{task}").PRIVILEGED)  # needs MuJoCo 3.17

    def make(
        self, perturbations: tuple[dict[str, Any], ...] = (), tell: tuple[str, ...] = ()
    ) -> gymnasium.Env[Any, Any]:
        """Builds the environment; `tell` names the privileged observations that it adds."""
        return gymnasium.make(self.id, perturbations=list(perturbations) or None, **self._arguments(tell))

    def make_rows(
        self, rows: int, world: calfree_gym.World, tell: tuple[str, ...] = ()
    ) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
        """Builds a batched environment in one world, whose next trials begin when they are told to."""
        arguments = {**self._arguments(tell), "world": world}
        return gymnasium.make_vec(self.id, num_envs=rows, autoreset_mode="Disabled", **arguments)

    @property
    def task(self) -> str:
        """What agents are to do in it."""
        return _class_of(self.id).task

    def _arguments(self, tell: tuple[str, ...]) -> dict[str, Any]:
        takes = _usual(self.id)
        arguments = self.model_dump(include={*OF_ALL, *takes} - {"id"})
        return {**arguments, "tell": tell} if "tell" in takes else arguments


def _class_of(env_id: str) -> Any:
    """The class of its environments, which says what its task is, and which arguments that has."""
    return load_env_creator(str(gymnasium.registry[env_id].entry_point))


def _usual(env_id: str) -> dict[str, Any]:
    """The arguments of its task, with their defaults."""
    return {each.name: each.default for each in fields(_class_of(env_id).arms_of.config_of)}
