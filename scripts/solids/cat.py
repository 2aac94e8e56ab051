"""The cat: 114 lights in the plane. It sits and looks at the viewer, its tail around its side."""

from __future__ import annotations

import numpy as np

from solids.outlines import Array, lights, mirrored, on_glass, ring, smooth_curve, stroke

# The right half of what is symmetric, knots (L, H).
FOREHEAD = [(0.0, 21.3), (1.6, 21.15), (2.7, 20.8)]
EAR = [(2.7, 20.8), (4.0, 22.7), (5.3, 23.95)]
TEMPLE = [(5.3, 23.95), (5.95, 21.7), (6.1, 19.2)]
CHEEK = [(6.1, 19.2), (6.6, 16.7), (5.6, 14.2), (3.6, 12.7)]
CHIN = [(3.6, 12.7), (1.9, 12.1), (0.0, 11.95)]
FLANK = [(4.3, 11.2), (5.6, 8.9), (6.9, 6.0), (7.3, 3.2), (6.2, 0.9)]
FEET = [(6.2, 0.9), (4.4, 0.1), (2.6, 0.0), (1.0, 0.5)]
LEG = [(2.6, 7.4), (2.7, 4.9), (2.6, 2.4)]
EYE, EYE_RADII = (2.7, 17.4), (1.0, 0.85)
MOUTH = [(0.0, 14.4), (1.1, 13.65), (2.2, 14.2)]
WHISKERS = ([(7.7, 16.6), (9.2, 17.0), (10.6, 17.7)], [(7.5, 14.6), (9.0, 14.3), (10.5, 13.7)])

NOSE = [(0.0, 15.6)]
TAIL = [(7.75, 1.2), (9.9, 1.0), (11.6, 2.4), (11.6, 4.8), (10.4, 6.7), (10.9, 8.9), (12.6, 9.7)]


def make() -> Array:
    """The cat's points (114, 3), display cells."""
    half = np.vstack([
        lights(stroke(FOREHEAD, EAR), 5, ends="last"),
        lights(stroke(TEMPLE, CHEEK, CHIN), 14, ends="none"),
        lights(stroke(FLANK, FEET), 14),
        lights(smooth_curve(LEG, 40), 4),
        lights(ring(EYE, EYE_RADII, 90), 4, ends="first"),
        lights(smooth_curve(MOUTH, 40), 2, ends="last"),
        *[lights(smooth_curve(whisker, 40), 3) for whisker in WHISKERS],
    ])  # fmt: skip
    middle = np.array([FOREHEAD[0], *NOSE, MOUTH[0], CHIN[-1]])
    return on_glass(np.vstack([middle, mirrored(half), lights(smooth_curve(TAIL, 40), 12)]))
