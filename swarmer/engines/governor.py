"""The governor: the speed at which a run on this machine stays true to its rules (`--time-scale auto`)."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from swarmer.engines.fidelity import lateness

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Histogram = NDArray[np.int64]

# Shares are of the bound; seconds are wall, unless said.
LOOK_S = 0.05  # from look to look
WINDOW_S = 0.4  # how far a look sees back
ENOUGH = 30  # counts from which a p99 is worth acting on
SLOWEST = 0.02
CALM = 0.8  # more lateness than this is too much, if the run as a whole is as late as this ...
LEAST, MOST = 0.6, 1.2  # ... and less, or more, if it is later or more punctual
IDLE = 0.4  # less than this: there is room
WORTH = 2.0  # things done in the time that a wake-up took when all were woken at once
BUSIEST = 40.0  # things an FLS has to do in an emulated second of a formation, until one was seen
STEEPEST = 0.5  # one lesson of lateness is at most down to this share
GAIN = 1.08  # one lesson of punctuality ...
USED = 0.7  # ... at no less than this share of the capacity
WARY, WARY_GAIN = 0.9, 1.03  # one near what was too much before ...
ALIKE = 2.0  # ... for a demand within this factor of the one then
EASE = 0.93  # a change down is worth making from here on
UP = 1.4  # the least change up: everybody must be woken for it, which makes some late, so they are few
SETTLE_S = 0.35  # from one lesson to the next
AWAKE_S = 0.25  # from a change up until all have woken for it
PATIENCE_S = 0.8  # from a change to one up
LANDED_S = 1.0  # emulated: by then about half of a display has landed
BRACED_S = 0.5  # emulated: from the start of a thaw until its work is seen
DEMAND_S = 0.1  # emulated: how far back the demand is looked at


class Governor:
    """Chooses the time scale: a fixed one, or as fast as this machine stays faithful, at most 1.

    `auto` compares two rates: what the FLSs have to do in an emulated second (`demand`: timers and datagrams), which
    is seen at every look and changes a hundredfold within a run, and what this machine does in a wall second without
    being late (`capacity`), which the lateness teaches. Their quotient is the scale. A thaw sends all FLSs off at once,
    so for one it braces: the demand is taken to be the highest of the last formation before it is seen to be.

    A look (`judge`) goes: how late everything was and what there was to do, in the window that lies behind; the lesson
    of that for the capacity; the demand to reckon with; down at once if it takes a smaller scale, up only where that
    pays. Lessons are of two kinds, and rare (SETTLE_S). Late: the capacity falls by as much as the lateness was too
    large, at most to STEEPEST. Punctual, though nearly all of the capacity was used: it grows by GAIN, by less near a
    capacity that was too much before. A machine that had little to do teaches nothing, nor does one that has just woken
    all.
    """

    def __init__(self, wanted: float | str, lease_ms: float, count: int) -> None:
        self.auto = wanted == "auto"
        self.scale = 1.0 if isinstance(wanted, str) else float(wanted)
        self.bound_ms = lease_ms / 2
        self.reason = ""
        self._capacity = BUSIEST * count  # until a rehearsal or a lesson says otherwise: real time
        # The capacity that was believed in and proved too large last, and the demand that proved it.
        self._too_much = float("inf"), 0.0
        self.count = count
        self._busiest = BUSIEST * count  # demand at the height of the last formation
        self._height = 0.0  # of this one, so far
        self._thaws = 0
        self._thawed_s = LANDED_S  # landing is as busy as a thaw
        self._changed = self._taught = 0.0
        self._awake = 0.0  # until then some are late because all were woken to go faster
        self._marks: deque[_Mark] = deque()

    def rehearsed(self, wake_ms: float) -> None:
        """Begin as fast as the rehearsal allows: every FLS was woken at once, and the last took `wake_ms` (p99)."""
        self._capacity = WORTH * self.count / max(wake_ms / 1e3, 1e-6)
        self.scale = self._affordable(self._busiest)
        self.reason = f"waking all took {wake_ms:.0f} ms"

    def judge(
        self, timer: Histogram, handled: Histogram, delivered: int, thaws: int, t_s: float, wall: float
    ) -> float:
        """The time scale from now on.

        timer, handled: lateness counted so far. delivered: datagrams. thaws: how many there were. t_s, wall: now,
        emulated and monotonic.
        """
        if not self.auto:
            return self.scale
        self._look(_Mark(wall, t_s, timer, handled, delivered + int(timer.sum())))
        late, demand = self._late_ms(), self._demand()
        self._height = max(self._height, demand)
        self._learn(late, self._calm(timer, handled), demand, wall)
        if thaws > self._thaws:
            self._thaws, self._thawed_s = thaws, t_s
            self._busiest, self._height = max(self._height, self._busiest / 2), 0.0
        if t_s - self._thawed_s < BRACED_S:
            demand = max(demand, self._busiest)
        wanted = self._affordable(demand)
        if wanted < EASE * self.scale:
            self._change(wanted, f"demand {demand:,.0f}/s, {late:.0f} ms late", wall)
        elif late < IDLE * self.bound_ms and self._worth_waking_for(wanted, wall):
            self._change(wanted, f"demand only {demand:,.0f}/s, {late:.0f} ms late", wall)
            self._awake = wall + AWAKE_S
        return self.scale

    def _worth_waking_for(self, wanted: float, wall: float) -> bool:
        return wanted >= min(UP * self.scale, 1.0) > self.scale and wall - self._changed > PATIENCE_S

    def _affordable(self, demand: float) -> float:
        return min(1.0, max(SLOWEST, self._capacity / max(demand, 1.0)))

    def _look(self, mark: _Mark) -> None:
        marks = self._marks
        marks.append(mark)
        while (
            len(marks) > 2 and marks[1].wall <= mark.wall - WINDOW_S and marks[1].t_s <= mark.t_s - DEMAND_S
        ):
            marks.popleft()

    def _since(self, wall: float) -> _Mark:
        """The newest look that is not after `wall`, or the oldest."""
        return next((mark for mark in reversed(self._marks) if mark.wall <= wall), self._marks[0])

    def _demand(self) -> float:
        """Things to do in an emulated second, of late."""
        last = self._marks[-1]
        first = next(
            (mark for mark in reversed(self._marks) if mark.t_s <= last.t_s - DEMAND_S), self._marks[0]
        )
        return (last.done - first.done) / max(last.t_s - first.t_s, DEMAND_S / 2)

    def _rate(self) -> float:
        """Things done in a wall second, of late."""
        last = self._marks[-1]
        first = self._since(last.wall - WINDOW_S)
        return (last.done - first.done) / max(last.wall - first.wall, WINDOW_S / 2)

    def _late_ms(self) -> float:
        """The larger p99 of the window; 0 while too little happened to be late."""
        last = self._marks[-1]
        first = self._since(max(last.wall - WINDOW_S, self._awake))
        windows = (last.timer - first.timer, last.handled - first.handled)
        known = [late.p99 for counts in windows if counts.sum() >= ENOUGH and (late := lateness(counts))]
        return max(known, default=0.0)

    def _calm(self, timer: Histogram, handled: Histogram) -> float:
        """How late the last moments may be, a share of the bound: that is on the whole run; a punctual one has more.

        CALM for a run that is CALM late as a whole; every percent more of the one is two percent less of the other.
        """
        known = [late.p99 for counts in (timer, handled) if (late := lateness(counts))]
        share = max(known, default=0.0) / self.bound_ms
        return min(max(3 * CALM - 2 * share, LEAST), MOST)

    def _learn(self, late: float, calm: float, demand: float, wall: float) -> None:
        """What this machine does in a second without being late: less than was thought, or more?"""
        if wall - self._taught < SETTLE_S or wall < self._awake:  # before all are awake nobody can be judged
            return
        if late > calm * self.bound_ms:
            self._too_much = self._capacity, demand
            self._capacity *= max(calm * self.bound_ms / late, STEEPEST)
            self._taught = wall
        elif late < IDLE * self.bound_ms and self._rate() > USED * self._capacity:
            self._capacity *= WARY_GAIN if self._was_too_much(GAIN * self._capacity, demand) else GAIN
            self._taught = wall

    def _was_too_much(self, capacity: float, demand: float) -> bool:
        """Whether a demand of about this size was late at little more."""
        limit, then = self._too_much
        return capacity > WARY * limit and then / ALIKE < demand < then * ALIKE

    def _change(self, scale: float, reason: str, wall: float) -> None:
        self.scale, self.reason, self._changed = scale, reason, wall


class _Mark(NamedTuple):
    """What a look saw."""

    wall: float
    t_s: float
    timer: Histogram
    handled: Histogram
    done: int  # timers that fell due and datagrams that arrived
