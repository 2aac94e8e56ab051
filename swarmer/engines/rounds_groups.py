"""Who localizes relative to whom in a round (rules 5 to 7 of the rounds engine, docs/rounds.md).

Loops over swarms, not over FLSs: each challenger has a handful of links, and a plain loop over lists takes some
microseconds per swarm, of which there are ever fewer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swarmer.engines.rounds_links import Links, Rows, Swarms, Vectors
from swarmer.shapes.neighbours import nearest_of

FREE = -1
Ranks = NDArray[np.int64]


class Groups(NamedTuple):
    """The localizations of a round, as arrays of one entry each, in the order in which they were agreed."""

    localizer: Rows  # FLS that localizes
    anchor: Rows  # FLS relative to which
    swarm: Rows  # the localizer's, which follows
    anchor_swarm: Rows
    wave: Rows  # 1 where the anchor's swarm stands still, 1 more than its wave where it localizes, too
    busy_joins: int

    def measuring(self, absolute: NDArray[np.bool_]) -> Groups:
        """Without those in which nobody measures or flies, for both swarms are absolute. absolute: (S,)."""
        if not absolute.any():
            return self
        kept = ~absolute[self.swarm]  # an absolute swarm is never corrected by one that is not
        return Groups(
            self.localizer[kept], self.anchor[kept], self.swarm[kept], self.anchor_swarm[kept], self.wave[kept],
            self.busy_joins,
        )  # fmt: skip


@dataclass(slots=True)
class _Agreed:
    """Groups while they are made."""

    localizer: list[int] = field(default_factory=list)
    anchor: list[int] = field(default_factory=list)
    swarm: list[int] = field(default_factory=list)
    anchor_swarm: list[int] = field(default_factory=list)
    wave: list[int] = field(default_factory=list)
    busy_joins: int = 0

    def add(self, localizer: int, anchor: int, swarm: int, anchor_swarm: int, wave: int) -> None:
        self.localizer.append(localizer)
        self.anchor.append(anchor)
        self.swarm.append(swarm)
        self.anchor_swarm.append(anchor_swarm)
        self.wave.append(wave)

    def groups(self) -> Groups:
        return Groups(
            localizer=np.array(self.localizer, dtype=np.int64),
            anchor=np.array(self.anchor, dtype=np.int64),
            swarm=np.array(self.swarm, dtype=np.int64),
            anchor_swarm=np.array(self.anchor_swarm, dtype=np.int64),
            wave=np.array(self.wave, dtype=np.int64),
            busy_joins=self.busy_joins,
        )


class Selection(NamedTuple):
    """Who becomes the anchor of a group: an absolute swarm, else that of the lowest rank or always the challenger's."""

    rank: Ranks  # (S,), all different
    challenger: bool
    absolute: NDArray[np.bool_]  # (S,), an oracle is in it

    def first(self, one: int, other: int) -> bool:
        """Of a challenging swarm and another one: does `one`, which challenges, anchor?"""
        if self.absolute[one] != self.absolute[other]:
            return bool(self.absolute[one])
        return self.challenger or bool(self.rank[one] < self.rank[other])


def select_anchors(
    strategy: str, swarms: Swarms, rng: np.random.Generator, absolute: NDArray[np.bool_]
) -> Selection:
    """Ranks of the swarms by an anchor strategy; ties go to the lower Swarm-ID (rule 7).

    largest, smallest: by size; lowest: by Swarm-ID; challenger; random: drawn anew for each round.
    """
    count = len(swarms)
    if strategy == "random":
        return Selection(rng.permutation(count), False, absolute)
    rank = np.arange(count)
    if strategy in ("largest", "smallest"):
        sign = -1 if strategy == "largest" else 1
        rank[np.argsort(sign * swarms.sizes, kind="stable")] = np.arange(count)
    return Selection(rank, strategy == "challenger", absolute)


def group_all(links: Links, swarms: Swarms, order: Rows, selection: Selection) -> Groups:
    """M = ∞: each free swarm, in the order given, gathers the free swarms that its challenger sees; one anchors.

    A challenger that sees busy swarms alone localizes relative to the nearest FLS it sees, and joins. An absolute swarm
    joins none but those that will be absolute, or waits for the next round.
    """
    agreed = _Agreed()
    wave = [FREE] * len(swarms)
    absolute = selection.absolute.tolist()  # that it is when this round ends, too
    rank, by_challenger = selection.rank.tolist(), selection.challenger
    starts, ends, seen = links.starts.tolist(), links.ends.tolist(), swarms.of[links.ends].tolist()
    challenger = links.challenger.tolist()
    for swarm in order.tolist():
        if wave[swarm] != FREE:
            continue
        begin, end = starts[swarm], starts[swarm + 1]
        group = {swarm: challenger[swarm]}
        for at in range(begin, end):
            other = seen[at]
            if wave[other] == FREE and other not in group:
                group[other] = ends[at]
        if len(group) > 1:
            known = [member for member in group if absolute[member]] or group
            best = swarm if by_challenger and swarm in known else min(known, key=rank.__getitem__)
            for member, row in group.items():
                wave[member] = 0 if member == best else 1
                if member != best:
                    agreed.add(row, group[best], member, best, 1)
                absolute[member] = absolute[best]
        else:
            at = begin
            if absolute[swarm]:
                at = next((at for at in range(begin, end) if absolute[seen[at]]), end)
            if at < end:
                wave[swarm] = wave[seen[at]] + 1
                agreed.add(challenger[swarm], ends[at], swarm, seen[at], wave[swarm])
                agreed.busy_joins += 1
                absolute[swarm] = absolute[seen[at]]
    return agreed.groups()


def pair_fast(links: tuple[Rows, Rows], position: Vectors, swarms: Swarms, selection: Selection) -> Groups:
    """M = 2: pairs along live links (u, v) in their order, u challenging; then the lowest FIDs of those left over,
    mutually nearest ones first, until at most one swarm is left.
    """
    agreed = _Agreed()
    free = [True] * len(swarms)
    u, v = links
    for row, other_row, one, other in zip(
        u.tolist(), v.tolist(), swarms.of[u].tolist(), swarms.of[v].tolist(), strict=True
    ):
        if free[one] and free[other]:
            free[one] = free[other] = False
            _pair(agreed, (row, one), (other_row, other), selection.first(one, other))
    left = np.flatnonzero(free)
    while len(left) > 1:
        rows = swarms.members[swarms.starts[left]]
        here = position[rows]
        near = nearest_of(cKDTree(here), here, np.arange(len(left)), 1)[0][:, 0]
        mutual = np.flatnonzero((near[near] == np.arange(len(left))) & (near > np.arange(len(left))))
        for at in mutual.tolist():
            one, other = int(left[at]), int(left[near[at]])
            _pair(agreed, (int(rows[at]), one), (int(rows[near[at]]), other), selection.first(one, other))
        paired = np.concatenate([mutual, near[mutual]])
        left = np.delete(left, paired)
    return agreed.groups()


def pair_exact(position: Vectors, swarms: Swarms, absolute: NDArray[np.bool_]) -> Groups:
    """M = 2 as the authors' program: in the order of FIDs the lowest FID of each free swarm localizes relative to the
    nearest FLS of any free swarm, unless its own swarm alone is absolute. Each looks at all FLSs that are left, so the
    time grows with the square of F.
    """
    agreed = _Agreed()
    free = np.ones(len(swarms), dtype=np.bool_)
    candidates = np.arange(len(position))
    pairs_since = 0
    for swarm in range(len(swarms)):
        if not free[swarm]:
            continue
        free[swarm] = False
        if pairs_since >= 16:  # to strike out those taken costs about as much as to look at them some times
            candidates, pairs_since = candidates[free[swarms.of[candidates]]], 0
        row = int(swarms.members[swarms.starts[swarm]])
        offset = position[candidates] - position[row]
        squared = np.einsum("ij,ij->i", offset, offset)
        squared[~free[swarms.of[candidates]]] = np.inf
        best = int(np.argmin(squared)) if len(squared) else 0
        if not len(squared) or squared[best] == np.inf:
            break
        anchor = int(candidates[best])
        other = int(swarms.of[anchor])
        free[other] = False
        _pair(agreed, (row, swarm), (anchor, other), bool(absolute[swarm] and not absolute[other]))
        pairs_since += 1
    return agreed.groups()


def _pair(agreed: _Agreed, one: tuple[int, int], other: tuple[int, int], one_anchors: bool) -> None:
    """one, other: (row, swarm)."""
    anchor, localizer = (one, other) if one_anchors else (other, one)
    agreed.add(localizer[0], anchor[0], localizer[1], anchor[1], 1)


def merged(swarms: Swarms, groups: Groups) -> Rows:
    """(F,): the lowest row of the swarm of each FLS after the merges (rule 9)."""
    parent = np.arange(len(swarms))
    parent[groups.swarm] = groups.anchor_swarm
    while True:
        above = parent[parent]
        if np.array_equal(above, parent):
            break
        parent = above
    lowest = swarms.ids.copy()
    np.minimum.at(lowest, parent, swarms.ids)
    xi: Rows = lowest[parent][swarms.of]
    return xi
