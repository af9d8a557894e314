"""What is written on a film's pictures: a caption, a legend, each trial's motions, announcements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from calfree_gym.envs.rendering.scene_frame import GRIPPER_COLOUR, OBJECT_COLOUR

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

DARK, LIGHT = (30, 30, 34), (240, 240, 240)
ALARM, SUCCESS, FAILURE = (222, 80, 16), (24, 150, 90), (150, 150, 156)
GOOD_NEWS = (120, 225, 140)
LEGEND = (("gripper", GRIPPER_COLOUR), ("object", OBJECT_COLOUR), ("rings: seen", LIGHT))
"""From the left, at the right of the caption."""
EXPECTED = ("crosses: expected", LIGHT)
"""Likewise, of agents that expect something."""
MOST_BARS = 12
"""Of so many trials, the last ones, bars are shown."""
TALLEST = 3.0
"""A bar is at most so many captions high; bars of more motions than `MOST_MOTIONS` are not higher."""
MOST_MOTIONS = 12


COLOURS = (
    *(DARK, LIGHT, ALARM, SUCCESS, FAILURE, GOOD_NEWS, GRIPPER_COLOUR, OBJECT_COLOUR),
    *((255, 255, 255), (0, 0, 0)),
)
"""All that is drawn and written, but for the scene."""


class Trial(NamedTuple):
    """A bar.

    Attributes:
        motions: Made so far.
        success: Whether its task was done; None while it lasts.
        knocked: Whether the world was changed at its beginning or in it.
    """

    motions: int = 0
    success: bool | None = None
    knocked: bool = False


class Words(NamedTuple):
    """What a picture says.

    Attributes:
        caption: Below.
        good: Whether that is good news.
        announced: Across the scene; nothing, if empty.
        unit: What a trial is called.
        trials: All so far, also those that were not shown.
        expected: Whether the agent has expected anything so far.
    """

    caption: str
    good: bool = False
    announced: str = ""
    unit: str = "trial"
    trials: tuple[Trial, ...] = ()
    expected: bool = False


class Lettering:
    """Writes on pictures of one size, and a caption below.

    Args:
        width: Of a picture, in pixels.
        scene: Of its scene, likewise.
        caption: Height of the caption, likewise.
    """

    def __init__(self, width: int, scene: int, caption: int) -> None:
        self._width, self._scene, self._caption = width, scene, caption
        self._edge = round(0.35 * caption)
        self._font, self._small = font(0.42 * caption), font(0.34 * caption)

    def write(self, picture: Image, words: Words) -> Image:
        """The picture (height, width, 3) with what is written, (height + caption, width, 3)."""
        height = len(picture)
        canvas = Pictures.new("RGB", (self._width, height + self._caption), DARK)
        canvas.paste(Pictures.fromarray(picture), (0, 0))
        draw = ImageDraw.Draw(canvas, "RGBA")
        if words.trials:
            self._bars(draw, height, words)
        if words.announced:
            self._announce(draw, words.announced)
        self._below(draw, height, words)
        return np.asarray(canvas)

    def _announce(self, draw: ImageDraw.ImageDraw, text: str) -> None:
        draw.rectangle((0, 0, self._scene, self._caption), ALARM)
        middle = self._scene // 2, self._caption // 2
        fits = fitting(text, self._font, self._scene - 2 * self._edge)
        draw.text(middle, text, (255, 255, 255), fits, anchor="mm")

    def _below(self, draw: ImageDraw.ImageDraw, height: int, words: Words) -> None:
        """The caption, and as much of the legend as it leaves room for."""
        gap, middle = self._small.getlength("   "), height + self._caption // 2
        parts = (*LEGEND, EXPECTED) if words.expected else LEGEND
        legend = sum(self._small.getlength(text) + gap for text, _ in parts)
        room = self._width - 2 * self._edge
        fits = fitting(words.caption, self._font, room - legend)
        draw.text((self._edge, middle), words.caption, GOOD_NEWS if words.good else LIGHT, fits, anchor="lm")
        x = self._width - self._edge - legend + gap
        for text, colour in parts:
            draw.text((x, middle), text, colour, self._small, anchor="lm")
            x += self._small.getlength(text) + gap

    def _bars(self, draw: ImageDraw.ImageDraw, height: int, words: Words) -> None:
        """Motions of each trial, as bars over a line, with a line where the world was changed."""
        edge, step = self._edge, round(0.72 * self._caption)
        ground, title = height - edge, f"motions in each {words.unit}"
        top = ground - (TALLEST + 1.4) * self._caption
        shown = words.trials[-MOST_BARS:]
        wide = max(self._small.getlength(title), step * len(shown)) + 2 * edge
        draw.rectangle((0, top, wide, height), (255, 255, 255, 215))
        draw.text((edge, top + edge), title, DARK, self._small, anchor="lt")
        for place, trial in enumerate(shown):
            left = edge + place * step
            right, middle = left + 0.7 * step, left + 0.35 * step
            share = min(trial.motions, MOST_MOTIONS) / MOST_MOTIONS
            bar = ground - TALLEST * self._caption * share
            if trial.knocked:
                x = left - 0.15 * step
                draw.line((x, top + 3 * edge, x, ground), ALARM, max(2, self._caption // 14))
            draw.rectangle((left, min(bar, ground - 2), right, ground), _COLOURS[trial.success])
            draw.text((middle, bar - edge / 4), f"{trial.motions}", DARK, self._small, anchor="mb")


_COLOURS: dict[bool | None, Colour] = {None: DARK, True: SUCCESS, False: FAILURE}


def font(size: float) -> ImageFont.FreeTypeFont:
    """Pillow's own font, so many pixels high."""
    found = ImageFont.load_default(size)
    assert isinstance(found, ImageFont.FreeTypeFont), "Pillow has one of any size where it has FreeType"
    return found


def fitting(text: str, usual: ImageFont.FreeTypeFont, width: float) -> ImageFont.FreeTypeFont:
    """The font, or a smaller one where text would be wider than `width` pixels."""
    return font(usual.size * min(1.0, width / max(1.0, usual.getlength(text))))
