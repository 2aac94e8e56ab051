"""Hausdorff distance between where the FLSs are and where they should be (SwarMer, section 6).

HD = max(max_i min_j |e'_i - g_j|, max_j min_i |e'_i - g_j|), with e' the estimated truth after a translation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmer.errors import BadInput

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

BATCH = 64  # points that are asked for their nearest in one go, at first
Points = NDArray[np.float64]  # (n, 3), display cells


class EmptyCloud(BadInput):
    """A distance was asked between clouds of which one has no point."""

    def __init__(self, which: str) -> None:
        super().__init__(which, "0 points", "a Hausdorff distance needs at least 1 point on both sides")


def hausdorff(estimated: NDArray[Any], truth: NDArray[Any], translate: bool = True) -> float:
    """Hausdorff distance, by default after moving `estimated` until the two centroids coincide.

    estimated: (n, 3), truth: (m, 3), display cells; so is the result. Raises EmptyCloud if either has no point.

    >>> hausdorff(np.array([[0, 0, 0], [2, 0, 0]]), np.array([[0, 0, 0], [4, 0, 0]]))
    1.0
    >>> hausdorff(np.array([[0, 0, 0], [2, 0, 0]]), np.array([[0, 0, 0], [4, 0, 0]]), translate=False)
    2.0
    """
    moved, fixed = _checked(estimated, "estimated"), _checked(truth, "truth")
    if translate:
        moved = moved + (fixed.mean(axis=0) - moved.mean(axis=0))
    return _larger_of_both(moved, fixed, _tree(fixed))


class HausdorffMeter:
    """Reads the HD of a swarm again and again against one cloud; row i of a position is the FLS of truth's row i."""

    def __init__(self, truth: NDArray[Any]) -> None:
        """truth: (F, 3), display cells. Raises EmptyCloud."""
        self.truth: Points = _checked(truth, "truth").copy()
        self._whole_tree: cKDTree = _tree(self.truth)
        self._half_spacing = 0.5 * smallest_spacing(self.truth, self._whole_tree)

    def hd(self, position: Points, lit: NDArray[np.bool_] | None = None) -> float:
        """HD in cells of the lit FLSs and their points, translated by the mean of g_i - x_i over them.

        position: (F, 3), cells; lit: (F,), None for all. Raises EmptyCloud if nobody is lit. Of a single lit FLS it
        is 0, wherever that is: the move takes all of its error.
        """
        moved, fixed = self._lit(position, lit)
        return self._read(moved + (fixed - moved).mean(axis=0), fixed)

    def absolute(self, position: Points, lit: NDArray[np.bool_] | None = None) -> float:
        """HD in cells without any translation; arguments and errors as `hd`."""
        return self._read(*self._lit(position, lit))

    def by_fls(self, position: Points, lit: NDArray[np.bool_]) -> Points:
        """What each lit FLS and its point add to HD, (F,) cells, NaN while dark; the largest is the HD.

        It is the larger of two distances: from the FLS, translated as for `hd`, to the nearest point, and from its
        point to the nearest FLS. position: (F, 3), cells; lit: (F,). Raises EmptyCloud if nobody is lit.
        """
        moved, fixed = self._lit(position, lit)
        moved = moved + (fixed - moved).mean(axis=0)
        apart = np.full(len(self.truth), np.nan)
        apart[lit] = np.maximum(_tree(fixed).query(moved)[0], _tree(moved).query(fixed)[0])
        return apart

    def _lit(self, position: Points, lit: NDArray[np.bool_] | None) -> tuple[Points, Points]:
        if lit is None or lit.all():
            return position, self.truth
        if not lit.any():
            raise EmptyCloud("lit FLSs")
        return position[lit], self.truth[lit]

    def _read(self, moved: Points, fixed: Points) -> float:
        """HD of two clouds with pairwise rows.

        If no one is half the smallest spacing away from its own point, that point is everyone's nearest, and the
        other way round: the largest distance of a pair is the HD, and no tree is asked.
        """
        apart = np.sqrt(((moved - fixed) ** 2).sum(axis=1))
        farthest = float(apart.max())
        if farthest < self._half_spacing:
            return farthest
        tree = self._whole_tree if len(fixed) == len(self.truth) else _tree(fixed)
        order = np.argsort(apart)[::-1]
        one_way = _farthest_from(tree, moved, apart, order, 0.0)
        return _farthest_from(_tree(moved), fixed, apart, order, one_way)


def sampled_translation(errors: Points) -> Points:
    """The paper's other translation: of a sample's own errors the one that brings the sample nearest to its points.

    errors: (n, 3), g_k - x_k of n FLSs, cells. Result: (3,), the D_k with the least sum_j |D_k - D_j|; the first of
    equal ones (SwarMer, section 4.2, the simulator).

    >>> sampled_translation(np.array([[0.0, 0, 0], [1, 0, 0], [5, 0, 0]])).tolist()
    [1.0, 0.0, 0.0]
    """
    from scipy.spatial.distance import cdist

    best: Points = errors[int(np.argmin(cdist(errors, errors).sum(axis=1)))]
    return best


def smallest_spacing(truth: Points, tree: cKDTree | None = None) -> float:
    """Smallest distance between two of the (F, 3) points, cells; infinite for a single point."""
    if len(truth) < 2:
        return float("inf")
    distances = np.asarray((tree or _tree(truth)).query(truth, k=2)[0])
    return float(distances[:, 1].min())


def _farthest_from(
    tree: cKDTree, points: Points, apart: NDArray[np.float64], order: NDArray[np.intp], known: float
) -> float:
    """The largest distance of a point to its nearest in `tree`, or `known` if that is larger.

    No nearest is farther than the point's own partner, `apart` (n,) away. So they are asked by that, `order`, the
    farthest first, until the rest cannot change the answer: a few of thousands.
    """
    begin, some = 0, BATCH
    while begin < len(order) and apart[order[begin]] > known:
        rows = order[begin : begin + some]
        known = max(known, float(np.max(tree.query(points[rows])[0])))
        begin, some = begin + some, 2 * some
    return known


def _larger_of_both(moved: Points, fixed: Points, fixed_tree: cKDTree) -> float:
    to_fixed, to_moved = fixed_tree.query(moved)[0], _tree(moved).query(fixed)[0]
    return float(max(np.max(to_fixed), np.max(to_moved)))


def _tree(points: Points) -> cKDTree:
    from scipy.spatial import cKDTree

    return cKDTree(points)


def _checked(points: NDArray[Any], which: str) -> Points:
    array = np.asarray(points, dtype=np.float64)
    if array.size == 0:
        raise EmptyCloud(which)
    return array
