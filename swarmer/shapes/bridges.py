"""The shortest links that join separate parts of a cloud: a minimum spanning tree over the parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swarmer.shapes.cloud import Points

Rows = NDArray[np.int64]
SMALL = 32  # a part of at most this many points asks the common tree; a larger one the tree of the others


def shortest_bridges(points: Points, label: NDArray[np.int64]) -> Rows:
    """Links (parts - 1, 2), pairs of rows, lower first, that join all parts with the least total length.

    points: (F, 3); label: (F,), which part each point belongs to, 0..parts - 1.
    Borůvka's algorithm (1926): each part picks its shortest link to any other part, parts so linked
    become one, until one is left. The order of links is total (length, lower row, higher row), so
    the links do not depend on the order of the parts and never close a ring.
    """
    label = label.copy()
    tree = cKDTree(points)
    bridges: list[tuple[int, int]] = []
    while label.max() > 0:
        picked = {_shortest_link(points, tree, label, part) for part in range(label.max() + 1)}
        root = list(range(label.max() + 1))
        for _, low, high in sorted(picked):
            one, other = _find(root, int(label[low])), _find(root, int(label[high]))
            if one != other:
                root[max(one, other)] = min(one, other)
                bridges.append((low, high))
        label = np.unique([_find(root, part) for part in range(len(root))], return_inverse=True)[1][label]
    return np.array(bridges, dtype=np.int64).reshape(-1, 2)


def _shortest_link(
    points: Points, tree: cKDTree, label: NDArray[np.int64], part: int
) -> tuple[float, int, int]:
    """(squared length, lower row, higher row) of the least link that leaves `part`."""
    mine = np.flatnonzero(label == part)
    way_out = _way_out(points, tree, label, part, mine)
    radius = way_out.min() * (1 + 1e-9)  # with room for rounding: what is equal is decided below
    near = mine[way_out <= radius]
    links: list[tuple[float, int, int]] = []
    for row, found in zip(near.tolist(), tree.query_ball_point(points[near], radius), strict=True):
        foreign = np.array([other for other in found if label[other] != part], dtype=np.int64)
        squared = ((points[foreign] - points[row]) ** 2).sum(axis=1)
        links += [
            (length, min(row, other), max(row, other))
            for length, other in zip(squared.tolist(), foreign.tolist(), strict=True)
        ]
    return min(links)


def _way_out(
    points: Points, tree: cKDTree, label: NDArray[np.int64], part: int, mine: Rows
) -> NDArray[np.float64]:
    """Distance from each point of the part to the nearest point outside it."""
    if len(mine) > SMALL:
        others = points[label != part]
        return np.asarray(cKDTree(others).query(points[mine])[0])
    # Among its |part| + 1 nearest, itself included, a point of the part has one that is not in it.
    distance, found = tree.query(points[mine], k=len(mine) + 1)
    return np.asarray(np.where(label[found] != part, distance, np.inf).min(axis=1))


def _find(root: list[int], part: int) -> int:
    while root[part] != part:
        part = root[part]
    return part
