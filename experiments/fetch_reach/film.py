"""`python -m experiments film-knocked`: one episode, and two policies in it, whose camera is turned."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

import agents
from calfree_gym.perturb import paired
from experiments.errors import ConfigError
from experiments.fetch_reach.policies import (
    CAMERA,
    GRIPPER,
    GRIPPER_AT_HOME,
    SUCCESS,
    Calibrated,
    aim,
    draw_goal,
    fetch,
    points_of,
    succeeded,
)
from experiments.options import Parser
from experiments.running.results_folder import made_folder

Image = NDArray[np.uint8]

EPISODE = 12
"""The one that is shown; those before it are lived through, too."""
SIZE, INSET, BAND = 360, 132, 40
"""Of a panel, of what the camera that is turned shows in it, and of the words below, in pixels."""
LASTS, END = 120, 3000
"""Of a step, and of the last one, in ms."""
DARK, LIGHT, ALARM, GOOD_NEWS = (30, 30, 34), (240, 240, 240), (222, 80, 16), (120, 225, 140)
DEGREES, KNOCKED = 10, 12
"""How far the camera is turned, and after how many steps: while the gripper is on its way."""
CALIBRATED, SERVO = "calibrated", "unified_servo"


class _FilmedFetch(gym.Wrapper[Any, Any, Any, Any]):
    """Takes a picture after each step of one episode.

    Attributes:
        frames: So far, with how far (m) the gripper is from the goal.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.frames: list[tuple[Image, float]] = []
        self._episodes = 0
        made: Any = env.unwrapped
        self._renderer = mujoco.Renderer(made.model, SIZE, SIZE)
        self._inset = mujoco.Renderer(made.model, INSET, INSET)
        self._view = mujoco.MjvCamera()
        self._view.lookat[:], self._view.distance = GRIPPER_AT_HOME, 1.3
        self._view.azimuth, self._view.elevation = 140, -20

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        found = self.env.reset(seed=seed, options=options)
        self._episodes += 1
        self._take()
        return found

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        found = self.env.step(action)
        self._take()
        return found

    def close(self) -> None:
        self._renderer.close()
        self._inset.close()
        super().close()

    def _take(self) -> None:
        if self._episodes != EPISODE + 1:
            return
        made: Any = self.env.unwrapped
        draw_goal(self.env)
        self._renderer.update_scene(made.data, self._view)
        self._inset.update_scene(made.data, CAMERA)
        picture = self._renderer.render().copy()
        picture[:INSET, -INSET:] = self._inset.render()
        self.frames.append((picture, float(np.linalg.norm(made.data.site(GRIPPER).xpos - made.goal))))


def add_film_knocked(parser: Parser) -> None:
    """Films FetchReach."""
    parser.add_argument("--out", type=Path, required=True, help="file.gif")
    parser.set_defaults(does=_film)


def _film(options: argparse.Namespace) -> int:
    try:
        panels = [_lived(name) for name in (CALIBRATED, SERVO)]
    except ModuleNotFoundError as error:
        raise ConfigError(f"{error}: FetchReach comes with gymnasium-robotics, see docs/perturb.md") from None
    last = len(panels[0]) - 1
    pictures = []
    for step, shown in enumerate(zip(*panels, strict=True)):
        picture = [
            _panel(frame, off, name, step, step == last)
            for name, (frame, off) in zip((CALIBRATED, SERVO), shown, strict=True)
        ]
        pictures.append(Pictures.fromarray(np.hstack(picture)))
    colours = pictures[last].quantize(256, Pictures.Quantize.MEDIANCUT)
    first, *others = (each.quantize(palette=colours, dither=Pictures.Dither.NONE) for each in pictures)
    made_folder(options.out.parent)
    lasts = [LASTS] * last + [END]
    first.save(options.out, "GIF", save_all=True, append_images=others, duration=lasts, loop=0)
    print(f"film: {options.out} ({options.out.stat().st_size / 1e6:.1f} MB)")
    return 0


def _lived(name: str) -> list[tuple[Image, float]]:
    """The frames of the episode that is shown, as one policy lives through it."""
    filmed: list[_FilmedFetch] = []

    def sees(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        filmed.append(_FilmedFetch(env))
        return points_of(filmed[0])

    learns = name == SERVO
    paired(
        fetch,
        partial(agents.make, name) if learns else Calibrated(),
        {name: aim(DEGREES, KNOCKED)},
        episodes=EPISODE + 1,
        learns=learns,
        success=succeeded,
        wrap=sees,
        images={CAMERA: None},
        per="episode",
    )
    filmed[0].close()
    return filmed[0].frames


def _panel(frame: Image, off: float, name: str, step: int, last: bool) -> Image:
    """A frame with words (SIZE + BAND, SIZE, 3)."""
    panel = Pictures.new("RGB", (SIZE, SIZE + BAND), DARK)
    panel.paste(Pictures.fromarray(frame), (0, 0))
    draw, small, usual = ImageDraw.Draw(panel), *map(ImageFont.load_default, (13, 17))
    colour = ALARM if step > KNOCKED else LIGHT
    draw.rectangle((SIZE - INSET - 1, 0, SIZE - 1, INSET), outline=colour, width=3)
    if step > KNOCKED:
        draw.text((SIZE - INSET, INSET + 4), f"camera turned by {DEGREES}°", ALARM, small)
    reached = off < SUCCESS
    said = f"{name}: {100 * off:.0f} cm off" + (", reached" if last and reached else "")
    draw.text((10, SIZE + BAND // 2), said, GOOD_NEWS if reached else LIGHT, usual, anchor="lm")
    return np.asarray(panel)
