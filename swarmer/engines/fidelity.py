"""Is a run on this machine true to its rules? Lateness of timers and messages.

Faithful means: the 99th percentiles of both, in emulated time, stay within half a lease, the bound under which a
renewal still arrives in time (CONTRACT: `faithful`).
"""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Any

from swarmer.engines.result import Lateness
from swarmer.metrics.lateness import percentiles

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from swarmer.telemetry import Sample

    Histogram = NDArray[np.int64]

RECENT_S = 5.0  # wall seconds that the live figures look back
ROUND = 0.05  # suggested time scales are rounded down to this


class Tally:
    """Adds up what the FLSs count: over the whole run, and over the last seconds."""

    def __init__(self) -> None:
        self._marks: deque[tuple[float, Histogram, Histogram]] = deque()
        self._before: tuple[Any, Any] = (0, 0)

    def start(self) -> None:
        """The run begins: what was counted up to now was the rehearsal."""
        if self._marks:
            _, timer, handled = self._marks[-1]
            self._before = (self._before[0] + timer, self._before[1] + handled)
            self._marks.clear()

    def add(self, sample: Sample) -> Tally:
        """Take the histograms of a sample."""
        now = time.monotonic()
        self._marks.append((now, sample.timer_late - self._before[0], sample.handled_late - self._before[1]))
        while len(self._marks) > 2 and self._marks[1][0] < now - RECENT_S:
            self._marks.popleft()
        return self

    def timer(self) -> Lateness | None:
        return lateness(self._marks[-1][1]) if self._marks else None

    def handled(self) -> Lateness | None:
        return lateness(self._marks[-1][2]) if self._marks else None

    def recent_timer(self) -> Lateness | None:
        return lateness(self._marks[-1][1] - self._marks[0][1]) if self._marks else None

    def recent_handled(self) -> Lateness | None:
        return lateness(self._marks[-1][2] - self._marks[0][2]) if self._marks else None

    def faithful(self, lease_ms: float) -> bool | None:
        """Is the whole run faithful so far?"""
        return faithful(self.timer(), self.handled(), lease_ms)

    def worst_ms(self) -> float | None:
        """The larger of the two p99."""
        return worst_ms(self.timer(), self.handled())

    def suggestion(self, scale: float, lease_ms: float) -> float | None:
        """The time scale that would have kept the run faithful; None where it was."""
        worst = self.worst_ms()
        if worst is None or worst <= lease_ms / 2:
            return None
        # A delay in wall time weighs the less in emulated time the slower that goes.
        exact = scale * (lease_ms / 2) / worst
        return round(max(ROUND, int(exact / ROUND) * ROUND), 2)


def faithful(timer: Lateness | None, handled: Lateness | None, lease_ms: float) -> bool | None:
    """Both p99 within half a lease, whatever the engine; None while no message was handled: that proves nothing."""
    worst = worst_ms(timer, handled)
    return None if worst is None or handled is None else worst <= lease_ms / 2


def worst_ms(timer: Lateness | None, handled: Lateness | None) -> float | None:
    """The larger of the two p99; None if neither is known."""
    return max((late.p99 for late in (timer, handled) if late is not None), default=None)


def lateness(counts: NDArray[np.int64]) -> Lateness | None:
    """The percentiles of a histogram of lateness, (BUCKETS,); None where nothing was counted."""
    found = percentiles(counts.tolist())
    return None if found is None else Lateness(*found)
