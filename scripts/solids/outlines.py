"""Drawings in the plane: smooth strokes with so many lights each.

Lengths are in display cells; a point is (L, H): length, height (up).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from solids.fields import Array, smooth_curve

Knots = Sequence[tuple[float, float]]
STEPS = 40  # pieces of a curve between two knots


def stroke(*pieces: Knots) -> Array:
    """Smooth curves one after the other, (N, 2), with a corner where one ends and the next begins."""
    return np.vstack([smooth_curve(knots, STEPS) for knots in pieces])


def ring(at: tuple[float, float], radii: tuple[float, float], turn_deg: float = 0.0) -> Array:
    """An ellipse (N, 2) that begins, and ends, `turn_deg` on from the right."""
    angle = np.radians(turn_deg + np.linspace(0, 360, 4 * STEPS + 1))
    return np.array(at) + np.column_stack([np.cos(angle), np.sin(angle)]) * np.array(radii)


def lights(curve: Array, count: int, ends: str = "both") -> Array:
    """`count` lights (count, 2) evenly along a curve (N, 2), by its length.

    ends: `both` are lit, only the `first`, only the `last`, or `none`; a closed curve wants `first`.
    """
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    run = np.concatenate([[0.0], np.cumsum(steps)])
    skipped, left = {"both": (0, 0), "first": (0, 1), "last": (1, 0), "none": (1, 1)}[ends]
    at = np.linspace(0, run[-1], count + skipped + left)[skipped : skipped + count]
    return np.column_stack([np.interp(at, run, axis) for axis in curve.T])


def mirrored(half: Array) -> Array:
    """The points and their images left of L = 0, (2 N, 2)."""
    return np.vstack([half, half * np.array([-1.0, 1.0])])


def on_glass(points: Array) -> Array:
    """Points (N, 2) as (N, 3), all of depth 0."""
    return np.column_stack([points, np.zeros(len(points))])
