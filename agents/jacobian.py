"""The sensor-control Jacobian: solving -d = J c for control words (paper, section 3.2)."""

from __future__ import annotations

import numpy as np

from agents.agent import Array, Look


def solve(jacobian: Array, distance: Array, damping: float) -> Array:
    """Control words c (m,) that would make the image distance vanish if the world were linear.

    Four equations for three words are solved by least squares, which uses their redundancy [Maryniak,
    Graefe 1999]. Columns are scaled to equal length before they are damped: a word has no natural unit.

    Args:
        jacobian: Image distance by words (4, m); zero columns give zero words.
        distance: Image distance d (4,).
        damping: Relative to the columns' length.
    """
    lengths = np.sqrt((jacobian * jacobian).sum(0))
    scale = np.where(lengths > 0, lengths, 1.0)
    scaled = jacobian / scale
    normal = scaled.T @ scaled + damping**2 * np.eye(len(lengths))
    return np.asarray(-np.linalg.solve(normal, scaled.T @ distance) / scale)


def solve_within(jacobian: Array, distance: Array, damping: float, lowest: Array, highest: Array) -> Array:
    """As `solve`, but with words (m,) within bounds: a motor held back leaves its part to the others.

    Where holding motors back one after the other would end no nearer, all words are shortened alike: that
    always does.

    Args:
        jacobian: As for `solve`.
        distance: As for `solve`.
        damping: As for `solve`.
        lowest: Not above zero (m,).
        highest: Not below zero (m,).
    """
    words = wanted = solve(jacobian, distance, damping)
    free = np.ones(len(words), bool)
    for _ in range(len(words)):
        beyond = free & ((words < lowest) | (words > highest))
        if not beyond.any():
            break
        free &= ~beyond
        words = np.clip(words, lowest, highest)
        rest = distance + jacobian[:, ~free] @ words[~free]
        words[free] = solve(jacobian[:, free], rest, damping) if free.any() else 0.0
    words = np.clip(words, lowest, highest)
    bounds = np.where(wanted > 0, highest, lowest)
    moving = wanted != 0
    shortened = wanted * np.min(bounds[moving] / wanted[moving], initial=1.0)
    left, left_shortened = (np.linalg.norm(distance + jacobian @ each) for each in (words, shortened))
    return words if left <= left_shortened else shortened


def both_points(look: Look) -> Array:
    """Gripper and object points (8,): on the waist mount, words move both in the images."""
    return np.concatenate([look.gripper, look.object])


def distance_jacobian(points_jacobian: Array) -> Array:
    """The Jacobian of the image distance (4, m), from that of gripper and object points (8, m)."""
    return points_jacobian[:4] - points_jacobian[4:]
