"""What the report's figures are computed from: a saved run turned into curves. Nothing here draws."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.messages import SIZE, Kind
from swarmer.metrics.hausdorff import HausdorffMeter
from swarmer.next_shape import standing_at
from swarmer.observe.palette import STATES
from swarmer.observe.progress import LIT_MIN
from swarmer.observe.report_drawing import Clock, clock_of
from swarmer.observe.report_marks import Mark, marks_of
from swarmer.observe.report_rounds import read_rounds
from swarmer.observe.saved_run import SavedRun
from swarmer.observe.saved_timeline import SavedTimeline

READINGS_MAX = (
    1_000_000  # positions for which HD without translation is read: all samples of 1,700 FLSs in a minute
)
READINGS_MIN = 8
FAILURES = ("failure", "crash")

Curve = tuple[NDArray[np.float64], NDArray[np.float64]]  # moments, values


class Cycle(NamedTuple):
    """From one thaw to the next; the first begins with the deployment."""

    begin_s: float
    end_s: float
    since_s: NDArray[np.float64]  # of each sample in it, since its beginning
    swarms: NDArray[np.int64]


@dataclass
class RunData:
    """The curves of one run; each is computed when it is asked for, and once."""

    run: SavedRun
    timeline: SavedTimeline

    @property
    def clock(self) -> Clock:
        return clock_of(self.run)

    @property
    def t(self) -> NDArray[np.float64]:
        """(T,), in the unit of the clock."""
        return self.timeline.t_s

    @property
    def points(self) -> int:
        return len(self.timeline.truth)

    def series(self, name: str) -> NDArray[np.float64] | None:
        """(T,) what the run has written down under a name; None where it has nothing."""
        found = self.timeline.series.get(name)
        if found is None:
            found = self.of_rounds.get(name)
        return None if found is None or not np.isfinite(found).any() else found

    @cached_property
    def of_rounds(self) -> dict[str, NDArray[np.float64]]:
        """What rounds.csv adds up to, where the samples are its rounds."""
        rounds = read_rounds(self.run)
        names = {"localizing_cells": "localizing_cells", "following_cells": "swarm_cells"}
        if len(rounds.get("round", ())) != len(self.t) or not set(names.values()) <= rounds.keys():
            return {}
        return {name: np.cumsum(np.nan_to_num(rounds[column])) for name, column in names.items()}

    def grows(self, name: str) -> NDArray[np.float64] | None:
        """A total over time; None where nothing was ever counted."""
        found = self.series(name)
        return None if found is None or not np.nanmax(found) > 0 else np.nan_to_num(found)

    @cached_property
    def hd(self) -> Curve:
        """With translation, without the moments that have none."""
        shown = np.isfinite(self.timeline.hd_cells)
        return self.t[shown], self.timeline.hd_cells[shown]

    @cached_property
    def hd_absolute(self) -> Curve:
        """Without translation, at as many samples as can be read in a moment."""
        known = self.series("hd_absolute_cells")
        if known is not None:
            shown = np.isfinite(known)
            return self.t[shown], known[shown]
        count = min(len(self.t), max(READINGS_MIN, READINGS_MAX // max(self.points, 1)))
        at = np.unique(np.linspace(0, len(self.t) - 1, count).round().astype(np.int64))
        shapes = self.timeline.standings()
        meters = {one.from_s: HausdorffMeter(one.truth[one.member]) for one in shapes}
        moments, values = [], []
        for i in at:
            t_s, lit = float(self.t[i]), self.timeline.lit[i]
            shape = standing_at(shapes, t_s)
            if (lit & shape.member).sum() >= LIT_MIN:
                position = self.timeline.position[i].astype(np.float64)
                moments.append(t_s)
                values.append(meters[shape.from_s].absolute(position[shape.member], lit[shape.member]))
        return np.array(moments, dtype=np.float64), np.array(values, dtype=np.float64)

    @cached_property
    def sizes(self) -> list[NDArray[np.int64]]:
        """The sizes of the swarms at each sample."""
        return [
            np.unique(swarm[lit], return_counts=True)[1]
            for swarm, lit in zip(self.timeline.swarm, self.timeline.lit, strict=True)
        ]

    @cached_property
    def swarms(self) -> NDArray[np.int64]:
        """(T,): how many there are."""
        return np.array([len(sizes) for sizes in self.sizes], dtype=np.int64)

    @cached_property
    def largest(self) -> NDArray[np.int64]:
        """(T,): FLSs in the largest swarm."""
        return np.array([sizes.max(initial=0) for sizes in self.sizes], dtype=np.int64)

    @cached_property
    def states(self) -> NDArray[np.int64]:
        """(T, number of states)."""
        return self.timeline.states(len(STATES))

    @cached_property
    def dark(self) -> NDArray[np.int64]:
        """(T,): FLSs that had been lit once and are not now."""
        ever = np.logical_or.accumulate(self.timeline.lit, axis=0)
        gone: NDArray[np.int64] = (ever & ~self.timeline.lit).sum(axis=1)
        return gone

    def moments(self, *kinds: str) -> NDArray[np.float64]:
        """When events of these kinds happened."""
        return np.array([event.t_s for event in self.run.events if event.kind in kinds], dtype=np.float64)

    @cached_property
    def marks(self) -> list[Mark]:
        """When faults began and ended, and hosts were lost."""
        return marks_of(self.run.events, float(self.t[-1]))

    @cached_property
    def cycles(self) -> list[Cycle]:
        """The run cut at its thaws. A thaw that no sample lies behind makes none."""
        if not len(self.t):
            return []
        bounds = [float(self.t[0]), *np.unique(self.moments("thaw")).tolist(), np.inf]
        cycles = []
        for begin, end in pairwise(bounds):
            inside = (self.t >= begin) & (self.t < end)
            if inside.any():
                last = min(end, float(self.t[-1]))
                cycles.append(Cycle(begin, last, self.t[inside] - begin, self.swarms[inside]))
        return cycles

    @cached_property
    def by_kind(self) -> list[tuple[str, NDArray[np.float64], NDArray[np.float64]]]:
        """Kind, sent and delivered over time, (T,) each; those of which there were most first."""
        found = []
        for kind in Kind:
            sent, delivered = (self.series(f"{way}_{kind.name.lower()}") for way in ("sent", "delivered"))
            if sent is not None and delivered is not None and max(sent[-1], delivered[-1]) > 0:
                found.append((kind.name, np.nan_to_num(sent), np.nan_to_num(delivered)))
        return sorted(found, key=lambda one: -one[1][-1])

    @property
    def datagram_bytes(self) -> float:
        """Of one datagram: they are all of one size."""
        sent, octets = self.grows("datagrams_sent"), self.grows("bytes_sent")
        return SIZE if sent is None or octets is None else float(octets[-1] / sent[-1])


def data_of(run: SavedRun) -> RunData | None:
    """None for a run without a sample."""
    return None if run.timeline is None or not len(run.timeline.t_s) else RunData(run, run.timeline)
