"""Who sees whom in a round: the swarms as arrays, links to the nearest FLSs, and who challenges for each swarm.

A link leads from an FLS to one of its neighbours; it is live if the neighbour is of another swarm. Of a swarm the
member with the lowest FID that has a live link challenges (rules 3 and 4 of the rounds engine, docs/rounds.md).
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swarmer.shapes.neighbours import NeighbourLists, nearest_of

Rows = NDArray[np.int64]  # 0-based rows, in the order of FIDs
Vectors = NDArray[np.float64]
WIDEN_MAX = 4_000_000  # candidates looked at together while a swarm widens its range


class Swarms(NamedTuple):
    """The swarms at the start of a round, in the order of their Swarm-IDs."""

    ids: Rows  # (S,) lowest row of each
    of: Rows  # (F,) the swarm of each FLS
    members: Rows  # (F,) rows, swarm by swarm, each in the order of FIDs
    starts: Rows  # (S + 1,) where the members of each begin
    sizes: Rows  # (S,)

    @classmethod
    def of_ids(cls, xi: Rows) -> Swarms:
        """xi: (F,), the lowest row of the swarm of each FLS."""
        ids, of, sizes = np.unique(xi, return_inverse=True, return_counts=True)
        starts = np.concatenate([[0], np.cumsum(sizes)])
        return cls(ids, of, np.argsort(of, kind="stable"), starts, sizes)

    def __len__(self) -> int:
        return len(self.ids)


class Sight(Protocol):
    """Links of FLSs: `of` gives how many each has, and where they lead, nearest first, one list after the other."""

    def of(self, rows: Rows) -> tuple[Rows, Rows]: ...


class Nearest:
    """Links to the k nearest FLSs where they are; of equal distances the lower FID."""

    def __init__(self, position: Vectors, k: int, dim: int) -> None:
        self.position, self.k = position[:, :dim], k
        self.tree = cKDTree(self.position, balanced_tree=False)

    def of(self, rows: Rows) -> tuple[Rows, Rows]:
        near = nearest_of(self.tree, self.position, rows, self.k)[0]
        return np.full(len(rows), self.k), near.ravel()

    def widened(self, k: int) -> Nearest:
        """The same with more links."""
        wider = Nearest.__new__(Nearest)
        wider.position, wider.k, wider.tree = self.position, min(k, len(self.position) - 1), self.tree
        return wider


class Planned:
    """Links to the planned neighbours."""

    def __init__(self, lists: NeighbourLists, point: Rows) -> None:
        """point: (F,), which point of the plan each row has."""
        row = np.empty_like(point)
        row[point] = np.arange(len(point))
        starts = np.asarray(lists.starts, dtype=np.int64)
        counts = (starts[1:] - starts[:-1])[point]
        self._ends: Rows = row[lists.fids.astype(np.int64)[ranges(starts[point], counts)] - 1]
        self._starts: Rows = np.concatenate([[0], np.cumsum(counts)])

    def of(self, rows: Rows) -> tuple[Rows, Rows]:
        starts = self._starts[rows]
        counts = self._starts[rows + 1] - starts
        return counts, self._ends[ranges(starts, counts)]


class Links(NamedTuple):
    """The live links of each swarm's challenger; a swarm that sees nobody has none."""

    challenger: Rows  # (S,) row
    starts: Rows  # (S + 1,)
    ends: Rows  # rows, those of swarm s at starts[s]:starts[s + 1], nearest first


def challengers(sight: Sight, swarms: Swarms) -> Links:
    """Who challenges for each swarm, and whom it sees.

    Members are asked in the order of their FIDs, some of each swarm at a time: most swarms have their challenger at
    once, and a large one has it long before all of its members were asked.
    """
    challenger = swarms.members[swarms.starts[:-1]]
    found: list[tuple[Rows, Rows]] = []  # (swarm, row linked to)
    pending, asked, more = np.arange(len(swarms)), 0, 1
    blind: list[Rows] = []
    while len(pending):
        take = np.minimum(more, swarms.sizes[pending] - asked)
        rows = swarms.members[ranges(swarms.starts[pending] + asked, take)]
        at, ends = _live(sight, swarms, rows)
        seers, first = np.unique(
            at, return_index=True
        )  # rows that see an outsider, in the order of swarms and FIDs
        owners, lowest = np.unique(swarms.of[rows[seers]], return_index=True)
        challenger[owners] = rows[seers[lowest]]
        ending = np.append(first[1:], len(at))
        counts = (ending - first)[lowest]
        found.append((np.repeat(owners, counts), ends[ranges(first[lowest], counts)]))
        asked, more = asked + more, 2 * more
        left = np.setdiff1d(pending, owners, assume_unique=True)
        blind.append(left[swarms.sizes[left] <= asked])
        pending = left[swarms.sizes[left] > asked]
    if isinstance(sight, Nearest):
        for swarm in np.concatenate(blind).tolist():
            challenger[swarm], ends = _widened(sight, swarms, swarm)
            found.append((np.full(len(ends), swarm), ends))
    return _sorted(challenger, found)


def _live(sight: Sight, swarms: Swarms, rows: Rows) -> tuple[Rows, Rows]:
    """The live links of rows: places in `rows`, ascending, and the rows they lead to."""
    counts, ends = sight.of(rows)
    at = np.repeat(np.arange(len(rows)), counts)
    live = swarms.of[rows][at] != swarms.of[ends]
    return at[live], ends[live]


def live_links(sight: Sight, swarms: Swarms) -> tuple[Rows, Rows]:
    """All live links (u, v), by u, nearest first."""
    return _live(sight, swarms, np.arange(len(swarms.of)))


def _widened(sight: Nearest, swarms: Swarms, swarm: int) -> tuple[int, Rows]:
    """The challenger of a swarm none of whose members sees an outsider, and the nearest outsiders it sees.

    All members double their range until one sees an outsider; the one for whom it is the nearest by rank challenges.
    Where that would look at too many candidates, it is the one for whom it is the nearest by distance.
    """
    members = swarms.members[swarms.starts[swarm] : swarms.starts[swarm + 1]]
    wider = sight
    while wider.k < len(swarms.of) - 1:
        wider = wider.widened(2 * wider.k)
        if len(members) * wider.k > WIDEN_MAX:
            return _nearest_outsider(sight.position, members, np.flatnonzero(swarms.of != swarm))
        near = wider.of(members)[1].reshape(len(members), wider.k)
        outside = swarms.of[near] != swarm
        rank = np.where(outside.any(axis=1), outside.argmax(axis=1), wider.k)
        best = int(rank.argmin())
        if rank[best] < wider.k:
            return int(members[best]), near[best][outside[best]]
    raise AssertionError("two swarms see each other when they look at all FLSs")


def _nearest_outsider(position: Vectors, members: Rows, others: Rows) -> tuple[int, Rows]:
    distance, near = map(np.asarray, cKDTree(position[others]).query(position[members]))
    best = int(distance.argmin())
    return int(members[best]), others[near[best : best + 1]]


def _sorted(challenger: Rows, found: list[tuple[Rows, Rows]]) -> Links:
    owner = np.concatenate([owner for owner, _ in found])
    ends = np.concatenate([ends for _, ends in found])
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner, minlength=len(challenger))
    return Links(challenger, np.concatenate([[0], np.cumsum(counts)]), ends[order])


def ranges(starts: Rows, counts: Rows) -> Rows:
    """The numbers starts[i] to starts[i] + counts[i] - 1 of every i, one range after the other.

    >>> ranges(np.array([5, 0]), np.array([2, 3])).tolist()
    [5, 6, 0, 1, 2]
    """
    before = np.cumsum(counts) - counts
    return np.repeat(starts - before, counts) + np.arange(int(counts.sum()))
