"""The teapot: 100 lights in the plane, seen from the side, its spout to the right."""

from __future__ import annotations

import numpy as np

from solids.outlines import Array, lights, mirrored, on_glass, smooth_curve

# The right half of the pot, knots (L, H); it stands at L = 0.
BELLY = [(3.5, 12.2), (5.9, 10.8), (7.0, 8.2), (6.8, 5.4), (5.5, 3.0), (4.0, 1.4), (4.4, 0.0)]
BASE = [(4.4, 0.0), (0.0, 0.0)]
RIM = [(3.5, 12.2), (0.0, 12.2)]
LID = [(3.3, 13.4), (2.4, 14.8), (0.0, 15.6)]
KNOB = [(0.7, 16.7), (1.1, 17.9), (0.0, 18.9)]
BAND = [(6.6, 9.3), (3.5, 8.8), (0.0, 8.6)]
DOTS = [(1.5, 6.6), (4.5, 6.8), (3.0, 5.0)]

SPOUT_ABOVE = [(6.9, 8.0), (8.6, 8.6), (9.9, 10.4), (10.8, 12.4), (12.2, 13.3)]
SPOUT_BELOW = [(12.2, 13.3), (12.5, 12.4), (11.9, 9.6), (10.5, 6.6), (8.6, 4.7), (6.3, 4.2)]
HANDLE = [(-5.9, 10.8), (-7.6, 12.5), (-10.1, 12.1), (-11.25, 9.6), (-10.8, 6.6), (-8.8, 4.6), (-6.4, 4.2)]
STEAM = [(12.1, 15.4), (12.7, 17.2), (11.6, 19.1), (12.1, 20.8), (12.6, 22.2)]


def make() -> Array:
    """The teapot's points (100, 3), display cells."""
    half = np.vstack([
        lights(smooth_curve(BELLY, 40), 13),
        lights(smooth_curve(BASE, 40), 2, ends="none"),
        lights(smooth_curve(RIM, 40), 2, ends="none"),
        lights(smooth_curve(LID, 40), 3, ends="first"),
        lights(smooth_curve(KNOB, 40), 2, ends="first"),
        lights(smooth_curve(BAND, 40), 4, ends="none"),
        DOTS,
    ])  # fmt: skip
    middle = np.array([BASE[-1], RIM[-1], LID[-1], KNOB[-1], BAND[-1], (0.0, 5.0)])
    rest = [
        lights(smooth_curve(SPOUT_ABOVE, 40), 7, ends="last"),
        lights(smooth_curve(SPOUT_BELOW, 40), 9, ends="none"),
        lights(smooth_curve(HANDLE, 40), 14, ends="none"),
        lights(smooth_curve(STEAM, 40), 6),
    ]
    return on_glass(np.vstack([middle, mirrored(half), *rest]))
