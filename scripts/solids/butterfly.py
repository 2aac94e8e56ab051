"""The small butterfly: 94 lights in the plane, its left half the mirror of its right."""

from __future__ import annotations

import numpy as np

from solids.outlines import Array, lights, mirrored, on_glass, smooth_curve, stroke

BODY = [(0.0, height) for height in (17.4, 16.0, 14.75, 13.5, 12.25, 11.0, 9.75, 8.5)]

# The right half, knots (L, H).
FOREWING = (
    [(1.15, 15.2), (4.2, 18.6), (7.6, 21.2), (11.1, 22.6)],
    [(11.1, 22.6), (12.0, 20.6), (11.4, 17.6), (10.0, 15.1), (8.6, 13.2)],
)
SEAM = [(8.6, 13.2), (5.0, 12.4), (1.2, 12.9)]
HINDWING = [(8.6, 13.2), (9.9, 10.6), (9.6, 7.4), (7.6, 4.6), (5.0, 3.0), (3.3, 4.6), (2.2, 7.4), (1.1, 10.2)]
ANTENNA = [(0.75, 18.4), (1.3, 20.1), (2.4, 21.6), (4.0, 22.4)]
SPOTS = [(9.7, 20.2), (9.5, 18.2), (8.4, 16.3), (7.7, 9.9), (7.5, 7.8), (6.2, 5.9)]  # along the margins


def make() -> Array:
    """The butterfly's points (94, 3), display cells."""
    half = np.vstack([
        lights(stroke(*FOREWING), 16),
        lights(smooth_curve(SEAM, 40), 5, ends="last"),
        lights(smooth_curve(HINDWING, 40), 12, ends="last"),
        lights(smooth_curve(ANTENNA, 40), 4),
        SPOTS,
    ])  # fmt: skip
    return on_glass(np.vstack([BODY, mirrored(half)]))
