"""Is a run on this machine true to its rules? Lateness of timers and messages, and the speed that keeps it small.

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

RECENT_S = 5.0  # wall seconds that the live figures look back
SECOND_S = 1.0  # wall seconds that the governor looks back
ROUND = 0.05  # suggested time scales are rounded down to this

ENOUGH = 50  # counts from which a p99 is worth acting on
SLOWEST = 0.02
CALM = 0.7  # share of the bound that lateness may take
IDLE = 0.35  # below this share there is room to go faster
BURSTS = 2.0  # a swarm's message is more work than the rehearsal's wake-up
STEEPEST = 0.4  # one step down at most to this share
UP = 1.2  # one step up
SETTLE_S = 0.6  # wall seconds until a change shows
PATIENCE_S = 3.0  # wall seconds between a change and a step up


class Tally:
    """Adds up what the FLSs count: over the whole run, and over the last seconds."""

    def __init__(self) -> None:
        self._marks: deque[tuple[float, NDArray[np.int64], NDArray[np.int64]]] = deque()
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
        return _lateness(self._marks[-1][1]) if self._marks else None

    def handled(self) -> Lateness | None:
        return _lateness(self._marks[-1][2]) if self._marks else None

    def recent_timer(self) -> Lateness | None:
        return _lateness(self._marks[-1][1] - self._marks[0][1]) if self._marks else None

    def recent_handled(self) -> Lateness | None:
        return _lateness(self._marks[-1][2] - self._marks[0][2]) if self._marks else None

    def last_second_ms(self) -> float | None:
        """The larger p99 of the last second; None while too little was counted to tell."""
        if not self._marks:
            return None
        now, timer, handled = self._marks[-1]
        past = next((mark for mark in reversed(self._marks) if mark[0] <= now - SECOND_S), self._marks[0])
        windows = [(timer - past[1]), (handled - past[2])]
        known = [late.p99 for counts in windows if counts.sum() >= ENOUGH and (late := _lateness(counts))]
        return max(known, default=None)

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
    """Chooses the time scale: a fixed one, or as fast as this machine stays faithful, at most 1.

    `auto` begins at what the rehearsal promises, goes down at once when lateness nears the bound, and up slowly.
    """

    def __init__(self, wanted: float | str, lease_ms: float) -> None:
        self.auto = wanted == "auto"
        self.scale = 1.0 if isinstance(wanted, str) else float(wanted)
        self.bound_ms = lease_ms / 2
        self.reason = ""
        self._changed_wall = time.monotonic()

    def rehearsed(self, wake_ms: float) -> None:
        """Begin as fast as the rehearsal allows: every FLS was woken at once, and the last took `wake_ms` (p99)."""
        if self.auto:
            allowed = CALM * self.bound_ms / max(BURSTS * wake_ms, 1e-3)
            self.scale = min(1.0, max(SLOWEST, allowed))
            self.reason = f"waking all took {wake_ms:.0f} ms"
        self._changed_wall = time.monotonic()

    def judge(self, tally: Tally) -> float:
        """The time scale from now on, from the lateness of the last second."""
        late = tally.last_second_ms()
        since = time.monotonic() - self._changed_wall
        if not self.auto or late is None or since < SETTLE_S:
            return self.scale
        if late > CALM * self.bound_ms:
            self._change(
                self.scale * max(CALM * self.bound_ms / late, STEEPEST),
                f"messages or timers {late:.0f} ms late",
            )
        elif late < IDLE * self.bound_ms and self.scale < 1.0 and since > PATIENCE_S:
            self._change(min(1.0, self.scale * UP), f"only {late:.0f} ms late")
        return self.scale

    def _change(self, scale: float, reason: str) -> None:
        self.scale, self.reason = max(SLOWEST, scale), reason
        self._changed_wall = time.monotonic()


def _lateness(counts: NDArray[np.int64]) -> Lateness | None:
    found = percentiles(counts.tolist())
    return None if found is None else Lateness(*found)
