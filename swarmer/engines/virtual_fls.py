"""One FLS in virtual time: what `fls_process.Fls` does with sockets and a clock, done with an agenda.

The same machine, the same judge at the network's door, the same rules of the radio, the same flights and sensors, drawn
from the same streams; only who calls differs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count as counting
from random import Random
from typing import Any

from swarmer.engines.result import Witness
from swarmer.engines.virtual_radio import RUN, Air
from swarmer.engines.virtual_time import HELD, OUTGOING, Agenda
from swarmer.fls_process import BATTERY, FAILURE, LANDING, LAUNCH, MEASURED, NEVER, FlsSpec
from swarmer.messages import ENGINE_FID, NO_SWARM, Message, Stamp, Vec3
from swarmer.physics.dead_reckoning import MODELS as DEAD_RECKONING
from swarmer.physics.flight import Flight, plan_flight, position_at
from swarmer.plan import Rules, make_machine, make_sensor, make_velocity
from swarmer.protocol import race
from swarmer.protocol.events import (
    Arm,
    BatteryLow,
    Depart,
    Disarm,
    Due,
    Event,
    Fly,
    Landed,
    Launch,
    Measure,
    Measured,
    Received,
    Send,
    ThawBegins,
    Timer,
)
from swarmer.radio import Ears, EndRules, ReplayWindow, fate, heard
from swarmer.state_machine import Identity
from swarmer.streams import stream
from swarmer.telemetry import Wire

FAILED, DEPARTED = "failed", "departed"

# As plain numbers: indexing by a member of an enum takes twice the time.
_SENT, _DELIVERED, _REPLAYED = int(Wire.SENT), int(Wire.DELIVERED), int(Wire.REPLAYED)
_LOST_SENDER, _LOST_RECEIVER = int(Wire.LOST_SENDER), int(Wire.LOST_RECEIVER)
_ANSWERED_AT_ONCE, _FLIGHTS = int(Wire.ANSWERED_AT_ONCE), int(Wire.FLIGHTS)
_DISTANCE = int(Wire.DISTANCE_MICROCELLS)
_REFUSED = {
    "run": Wire.OTHER_RUN, "sender": Wire.BAD, "address": Wire.NOT_ADDRESSED, "range": Wire.OUT_OF_RANGE,
    "own": Wire.OWN_SWARM,
}  # fmt: skip
_DUE = tuple(map(Due, Timer))
_LANDED = Landed()
_STILL: Vec3 = (0.0, 0.0, 0.0)


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


class VirtualFls:
    """The network role (`hear`) and the handler role (`take_message`, `take_due`) of one FLS.

    It handles what reaches it at once; `virtual_queue.BusyFls` takes time for it.
    """

    __slots__ = (
        "_agenda", "_air", "_count", "_counts", "_dead_reckoning", "_flight_rng", "_fresh", "_heard_from",
        "_latency_rng", "_machine_rng", "_measured_from", "_neighbour_reply", "_neighbours", "_noted",
        "_numbers", "_range_estimated", "_receiver_rng", "_receiver_rules", "_sender_rng", "_sender_rules",
        "_sensor", "_sensor_rng", "_velocity", "_witness", "alive", "due", "ears", "fid", "flight", "machine", "shared",
        "spec",
    )  # fmt: skip

    def __init__(self, shared: Shared, spec: FlsSpec) -> None:
        rules = shared.rules
        self.shared, self.spec, self.fid, self.alive = shared, spec, spec.fid, True
        self._agenda, self._air, self._counts = shared.agenda, shared.air, shared.counts
        self._witness = shared.witness
        self._count = rules.count
        self._velocity, self._sensor = make_velocity(rules), make_sensor(rules)
        self._dead_reckoning = DEAD_RECKONING[rules.dead_reckoning]
        self._sender_rules, self._receiver_rules = EndRules(*rules.sender), EndRules(*rules.receiver)
        self._range_estimated, self._neighbour_reply = rules.range_estimated, rules.neighbour_reply
        self._draw_streams()
        self.machine = make_machine(
            rules, Identity(spec.fid, spec.incarnation, spec.truth), spec.neighbours, spec.reach,
            self._machine_rng, shared.counts, spec.epoch,
        )  # fmt: skip
        self._neighbours = self.machine.beliefs.neighbours
        self.flight = Flight(spec.origin, _STILL, 0.0, 0.0, 0.0)
        self.ears = Ears(RUN, spec.fid, NO_SWARM, spec.truth, self._neighbours)
        self._fresh = ReplayWindow().fresh
        self._numbers = counting(1)
        self._heard_from = self._measured_from = _STILL
        self.due = [NEVER] * (FAILURE + 1)  # when what this FLS waits for is due
        self._noted = [NEVER] * (FAILURE + 1)  # when the agenda will look at it, which may be earlier
        self._air.join(self, spec)
        now = self._agenda.now
        if self._witness is not None:
            self._witness.made(self, now)
        self._wait(LAUNCH, spec.launch_at_s)
        if rules.failure_rate > 0:
            self._wait(FAILURE, now + self._stream("failure").expovariate(rules.failure_rate))
        if rules.battery_s > 0:
            self._wait(BATTERY, now + rules.battery_s)

    def _draw_streams(self) -> None:
        """The streams of `fls_process`, those that this run draws from, and one for latencies."""
        rules, seed = self.shared.rules, self.shared.seed
        shared = rules.deploy_shared_error and self.spec.incarnation == 0
        self._flight_rng = stream(seed, "flight") if shared else self._stream("flight")
        self._machine_rng = stream(seed, "machine") if shared else self._stream("machine")
        self._latency_rng = self._stream("latency")
        self._sender_rng = None if self._sender_rules.perfect else self._stream("sender")
        self._receiver_rng = None if self._receiver_rules.perfect else self._stream("receiver")
        self._sensor_rng = self._stream("sensor")

    def _stream(self, purpose: str) -> Random:
        return stream(self.shared.seed, purpose, self.fid, self.spec.incarnation)

    # -- the network role ----------------------------------------------------------------------------------------

    def hear(self, message: Message, stamp: Stamp) -> None:
        """Take one datagram off the air."""
        here = self.position() if self._range_estimated else None
        refusal = heard(message, stamp, self.ears, self._count, here)
        if refusal is not None:
            self._counts[_REFUSED[refusal]] += 1
            self._tell_fate(message, stamp, refusal)
            return
        rng = self._receiver_rng
        if rng is None or message.sender == ENGINE_FID:
            self.arrive(message, stamp)
            return
        copies = fate(self._receiver_rules, rng)
        if not copies:
            self._counts[_LOST_RECEIVER] += 1
            self._tell_fate(message, stamp, "lost")
        for delay in copies:
            if delay > 0.0:
                self._tell_fate(message, stamp, "delayed")
                self._agenda.put(self._agenda.now + delay, HELD, self, message, stamp)
            else:
                self.arrive(message, stamp)

    def arrive(self, message: Message, stamp: Stamp) -> None:
        """A datagram that the radio let through: judged, answered at once or handled."""
        counts = self._counts
        if not self._fresh(message.sender, message.incarnation, stamp.number):
            counts[_REPLAYED] += 1
            self._tell_fate(message, stamp, "replayed")
            return
        counts[_DELIVERED] += 1
        machine = self.machine
        verdict = race.judge(message, machine, self._neighbours, self._neighbour_reply)
        if self._witness is not None:
            self._tell_fate(message, stamp, _fate_of(verdict))
        if verdict.queue:
            self.take_message(message, stamp)
            return
        if verdict.reply is not None:
            counts[_ANSWERED_AT_ONCE] += 1
            spec = self.spec
            self.send(race.answer(message, verdict.reply, machine, spec.fid, spec.incarnation, spec.truth))
        if verdict.note:
            self.take_note(message, stamp)

    def _tell_fate(self, message: Message, stamp: Stamp, fate: str) -> None:
        if self._witness is not None:
            self._witness.heard(self, message, stamp, fate, self._agenda.now)

    # -- the handler role ----------------------------------------------------------------------------------------

    def take_message(self, message: Message, stamp: Stamp) -> None:
        """Handle a message that the network role queued."""
        self._heard_from = stamp.origin
        self.feed(Received(message), stamp)

    def take_note(self, message: Message, stamp: Stamp) -> None:
        """Note the sender's Swarm-ID."""
        self.feed(Received(message, noted=True), stamp)

    def take_due(self, what: int) -> None:
        """Take up a timer, a landing, or what else this FLS waited for."""
        if what < LANDING:
            self.feed(_DUE[what])
        elif what == LANDING:
            end = position_at(self.flight, NEVER, self._velocity)
            self.flight = Flight(end, _STILL, self._agenda.now, 0.0, 0.0)
            self._air.moved(self)
            self.feed(_LANDED)
        elif what == MEASURED:
            self._measure()
        elif what == LAUNCH:
            self.feed(_LANDED if self.shared.rules.deploy_random else Launch(self.spec.origin))
        elif what == BATTERY:
            self.feed(BatteryLow())
        else:
            self._end(FAILED)

    def feed(self, event: Event, cause: Stamp | None = None) -> None:
        """One event to the machine, and what it wants done. cause: the stamp of an event that is a datagram."""
        machine = self.machine
        actions = machine.handle(event, self._agenda.now)
        if self._witness is not None:
            self._witness.handled(self, event, actions, cause, self._agenda.now)
        if machine.swarm is not self.ears.swarm:
            self._retune()
        for action in actions:
            kind = type(action)
            if kind is Send:
                self.send(action.message)  # type: ignore[union-attr]
            elif kind is Arm:
                self._wait(int(action.timer), action.at_s)  # type: ignore[union-attr]
            elif kind is Disarm:
                self.due[action.timer] = NEVER  # type: ignore[union-attr]
            else:
                self._perform(action)

    def _perform(self, action: Any) -> None:
        """What is seldom asked for."""
        kind = type(action)
        if kind is Fly:
            self._fly(action.vector)
        elif kind is Measure:
            self._measured_from = self._heard_from
            if self._sensor.delay_s > 0:
                self._wait(MEASURED, self._agenda.now + self._sensor.delay_s)
            else:
                self._measure()
        elif kind is ThawBegins:
            self.shared.thaw_begins(self, action)
        elif kind is Depart:
            self._end(DEPARTED)

    def _measure(self) -> None:
        x, o = self.position(), self._measured_from
        vector = self._sensor.measure((o[0] - x[0], o[1] - x[1], o[2] - x[2]), self._sensor_rng)
        self.feed(Measured(vector))

    def _fly(self, vector: Vec3) -> None:
        rules, now, counts = self.shared.rules, self._agenda.now, self._counts
        flown = self._dead_reckoning(vector, rules.epsilon, rules.dim, self._flight_rng)
        self.flight = flight = plan_flight(self.position(), flown, now, self._velocity)
        self._wait(LANDING, now + flight.duration_s)
        self._air.moved(self)
        if self._witness is not None:
            self._witness.flew(self, vector, flight, now)
        counts[_FLIGHTS] += 1
        counts[_DISTANCE] += round(flight.length * 1e6)

    def _wait(self, what: int, at_s: float) -> None:
        """Wait until an emulated second, and no longer for what `what` was waited for before."""
        self.due[what] = at_s = max(at_s, self._agenda.now)
        if at_s < self._noted[what]:  # else the agenda looks early enough, and then again
            self._noted[what] = at_s
            self._agenda.put(at_s, what, self)

    def look(self, what: int, at_s: float) -> bool:
        """The agenda's note of `at_s` has come up: is that due now? Then it is taken off."""
        if self._noted[what] != at_s:
            return False  # there was an earlier note since
        self._noted[what] = NEVER
        due_s = self.due[what]
        if due_s > at_s:
            if due_s < NEVER:
                self._wait(what, due_s)
            return False
        self.due[what] = NEVER
        return True

    def _retune(self) -> None:
        """Listen to the machine's swarm from now on; in the dark to none."""
        machine, ears = self.machine, self.ears
        if machine.awake:
            self.ears = Ears(RUN, self.fid, machine.swarm, ears.truth, ears.neighbours)
            if machine.swarm != ears.swarm:
                self._air.tune(self, ears.swarm, machine.swarm)

    def _end(self, how: str) -> None:
        self.alive = False
        self.due = [NEVER] * len(self.due)
        self._air.leave(self)
        if self._witness is not None:
            self._witness.ended(self, how, self._agenda.now)
        self.shared.ended(self, how)

    # -- both ----------------------------------------------------------------------------------------------------

    def position(self) -> Vec3:
        """Where this FLS really is: for the radio's emulation of signals, never for the machine."""
        flight = self.flight
        if flight.length == 0.0:
            return flight.start
        return position_at(flight, self._agenda.now, self._velocity)

    @property
    def lit(self) -> bool:
        return self.alive and self.machine.awake

    def send(self, message: Message) -> None:
        """Stamp a message and put it on the air."""
        now, counts = self._agenda.now, self._counts
        counts[_SENT] += 1
        rng = self._sender_rng
        if rng is None:
            stamp = Stamp(RUN, next(self._numbers), self.position(), now)
            if self._witness is not None:
                self._witness.sent(self, message, stamp, 1, now)
            self._air.transmit(message, stamp, self._latency_rng, self)
            return
        copies = fate(self._sender_rules, rng)
        delay = copies[0] if copies else 0.0
        stamp = Stamp(RUN, next(self._numbers), self.position(), now + delay)
        if self._witness is not None:
            self._witness.sent(self, message, stamp, len(copies), now)
        if not copies:
            counts[_LOST_SENDER] += 1
        for delay in copies:
            if delay > 0.0:
                self._agenda.put(now + delay, OUTGOING, self, message, stamp)
            else:
                self.transmit(message, stamp)

    def transmit(self, message: Message, stamp: Stamp) -> None:
        """A datagram leaves this FLS's own end of the radio."""
        self._air.transmit(message, stamp, self._latency_rng, self)


def _fate_of(verdict: race.Verdict) -> str:
    if verdict.queue:
        return "queued"
    if verdict.reply is not None:
        return "answered"
    return "noted" if verdict.note else "dropped"
