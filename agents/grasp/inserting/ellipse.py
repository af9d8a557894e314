"""The ellipse that a point traces which turns about an axis (Yoshimi & Allen 1994)."""

from __future__ import annotations

import numpy as np

from ...base.observation import Array


def ellipse_centre(points: Array) -> Array:
    """The centre (2,) of the ellipse that fits points (k, 2) best; their mean, where none does.

    By direct least squares (Halir & Flusser 1998), with points moved and scaled to about 1.
    """
    middle = points.mean(0)
    size = float(np.sqrt(np.square(points - middle).mean()))
    if len(points) < 6 or size == 0:
        return np.asarray(middle)
    x, y = ((points - middle) / size).T
    squares, lines = np.stack([x * x, x * y, y * y], 1), np.stack([x, y, np.ones_like(x)], 1)
    try:
        of_lines = -np.linalg.solve(lines.T @ lines, lines.T @ squares)
    except np.linalg.LinAlgError:
        return np.asarray(middle)
    reduced = squares.T @ squares + squares.T @ lines @ of_lines
    values, vectors = np.linalg.eig(np.stack([reduced[2] / 2, -reduced[1], reduced[0] / 2]))
    a, b, c = np.real(vectors)
    is_ellipse = 4 * a * c - b * b > 0
    if not is_ellipse.any():
        return np.asarray(middle)
    best = int(np.where(is_ellipse, np.abs(np.real(values)), np.inf).argmin())
    a, b, c = np.real(vectors[:, best])
    d, e, _ = of_lines @ np.real(vectors[:, best])
    centre = np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e])
    return np.asarray(middle + size * centre)
