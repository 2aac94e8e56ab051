"""What is known of a run so far: HD and when it was reached, swarms, states. Pure bookkeeping, no files.

HD is that of the lit FLSs and their points (specification, section 1). Which HDs there are, and which count:

- There is one while at least two FLSs are lit. Moved to the right centroid, a single light is always perfect.
- It counts, for the lowest HD, for the times and for `--until-hd`, from the moment when every FLS has been lit once,
  and while at least half of them are lit: what is left of a display that has gone dark is no success.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swarmer.engines.result import Snapshot
from swarmer.metrics.hausdorff import HausdorffMeter
from swarmer.metrics.swarms import SwarmStatistics, swarm_statistics
from swarmer.observe.palette import STATES

THRESHOLDS = ("1", "0.1", "0.09", "0.01", "0.001")
"""HD in cells whose first crossing is recorded, as they are written in summary.json."""

LIT_MIN = 2  # FLSs; fewer have no HD
COUNTS_FROM = 0.5  # share of the FLSs; an HD of fewer is shown but counts for nothing

NO_SWARM = SwarmStatistics(0, 0, 0, False)


@dataclass(slots=True)
class Progress:
    """Taken from sample to sample by `update`."""

    truth: NDArray[np.float64]
    ever_lit: NDArray[np.bool_]
    t_s: float = 0.0
    samples: int = 0
    all_lit_s: float | None = None  # when every FLS had been lit once
    hd: float = math.nan  # of the last sample, cells; NaN while fewer than LIT_MIN are lit
    hd_counts: bool = False  # whether that HD counts
    hd_min: float | None = None  # the lowest that counted
    last: tuple[NDArray[np.float64], NDArray[np.bool_]] | None = None  # positions and lit of the last sample
    time_to_hd_s: dict[str, float | None] = field(default_factory=lambda: dict.fromkeys(THRESHOLDS))
    first_single_swarm_s: float | None = None
    single_swarm_count: int = 0
    swarms: SwarmStatistics = NO_SWARM
    states: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(STATES), dtype=np.int64))
    lit_share: float = 0.0
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

    def update(self, snapshot: Snapshot) -> None:
        """Take a sample."""
        self.samples += 1
        self.t_s = snapshot.t_s
        self.ever_lit |= snapshot.lit
        if self.all_lit_s is None and self.ever_lit.all():
            self.all_lit_s = snapshot.t_s
        self.lit_share = float(snapshot.lit.mean())
        self.states = np.bincount(snapshot.state, minlength=len(STATES))[: len(STATES)]
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
        self.hd_counts = has_one and self.all_lit_s is not None and self.lit_share >= COUNTS_FROM
        if not self.hd_counts:
            return
        self.hd_min = self.hd if self.hd_min is None else min(self.hd_min, self.hd)
        for name, reached in self.time_to_hd_s.items():
            if reached is None and self.hd < float(name):
                self.time_to_hd_s[name] = snapshot.t_s

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

    def hd_absolute(self) -> float | None:
        """HD of the last sample without any translation; None where that has no HD."""
        return None if self.last is None or math.isnan(self.hd) else self.meter.absolute(*self.last)

    def reached(self, hd_cells: float | None) -> bool:
        """True if HD counts and is below `hd_cells` now."""
        return hd_cells is not None and self.hd_counts and self.hd < hd_cells
