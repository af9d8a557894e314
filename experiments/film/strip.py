"""A few moments of a film side by side, with words below: an agent at work, in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from PIL import Image as Pictures
from PIL import ImageDraw

from experiments.film.lettering import DARK, Image, fitting, font

MOST = 5
"""Moments in a strip."""
FEWEST = 4
"""Where there are fewer turns, looks are shown beside them."""
WIDTH = 400
"""Of a moment, in pixels."""
_GAP, _BELOW = 12, 44
"""Between moments, and for words below them, in pixels."""


class Moment(NamedTuple):
    """What may be shown.

    Attributes:
        picture: `WIDTH` wide (height, width, 3).
        words: Said of it.
        turn: Whether a trial ended, or the world was changed; else the agent just looks.
        change: Whether the world was changed.
    """

    picture: Image
    words: str
    turn: bool = False
    change: bool = False


def moment(picture: Image, words: str, turn: bool = False, change: bool = False) -> Moment:
    """A moment of a picture of any size."""
    size = WIDTH, round(len(picture) * WIDTH / picture.shape[1])
    return Moment(np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA)), words, turn, change)


def chosen(moments: Sequence[Moment]) -> list[Moment]:
    """At most `MOST`: from the turn before the first change on; without a change, evenly spaced."""
    turns = [each for each in moments if each.turn]
    shown = turns if len(turns) >= FEWEST else list(moments)
    change = next((place for place, each in enumerate(shown) if each.change), None)
    if change is not None:
        begin = max(0, min(change - 1, len(shown) - MOST))
        return shown[begin : begin + MOST]
    places = np.linspace(0, len(shown) - 1, min(MOST, len(shown))).round().astype(int)
    return [shown[place] for place in places]


def frame_strip(moments: Sequence[Moment]) -> Image:
    """Moments of one size side by side (height, width, 3), on white.

    Raises:
        ValueError: There is none.
    """
    if not moments:
        raise ValueError("a strip of no moments")
    height, step = len(moments[0].picture), WIDTH + _GAP
    strip = Pictures.new("RGB", (step * len(moments) - _GAP, height + _BELOW), "white")
    draw, usual = ImageDraw.Draw(strip), font(0.6 * _BELOW)
    for place, each in enumerate(moments):
        left = place * step
        strip.paste(Pictures.fromarray(each.picture), (left, 0))
        middle = left + WIDTH // 2, height + _BELOW // 2
        draw.text(middle, each.words, DARK, fitting(each.words, usual, WIDTH), anchor="mm")
    return np.asarray(strip)
