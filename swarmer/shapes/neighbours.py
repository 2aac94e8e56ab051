"""Who is whose planned neighbour in the ground truth (specs: R-Complete, rule 9).

`nearest` is the paper's: the η nearest points, a directed relation. `connected` is ours: those made
symmetric, plus the shortest links that make the whole graph connected, so that "every FLS has its
neighbours in its swarm" implies "one swarm".
"""

from __future__ import annotations

from dataclasses import dataclass

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

Rows = NDArray[np.int64]  # 0-based rows of the cloud; FID = row + 1
Cells = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NeighbourPlan:
    """The planned neighbours of every FLS and what kind of graph they make."""

    neighbours: tuple[tuple[int, ...], ...]  # of FID i + 1 at i: FIDs, nearest first, ties by lower FID
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
    near = np.column_stack([np.repeat(np.arange(count), eta), nearest.ravel()])
    label = _labels(near, count)
    components = int(label.max()) + 1
    links, added = near, 0
    if mode == "connected":
        bridges = shortest_bridges(points, label)
        added = len(bridges)
        links = np.unique(np.concatenate([near, near[:, ::-1], bridges, bridges[:, ::-1]]), axis=0)
    neighbours, reach, degree = _sorted_neighbours(points, links, count)
    return NeighbourPlan(
        neighbours=neighbours,
        eta=eta,
        mode=mode,
        components=components,
        added_links=added,
        longest_link_cells=float(reach.max()),
        one_way_share=_one_way_share(near, count),
        mean_degree=float(degree.mean()),
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
    """Rows (F, k) of the k nearest others and their distances, sorted by (distance, row).

    A k-d tree breaks ties as it likes, so it is asked for more than k, and asked again for those
    whose tie with the k-th neighbour may reach beyond what it gave.
    """
    count = len(points)
    rows, distance = np.zeros((count, k), dtype=np.int64), np.zeros((count, k))
    if k == 0:
        return rows, distance
    tree = cKDTree(points)
    left = np.arange(count)
    asked = min(count, k + 9)
    while len(left):
        undecided = []
        for part in np.array_split(left, max(1, len(left) * asked // 2_000_000)):
            found, squared = _candidates(tree, points, part, asked)
            rows[part], distance[part] = found[:, :k], np.sqrt(squared[:, :k])
            # The last one is the point itself, at infinity: the one before is the farthest asked for.
            open_tie = squared[:, -2] <= squared[:, k - 1] * (1 + 1e-9)
            undecided.append(part[open_tie] if asked < count else part[:0])
        left = np.concatenate(undecided)
        asked = min(count, 2 * asked)
    return rows, distance


def _candidates(tree: cKDTree, points: Points, part: Rows, asked: int) -> tuple[Rows, Cells]:
    _, found = tree.query(points[part], k=asked)
    squared = ((points[found] - points[part, None, :]) ** 2).sum(axis=2)
    squared[found == part[:, None]] = np.inf
    order = np.lexsort((found, squared), axis=1)
    return np.take_along_axis(found, order, axis=1), np.take_along_axis(squared, order, axis=1)


def _labels(links: Rows, count: int) -> NDArray[np.int64]:
    graph = coo_array((np.ones(len(links), dtype=np.int8), (links[:, 0], links[:, 1])), shape=(count, count))
    return connected_components(graph.tocsr(), directed=False)[1].astype(np.int64)


def _one_way_share(near: Rows, count: int) -> float:
    there = near[:, 0] * count + near[:, 1]
    back = near[:, 1] * count + near[:, 0]
    return float(1 - np.isin(back, there).mean())


def _sorted_neighbours(
    points: Points, links: Rows, count: int
) -> tuple[tuple[tuple[int, ...], ...], Cells, NDArray[np.int64]]:
    squared = ((points[links[:, 0]] - points[links[:, 1]]) ** 2).sum(axis=1)
    links = links[np.lexsort((links[:, 1], squared, links[:, 0]))]
    degree = np.bincount(links[:, 0], minlength=count)
    end = np.cumsum(degree)
    fids = (links[:, 1] + 1).tolist()
    neighbours = tuple(
        tuple(fids[last - size : last]) for last, size in zip(end.tolist(), degree.tolist(), strict=True)
    )
    farthest = links[end - 1]
    reach = np.sqrt(((points[farthest[:, 0]] - points[farthest[:, 1]]) ** 2).sum(axis=1))
    return neighbours, reach, degree
