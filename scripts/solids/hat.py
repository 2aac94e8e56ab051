"""The hat: a wizard's, 1562 lights, made from nothing but the numbers below.

Two sheets: an oval brim that waves, and a cone around a line that slouches and bends over. The lines
that the eye looks for come first: edge of the brim, band, buckle, moon and stars, folds, tip.
"""

from __future__ import annotations

import numpy as np

from solids.fields import Array, boxed, drawn_on_sheets, evenly, smooth_curve, spread

COUNT = 1562
BOX = (86.0, 95.0, 42.0)  # cells: length, height, depth
GAP = 1.3  # cells, between any two lights before the fit to the box

# The cone's middle line and its half widths: (L, H, 0, across, in depth).
CONE = [
    (0, 0, 0, 22.0, 14.5),
    (0, 4, 0, 20.0, 13.0),
    (-0.5, 14, 0, 18.4, 12.0),
    (-3, 31, 0, 15.0, 10.2),
    (-6.5, 46, 0, 12.0, 8.6),
    (-7, 55, 0, 9.4, 7.2),
    (-4, 65, 0, 9.4, 7.0),
    (1, 74, 0, 6.6, 5.4),
    (10, 82, 0, 5.6, 4.4),
    (20, 83, 0, 3.7, 3.0),
    (28, 77, 0, 2.2, 1.8),
    (32.5, 67, 0, 0.4, 0.4),
]
BRIM = (43.0, 21.0)  # half length, half depth of its edge
BAND = (3.0, 13.5)  # heights of its edges
BUCKLE = (8.0, 4.6)  # half widths of its outer and inner frame
# Creases that fan out from the kink: (height, turn) of both ends, heights along the middle line.
FOLDS = [((54.0, 0.15), (48.0, 1.9)), ((56.5, 0.15), (57.5, 1.6)), ((59.0, 0.15), (67.0, 1.9))]
SIGNS = [(3.2, 27.0, 6.3), (-8.8, 31.5, 4.7), (-3.0, 44.5, 4.2)]  # L, height, radius: moon, then stars
CLEAR = 1.9  # cells around moon and stars without lights
FINE = np.linspace(0, 2 * np.pi, 721)
LINE = smooth_curve(CONE, 40)
ALONG = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(LINE[:, :2], axis=0), axis=1))])


def make() -> Array:
    """The hat's points (1562, 3), display cells, lower corner at 0."""
    candidates = drawn_on_sheets([_cone_sheet(), _brim_sheet()], 60_000, seed=COUNT)
    points = spread(np.vstack(_lines()), candidates, _weight(candidates), COUNT, GAP)
    return boxed(points, BOX)


def _weight(points: Array) -> Array:
    """How dense the lights shall be on the surface: none in the band, so that its buckle stands out."""
    length, height, depth = points.T
    weight = np.where((depth < 0) & (height > BAND[1]), 0.75, 1.0)  # the back shines through
    for across, up, radius in SIGNS:
        weight[(depth > 0) & (np.hypot(length - across, height - up) < radius + CLEAR)] = 0.0
    weight[(height > BAND[0]) & (height < BAND[1]) & (np.hypot(length / 21, depth / 14) < 1)] = 0.0
    return weight


def _on_cone(height: Array, turn: Array) -> Array:
    """(N, 3) on the cone, `height` along its middle line, turned by `turn` radians: a quarter is the front."""
    columns = np.hstack([LINE, np.gradient(LINE[:, :2], axis=0)]).T
    across, up, _, wide, deep, *ahead = (np.interp(height, ALONG, column) for column in columns)
    right, down = np.array((ahead[1], ahead[0])) / np.hypot(*ahead)
    out = wide * np.cos(turn)
    return np.column_stack([across + right * out, up - down * out, deep * np.sin(turn)])


def _on_brim(share: Array, turn: Array) -> Array:
    """(N, 3) on the brim, from the cone (share 0) to the edge (1): its sides curl up, its front dips."""
    half_length, half_depth = (CONE[0][3 + i] + share * (BRIM[i] - CONE[0][3 + i]) for i in (0, 1))
    wave = 4.5 * np.cos(2 * turn + 0.5) - 1.6 * np.sin(turn - 0.4) - 1.0
    return np.column_stack([half_length * np.cos(turn), share**1.6 * wave, half_depth * np.sin(turn)])


def _cone_sheet() -> Array:
    height, turn = np.meshgrid(np.linspace(0, ALONG[-1], 160), FINE[::6], indexing="ij")
    return _on_cone(height.ravel(), turn.ravel()).reshape(*height.shape, 3)


def _brim_sheet() -> Array:
    share, turn = np.meshgrid(np.linspace(0, 1, 30), FINE[::4], indexing="ij")
    return _on_brim(share.ravel(), turn.ravel()).reshape(*share.shape, 3)


def _lines() -> list[Array]:
    """The lines the eye looks for, most important first: where two meet, the first keeps its points."""
    tip = _on_cone(np.array([ALONG[-1]]), np.zeros(1))
    edge = evenly(_on_brim(np.ones(len(FINE)), FINE), 1.45)[:-1]
    bands = [evenly(_on_cone(np.full(len(FINE), height), FINE), 1.5)[:-1] for height in BAND]
    stitches = evenly(_on_cone(np.full(len(FINE), sum(BAND) / 2), FINE), 2.9)[:-1]
    folds = [evenly(_on_cone(*np.linspace(start, end, 99).T), 1.4) for start, end in FOLDS]
    signs = [_moon(*SIGNS[0]), *[_star(*at) for at in SIGNS[1:]]]
    return [tip, edge, *_buckle(), *signs, *bands, stitches, *folds]


def _on_front(across: Array, height: Array) -> Array:
    """(N, 3) on the cone's front, at (L, H) seen flat on; for the cone's straight part."""
    wide = np.interp(height, *np.array(CONE)[:, [1, 3]].T)
    middle = np.interp(height, *np.array(CONE)[:, [1, 0]].T)
    deep = np.interp(height, *np.array(CONE)[:, [1, 4]].T)
    return np.column_stack([across, height, deep * np.sqrt(1 - ((across - middle) / wide) ** 2)])


def _buckle() -> list[Array]:
    """Two frames, one in the other, on the front of the band."""
    corners = np.array([(-1, -0.82), (1, -0.82), (1, 0.82), (-1, 0.82), (-1, -0.82)])
    return [_drawn(half * corners, 0.0, sum(BAND) / 2) for half in BUCKLE]


def _drawn(flat: Array, across: float, height: float) -> Array:
    """A closed outline (N, 2) around (across, height) as lights on the cone's front."""
    return evenly(_on_front(*(evenly(flat, 0.2) + (across, height)).T), 1.38)[:-1]


def _moon(across: float, height: float, radius: float) -> Array:
    outer = np.linspace(0.3 * np.pi, 1.9 * np.pi, 60)
    inner = np.linspace(1.72 * np.pi, 0.48 * np.pi, 60)
    bow = np.column_stack([np.cos(outer), np.sin(outer)])
    hollow = np.column_stack([0.32 + 0.74 * np.cos(inner), 0.08 + 0.74 * np.sin(inner)])
    return _drawn(radius * np.vstack([bow, hollow, bow[:1]]), across, height)


def _star(across: float, height: float, radius: float) -> Array:
    """Five rays from the middle."""
    turn = np.pi / 2 + np.arange(5) * 2 * np.pi / 5
    rays = [np.linspace((0, 0), (radius * np.cos(one), radius * np.sin(one)), 4)[1:] for one in turn]
    flat = np.vstack([np.zeros((1, 2)), *rays]) + (across, height)
    return _on_front(*flat.T)
