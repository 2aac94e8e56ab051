"""Who is whose planned neighbour in the ground truth (specs: R-Complete, rule 9).

`nearest` is the paper's: the η nearest points, a directed relation. `connected` is ours: those made
symmetric, plus the shortest links that make the whole graph connected, so that "every FLS has its
neighbours in its swarm" implies "one swarm".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from swarmer.errors import BadInput
from swarmer.shapes.bridges import shortest_bridges
from swarmer.shapes.cloud import Points

ETA = 5
MODES = ("connected", "nearest")
QUERIED = 1_000_000  # candidates looked at together: what bounds the memory

Rows = NDArray[np.int64]  # 0-based rows of the cloud; FID = row + 1
Cells = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NeighbourLists(Sequence[tuple[int, ...]]):
    """The planned neighbours of FID i + 1 at i: FIDs, nearest first, ties by lower FID.

    Held as two arrays, for a million FLSs would be gigabytes of tuples; each tuple is made when it is asked for.

    >>> lists = NeighbourLists(np.array([2, 1, 3, 2]), np.array([0, 1, 3, 4]))
    >>> lists[1], list(lists)
    ((1, 3), [(2,), (1, 3), (2,)])
    """

    fids: NDArray[np.integer]  # of all lists, one after the other
    starts: NDArray[np.integer]  # (F + 1,): list i is fids[starts[i]:starts[i + 1]]

    def __len__(self) -> int:
        return len(self.starts) - 1

    @overload
    def __getitem__(self, row: int) -> tuple[int, ...]: ...

    @overload
    def __getitem__(self, row: slice) -> tuple[tuple[int, ...], ...]: ...

    def __getitem__(self, row: int | slice) -> tuple[int, ...] | tuple[tuple[int, ...], ...]:
        if isinstance(row, slice):
            return tuple(self[at] for at in range(*row.indices(len(self))))
        at = range(len(self))[row]
        return tuple(self.fids[self.starts[at] : self.starts[at + 1]].tolist())


@dataclass(frozen=True, slots=True, eq=False)
class NeighbourPlan:
    """The planned neighbours of every FLS and what kind of graph they make."""

    neighbours: NeighbourLists
    eta: int  # resolved
    mode: str  # connected | nearest
    components: int  # of the η-nearest graph, links taken both ways, before any link was added
    added_links: int  # that joined those components; 0 in mode `nearest`
    longest_link_cells: float  # of the plan
    one_way_share: float  # of the η-nearest relation: pairs whose reverse is not in it
    mean_degree: float  # planned neighbours per FLS
    spacing_min_cells: float  # least distance of two points
    reach_cells: Cells  # (F,), from each FLS to its farthest planned neighbour


def neighbour_plan(points: Points, eta: int | None = None, mode: str = "connected") -> NeighbourPlan:
    """Plan the neighbours of all FLSs.

    points: (F, 3), display cells, all different. eta: None takes 5, or F - 1 if that is smaller.
    Ties of distance go to the lower FID. Raises BadInput (`eta`, `neighbours`).
    """
    count = len(points)
    eta = resolve_eta(eta, count)
    if mode not in MODES:
        raise BadInput("neighbours", mode, "connected (default) or nearest")
    nearest, distance = _nearest(points, eta)
    links = _keys(np.repeat(np.arange(count), eta), nearest.ravel(), count)
    del nearest
    links.sort()
    label = _labels(links, count)
    components, added = int(label.max()) + 1, 0
    one_way_share = _one_way_share(links, count)
    if mode == "connected":
        low, high = shortest_bridges(points, label).T
        added = len(low)
        links = np.concatenate(
            [links, _reversed(links, count), _keys(low, high, count), _keys(high, low, count)]
        )
        links = _each_once(links)
    lists, reach = _sorted_lists(points, links)
    return NeighbourPlan(
        neighbours=lists,
        eta=eta,
        mode=mode,
        components=components,
        added_links=added,
        longest_link_cells=float(reach.max()),
        one_way_share=one_way_share,
        mean_degree=len(lists.fids) / count,
        spacing_min_cells=float(distance[:, 0].min()),
        reach_cells=reach,
    )


def resolve_eta(eta: int | None, count: int) -> int:
    """η for `count` FLSs; None is 5, or count - 1 if smaller. Raises BadInput outside 1 to count - 1."""
    if eta is None:
        return min(ETA, count - 1)
    if not 1 <= eta <= count - 1:
        raise BadInput("eta", eta, f"1 to {count - 1} for {count} FLSs (default {min(ETA, count - 1)})")
    return int(eta)


def nearest_table(points: Points, k: int) -> tuple[NDArray[np.uint32], Cells]:
    """FIDs (F, k) of the k points nearest to each point, nearest first, and their distances (F, k), cells.

    points: (F, 3). k may be 0 to F - 1. Ties go to the lower FID. The point itself is not listed.
    Raises BadInput (`k`).
    """
    if not 0 <= k <= len(points) - 1:
        raise BadInput("k", k, f"0 to {len(points) - 1} for {len(points)} points")
    rows, distance = _nearest(points, k)
    return (rows + 1).astype(np.uint32), distance


def _nearest(points: Points, k: int) -> tuple[Rows, Cells]:
    """Rows (F, k) of the k nearest others and their distances, sorted by (distance, row)."""
    if k == 0:
        return np.zeros((len(points), 0), dtype=np.int64), np.zeros((len(points), 0))
    tree = cKDTree(points)
    near_ones = np.asarray(tree.indices)  # after one another: what the tree read is still at hand
    rows, squared = _ask(tree, points, near_ones, near_ones, k)
    return rows, np.sqrt(squared, out=squared)


def nearest_of(tree: cKDTree, points: Points, asking: Rows, k: int) -> tuple[Rows, Cells]:
    """Of each asking row of points the rows (n, k) of the k nearest others, sorted by (distance, row).

    tree: of the points. k: 1 to F - 1. Also gives the squared distances, (n, k).
    """
    return _ask(tree, points, asking, np.arange(len(asking)), k)


def _ask(tree: cKDTree, points: Points, asking: Rows, places: Rows, k: int) -> tuple[Rows, Cells]:
    """What `nearest_of` gives, that of the row asking[i] at places[i].

    A k-d tree breaks ties as it likes, so it is asked for more than k, and asked again for those
    whose tie with the k-th neighbour may reach beyond what it gave.
    """
    count = len(points)
    rows, squared = np.empty((len(asking), k), dtype=np.int64), np.empty((len(asking), k))
    left = np.arange(len(asking))
    asked = min(count, k + 3)
    while len(left):
        undecided = []
        for part in np.array_split(left, max(1, len(left) * asked // QUERIED)):
            found, apart = _candidates(tree, points, asking[part], asked)
            rows[places[part]], squared[places[part]] = found[:, :k], apart[:, :k]
            # The last one is the point itself, at infinity: the one before is the farthest asked for.
            open_tie = apart[:, -2] <= apart[:, k - 1] * (1 + 1e-9)
            undecided.append(part[open_tie] if asked < count else part[:0])
        left = np.concatenate(undecided)
        asked = min(count, 2 * asked)
    return rows, squared


def _candidates(tree: cKDTree, points: Points, part: Rows, asked: int) -> tuple[Rows, Cells]:
    _, found = tree.query(points[part], k=asked)
    squared = ((points[found] - points[part, None, :]) ** 2).sum(axis=2)
    squared[found == part[:, None]] = np.inf
    order = np.lexsort((found, squared), axis=1)
    return np.take_along_axis(found, order, axis=1), np.take_along_axis(squared, order, axis=1)


# A link from row i to row j is the number i * F + j: sorting and comparing those is cheap.


def _keys(start: Rows, end: Rows, count: int) -> Rows:
    return start * count + end


def _reversed(links: Rows, count: int) -> Rows:
    return _keys(links % count, links // count, count)


def _each_once(links: Rows) -> Rows:
    links.sort()
    return links[np.concatenate([[True], links[1:] != links[:-1]])]


def _labels(links: Rows, count: int) -> NDArray[np.int64]:
    ones = np.ones(len(links), dtype=np.int8)
    graph = coo_array((ones, (links // count, links % count)), shape=(count, count))
    return connected_components(graph.tocsr(), directed=False)[1].astype(np.int64)


def _one_way_share(links: Rows, count: int) -> float:
    """Of the sorted links, how many are not there the other way."""
    back = _reversed(links, count)
    at = np.minimum(np.searchsorted(links, back), len(links) - 1)
    return float(1 - (links[at] == back).mean())


def _sorted_lists(points: Points, links: Rows) -> tuple[NeighbourLists, Cells]:
    """The lists of the sorted links, each by distance, then FID; and the length of each list's last link."""
    count = len(points)
    start, end = links // count, links % count
    squared = np.empty(len(links))
    for chunk in np.array_split(np.arange(len(links)), 1 + len(links) // QUERIED):
        squared[chunk] = ((points[start[chunk]] - points[end[chunk]]) ** 2).sum(axis=1)
    order = np.lexsort((squared, start))  # stable: equal ones stay in the order of their FIDs
    starts = np.concatenate([[0], np.cumsum(np.bincount(start, minlength=count))])
    reach = np.sqrt(squared[order[starts[1:] - 1]])
    return NeighbourLists((end[order] + 1).astype(np.uint32), starts), reach
