"""Is a run on this machine true to its rules? Lateness of timers and messages, and the speed that keeps it small.

Faithful means: the 99th percentiles of both, in emulated time, stay within half a lease, the bound under which a
renewal still arrives in time (CONTRACT: `faithful`).
"""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING

from swarmer.engines.result import Lateness
from swarmer.metrics.lateness import percentiles

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from swarmer.telemetry import Sample

RECENT_S = 5.0  # wall seconds that the live figures look back
ROUND = 0.05  # suggested time scales are rounded down to this


class Tally:
    """Adds up what the FLSs count: over the whole run, and over the last seconds."""

    def __init__(self) -> None:
        self._marks: deque[tuple[float, NDArray[np.int64], NDArray[np.int64]]] = deque()

    def add(self, sample: Sample, scale: float) -> Tally:
        """Take the histograms of a sample."""
        now = time.monotonic()
        self._marks.append((now, sample.timer_late, sample.handled_late))
        while len(self._marks) > 2 and self._marks[1][0] < now - RECENT_S:
            self._marks.popleft()
        return self

    def timer(self) -> Lateness | None:
        return _lateness(self._marks[-1][1]) if self._marks else None

    def handled(self) -> Lateness | None:
        return _lateness(self._marks[-1][2]) if self._marks else None

    def recent_timer(self) -> Lateness | None:
        return _lateness(self._marks[-1][1] - self._marks[0][1]) if self._marks else None

    def recent_handled(self) -> Lateness | None:
        return _lateness(self._marks[-1][2] - self._marks[0][2]) if self._marks else None

    def faithful(self, lease_ms: float) -> bool | None:
        """Both p99 of the whole run within half a lease; None while nothing was counted."""
        worst = self.worst_ms()
        return None if worst is None else worst <= lease_ms / 2

    def worst_ms(self) -> float | None:
        """The larger of the two p99."""
        known = [late.p99 for late in (self.timer(), self.handled()) if late is not None]
        return max(known, default=None)

    def suggestion(self, scale: float, lease_ms: float) -> float | None:
        """The time scale that would have kept the run faithful; None where it was."""
        worst = self.worst_ms()
        if worst is None or worst <= lease_ms / 2:
            return None
        # A delay in wall time weighs the less in emulated time the slower that goes.
        exact = scale * (lease_ms / 2) / worst
        return max(ROUND, int(exact / ROUND) * ROUND)


class Governor:
    """Chooses the time scale: a fixed one, or as fast as this machine stays faithful, at most 1."""

    def __init__(self, wanted: float | str, lease_ms: float) -> None:
        self.auto = wanted == "auto"
        self.scale = 1.0 if isinstance(wanted, str) else float(wanted)
        self.lease_ms = lease_ms
        self.reason = ""

    def judge(self, tally: Tally, t_s: float) -> float:
        return self.scale


def _lateness(counts: NDArray[np.int64]) -> Lateness | None:
    found = percentiles(counts.tolist())
    return None if found is None else Lateness(*found)
