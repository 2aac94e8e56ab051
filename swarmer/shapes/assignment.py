"""Who flies where when one shape becomes the next: pairs of FLSs and points with little squared distance in all.

Squared, because then nobody flies very far and straight ways hardly cross. Where the counts differ, the FLSs that
are farthest out of the way leave, or the points that are farthest from everybody get new FLSs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from swarmer.errors import BadInput
from swarmer.shapes.cloud import Points

Rows = NDArray[np.int64]

EXACT_PAIRS = 4_000_000  # pairs looked at to find the optimum: 2,000 FLSs and points, 32 MB, some seconds
BLOCK = 256  # FLSs that are assigned among themselves, optimally, where all together are too many
PASSES = 40  # over all blocks, each time other ones, at most
SOLVED = 12_000_000  # points in all passes together, about: what bounds the time for very many
ENOUGH = 5e-4  # share of the total: who gains less in a pass has nearly all there is to gain
SEED = 2312  # of the blocks; the result depends on the points alone
NOBODY = -1


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """Everybody's next point. Rows, 0-based, of the two clouds."""

    point_of: Rows  # (F,) the point that FLS i flies to, NOBODY if it leaves
    leaving: Rows  # FLSs without a point, ascending
    joining: Rows  # points without an FLS, ascending
    squared_cells: float  # sum over the pairs
    longest_cells: float  # way of a pair
    optimal: bool


def assign(current: Points, target: Points) -> Assignment:
    """Pair FLSs at `current` (F, 3) one to one with points `target` (G, 3), min(F, G) pairs; cells.

    Up to 2,000 of each, or where the few meet very many, the sum of the squared distances is the least possible
    (`optimal`; Crouse, On implementing 2D rectangular assignment algorithms, 2016). Beyond, both clouds are halved
    again and again by planes into blocks of some 256, which are solved optimally; then pairs that lie near each other
    are put together into other blocks and these solved, until that gains nothing worth it. Against the optimum of
    2,000 to 5,000 points the sum then is up to 3 % larger, mostly less than 1 %. The same points give the same pairs.
    Raises BadInput (`points`): no FLS, or no point, to pair.
    """
    for name, cloud in (("current", current), ("target", target)):
        if len(cloud) == 0:
            raise BadInput("points", 0, f"at least one {name} point")
    swapped = len(current) < len(target)
    many, few = (target, current) if swapped else (current, target)
    partner, optimal = _solved(many, few)
    ways = ((many[partner] - few) ** 2).sum(axis=1)
    spare = np.setdiff1d(np.arange(len(many)), partner)
    point_of, none = partner, spare[:0]
    if not swapped:
        point_of = np.full(len(many), NOBODY)
        point_of[partner] = np.arange(len(few))
    leaving, joining = (none, spare) if swapped else (spare, none)
    return Assignment(point_of, leaving, joining, float(ways.sum()), float(np.sqrt(ways.max())), optimal)


def _solved(many: Points, few: Points) -> tuple[Rows, bool]:
    """The row of `many` for each of `few` (G,), and whether their sum is the least."""
    worth = _candidates(many, few)
    if len(worth) * len(few) <= EXACT_PAIRS:
        return worth[_optimum(many[worth], few)], True
    partner = np.full(len(few), NOBODY)
    for ours, theirs in _halved(many, few):
        near = ours[_candidates(many[ours], few[theirs])]
        partner[theirs] = near[_optimum(many[near], few[theirs])]
    rng = np.random.default_rng(SEED)
    total = _total(many, few, partner)
    for _ in range(min(PASSES, max(1, SOLVED // len(many)))):
        before = total
        _improve(many, few, partner, rng)
        total = _total(many, few, partner)
        if before - total <= ENOUGH * before:
            break
    return partner, False


def _candidates(many: Points, few: Points) -> Rows:
    """Rows of `many` that an optimum can do with: of each of `few`, as many nearest ones as `few` has.

    Were it given another one, one of those would be free, and nearer.
    """
    if len(few) ** 2 > EXACT_PAIRS or len(few) == len(many):
        return np.arange(len(many))
    found = cKDTree(many).query(few, k=[*range(1, len(few) + 1)])[1]
    return np.unique(found).astype(np.int64)


def _optimum(many: Points, few: Points) -> Rows:
    return np.asarray(linear_sum_assignment(cdist(few, many, "sqeuclidean"))[1], dtype=np.int64)


def _total(many: Points, few: Points, partner: Rows) -> float:
    return float(((many[partner] - few) ** 2).sum())


def _halved(many: Points, few: Points) -> Iterator[tuple[Rows, Rows]]:
    """Rows of both clouds by blocks of at most BLOCK of the few, and never fewer of the many.

    Both are cut by one plane, in the middle of the few; each side keeps enough of the many.
    """
    left = [(np.arange(len(many)), np.arange(len(few)))]
    while left:
        ours, theirs = left.pop()
        if len(theirs) <= BLOCK:
            yield ours, theirs
            continue
        axis = int((np.ptp(few[theirs], axis=0) + np.ptp(many[ours], axis=0)).argmax())
        ours = ours[np.argsort(many[ours, axis], kind="stable")]
        theirs = theirs[np.argsort(few[theirs, axis], kind="stable")]
        half = len(theirs) // 2
        plane = few[theirs[half], axis]
        cut = int(np.searchsorted(many[ours, axis], plane))
        cut = min(max(cut, half), len(ours) - (len(theirs) - half))
        left += [(ours[cut:], theirs[half:]), (ours[:cut], theirs[:half])]


def _improve(many: Points, few: Points, partner: Rows, rng: np.random.Generator) -> None:
    """Solve other blocks, of pairs and spare ones that are near each other, in place. The sum never grows."""
    theirs = np.full(len(many), NOBODY)
    theirs[partner] = np.arange(len(few))
    place = many.copy()
    weight = rng.random()  # between where a pair starts and where it ends
    place[partner] = weight * many[partner] + (1 - weight) * few
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    for ours in _equal_blocks(place @ turn, rng):
        ends = theirs[ours]
        ends = ends[ends != NOBODY]
        if len(ends):
            partner[ends] = ours[_optimum(many[ours], few[ends])]


def _equal_blocks(place: Points, rng: np.random.Generator) -> Iterator[Rows]:
    """Rows of the places, of near ones together, about BLOCK each; cut at the middle or beside it."""
    left = [np.arange(len(place))]
    while left:
        rows = left.pop()
        if len(rows) <= BLOCK:
            yield rows
            continue
        axis = int(np.ptp(place[rows], axis=0).argmax())
        cut = int(len(rows) * rng.uniform(0.4, 0.6))
        rows = rows[np.argpartition(place[rows, axis], cut)]
        left += [rows[cut:], rows[:cut]]
