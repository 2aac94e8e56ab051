"""The chess piece: a king as it falls, 454 lights, made from nothing but the numbers below.

A turned profile and a cross on top. The box is longest in depth, so the piece cannot stand: it topples
along the box's diagonal, foot towards the viewer, head up and away, as at the end of a lost game. The
cross and the turned edges come first; the surface gets what is left as blue noise.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from solids.fields import Array, boxed, drawn_on_sheets, evenly, smooth_curve, spread

COUNT = 454
BOX = (50.0, 50.0, 95.0)  # cells: length, height, depth
GAP = 1.4  # cells, between any two lights before the fit to the box
AXIS = (0.285, 0.285, -0.915)  # from foot to head, (L, H, D)
ROLL = np.radians(58.0)  # of the cross about the axis: broad to who sees the king from three quarters

# (along the axis from the foot, radius), from one edge to the next
BASE = [(0, 18.2), (4.5, 18.2), (6, 16.2), (10, 15.2), (13, 12.4)]
STEM = [(13, 12.4), (19, 9.4), (28, 7.4), (38, 6.4), (46.5, 6.2)]
COLLAR = [(46.5, 6.2), (47.5, 10.6), (49.5, 11.4), (52, 8.4), (53.5, 9.2), (55.5, 6.8)]
CROWN = [(55.5, 6.8), (61, 7.6), (66.5, 9.6), (72, 12.2)]
DOME = [(72, 12.2), (74, 10.2), (76.5, 7.0), (78.2, 3.4), (79.2, 2.6)]
RINGS = [(0, 18.2), (4.5, 18.2), (10, 15.2), (49.5, 11.4), (53.5, 9.2), (72, 12.2), (78.6, 3.0)]
# One half of the cross, (along, out).
CROSS = [(80, 2.6), (86, 1.6), (84.4, 7.4), (91.4, 7.4), (89.8, 1.6), (95.6, 3.0)]
CIRCLE = np.linspace(0, 2 * np.pi, 181)


def make() -> Array:
    """The king's points (454, 3), display cells, lower corner at 0."""
    turned = np.vstack([BASE, smooth_curve(STEM), COLLAR, smooth_curve(CROWN), smooth_curve(DOME)])
    candidates = drawn_on_sheets([_turned(*turned.T)], 30_000, seed=COUNT)
    weight = np.where(candidates[:, 2] > BASE[1][0], 1.0, 0.5)  # the wall of the base has its rims
    return boxed(_toppled(spread(np.vstack(_lines()), candidates, weight, COUNT, GAP)), BOX)


def _turned(along: Array, radius: Array) -> Array:
    """The sheet (N, 181, 3) of a profile turned about the third axis."""
    ring = np.broadcast_arrays(
        radius[:, None] * np.cos(CIRCLE), radius[:, None] * np.sin(CIRCLE), along[:, None]
    )
    return np.stack(ring, axis=-1)


def _toppled(own: Array) -> Array:
    """From upright on the third axis to (L, H, D), that axis along `AXIS`, the first one level."""
    axis = np.array(AXIS) / np.linalg.norm(AXIS)
    level = np.cross((0.0, 1.0, 0.0), axis)
    level /= np.linalg.norm(level)
    return np.asarray(own @ np.array([level, np.cross(axis, level), axis]))


def _lines() -> list[Array]:
    """The cross and the turned edges, most important first: where two meet, the first keeps its points."""
    half = np.array(CROSS)
    corners = np.vstack([half, half[::-1] * (1, -1), half[:1]])
    along, out = np.vstack([evenly(np.array(side), 1.6)[:-1] for side in pairwise(corners)]).T
    cross = np.column_stack([out * np.cos(ROLL), out * np.sin(ROLL), along])
    return [cross, *[_edge(*ring) for ring in RINGS]]


def _edge(along: float, radius: float) -> Array:
    """Lights around the axis, closer on the little ring that bears the cross."""
    circle = _turned(np.array([along]), np.array([radius]))[0]
    return evenly(circle, min(2.5, 0.6 * radius))[:-1]
