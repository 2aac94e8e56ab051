"""One FLS in virtual time: what is due and what is on its way stands on an agenda, and a handler may be busy.

What becomes of a datagram, a timer, a landing is `fls.BaseFls`, as in an FLS process. A handler takes `handling_s` for
every message (`virtual.handling_ms`): it acts at once and is busy for so long afterwards, while what comes waits in the
order of an FLS process. The network role is never busy.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field

from swarmer.engines.result import Witness
from swarmer.engines.virtual_radio import RUN, Air
from swarmer.engines.virtual_time import FREE, HELD, OUTGOING, Agenda
from swarmer.faults import NO_FAULTS, Schedule
from swarmer.fls import DEPARTED, DUE, FAILED, FAILURE, LANDING, NEVER
from swarmer.fls_battery import ChargedFls
from swarmer.fls_spec import FlsSpec
from swarmer.messages import ZERO, Message, Stamp, Swarm
from swarmer.metrics.lateness import bucket
from swarmer.physics.flight import Flight
from swarmer.protocol.events import ThawBegins
from swarmer.protocol.race import JUDGED, PRIORITY
from swarmer.protocol.records import Counters
from swarmer.radio import WINDOW, heard
from swarmer.rules import Rules
from swarmer.state_machine import State
from swarmer.telemetry import DELIVERED_BY_KIND, REFUSED, Wire

__all__ = ["DEPARTED", "FAILED", "Shared", "VirtualFls"]

# A named tuple's own `__new__` costs as much as handling a message: in the hottest lines it is passed by.
_new = tuple.__new__
NO_GRID, FARTHEST = Stamp(0, 0, ZERO, 0.0)[4:]  # there is no kernel here that would filter by them
HALF_WINDOW = WINDOW // 2
_DELIVERED = int(Wire.DELIVERED)


@dataclass(slots=True, eq=False)
class Shared:
    """What all FLSs of a run share."""

    seed: int
    rules: Rules
    agenda: Agenda
    air: Air
    ended: Callable[[VirtualFls, str], None]  # told when one fails or departs
    handling_s: float  # that an FLS takes for one message
    counts: list[int]  # of all FLSs together, in the places of `telemetry`
    timer_late: list[int]  # histograms of metrics.lateness
    handled_late: list[int]
    witness: Witness | None = None
    thaw_begins: Callable[[VirtualFls, ThawBegins], None] = lambda fls, begins: (
        None
    )  # told when one begins a thaw
    flown: array[int] | None = None  # by FID, two places each, microcells: localizing, following
    faults: Schedule = NO_FAULTS
    localized: list[tuple[int, int, Flight]] = field(
        default_factory=list
    )  # FID, its anchor's, its flight: since the last sample


class VirtualFls(ChargedFls):
    """The two roles of one FLS, called by `engines.virtual`."""

    __slots__ = (
        "_agenda", "_air", "_busy_until", "_half_window_s", "_handled_late", "_handling_s", "_latency_rng", "_noted",
        "_timer_late", "_waking", "alive", "fid", "shared", "tuned_at",
    )  # fmt: skip

    def __init__(self, shared: Shared, spec: FlsSpec) -> None:
        self.shared, self.fid, self.alive = shared, spec.fid, True
        self._agenda, self._air, self._handling_s = shared.agenda, shared.air, shared.handling_s
        self._timer_late, self._handled_late = shared.timer_late, shared.handled_late
        self._busy_until, self._waking = 0.0, False
        self._half_window_s = (
            -NEVER
        )  # when it sent the last datagram whose number is a multiple of HALF_WINDOW
        super().__init__(
            RUN, shared.seed, shared.rules, spec, shared.counts, shared.counts, shared.witness, shared.faults
        )
        self._latency_rng = self.own_stream("latency")
        self._noted = [NEVER] * len(
            self.due
        )  # when the agenda will look at it, which may be before it is due
        # Which of the air's tunings was its last: a datagram that is older may not be for it any more. NEVER where more
        # than its swarm decides whether it hears, or somebody watches.
        plain = self._ends.plain_in and self.witness is None and not self._range_estimated
        self.tuned_at = 0.0 if plain else NEVER
        self._air.join(self, spec)
        if self.witness is not None:
            self.witness.made(self, self._agenda.now)
        self.begin()

    def now(self) -> float:
        """The emulated second."""
        return self._agenda.now

    # -- the network role ----------------------------------------------------------------------------------------

    def hear(self, message: Message, stamp: Stamp) -> None:
        """As in every engine, by a short way where nothing but the radio's rules can stop a datagram."""
        if self.tuned_at == NEVER:
            super().hear(message, stamp)
            return
        refusal = heard(message, stamp, self.ears, self._count)
        if refusal is None:
            self.take(message, stamp)
        else:
            self.network_counts[REFUSED[refusal]] += 1

    def take(self, message: Message, stamp: Stamp) -> None:
        """`arrive`, by a short way for most datagrams: those that can only be queued."""
        if message.kind in JUDGED or self._air.doubtful[message.sender]:
            self.arrive(message, stamp)
        else:
            counts = self.network_counts
            counts[_DELIVERED] += 1
            counts[DELIVERED_BY_KIND + message.kind] += 1
            self.queue(message, stamp)

    def fresh(self, message: Message, stamp: Stamp) -> bool:
        """Asks the window only about senders whose datagrams may come late or twice: it could not refuse the others."""
        return not self._air.doubtful[message.sender] or super().fresh(message, stamp)

    def hear_later(self, delay_s: float, message: Message, stamp: Stamp) -> None:
        self._agenda.put(self._agenda.now + delay_s, HELD, self, message, stamp)

    def queue(self, message: Message, stamp: Stamp) -> None:
        """Handle a message at once, or let it wait for a handler that is busy."""
        now = self._agenda.now
        if self._waking or self._busy_until > now:
            self.queues[PRIORITY[message.kind]].append((now, message, stamp))
            self._wake_when_free()
        else:
            self._busy_until = now + self._handling_s
            self._handled_late[0] += 1
            self.take_message(message, stamp, now)

    def note(self, message: Message, stamp: Stamp) -> None:
        """Noting takes no time, but a handler that is busy."""
        now = self._agenda.now
        if self._waking or self._busy_until > now:
            self.notes.append((message, stamp))
            self._wake_when_free()
        else:
            self.take_message(message, stamp, now, noted=True)

    # -- the handler role ----------------------------------------------------------------------------------------

    def taken_up(self, late_s: float) -> None:
        self._handled_late[bucket(late_s * 1e3)] += 1
        self._busy_until = self._agenda.now + self._handling_s

    def timer_taken_up(self, late_s: float) -> None:
        self._timer_late[bucket(late_s * 1e3)] += 1

    def _wake_when_free(self) -> None:
        if not self._waking:
            self._waking = True
            self._agenda.put(self._busy_until, FREE, self)

    def wake(self) -> None:
        """The handling time of one message is over: go on with what is most urgent."""
        self._waking = False
        now = self._agenda.now
        while self.alive and self._busy_until <= now:
            if not self.work(now):
                return
        if self.alive and (self.notes or any(self.queues) or min(self.due) <= now):
            self._wake_when_free()

    def wait(self, what: int, at_s: float) -> None:
        """Have the agenda look at it then."""
        now = self._agenda.now
        self.due[what] = at_s = at_s if at_s > now else now
        if at_s < self._noted[what]:  # else the agenda looks early enough, and then again
            self._noted[what] = at_s
            self._agenda.put(at_s, what, self)

    def look(self, what: int, at_s: float) -> bool:
        """The agenda's note of `at_s` has come up: is that due now?"""
        if self._noted[what] != at_s:
            return False  # there was an earlier note since
        self._noted[what] = NEVER
        due_s = self.due[what]
        if due_s > at_s:
            if due_s < NEVER:
                self.wait(what, due_s)
            return False
        return True

    def fall_due(self, what: int) -> None:
        """Take up what is due, unless the handler is busy. A failure waits for nobody."""
        if what != FAILURE and (self._waking or self._busy_until > self._agenda.now):
            self._wake_when_free()
            return
        self.due[what] = NEVER
        self._timer_late[0] += 1
        if what < LANDING:
            self.feed(DUE[what])
        else:
            self.take_due(what)

    def tuned(self, old: Swarm) -> None:
        air = self._air
        air.tune(self, old, self.ears.swarm)
        if self.tuned_at != NEVER:
            self.tuned_at = air.tunings

    def moved_on(self) -> None:
        air = self._air
        air.move(self, self.spec)
        if self.tuned_at != NEVER:  # what is on its way was for it where it was
            self.tuned_at = air.tunings

    def moved(self) -> None:
        self._air.moved(self)
        if self.machine.state is State.BUSY_LOCALIZING and self.flight.length > 0.0:
            assert self.machine.anchor is not None
            self.shared.localized.append((self.fid, self.machine.anchor.sender, self.flight))

    def count_flown(self, place: int, microcells: int) -> None:
        super().count_flown(place, microcells)
        if (flown := self.shared.flown) is not None:
            flown[2 * self.fid + place - Wire.LOCALIZING_MICROCELLS] += microcells

    def thaw_begins(self, begins: ThawBegins) -> None:
        self.shared.thaw_begins(self, begins)

    def end(self, how: str) -> None:
        self.alive = False
        self.due = [NEVER] * len(self.due)
        self._air.leave(self)
        if self.witness is not None:
            self.witness.ended(self, how, self._agenda.now)
        self.shared.ended(self, how)

    # -- both ----------------------------------------------------------------------------------------------------

    @property
    def lit(self) -> bool:
        return self.alive and self.machine.awake

    def stamp(self, message: Message, sent_at: float) -> Stamp:
        """And let the radio know how fast it sends."""
        number = next(self._numbers)
        if number % HALF_WINDOW == 0:
            now = self._agenda.now
            self._air.hurries(self.fid, now - self._half_window_s)
            self._half_window_s = now
        flight = self.flight
        origin = flight.start if flight.length == 0.0 else self.position()
        return _new(Stamp, (RUN, number, origin, sent_at, NO_GRID, FARTHEST))

    def send_later(self, delay_s: float, message: Message, stamp: Stamp) -> None:
        self._agenda.put(self._agenda.now + delay_s, OUTGOING, self, message, stamp)

    def transmit(self, message: Message, stamp: Stamp, counts: Counters) -> None:
        self._air.transmit(message, stamp, self._latency_rng, self)
