"""Trilateration: the distances that three references must have put an FLS where their circles meet (a yardstick of
SwarMer, section 5). In 3D it takes four references and the spheres around them.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swarmer.plugins.fixing import FIXED, ArrayFixer, Fixes, Vectors

PAIRS = tuple(combinations(range(3), 2))
SLACK = 1e-12  # of the radii: circles that touch still meet when their distance was rounded up
ALIKE = 1e-9  # cells: two points that fit the third circle equally well
FLAT = 1e-9  # of the largest singular value: below it four references lie in one plane


class Trilateration(ArrayFixer):
    """Two circles meet in two points; the third distance says which. Fails with `no_intersection`, in 3D `coplanar`.

    That the three circles do not meet in one point is no failure: the measured distances are those of the ground
    truth, the references stand elsewhere. By how much they miss is the residual.
    """

    references = 3
    references_3d = 4

    def fixes(self, measured: Vectors, ground_truth: Vectors, dim: int) -> Fixes:
        """See `ArrayFixer.fixes`."""
        radius = np.linalg.norm(ground_truth, axis=2)
        return _in_plane(measured[:, :, :2], radius) if dim == 2 else _in_space(measured, radius)


def _in_plane(centre: Vectors, radius: NDArray[np.float64]) -> Fixes:
    """The first pair of circles that meet decides."""
    count = len(centre)
    vector, residual = np.full((count, 3), np.nan), np.full(count, np.nan)
    for one, other in PAIRS:
        left = np.flatnonzero(np.isnan(residual))
        third = 3 - one - other
        found, off, meet = _meeting(
            centre[left][:, [one, other, third]], radius[left][:, [one, other, third]]
        )
        rows = left[meet]
        vector[rows, :2], vector[rows, 2], residual[rows] = found[meet], 0.0, off[meet]
    return Fixes(vector, np.where(np.isnan(residual), "no_intersection", FIXED), residual)


def _meeting(
    centre: Vectors, radius: NDArray[np.float64]
) -> tuple[Vectors, NDArray[np.float64], NDArray[np.bool_]]:
    """Where the first two circles meet, of the two points the one that fits the third; how far it misses that; whether
    they meet at all. Where both fit, the third centre being in line with the others, the one nearer to the FLS.
    """
    r1, r2, r3 = radius.T
    between = centre[:, 1] - centre[:, 0]
    d = np.linalg.norm(between, axis=1)
    slack = SLACK * (r1 + r2)
    meet = (d > 0) & (d <= r1 + r2 + slack) & (d >= np.abs(r1 - r2) - slack)
    u = between / np.where(d > 0, d, 1.0)[:, None]
    a = (r1**2 - r2**2 + d**2) / (2 * np.where(d > 0, d, 1.0))
    h = np.sqrt(np.maximum(0.0, r1**2 - a**2))
    foot, side = centre[:, 0] + a[:, None] * u, h[:, None] * np.stack([-u[:, 1], u[:, 0]], axis=1)
    points = np.stack([foot + side, foot - side])  # (2, n, 2)
    off = np.abs(np.linalg.norm(points - centre[:, 2], axis=2) - r3)
    way = np.linalg.norm(points, axis=2)  # the FLS is at 0
    alike = np.abs(off[0] - off[1]) < ALIKE
    which = np.where(alike, way[1] < way[0], off[1] < off[0]).astype(np.int64)
    rows = np.arange(len(centre))
    return points[which, rows], off[which, rows], meet


def _in_space(centre: Vectors, radius: NDArray[np.float64]) -> Fixes:
    """Least squares of the spheres less the last of them, which is linear."""
    matrix = 2 * (centre[:, :-1] - centre[:, -1:])
    squares = (centre**2).sum(axis=2) - radius**2
    right = squares[:, :-1] - squares[:, -1:]
    left_vectors, values, right_vectors = np.linalg.svd(matrix, full_matrices=False)
    flat = values[:, -1] <= FLAT * values[:, 0]
    inverse = 1 / np.where(flat[:, None], 1.0, values)
    turned = np.einsum("nij,ni->nj", left_vectors, right) * inverse
    vector = np.einsum("nji,nj->ni", right_vectors, turned)
    vector[flat] = np.nan
    residual = np.abs(np.linalg.norm(vector[:, None] - centre, axis=2) - radius).max(axis=1)
    return Fixes(vector, np.where(flat, "coplanar", FIXED), residual)
