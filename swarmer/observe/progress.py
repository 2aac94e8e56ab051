"""What is known of a run so far: HD and when it was reached, swarms, states. Pure bookkeeping, no files."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swarmer.engines.result import Snapshot
from swarmer.metrics.hausdorff import HausdorffMeter
from swarmer.metrics.swarms import SwarmStatistics, swarm_statistics
from swarmer.observe.palette import STATES

THRESHOLDS = ("1", "0.1", "0.09", "0.01", "0.001")
"""HD in cells whose first crossing is recorded, as they are written in summary.json."""

NO_SWARM = SwarmStatistics(0, 0, 0, False)


@dataclass(slots=True)
class Progress:
    """Taken from sample to sample by `update`. Before every FLS has been lit once, an HD is shown but counts for
    nothing: a display of one lit point would be perfect.
    """

    meter: HausdorffMeter
    ever_lit: NDArray[np.bool_]
    t_s: float = 0.0
    samples: int = 0
    all_lit_s: float | None = None  # when every FLS had been lit once
    hd: float = math.nan  # last; NaN while nobody is lit
    hd_min: float | None = None
    last_lit: tuple[NDArray[np.float64], NDArray[np.bool_]] | None = None  # positions and lit of that HD
    time_to_hd_s: dict[str, float | None] = field(default_factory=lambda: dict.fromkeys(THRESHOLDS))
    first_single_swarm_s: float | None = None
    single_swarm_count: int = 0
    swarms: SwarmStatistics = NO_SWARM
    states: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(STATES), dtype=np.int64))
    lit_share: float = 0.0

    @classmethod
    def of(cls, truth: NDArray[np.float64]) -> Progress:
        """Nothing known yet of a swarm for `truth`, (F, 3) cells."""
        return cls(HausdorffMeter(truth), np.zeros(len(truth), dtype=np.bool_))

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
        if not snapshot.lit.any():
            self.hd = math.nan
            return
        self.hd = self.meter.hd(snapshot.position, snapshot.lit)
        self.last_lit = (snapshot.position, snapshot.lit)
        if self.all_lit_s is None:
            return
        self.hd_min = self.hd if self.hd_min is None else min(self.hd_min, self.hd)
        for name, reached in self.time_to_hd_s.items():
            if reached is None and self.hd < float(name):
                self.time_to_hd_s[name] = snapshot.t_s

    def _update_swarms(self, snapshot: Snapshot) -> None:
        was_single = self.swarms.single
        self.swarms = swarm_statistics(snapshot.swarm, snapshot.lit)
        if self.swarms.single and not was_single:
            self.single_swarm_count += 1
            if self.first_single_swarm_s is None:
                self.first_single_swarm_s = snapshot.t_s

    def hd_absolute(self) -> float | None:
        """The last HD without any translation; None if nobody was ever lit."""
        return None if self.last_lit is None else self.meter.absolute(*self.last_lit)

    def reached(self, hd_cells: float | None) -> bool:
        """True if HD counts and is below `hd_cells` now."""
        return hd_cells is not None and self.all_lit_s is not None and self.hd < hd_cells
