"""Triangulation: the angles under which three references must be seen put an FLS on two circles (three-object
triangulation by circle intersection, a yardstick of SwarMer, section 5).

The angle between two references lies on one circle through both; the two circles of three references meet in the second
of them, and in the position.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmer.plugins.fixing import FIXED, ArrayFixer, Fixes, Vectors

APART_MIN = 1.0  # cells between the two centres; nearer than that all four lie on one circle, or nearly
SAME = 1e-9  # cells
TURN = 2 * np.pi


class Triangulation(ArrayFixer):
    """Of the plane (L, H); in 3D the depth is kept, which is an experiment.

    Fails with `no_order`: no order of the three spans two angles below 180 degrees; `circles_too_close`: the circles
    are one, or nearly; `tangent`: they touch in the second reference alone; `degenerate`: two references in one place.
    """

    references = 3

    def fixes(self, measured: Vectors, ground_truth: Vectors, dim: int) -> Fixes:
        """See `ArrayFixer.fixes`."""
        ordered, alpha, beta, has_order = _in_order(measured[:, :, :2], ground_truth[:, :, :2])
        first, second, third = ordered[:, 0], ordered[:, 1], ordered[:, 2]
        with np.errstate(all="ignore"):  # what is not finite is found below
            centre_a, centre_b = _centre(first, second, alpha), _centre(second, third, beta)
            apart = np.linalg.norm(centre_a - centre_b, axis=1)
            w = (centre_a - centre_b) / apart[:, None]
            # The second reference, mirrored at the line through both centres.
            middle = centre_b + np.einsum("ij,ij->i", second - centre_b, w)[:, None] * w
            found = 2 * middle - second
            on_second = np.linalg.norm(found - second, axis=1) < SAME
        flat = (np.linalg.norm(first - second, axis=1) == 0) | (np.linalg.norm(second - third, axis=1) == 0)
        failure = np.select(
            [
                ~has_order,
                flat | ~np.isfinite(apart),
                apart < APART_MIN,
                ~np.isfinite(found).all(axis=1),
                on_second,
            ],
            ["no_order", "degenerate", "circles_too_close", "degenerate", "tangent"],
            FIXED,
        )
        vector = np.column_stack([found, np.zeros(len(found))])
        vector[failure != FIXED] = np.nan
        return Fixes(vector, failure, np.full(len(found), np.nan))


def _in_order(
    seen: Vectors, planned: Vectors
) -> tuple[Vectors, NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """The references counter-clockwise as planned, begun so that both angles are below 180 degrees where that goes."""
    bearing = np.arctan2(planned[:, :, 1], planned[:, :, 0]) % TURN
    order = np.argsort(bearing, axis=1, kind="stable")
    ahead = np.take_along_axis(bearing, order, axis=1)
    angle = (np.roll(ahead, -1, axis=1) - ahead) % TURN  # from each reference to the next
    fits = (angle > 0) & (angle < np.pi) & (np.sin(angle) != 0)
    both = fits & np.roll(fits, -1, axis=1)
    begin = both.argmax(axis=1)
    rows = np.arange(len(seen))
    turned = np.take_along_axis(order, (begin[:, None] + np.arange(3)) % 3, axis=1)
    return (
        np.take_along_axis(seen, turned[:, :, None], axis=1),
        angle[rows, begin],
        angle[rows, (begin + 1) % 3],
        both.any(axis=1),
    )


def _centre(one: Vectors, other: Vectors, angle: NDArray[np.float64]) -> Vectors:
    """Of the circle from which `one` and `other` are seen `angle` apart, counter-clockwise."""
    chord = other - one
    beside = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / (2 * np.tan(angle))[:, None]
    centre: Vectors = (one + other) / 2 + beside
    return centre
