"""The large butterfly: 1008 lights in the plane, its left half the mirror of its right.

Margins and body are lines of lights. Between the veins, which stay dark, lie patches of rows, like
the scales of a wing, with a blue noise in what the rows leave; along the borders runs a row of spots.
"""

from __future__ import annotations

import numpy as np
from shapely import LineString, Point, Polygon, contains_xy, unary_union

from solids.fields import evenly, fill_up, smooth_curve, thinned
from solids.outlines import Array, lights, mirrored, on_glass, ring, stroke

COUNT = 1008
GAP = 1.05  # cells, between any two lights
LINE = 1.1  # cells, between the lights of a line
ROW = 1.06  # cells, between the rows of a patch
GUTTER = 1.05  # cells, how far a vein darkens to each side
INSETS = (1.2, 1.75)  # cells, between the margin of the fore and hind wing and what is lit inside
SLIVER = 2.0  # cells², of a patch that is left out
DRAWN = 30_000  # places that the noise chooses from

SPINE = np.column_stack([np.zeros(16), np.linspace(8.4, 28.6, 16)])

# The right half, knots (L, H).
BODY = [
    (0.9, 28.0),
    (1.35, 26.6),
    (1.2, 25.4),
    (1.75, 23.4),
    (1.7, 20.8),
    (1.25, 18.8),
    (1.5, 15.6),
    (0.9, 9.6),
]
ANTENNA = [(0.8, 29.6), (1.9, 34.0), (4.6, 39.0), (8.4, 42.6), (10.4, 43.4)]

LEADING = [(1.7, 24.8), (5.6, 31.6), (13.0, 38.6), (22.0, 43.0), (30.4, 43.6)]
OUTER = [*LEADING, (31.2, 43.0), (31.9, 40.4), (31.6, 35.0), (29.8, 29.0), (27.4, 23.4)]
SEAM = [(27.4, 23.4), (18.0, 21.4), (8.5, 20.8), (1.8, 22.2)]
FORE_BORDER = [(24.0, 43.2), (27.8, 40.2), (27.6, 35.4), (26.0, 29.6), (23.6, 22.0)]
FORE_CELL = [(2.6, 23.9), (8.0, 29.6), (15.0, 34.4), (18.0, 32.4), (15.6, 28.0), (9.2, 24.6), (2.6, 22.9)]
FORE_VEINS = (
    [(15.0, 34.4), (21.0, 37.4), (27.8, 40.4)],
    [(18.0, 32.4), (23.0, 34.4), (28.4, 35.6)],
    [(16.8, 30.0), (21.6, 30.4), (27.0, 29.6)],
    [(14.0, 26.6), (19.0, 26.0), (25.0, 24.4)],
)

HINDWING = (
    [(27.4, 23.4), (29.8, 18.4), (29.4, 12.6), (26.2, 7.6), (23.6, 4.2), (22.8, 0.0)],
    [(22.8, 0.0), (20.2, 2.6), (18.0, 5.4), (12.0, 5.6), (6.8, 8.6), (3.4, 13.6), (1.8, 19.6)],
)
HIND_BORDER = [(24.4, 22.6), (26.0, 18.0), (25.4, 13.2), (22.4, 9.4), (16.8, 9.0), (11.0, 9.4), (6.6, 12.6)]
HIND_CELL = [(15.8, 21.4), (15.9, 18.0), (15.0, 15.2), (9.4, 15.6), (2.6, 18.4)]
HIND_VEINS = (
    [(15.0, 15.2), (16.4, 12.0), (16.8, 8.6)],
    [(9.4, 15.6), (10.4, 12.4), (10.6, 9.0)],
)
EYE, EYE_RADIUS = (21.7, 14.2), 2.35
SPOTS = (
    ([(27.6, 42.4), (29.8, 39.6), (29.6, 35.0), (28.0, 29.4), (25.8, 23.8)], 9),
    ([(26.6, 20.4), (27.9, 17.6), (27.4, 12.8), (24.4, 8.6), (22.4, 4.8)], 9),
    ([(18.6, 7.2), (12.4, 7.6), (7.6, 10.4), (4.6, 14.4)], 7),
)


def make() -> Array:
    """The butterfly's points (1008, 3), display cells."""
    patches = _patches()
    lines = np.vstack([SPINE, *_lines(), *_rows(patches)])
    candidates = _drawn_in(patches)
    count = (COUNT + len(SPINE)) // 2
    half = fill_up(thinned(lines, GAP), candidates, np.ones(len(candidates)), count)
    return on_glass(np.vstack([SPINE, mirrored(half[len(SPINE) :])]))


def _lines() -> list[Array]:
    """The lines of the right half, most important first: where two meet, the first keeps its lights."""
    return [
        *[evenly(smooth_curve(knots), LINE) for knots in (BODY, ANTENNA)],
        *[evenly(wing, LINE) for wing in (smooth_curve(OUTER), stroke(*HINDWING), smooth_curve(SEAM))],
        *[lights(smooth_curve(knots), count) for knots, count in SPOTS],
        np.array([EYE]),
        lights(ring(EYE, (EYE_RADIUS, EYE_RADIUS), 90), 12, ends="first"),
    ]


def _patches() -> list[Polygon]:
    """What is lit between the veins of the right wings, the largest first."""
    fore = Polygon(stroke(OUTER, SEAM)).buffer(-INSETS[0])
    fore &= Polygon(stroke(LEADING[:4], FORE_BORDER, [FORE_BORDER[-1], *SEAM[1:]]))
    hind = Polygon(stroke(*HINDWING, SEAM[::-1])).buffer(-INSETS[1])
    hind &= Polygon(stroke(SEAM[::-1], HIND_BORDER, [HIND_BORDER[-1], *HINDWING[1][-2:]]))
    veins = [smooth_curve(knots) for knots in (FORE_CELL, HIND_CELL, *FORE_VEINS, *HIND_VEINS)]
    dark = [LineString(vein).buffer(GUTTER) for vein in veins] + [Point(EYE).buffer(EYE_RADIUS)]
    rounded = (unary_union([fore, hind]) - unary_union(dark)).buffer(-0.35).buffer(0.35)
    return sorted((part for part in rounded.geoms if part.area > SLIVER), key=lambda part: -part.area)


def _rows(patches: list[Polygon]) -> list[Array]:
    """Lights along the outline of every patch, and along what is ROW cells further inside, and so on."""
    rows, left = [], list(patches)
    while left:
        rows += [evenly(np.array(patch.exterior.coords), LINE) for patch in left]
        inner = unary_union([patch.buffer(-ROW) for patch in left])
        left = [part for part in getattr(inner, "geoms", [inner]) if part.length > 0]
    return rows


def _drawn_in(patches: list[Polygon]) -> Array:
    rng = np.random.default_rng(COUNT)
    drawn = rng.uniform((1.8, 0.0), (32.0, 44.0), size=(DRAWN, 2))
    return drawn[np.any([contains_xy(patch, *drawn.T) for patch in patches], axis=0)]
