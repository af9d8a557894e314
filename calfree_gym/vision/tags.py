"""Printed tags: two on the gripper's print, one on the object's, and a page with both to cut out.

All lengths are in cells, squares of which a tag has 6 × 6, unless they are said to be in mm.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import check_choice
from calfree_gym.files import whole

Array = NDArray[np.float64]
GRIPPER, OBJECT = (0, 1), 2
"""Numbers of the tags. The gripper point is midway between its two, the object point in the middle of its
own."""


@cache
def dictionary(count: int) -> cv2.aruco.Dictionary:
    """The first so many of ArUco's 50 tags of 4 × 4 bits within a black border; no bit may be wrong.

    Number 17 is seen in photographs that show no tag.
    """
    every = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return cv2.aruco.Dictionary(every.bytesList[:count], 4, 0)


TAGS = OBJECT + 1
"""How many there are."""
CELL = 40 / 6
"""In mm. Choice: a tag of 40 mm has 37 px at 0.6 m, where a webcam with 640 px sees 60 degrees."""
SPACING = 21.0
"""Between the middles of the gripper's tags: 140 mm. Computed: at the rendezvous, both prints tilted by up to
45 degrees, the object's hides a tag of the gripper in 1 % of directions; in 44 % at 110 mm."""
SQUARE: Array = 3.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
"""Corners of a tag (4, 2) about its middle, y down, in ArUco's order."""
_APART = np.array([SPACING / 2, 0])
PAIR: Array = np.concatenate([SQUARE - _APART, SQUARE + _APART])
"""Corners of the gripper's tags (8, 2) about the gripper point."""

PAPERS = {"A4": (210.0, 297.0), "Letter": (215.9, 279.4)}
"""Width and height in mm."""
_MARGIN = 1.0
"""Of white round a tag: by it ArUco tells a tag from what is behind it."""
_HALF = 3 + _MARGIN
_OUTER, _INNER = SPACING / 2 + _HALF, SPACING / 2 - _HALF
_CARD = [(-_HALF, -_HALF), (_HALF, -_HALF), (_HALF, _HALF), (-_HALF, _HALF)]
_ARCH = [(-_OUTER, -8), (_OUTER, -8), (_OUTER, _HALF), (_INNER, _HALF)]
_ARCH += [(_INNER, -6), (-_INNER, -6), (-_INNER, _HALF), (-_OUTER, _HALF)]
"""Outlines about the points that the prints mark. The arch leaves room for the object's tag at the
rendezvous, where these points are one."""
_POINTS_PER_MM = 72 / 25.4


def print_tags(path: str | Path, paper: str = "A4") -> None:
    """Writes a PDF of one page, in true size: both prints to cut out, and a ruler of 100 mm.

    Args:
        path: Of the file.
        paper: `"A4"` or `"Letter"`.

    Raises:
        OSError: The file cannot be written.
        ValueError: There is no such paper.
    """
    check_choice("paper", paper, PAPERS)
    width, height = PAPERS[paper]
    middle = width / 2
    page = [
        _text(middle - 85, 20, "Print at 100 %, on matt paper. This line must then be 100 mm long:"),
        *_ruler(middle - 50, 30),
        _text(middle - 85, 48, "Cut along the grey lines. Glue each print onto something stiff and flat."),
        *_print(_ARCH, zip(GRIPPER, (-SPACING / 2, SPACING / 2), strict=True), (middle, 118)),
        _text(middle - 14, 119.5, "gripper point"),
        _text(middle - 85, 161, "Above: for the gripper. Below: for the object."),
        *_print(_CARD, [(OBJECT, 0.0)], (middle, 205)),
    ]
    with whole(os.path.realpath(path)) as file:
        file.write(_pdf(width, height, "\n".join(page)))


def _print(
    outline: list[tuple[float, float]], tags: Iterable[tuple[int, float]], at: tuple[float, float]
) -> list[str]:
    """PDF operators that draw a print about a place in mm: its outline, and the tags in it at their x."""
    corners = [f"{x:.4f} {y:.4f}" for x, y in CELL * np.array(outline) + at]
    drawn = ["0.7 G 0.2 w", f"{corners[0]} m", *(f"{corner} l" for corner in corners[1:]), "s", "0 g"]
    for number, x in tags:
        black = np.argwhere(cv2.aruco.generateImageMarker(dictionary(TAGS), number, 6) == 0)
        for row, column in black.tolist():
            left, top = CELL * np.array([x + column - 3, row - 3]) + at
            drawn.append(f"{left:.4f} {top:.4f} {CELL:.4f} {CELL:.4f} re")
    return [*drawn, "f"]


def _ruler(x: float, y: float) -> list[str]:
    """PDF operators that draw 100 mm, each of them marked, to the right of a place in mm."""
    ends = [(mm, 6 if mm % 10 == 0 else 3) for mm in range(101)]
    ticks = [f"{x + mm:.4f} {y} m {x + mm:.4f} {y + length} l" for mm, length in ends]
    return ["0 G 0.1 w", *ticks, f"{x} {y} m {x + 100} {y} l", "S"]


def _text(x: float, y: float, text: str) -> str:
    """PDF operators that write a line of text, whose foot begins at a place in mm."""
    return f"0 g BT /F 4 Tf 1 0 0 -1 {x} {y} Tm ({text}) Tj ET"


def _pdf(width: float, height: float, operators: str) -> bytes:
    """A file of one page, drawn in mm from its upper left corner, that viewers print unscaled."""
    scale = _POINTS_PER_MM
    drawn = f"{scale:.6f} 0 0 {-scale:.6f} 0 {scale * height:.4f} cm\n{operators}"
    font = "<< /F << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >>"
    box = f"[0 0 {scale * width:.4f} {scale * height:.4f}]"
    objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Resources << /Font {font} >> /Contents 4 0 R >>",
        f"<< /Length {len(drawn)} >>\nstream\n{drawn}\nendstream",
    ]
    file, places = "%PDF-1.6\n", []
    for number, each in enumerate(objects, start=1):
        places.append(f"{len(file):010} 00000 n \n")
        file += f"{number} 0 obj\n{each}\nendobj\n"
    count = len(objects) + 1
    table = f"xref\n0 {count}\n0000000000 65535 f \n{''.join(places)}"
    trailer = f"trailer\n<< /Size {count} /Root 1 0 R >>\nstartxref\n{len(file)}\n%%EOF\n"
    return (file + table + trailer).encode("ascii")
