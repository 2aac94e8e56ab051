"""What is known of a run so far: HD and when it was reached, swarms, states. Pure bookkeeping, no files.

HD is that of the lit FLSs and their points (specification, section 1). Which HDs there are, and which count:

- There is one while at least two FLSs are lit. Moved to the right centroid, a single light is always perfect.
- It counts, for the lowest HD, for the times and for `--until-hd`, from the moment when every FLS has been lit once,
  and while at least half of them are lit: what is left of a display that has gone dark is no success.
- Of a run that changes its shape each shape has times of its own; `--until-hd` asks for the last one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swarmer.engines.result import Snapshot
from swarmer.metrics.hausdorff import HausdorffMeter
from swarmer.metrics.swarms import SwarmStatistics, swarm_statistics
from swarmer.next_shape import Standing
from swarmer.observe.palette import STATES

THRESHOLDS = ("1", "0.1", "0.09", "0.01", "0.001")
"""HD in cells whose first crossing is recorded, as they are written in summary.json."""

LIT_MIN = 2  # FLSs; fewer have no HD
COUNTS_FROM = 0.5  # share of the FLSs; an HD of fewer is shown but counts for nothing

NO_SWARM = SwarmStatistics(0, 0, 0, False)


@dataclass(slots=True)
class Progress:
    """Taken from sample to sample by `update`."""

    truth: NDArray[np.float64]  # of who has a point now, cells
    ever_lit: NDArray[np.bool_]
    member: NDArray[np.bool_] | None = None  # (F,), who that is; None: all
    later: list[Standing] = field(default_factory=list)  # shapes to come
    shape_s: float = 0.0  # since when the present shape is the one
    t_s: float = 0.0
    samples: int = 0
    all_lit_s: float | None = None  # when every FLS of the first shape had been lit once
    shape_lit_s: float | None = None  # and every FLS of the present one
    hd: float = math.nan  # of the last sample, cells; NaN while fewer than LIT_MIN are lit
    hd_counts: bool = False  # whether that HD counts
    hd_min: float | None = None  # the lowest that counted
    last: tuple[NDArray[np.float64], NDArray[np.bool_]] | None = None  # positions and lit of the last sample
    time_to_hd_s: dict[str, float | None] = field(default_factory=lambda: dict.fromkeys(THRESHOLDS))
    time_to_hd_absolute_s: dict[str, float | None] | None = None  # without a translation; where oracles are
    next_time_to_hd_s: dict[str, float | None] | None = None  # of the next shape, from its beginning on
    first_single_swarm_s: float | None = None
    single_swarm_count: int = 0
    swarms: SwarmStatistics = NO_SWARM
    states: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(STATES), dtype=np.int64))
    lit_share: float = 0.0
    shares: list[float] = field(default_factory=list)  # lit_share at each sample since all were lit once
    hds: list[float] = field(default_factory=list)  # and HD, where there was one
    own_meter: HausdorffMeter | None = None

    @property
    def meter(self) -> HausdorffMeter:
        """Made when it is first needed, for of a million points it takes seconds, and some engines bring the HD."""
        if self.own_meter is None:
            self.own_meter = HausdorffMeter(self.truth)
        return self.own_meter

    @classmethod
    def of(cls, truth: NDArray[np.float64]) -> Progress:
        """Nothing known yet of a swarm for `truth`, (F, 3) cells."""
        return cls(truth, np.zeros(len(truth), dtype=np.bool_))

    @classmethod
    def through(cls, standings: Sequence[Standing], absolute: bool = False) -> Progress:
        """Nothing known yet of a swarm that becomes one shape after the other. absolute: it may come to stand where it
        should, so the HD without any translation has times, too.
        """
        progress = cls.of(standings[0].truth)
        progress._stand(standings[0])
        progress.later = list(standings[1:])
        if absolute:
            progress.time_to_hd_absolute_s = dict.fromkeys(THRESHOLDS)
        return progress

    def _stand(self, standing: Standing) -> None:
        self.member = None if standing.member.all() else standing.member
        self.truth = standing.truth if self.member is None else standing.truth[self.member]
        self.own_meter = None
        self.shape_s = standing.from_s

    def _change(self) -> None:
        self._stand(self.later.pop(0))
        self.shape_lit_s = None
        self.next_time_to_hd_s = dict.fromkeys(THRESHOLDS)

    def update(self, snapshot: Snapshot) -> None:
        """Take a sample."""
        while self.later and snapshot.t_s >= self.later[0].from_s:
            self._change()
        self.samples += 1
        self.t_s = snapshot.t_s
        self.ever_lit |= snapshot.lit
        self.states = np.bincount(snapshot.state, minlength=len(STATES))[: len(STATES)]
        if self.member is not None:
            snapshot = snapshot.of(self.member)
        ever_lit = self.ever_lit if self.member is None else self.ever_lit[self.member]
        if self.shape_lit_s is None and ever_lit.all():
            self.shape_lit_s = snapshot.t_s
            if self.next_time_to_hd_s is None:
                self.all_lit_s = snapshot.t_s
        self.lit_share = float(snapshot.lit.mean())
        if self.all_lit_s is not None:
            self.shares.append(self.lit_share)
        self._update_hd(snapshot)
        self._update_swarms(snapshot)

    def _update_hd(self, snapshot: Snapshot) -> None:
        self.last = (snapshot.position, snapshot.lit)
        has_one = int(snapshot.lit.sum()) >= LIT_MIN
        if snapshot.hd_cells is not None:
            self.hd = snapshot.hd_cells
            has_one = not math.isnan(self.hd)
        else:
            self.hd = self.meter.hd(snapshot.position, snapshot.lit) if has_one else math.nan
        self.hd_counts = has_one and self.shape_lit_s is not None and self.lit_share >= COUNTS_FROM
        if self.all_lit_s is not None and has_one:
            self.hds.append(self.hd)
        if not self.hd_counts:
            return
        self.hd_min = self.hd if self.hd_min is None else min(self.hd_min, self.hd)
        times = self.time_to_hd_s if self.next_time_to_hd_s is None else self.next_time_to_hd_s
        self._cross(times, self.hd, snapshot.t_s)
        if self.time_to_hd_absolute_s is not None and self.next_time_to_hd_s is None:
            absolute = self.hd_absolute()
            self._cross(self.time_to_hd_absolute_s, math.inf if absolute is None else absolute, snapshot.t_s)

    def _cross(self, times: dict[str, float | None], hd: float, t_s: float) -> None:
        """Which thresholds is HD below for the first time?"""
        for name, reached in times.items():
            if reached is None and hd < float(name):
                times[name] = t_s - self.shape_s

    def _update_swarms(self, snapshot: Snapshot) -> None:
        was_single = self.swarms.single
        self.swarms = swarm_statistics(snapshot.swarm, snapshot.lit, snapshot.swarm_incarnation)
        if self.swarms.single and not was_single:
            self.single_swarm_count += 1
            if self.first_single_swarm_s is None:
                self.first_single_swarm_s = snapshot.t_s

    def single_swarms(self, counters: Mapping[str, float]) -> int:
        """How often all were one swarm: samples miss what a thaw ends at once, which the engine's counters may have."""
        return max(self.single_swarm_count, round(counters.get("thaws_at_one_swarm", 0)))

    def illumination(self) -> dict[str, float | None]:
        """How much of the display shone, by name in the summary, of the samples since all were lit once."""
        shares = np.array(self.shares)
        if not len(shares):
            return dict.fromkeys(
                ("illumination_mean", "illumination_min", "fully_lit_share", "hd_median_cells")
            )
        return {
            "illumination_mean": float(shares.mean()),
            "illumination_min": float(shares.min()),
            "fully_lit_share": float((shares == 1.0).mean()),
            "hd_median_cells": float(np.median(self.hds)) if self.hds else None,
        }

    def hd_absolute(self) -> float | None:
        """HD of the last sample without any translation; None where that has no HD."""
        return None if self.last is None or math.isnan(self.hd) else self.meter.absolute(*self.last)

    def reached(self, hd_cells: float | None) -> bool:
        """True if HD counts and is below `hd_cells` now, and no other shape is to come."""
        return hd_cells is not None and not self.later and self.hd_counts and self.hd < hd_cells
