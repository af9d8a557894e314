"""What is written on a film's pictures: a caption, a legend, each trial's motions, announcements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from calfree_gym.engine.frames import GRIPPER_COLOUR, OBJECT_COLOUR

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

DARK, LIGHT = (30, 30, 34), (240, 240, 240)
ALARM, SUCCESS, FAILURE = (222, 80, 16), (40, 170, 105), (140, 140, 146)
GOOD_NEWS = (120, 225, 140)
LEGEND = (("gripper", GRIPPER_COLOUR), ("object", OBJECT_COLOUR), ("rings: seen", LIGHT))
"""From the left, under the caption."""
EXPECTED = ("crosses: expected", LIGHT)
"""Likewise, of agents that expect something."""
MOST_BARS = 10
"""Of so many trials, the last ones, bars are shown."""
FEWEST_MOTIONS, MOST_MOTIONS = 6, 14
"""Of the highest bar: those of more are not higher, and of fewer not as high."""

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
    """Writes on pictures of one size, and on a band below.

    Args:
        width: Of a picture, in pixels.
        scene: Of its scene, likewise.
        band: Height of the band, likewise.
    """

    def __init__(self, width: int, scene: int, band: int) -> None:
        self._width, self._scene, self._band = width, scene, band
        self._edge = round(0.18 * band)
        self._font, self._small, self._tiny = font(0.23 * band), font(0.18 * band), font(0.15 * band)

    def write(self, picture: Image, words: Words) -> Image:
        """The picture (height, width, 3) with what is written, (height + band, width, 3)."""
        height = len(picture)
        canvas = Pictures.new("RGB", (self._width, height + self._band), DARK)
        canvas.paste(Pictures.fromarray(picture), (0, 0))
        draw = ImageDraw.Draw(canvas)
        if words.announced:
            self._announce(draw, words.announced)
        self._below(draw, height, words)
        if words.trials:
            self._bars(draw, height, words)
        return np.asarray(canvas)

    def _announce(self, draw: ImageDraw.ImageDraw, text: str) -> None:
        high = round(0.5 * self._band)
        draw.rectangle((0, 0, self._scene, high), ALARM)
        fits = fitting(text, self._font, self._scene - 2 * self._edge)
        draw.text((self._scene // 2, high // 2), text, (255, 255, 255), fits, anchor="mm")

    def _below(self, draw: ImageDraw.ImageDraw, height: int, words: Words) -> None:
        """The caption, and under it the legend."""
        x, colour = float(self._edge), GOOD_NEWS if words.good else LIGHT
        fits = fitting(words.caption, self._font, self._scene - 2 * self._edge)
        draw.text((x, height + 0.34 * self._band), words.caption, colour, fits, anchor="lm")
        for text, colour in (*LEGEND, EXPECTED) if words.expected else LEGEND:
            draw.text((x, height + 0.72 * self._band), text, colour, self._small, anchor="lm")
            x += self._small.getlength(text + "   ")

    def _bars(self, draw: ImageDraw.ImageDraw, height: int, words: Words) -> None:
        """Motions of each trial, as bars; a line stands where the world was changed."""
        edge, left = self._edge, float(self._scene)
        ground, tallest = height + self._band - edge / 2, 0.38 * self._band
        draw.text((left, height + edge / 2), f"motions in each {words.unit}", LIGHT, self._small, anchor="lt")
        step = (self._width - left - edge) / MOST_BARS
        shown = words.trials[-MOST_BARS:]
        highest = min(max(FEWEST_MOTIONS, *(trial.motions for trial in shown)), MOST_MOTIONS)
        for trial in shown:
            bar = ground - tallest * min(1.0, trial.motions / highest)
            if trial.knocked:
                x = left - 0.15 * step
                draw.line((x, ground - 1.3 * tallest, x, ground), ALARM, max(2, self._band // 30))
            draw.rectangle((left, min(bar, ground - 2), left + 0.7 * step, ground), _COLOURS[trial.success])
            middle = left + 0.35 * step, bar - edge / 6
            draw.text(middle, f"{trial.motions}", LIGHT, self._tiny, anchor="mb")
            left += step


_COLOURS: dict[bool | None, Colour] = {None: LIGHT, True: SUCCESS, False: FAILURE}


def font(size: float) -> ImageFont.FreeTypeFont:
    """Pillow's own font, so many pixels high."""
    found = ImageFont.load_default(size)
    assert isinstance(found, ImageFont.FreeTypeFont), "Pillow has one of any size where it has FreeType"
    return found


def fitting(text: str, usual: ImageFont.FreeTypeFont, width: float) -> ImageFont.FreeTypeFont:
    """The font, or a smaller one where text would be wider than `width` pixels."""
    return font(usual.size * min(1.0, width / max(1.0, usual.getlength(text))))
