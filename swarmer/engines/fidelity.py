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

    Histogram = NDArray[np.int64]

RECENT_S = 5.0  # wall seconds that the live figures look back
ROUND = 0.05  # suggested time scales are rounded down to this

# The governor. Shares are of the bound; seconds are wall.
LOOK_S = 0.05  # from look to look
WINDOW_S = 0.4  # how far a look sees back
ENOUGH = 30  # counts from which a p99 is worth acting on
SLOWEST = 0.02
SLOWEST_START = 0.1  # the rehearsal may have met a moment of other load; what is late later corrects it
CALM = 0.8  # more lateness than this: slower, if the run as a whole is as late as this ...
LEAST, MOST = 0.6, 1.2  # ... and less, or more, if it is later or more punctual
IDLE = 0.4  # less than this: there is room to go faster
BURSTS = 3.5  # what follows a landing or a thaw is so much more work than the rehearsal's wake-up
STEEPEST = 0.6  # one step down is at most to this share
UP = 1.4  # one step up; everybody must be woken for it, so the steps are few
SETTLE_S = 0.35  # from a change to a step down
PATIENCE_S = 0.8  # from a change to a step up
TIGHTEN, RELEASE = 0.85, 1.15  # a brake that was too weak, or too strong, is changed by this
LANDED_S = 1.0  # emulated: by then about half of a display has landed
BUSY_S = 1.3  # emulated: how long a thaw keeps all busy


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
        return round(max(ROUND, int(exact / ROUND) * ROUND), 2)


class Governor:
    """Chooses the time scale: a fixed one, or as fast as this machine stays faithful, at most 1.

    `auto` begins at what the rehearsal promises, goes down when lateness nears the bound, and up when it is small.
    A thaw sends all FLSs off at once, so it brakes for one before it is late, by as much as the last ones needed.
    """

    def __init__(self, wanted: float | str, lease_ms: float) -> None:
        self.auto = wanted == "auto"
        self.scale = 1.0 if isinstance(wanted, str) else float(wanted)
        self.bound_ms = lease_ms / 2
        self.reason = ""
        self._brake = 1.0
        self._thaws = 0
        self._thawed_s = LANDED_S  # landing is as busy as a thaw
        self._braking = True  # a thaw's busy time is on, and we see how that goes
        self._worst_ms = 0.0  # since the last thaw
        self._changed = 0.0
        self._marks: deque[tuple[float, Histogram, Histogram]] = deque()

    def rehearsed(self, wake_ms: float) -> None:
        """Begin as fast as the rehearsal allows: every FLS was woken at once, and the last took `wake_ms` (p99)."""
        self._brake = min(1.0, max(SLOWEST_START, CALM * self.bound_ms / max(BURSTS * wake_ms, 1e-3)))
        self.scale = self._brake
        self.reason = f"waking all took {wake_ms:.0f} ms"

    def judge(self, timer: Histogram, handled: Histogram, thaws: int, t_s: float, wall: float) -> float:
        """The time scale from now on.

        timer, handled: lateness counted so far. thaws: how many there were. t_s, wall: now, emulated and monotonic.
        """
        if not self.auto:
            return self.scale
        late = self._late_ms(timer, handled, wall)
        calm = self._calm(timer, handled)
        since = wall - self._changed
        self._learn(late, calm, t_s)
        if thaws > self._thaws:
            self._thaws, self._thawed_s, self._worst_ms, self._braking = thaws, t_s, 0.0, True
            if self.scale > self._brake:
                self._change(self._brake, "a thaw", wall)
        elif late > calm * self.bound_ms and since > SETTLE_S:
            self._change(self.scale * max(calm * self.bound_ms / late, STEEPEST), f"{late:.0f} ms late", wall)
        elif late < IDLE * self.bound_ms and since > PATIENCE_S and self.scale < self._most(t_s):
            self._change(min(1.0, self.scale * UP), f"only {late:.0f} ms late", wall)
        return self.scale

    def _most(self, t_s: float) -> float:
        """Nothing is late while all are on their way, and that says nothing about their landing."""
        return self._brake if t_s < LANDED_S + BUSY_S else 1.0

    def _calm(self, timer: Histogram, handled: Histogram) -> float:
        """How late the last moments may be: the bound is on the whole run, and one that was punctual has some left."""
        known = [late.p99 for counts in (timer, handled) if (late := _lateness(counts))]
        share = max(known, default=0.0) / self.bound_ms
        return min(max(3 * CALM - 2 * share, LEAST), MOST)

    def _learn(self, late: float, calm: float, t_s: float) -> None:
        """Once a thaw's busy time is over: was braking too weak, or too strong?"""
        self._worst_ms = max(self._worst_ms, late)
        if self._braking and t_s - self._thawed_s > BUSY_S:
            self._braking = False
            share = self._worst_ms / self.bound_ms
            if share > calm:
                self._brake = max(SLOWEST, self._brake * TIGHTEN)
            elif share < calm:
                self._brake = min(1.0, self._brake * RELEASE)

    def _late_ms(self, timer: Histogram, handled: Histogram, wall: float) -> float:
        """The larger p99 of the window; 0 while too little happened to be late."""
        self._marks.append((wall, timer, handled))
        while len(self._marks) > 2 and self._marks[1][0] <= wall - WINDOW_S:
            self._marks.popleft()
        windows = (timer - self._marks[0][1], handled - self._marks[0][2])
        known = [late.p99 for counts in windows if counts.sum() >= ENOUGH and (late := _lateness(counts))]
        return max(known, default=0.0)

    def _change(self, scale: float, reason: str, wall: float) -> None:
        self.scale, self.reason, self._changed = max(SLOWEST, scale), reason, wall
        self._marks.clear()  # what was late at another scale says nothing about this one


def _lateness(counts: NDArray[np.int64]) -> Lateness | None:
    found = percentiles(counts.tolist())
    return None if found is None else Lateness(*found)
