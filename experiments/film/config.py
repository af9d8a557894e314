"""What is filmed: one agent in one world, read from YAML into frozen models."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationInfo, field_validator

from calfree_gym.engine.config import LARGEST, SMALLEST
from experiments.config.environment import EnvironmentConfig
from experiments.config.life import check_reached
from experiments.config.loading import load_as
from experiments.config.model import Model
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig

BAND = 6.5
"""The band of words takes one part in so many of a film's height."""
LEAST_HEIGHT = 144
"""Of a film, so that its pictures are not smaller than pictures can be."""


class GifConfig(Model):
    """The film once more, small enough for a page.

    Attributes:
        width: In pixels.
        frames_per_second: At most the film's.
    """

    width: int = Field(720, ge=SMALLEST, le=LARGEST)
    frames_per_second: int = Field(10, gt=0, le=50)


class FilmConfig(Model):
    """A lifetime that is filmed.

    Attributes:
        agent: Who is filmed; a name, or a mapping.
        env: Where.
        seed: Of world, objects, noise and agent.
        trials: So many are made.
        first_trial: The first that is shown; those before are made, too.
        learn: Whether the agent learns, or shows what it does without.
        perturbations: A schedule.
        width: Of the film, in pixels.
        height: Of the film, words included, in pixels.
        words: Whether words stand below, and say what happens; small films are better without.
        frames_per_second: Of the film.
        gif: Of the GIF.
    """

    agent: AgentConfig
    env: EnvironmentConfig
    seed: int = Field(0, ge=0)
    trials: int = Field(gt=0)
    first_trial: int = Field(1, gt=0)
    learn: bool = True
    perturbations: tuple[dict[str, Any], ...] = Field((), strict=False)
    words: bool = True
    height: int = Field(780, ge=LEAST_HEIGHT, le=LARGEST)
    width: int = Field(1080, ge=SMALLEST, le=LARGEST)
    frames_per_second: int = Field(20, gt=0, le=120)
    gif: GifConfig = Field({}, validate_default=True)

    @field_validator("first_trial")
    @classmethod
    def _one_of_them(cls, value: int, info: ValidationInfo) -> int:
        if value > info.data.get("trials", value):
            raise ValueError(f"there are {info.data['trials']} trials")
        return value

    @field_validator("perturbations")
    @classmethod
    def _within_the_film(
        cls, value: tuple[dict[str, Any], ...], info: ValidationInfo
    ) -> tuple[dict[str, Any], ...]:
        check_reached(value, {"trial": info.data.get("trials")})
        return value

    @field_validator("height", "width")
    @classmethod
    def _even(cls, value: int, info: ValidationInfo) -> int:
        if value % 2:
            raise ValueError("it must be even, as MP4 wants it")
        height = info.data.get("height")
        if info.field_name == "width" and height is not None and value < height:
            raise ValueError(f"it must be at least the height, {height}")
        return value

    @field_validator("gif")
    @classmethod
    def _no_finer_than_the_film(cls, value: GifConfig, info: ValidationInfo) -> GifConfig:
        for key in ("width", "frames_per_second"):
            of_film = info.data.get(key)
            if of_film is not None and getattr(value, key) > of_film:
                raise ValueError(
                    f"gif.{key} is {getattr(value, key)}: it must be at most the film's {of_film}"
                )
        return value

    @property
    def band(self) -> int:
        """Height of the band of words, in pixels; even."""
        return self.words * 2 * round(self.height / (2 * BAND))


def load_film(path: Path, overrides: Sequence[str] = ()) -> FilmConfig:
    """Reads and validates what is to be filmed; environment and agent are built once.

    Raises:
        ConfigError: Names the file, the path of each wrong key, what was found, what is allowed.
    """
    return load_as(FilmConfig, path, overrides, _unbuildable)


def _unbuildable(config: FilmConfig) -> dict[str, str]:
    try:
        config.env.make(config.perturbations).close()
    except ValueError as error:
        return {"env": f"{error}"}
    try:
        required = requirements(config.agent, config.env)
    except Exception as error:  # whatever a library raises at a setting that it cannot use
        return {"agent": f"{error}"}
    if required.rows > 1:
        return {"agent": f"{config.agent.name!r} learns from {required.rows} arms at once; a film shows one"}
    return {}
