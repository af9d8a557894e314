"""What of an environment can be perturbed, and whether a schedule can be applied to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from calfree_gym.errors import near_misses
from calfree_gym.perturb.actions import bounded
from calfree_gym.perturb.images import is_colour_image
from calfree_gym.perturb.model import ModelParts, joints_of, names_of
from calfree_gym.perturb.observations import Keys, Path, check_path, images_by_name, keys_of, leaf
from calfree_gym.perturb.simulation import FREE, HOW_TO, Adapter, Env, adapter_of
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.schedule import Schedule, Undo

RENDER = "render"
"""The camera that `render()` shows where it is none of a model."""
PERS = ("life", "episode")
OF_POSES = ("camera_aim", "camera_roll", "camera_shift", "camera_zoom")
OF_MODELS = (*OF_POSES, "light", "joint_zero")
OF_IMAGES = ("exposure", "blur", "image_noise", "lens")
OF_ACTIONS = ("motor_sign", "motor_gain", "repeatability", "shortfall", "longest_motion", "dead_zone")
OF_OBSERVATIONS = ("latency", "point_dropout")
ALLOWED = (*OF_MODELS, *OF_IMAGES, *OF_ACTIONS, *OF_OBSERVATIONS)


class Scope:
    """What of an environment can be perturbed.

    Attributes:
        adapter: Finds its model; None: it has none.
        rendered: The camera that `render()` shows.
        images: Where observations have images of a camera; nowhere: who wraps the environment makes them.
        late: What of observations can be late.
        parts: Names of what can be perturbed.

    Args:
        env: The environment.
        images: See `Perturb`.
        late: See `Perturb`.
        adapter: See `Perturb`.
    """

    def __init__(
        self,
        env: Env,
        images: Mapping[str, Path | None] | None,
        late: Sequence[Path] | None,
        adapter: Adapter | None,
    ) -> None:
        if isinstance(adapter, type):
            raise ValueError(
                f"adapter is the class {adapter.__name__}; it must be one of its kind, {adapter.__name__}()"
            )
        self.adapter = adapter or adapter_of(env)
        model = self.adapter.simulation(env)[0] if self.adapter else None
        self._env = env
        self._cameras = names_of(model, "camera", model.ncam) if model else ()
        self.rendered = self._rendered()
        space = env.observation_space
        self.images = images_by_name(space, self._cameras)
        if images is not None:
            if not isinstance(images, Mapping):
                raise ValueError(
                    f"images is {images!r}; it must be keys by camera, such as {{'top': 'pixels'}}"
                )
            self.images = {
                name: () if path is None else (keys_of(f"images.{name}", path),)
                for name, path in images.items()
            }
        self.parts = ModelParts((), ())
        for name, paths in self.images.items():
            if model and name not in (*self._cameras, RENDER):
                raise ValueError(f"images names {self._no_camera(name)}")
            for keys in paths:
                check_path("images", keys, space)
        if isinstance(late, str) or not isinstance(late, Sequence | None):
            such = [late if isinstance(late, str) else "observation"]
            raise ValueError(f"late is {late!r}; it must be a list of parts, such as {such}")
        self.late: tuple[Keys, ...] = ((),) if late is None else tuple(keys_of("late", each) for each in late)
        for keys in self.late:
            check_path("late", keys, space)
        shown = [*self.images]
        if env.render_mode is not None and (self.rendered in self._cameras or not shown):
            shown.append(self.rendered)
        names, slides = joints_of(model) if model else ((), ())
        self.parts = ModelParts(tuple(dict.fromkeys(shown)), self._motors(model), names, slides)

    @property
    def frames_can_be_at_fault(self) -> bool:
        """Whether `render()` gives single images, of a camera that can be perturbed."""
        return self._env.render_mode == "rgb_array" and self.rendered in self.parts.cameras

    def check(self, schedule: Schedule, per: str) -> None:
        """Raises ValueError where a schedule cannot be applied."""
        for i, event in enumerate(schedule):
            where, perturbation = f"schedule.{i}", event.perturbation
            if per == "episode" and event.clock == "trial":
                raise ValueError(
                    f"{where} counts episodes; with per='episode' a schedule is of one: count steps"
                )
            if isinstance(perturbation, Undo):
                continue
            kind = perturbation.type
            if kind not in ALLOWED:
                raise ValueError(
                    f"{where}: {kind} needs a robot of calfree's own; in other environments there are: "
                    f"{', '.join(ALLOWED)}"
                )
            if kind in OF_MODELS and self.adapter is None:
                raise ValueError(f"{where}: {kind}: {HOW_TO.format(env=type(self._env.unwrapped).__name__)}")
            if kind in OF_ACTIONS and not self.parts.motors:
                raise ValueError(
                    f"{where}: {kind} acts on actions that are numbers (m,), each in a range; these are "
                    f"{self._env.action_space}"
                )
            if kind in (*OF_POSES, *OF_IMAGES):
                self._check_cameras(where, perturbation)
            try:
                perturbation.check_fits(self.parts)  # type: ignore[arg-type]
            except ValueError as error:
                raise ValueError(f"{where}: {error}") from None

    def _check_cameras(self, where: str, perturbation: Perturbation) -> None:
        """The same, of a perturbation of one camera, or of any, if it names none."""
        kind, named = perturbation.type, getattr(perturbation, "camera", None)
        if kind in OF_POSES and not self._cameras:
            raise ValueError(f"{where}: {kind}: the model has no camera; possible here: {self._possible()}")
        if named is None and not self.parts.cameras:
            raise ValueError(f"{where}: {kind}: no image shows a camera; {self._show('NAME')}")
        for name in self.parts.cameras if named is None else (named,):
            if name == RENDER and name not in self.parts.cameras and self._env.render_mode == "rgb_array":
                raise ValueError(
                    f"{where}: {kind}: observations have images, and render() shows none of those: give "
                    "images={} to perturb what it shows"
                )
            if name not in (*self.parts.cameras, *self._cameras):
                raise ValueError(f"{where}: {kind} names {self._no_camera(name)}")
            if name not in self.parts.cameras:
                raise ValueError(f"{where}: {kind}: no image shows the camera {name!r}; {self._show(name)}")
            if kind in OF_POSES and name not in self._cameras:
                raise ValueError(
                    f"{where}: {kind}: {name!r} is the viewer's own camera, whose place no model knows; "
                    f"those of the model: {', '.join(self._cameras) or 'none'}. {self._show('NAME')}"
                )
            if kind in OF_IMAGES:
                self._check_image(f"{where}: {kind}", name)

    def _check_image(self, where: str, camera: str) -> None:
        paths = self.images.get(camera, ())
        for keys in paths:
            if not is_colour_image(space := leaf(self._env.observation_space, keys)):
                raise ValueError(
                    f"{where} acts on images (h, w, 3) or (3, h, w) of uint8; those of {camera!r} are {space}"
                )
        if not paths and not (self.frames_can_be_at_fault and camera == self.rendered):
            raise ValueError(
                f"{where} acts on images as they are delivered, and none of {camera!r} is: give "
                f"images={{{camera!r}: KEYS}}, or render_mode='rgb_array' (found: {self._env.render_mode!r})"
            )

    def _no_camera(self, name: str) -> str:
        known = tuple(dict.fromkeys((*self._cameras, *self.parts.cameras, RENDER)))
        hint = near_misses(name, known)
        return f"the camera {name!r}{hint}, which there is not; there are: {', '.join(known)}"

    def _show(self, name: str) -> str:
        return (
            f"give images={{{name!r}: KEYS}}, the keys of its image in observations (None: whoever wraps "
            "this makes it from the model), or let render() show it, as adapter= tells of one's own"
        )

    def _possible(self) -> str:
        """What acts where the model has no camera."""
        kinds = ["light", "joint_zero", *OF_OBSERVATIONS]
        kinds += OF_ACTIONS if self.parts.motors else ()
        kinds += OF_IMAGES if self.images or self.frames_can_be_at_fault else ()
        return ", ".join(kinds)

    def _rendered(self) -> str:
        camera = FREE if self.adapter is None else self.adapter.camera(self._env)
        if isinstance(camera, str):
            return camera
        if camera is None or camera == FREE:
            return RENDER
        if not 0 <= camera < len(self._cameras):
            known = ", ".join(map("{0[0]}: {0[1]}".format, enumerate(self._cameras))) or "none"
            raise ValueError(f"the adapter's camera is {camera}; those of the model: {known}")
        return self._cameras[camera]

    def _motors(self, model: Any) -> tuple[str, ...]:
        """Names of the numbers of an action: of the actuators, where there are as many."""
        if not bounded(space := self._env.action_space):
            return ()
        (count,) = space.shape or (0,)
        if model and model.nu == count:
            return names_of(model, "actuator", count)
        return tuple(f"action{i}" for i in range(count))
