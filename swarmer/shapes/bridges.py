"""The shortest links that join separate parts of a cloud: a minimum spanning tree over the parts.

Borůvka's algorithm (1926): each part picks its shortest link to any other part, parts so linked become
one, until one is left. The order of links is total (squared length, lower row, higher row), so there is
one such tree, whatever the order of the parts. All parts look for their links together: the points lie
in a tree of boxes, and pairs of boxes are followed downwards as long as they may hold a shortest link,
box by box and level by level (after March, Ram and Gray, Fast Euclidean minimum spanning tree, 2010).
So neither many small parts nor a few large ones, near or far, cost much more than sorting the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from swarmer.shapes.cloud import Points

Rows = NDArray[np.int64]
Squares = NDArray[np.float64]  # squared distances, cells²

LEAF = 8  # points in a box that is not divided further, at most
PAIRS = 1 << 18  # pairs of boxes, or of points, looked at together: what bounds the memory
NO_PART = -1


def shortest_bridges(points: Points, label: NDArray[np.int64]) -> Rows:
    """Links (parts - 1, 2), pairs of rows, lower first, that join all parts with the least total length.

    points: (F, 3); label: (F,), which part each point belongs to, 0..parts - 1. The shortest comes first.
    """
    links = np.empty((0, 2), dtype=np.int64)
    if label.max() > 0:
        boxes = _boxes(points)
    while (parts := int(label.max()) + 1) > 1:
        picked = np.unique(_ways_out(boxes, label, parts), axis=0)
        links = np.concatenate([links, picked])
        ends = label[picked]
        graph = coo_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(parts, parts))
        label = connected_components(graph.tocsr(), directed=False)[1].astype(np.int64)[label]
    squared = ((points[links[:, 0]] - points[links[:, 1]]) ** 2).sum(axis=1)
    return links[np.lexsort((links[:, 1], links[:, 0], squared))]


# -- the tree of boxes -----------------------------------------------------------------------------------------------


class _Level(NamedTuple):
    low: Points  # (boxes, 3) corners of the boxes; box i holds the boxes 2i and 2i + 1 of the next level
    high: Points


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """The points halved across the widest side again and again, into 2^n boxes of equally many."""

    rows: Rows  # (2^n, size) of the points; some stand twice, to fill the last box
    at: Points  # (2^n, size, 3) where they are
    levels: list[_Level]  # from the one box around all to the 2^n


def _boxes(points: Points) -> _Boxes:
    depth = max(0, int(np.ceil(np.log2(len(points) / LEAF))))
    rows = np.arange(-(-len(points) // 2**depth) * 2**depth) % len(points)
    for level in range(depth):
        rows = rows.reshape(2**level, -1)
        inside = points[rows]
        widest = np.ptp(inside, axis=1).argmax(axis=1)
        along = np.take_along_axis(inside, widest[:, None, None], axis=2)[:, :, 0]
        halves = np.argpartition(along, rows.shape[1] // 2, axis=1)
        rows = np.take_along_axis(rows, halves, axis=1)
    rows = rows.reshape(2**depth, -1)
    at = points[rows]
    levels = [_Level(at.min(axis=1), at.max(axis=1))]
    while len(levels[0].low) > 1:
        low, high = (side.reshape(-1, 2, 3) for side in levels[0])
        levels.insert(0, _Level(low.min(axis=1), high.max(axis=1)))
    return _Boxes(rows, at, levels)


# -- one round: the shortest link of each part -----------------------------------------------------------------------


class _Round:
    """One round's search. `bound` falls to the squared length of each part's shortest link."""

    def __init__(self, boxes: _Boxes, label: NDArray[np.int64], parts: int) -> None:
        self.boxes = boxes
        self.label = label
        self.part = label[boxes.rows]  # (2^n, size)
        self.bound = self._first_bound(parts)
        # The largest part waits to be picked: every other one still finds its link, and it is the most work.
        self.bound[np.bincount(label).argmax()] = -1.0
        self.sole = self._sole_parts()
        self.found: list[_Links] = []

    def _first_bound(self, parts: int) -> Squares:
        """Points that follow one another in the boxes lie near each other; each part borders on another."""
        bound = np.full(parts, np.inf)
        part, at = self.part.ravel(), self.boxes.at.reshape(-1, 3)
        border = np.flatnonzero(part[1:] != part[:-1])
        squared = _squared(at[border] - at[border + 1])
        np.minimum.at(bound, part[border], squared)
        np.minimum.at(bound, part[border + 1], squared)
        return bound

    def _sole_parts(self) -> list[NDArray[np.int64]]:
        """For each level the part that a box's points all belong to, or NO_PART."""
        low, high = self.part.min(axis=1), self.part.max(axis=1)
        sole = [np.where(low == high, low, NO_PART)]
        while len(low) > 1:
            low, high = low.reshape(-1, 2).min(axis=1), high.reshape(-1, 2).max(axis=1)
            sole.insert(0, np.where(low == high, low, NO_PART))
        return sole

    def _reach(self, level: int) -> Squares:
        """How far (squared) the boxes of a level need to look: the largest bound among their points'."""
        largest = self.bound[self.part].max(axis=1)
        return np.asarray(largest.reshape(2**level, -1).max(axis=1))

    def search(self) -> Rows:
        """The shortest link (parts - 1, 2) of each part but the largest, lower row first."""
        one, other = np.zeros((2, 1), dtype=np.int64)
        for level in range(len(self.boxes.levels)):
            if level:
                one, other = self._descend(level, one, other)
        apart = self._apart(len(self.boxes.levels) - 1, one, other)
        nearest_first = np.argsort(apart, kind="stable")
        one, other, apart = one[nearest_first], other[nearest_first], apart[nearest_first]
        step = max(1, PAIRS // self.part.shape[1] ** 2)
        for start in range(0, len(one), step):
            chunk = slice(start, start + step)
            self._measure(one[chunk], other[chunk], apart[chunk])
        return self._shortest()

    def _descend(self, level: int, one: Rows, other: Rows) -> tuple[Rows, Rows]:
        """The pairs of boxes of `level`, inside those of the level above, that may hold a shortest link."""
        reach = self._reach(level)
        kept = []
        for start in range(0, len(one), PAIRS):
            above = one[start : start + PAIRS], other[start : start + PAIRS]
            here = np.concatenate([2 * above[0], 2 * above[0], 2 * above[0] + 1, 2 * above[0] + 1])
            there = np.concatenate([2 * above[1], 2 * above[1] + 1, 2 * above[1], 2 * above[1] + 1])
            mine = self.sole[level][here]
            use = (mine == NO_PART) | (mine != self.sole[level][there])
            here, there, mine = here[use], there[use], mine[use]
            use = self._apart(level, here, there) <= reach[here]
            here, there, mine = here[use], there[use], mine[use]
            whole = (mine != NO_PART) & (self.bound[mine] >= 0)
            np.minimum.at(self.bound, mine[whole], self._across(level, here[whole], there[whole]))
            kept.append((here, there))
        return np.concatenate([pair[0] for pair in kept]), np.concatenate([pair[1] for pair in kept])

    def _apart(self, level: int, here: Rows, there: Rows) -> Squares:
        """Squared distance of two boxes: rounded as for their points, so never more than two of these have."""
        low, high = self.boxes.levels[level]
        return _squared(np.maximum(0.0, np.maximum(low[there] - high[here], low[here] - high[there])))

    def _across(self, level: int, here: Rows, there: Rows) -> Squares:
        """The largest squared distance of two points in the two boxes."""
        low, high = self.boxes.levels[level]
        return _squared(np.maximum(high[there] - low[here], high[here] - low[there]))

    def _measure(self, one: Rows, other: Rows, apart: Squares) -> None:
        """Measure all pairs of points of the pairs of smallest boxes, unless better is known by now."""
        use = apart <= self.bound[self.part[one]].max(axis=1)
        one, other = one[use], other[use]
        here, there = self.boxes.at[one], self.boxes.at[other]
        squared = _squared(here[:, :, None, :] - there[:, None, :, :])
        mine, theirs = self.part[one][:, :, None], self.part[other][:, None, :]
        pair, i, j = np.nonzero((mine != theirs) & (squared <= self.bound[mine]))
        if len(pair):
            links = _Links.of(
                self.part[one[pair], i], squared[pair, i, j],
                self.boxes.rows[one[pair], i], self.boxes.rows[other[pair], j],
            )  # fmt: skip
            self.bound[links.part] = links.squared
            self.found.append(links)

    def _shortest(self) -> Rows:
        links = _Links.of(*(np.concatenate(column) for column in zip(*self.found, strict=True)))
        return np.column_stack([links.low, links.high])


class _Links(NamedTuple):
    """Links that leave `part`, each part at most once."""

    part: NDArray[np.int64]
    squared: Squares
    low: Rows
    high: Rows

    @classmethod
    def of(cls, part: NDArray[np.int64], squared: Squares, one: Rows, other: Rows) -> _Links:
        """The least of each part."""
        low, high = np.minimum(one, other), np.maximum(one, other)
        order = np.lexsort((high, low, squared, part))
        order = order[np.concatenate([[True], np.diff(part[order]) != 0])]
        return cls(part[order], squared[order], low[order], high[order])


def _ways_out(boxes: _Boxes, label: NDArray[np.int64], parts: int) -> Rows:
    return _Round(boxes, label, parts).search()


def _squared(difference: NDArray[np.float64]) -> Squares:
    x, y, z = difference[..., 0], difference[..., 1], difference[..., 2]
    return np.asarray(x * x + y * y + z * z)
