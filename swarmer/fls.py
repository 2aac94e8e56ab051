"""One FLS, whatever engine it lives in: what its network role and its handler role do with a datagram and with time.

The network role (`hear`) asks the radio's rules, answers races at once (rules 8 and 9) and passes the rest on. The
handler role alone mutates: it feeds one message, timer or landing to the pure state machine, and performs what comes
back. An engine's business is where datagrams and moments come from and go to: `fls_process.Fls` has sockets and a
clock, `engines.virtual_fls.VirtualFls` an agenda.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from itertools import count as counting
from random import Random
from typing import TYPE_CHECKING

from swarmer.faults import NO_FAULTS, Schedule
from swarmer.fls_spec import FlsSpec
from swarmer.messages import ENGINE_FID, NO_SWARM, ZERO, Message, Stamp, Swarm, Vec3
from swarmer.physics.dead_reckoning import MODELS as DEAD_RECKONING
from swarmer.physics.flight import Flight, plan_flight, position_at, way
from swarmer.physics.sensor_faults import sensed
from swarmer.plan import make_machine, make_sensor, make_velocity
from swarmer.protocol import race
from swarmer.protocol.events import (
    Action,
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
    NewShape,
    Received,
    Send,
    ThawBegins,
    Timer,
)  # fmt: skip
from swarmer.protocol.records import Counters
from swarmer.radio import Ears, ReplayWindow, heard
from swarmer.radio_faults import Ends
from swarmer.rules import Rules
from swarmer.state_machine import Identity, State
from swarmer.streams import stream
from swarmer.telemetry import DELIVERED_BY_KIND, REFUSED, SENT_BY_KIND, Wire

if TYPE_CHECKING:
    from swarmer.engines.result import Witness

FAILED, DEPARTED = "failed", "departed"

# What an FLS waits for, besides the machine's timers, which come first: places in the list of deadlines.
LANDING, MEASURED, LAUNCH, BATTERY, NEW_SHAPE, FAILURE = range(len(Timer), len(Timer) + 6)
NEVER = float("inf")

# As plain numbers: indexing by a member of an enum takes twice the time.
_SENT, _DELIVERED, _REPLAYED = int(Wire.SENT), int(Wire.DELIVERED), int(Wire.REPLAYED)
_LOST_SENDER, _LOST_RECEIVER = int(Wire.LOST_SENDER), int(Wire.LOST_RECEIVER)
_ANSWERED_AT_ONCE, _FLIGHTS = int(Wire.ANSWERED_AT_ONCE), int(Wire.FLIGHTS)
_DISTANCE, _LOCALIZING = int(Wire.DISTANCE_MICROCELLS), int(Wire.LOCALIZING_MICROCELLS)
_FLOWN = {State.BUSY_LOCALIZING: _LOCALIZING, State.WAITING: int(Wire.FOLLOWING_MICROCELLS)}
DUE, _LANDED = tuple(map(Due, Timer)), Landed()

Queued = tuple[float, Message, Stamp]  # since which emulated second it counts as late


class BaseFls(ABC):
    """The two roles and what they share. An engine's class says how time passes and which way a datagram takes."""

    __slots__ = (
        "_count", "_dead_reckoning", "_ends", "_flight_rng", "_heard_from", "_legs", "_machine_rng", "_measured_from",
        "_neighbour_reply", "_neighbours", "_numbers", "_range_estimated", "_run_id", "_seed", "_sensor_faults",
        "_sensor_faults_rng", "_sensor_rng", "_window", "due", "ears", "flight", "handler_counts", "machine",
        "network_counts", "notes", "published", "queues", "rules", "sensor", "spec", "velocity", "witness",
    )  # fmt: skip

    def __init__(
        self, run_id: int, seed: int, rules: Rules, spec: FlsSpec, handler_counts: Counters, network_counts: Counters,
        witness: Witness | None = None, faults: Schedule = NO_FAULTS,
    ) -> None:  # fmt: skip
        """run_id: on every datagram. seed: of the run. counts: of the thread of either role, in places of `Wire`.
        witness: told of everything, if the engine lets anybody watch. faults: of which this is about those of radio and
        sensor; who is dark, hangs or is slow is an engine's business.

        The clock of the class must run by now, for what an FLS waits for from its first moment on.
        """
        self._run_id, self._seed, self.rules, self.spec = run_id, seed, rules, spec
        self.handler_counts, self.network_counts, self.witness = handler_counts, network_counts, witness
        self.velocity, self.sensor = make_velocity(rules), make_sensor(rules)
        self._dead_reckoning = DEAD_RECKONING[rules.dead_reckoning]
        self._ends = Ends(rules, faults, seed, spec.fid, self.own_stream)
        self._sensor_faults = faults.of_sensors(spec.fid)
        self._count, self._range_estimated = rules.count, rules.range_estimated
        self._neighbour_reply = rules.neighbour_reply
        self._draw_streams()
        self.machine = make_machine(
            rules, Identity(spec.fid, spec.incarnation, spec.truth), spec.neighbours, spec.reach,
            self._machine_rng, handler_counts, spec.epoch, spec.then,
        )  # fmt: skip
        self.published: race.Published = self.machine  # what the network role may read of it
        self._neighbours = self.machine.beliefs.neighbours
        self.flight = Flight(spec.begins_at, ZERO, 0.0, 0.0, 0.0)
        self._legs: tuple[Vec3, ...] = ()  # of the way that it is on, those still to come
        self.ears = Ears(run_id, spec.fid, NO_SWARM, spec.truth, self._neighbours)
        self._window = ReplayWindow()
        self._numbers = counting(1)
        self.queues: tuple[deque[Queued], ...] = (deque(), deque(), deque())
        self.notes: deque[tuple[Message, Stamp]] = deque(maxlen=1024)
        # Where the sender of the message in hand is; where the anchor is: samples take time, others speak meanwhile.
        self._heard_from = self._measured_from = ZERO
        self.due = [NEVER] * (FAILURE + 1)  # emulated seconds

    def begin(self) -> None:
        """From now on it waits for its launch, and for its end if it has one."""
        rules, now = self.rules, max(self.now(), 0.0)
        self.wait(LAUNCH, self.spec.launch_at_s)
        if rules.failure_rate > 0:
            self.wait(FAILURE, now + self.own_stream("failure").expovariate(rules.failure_rate))
        if rules.battery_s > 0:
            self.wait(BATTERY, max(now, self.spec.launch_at_s) + rules.battery_s)
        if self.spec.then is not None:
            self.wait(NEW_SHAPE, rules.change_s or 0.0)

    def _draw_streams(self) -> None:
        # The authors' processes fork with one state of the generator: the first draws of all are the same.
        shared = self.rules.deploy_shared_error and self.spec.incarnation == 0
        self._flight_rng = stream(self._seed, "flight") if shared else self.own_stream("flight")
        self._machine_rng = stream(self._seed, "machine") if shared else self.own_stream("machine")
        own = self.own_stream
        self._sensor_rng = own("sensor")
        self._sensor_faults_rng = own("sensor faults") if self._sensor_faults else self._sensor_rng

    def own_stream(self, purpose: str) -> Random:
        """What this FLS draws from for one purpose."""
        return stream(self._seed, purpose, self.spec.fid, self.spec.incarnation)

    # -- what an engine supplies ---------------------------------------------------------------------------------

    @abstractmethod
    def now(self) -> float:
        """The emulated second."""

    @abstractmethod
    def wait(self, what: int, at_s: float) -> None:
        """Wait for `what` until an emulated second, in place of what it was waited for before."""

    @abstractmethod
    def transmit(self, message: Message, stamp: Stamp, counts: Counters) -> None:
        """A datagram leaves this FLS's own end of the radio. counts: of the thread that lets it go."""

    @abstractmethod
    def send_later(self, delay_s: float, message: Message, stamp: Stamp) -> None:
        """`transmit` it so many emulated seconds from now."""

    @abstractmethod
    def hear_later(self, delay_s: float, message: Message, stamp: Stamp) -> None:
        """Let it `arrive` so many emulated seconds from now."""

    @abstractmethod
    def queue(self, message: Message, stamp: Stamp) -> None:
        """The handler takes this message up, by its priority."""

    @abstractmethod
    def note(self, message: Message, stamp: Stamp) -> None:
        """The handler notes the sender's Swarm-ID."""

    @abstractmethod
    def taken_up(self, late_s: float) -> None:
        """The handler begins with a message that has waited for so many emulated seconds."""

    @abstractmethod
    def timer_taken_up(self, late_s: float) -> None:
        """The handler begins with what was due so many emulated seconds ago."""

    @abstractmethod
    def tuned(self, old: Swarm) -> None:
        """`ears` listen to another swarm than `old` from now on."""

    @abstractmethod
    def moved_on(self) -> None:
        """`spec` and `ears` are those of the next shape."""

    @abstractmethod
    def moved(self) -> None:
        """`flight` has begun or ended."""

    def thaw_begins(self, begins: ThawBegins) -> None:  # noqa: B027 -- most engines have nothing to do
        """This FLS begins a thaw: for who watches."""

    @abstractmethod
    def end(self, how: str) -> None:
        """Its life is over: FAILED or DEPARTED."""

    # -- the network role ----------------------------------------------------------------------------------------

    def hear(self, message: Message, stamp: Stamp) -> None:
        """Take one datagram off the air."""
        here = self.position() if self._range_estimated else None
        refusal = heard(message, stamp, self.ears, self._count, here)
        if refusal is not None:
            self.network_counts[REFUSED[refusal]] += 1
            self.tell_fate(message, stamp, refusal)
        elif self._ends.plain_in or message.sender == ENGINE_FID:
            self.arrive(message, stamp)
        else:
            self._receive(message, stamp)

    def _receive(self, message: Message, stamp: Stamp) -> None:
        """What this FLS's own end of the radio does to it."""
        copies = self._ends.heard(message, stamp.sent_at)
        if not copies:
            self.network_counts[_LOST_RECEIVER] += 1
            self.tell_fate(message, stamp, "lost")
        for delay in copies:
            if delay > 0.0:
                self.tell_fate(message, stamp, "delayed")
                self.hear_later(delay, message, stamp)
            else:
                self.arrive(message, stamp)

    def arrive(self, message: Message, stamp: Stamp) -> None:
        """A datagram that the radio let through: judged, answered at once, noted or queued."""
        counts = self.network_counts
        if not self.fresh(message, stamp):
            counts[_REPLAYED] += 1
            self.tell_fate(message, stamp, "replayed")
            return
        counts[_DELIVERED] += 1
        counts[DELIVERED_BY_KIND + message.kind] += 1
        verdict = race.judge(message, self.published, self._neighbours, self._neighbour_reply)
        if self.witness is not None:
            self.tell_fate(message, stamp, verdict.word)
        if verdict.queue:
            self.queue(message, stamp)
            return
        if verdict.reply is not None:
            counts[_ANSWERED_AT_ONCE] += 1
            spec = self.spec
            reply = race.answer(
                message, verdict.reply, self.published, spec.fid, spec.incarnation, spec.truth
            )
            self.send(reply, counts)
        if verdict.note:
            self.note(message, stamp)

    def fresh(self, message: Message, stamp: Stamp) -> bool:
        """Rule 12: not received before, not too old, not from a predecessor; from now on it counts as received."""
        return self._window.fresh(message.sender, message.incarnation, stamp.number)

    def tell_fate(self, message: Message, stamp: Stamp, fate: str) -> None:
        """What became of a datagram here, in the words of `engines.result.FATES`."""
        if self.witness is not None:
            self.witness.heard(self, message, stamp, fate, self.now())  # type: ignore[arg-type]

    # -- the handler role ----------------------------------------------------------------------------------------

    def work(self, now: float) -> bool:
        """Handle the one thing that is most urgent; False if there is nothing to do now."""
        while self.notes:
            message, stamp = self.notes.popleft()
            if not self._outlived(message, stamp):
                self.take_message(message, stamp, self.now(), noted=True)
        queues = self.queues
        if queues[0]:
            self._take_up(queues[0], now)
        elif (due_s := min(self.due)) <= now:
            what = self.due.index(due_s)
            self.due[what] = NEVER
            self.timer_taken_up(now - due_s)
            self.take_due(what)
        elif queues[1]:
            self._take_up(queues[1], now)
        elif queues[2]:
            self._take_up(queues[2], now)
        else:
            return False
        return True

    def _take_up(self, queue: deque[Queued], now: float) -> None:
        since, message, stamp = queue.popleft()
        if not (self._outlived(message, stamp) or self.machine.is_void(message, since)):
            self.taken_up(now - since)
            self.take_message(message, stamp, self.now())

    def _outlived(self, message: Message, stamp: Stamp) -> bool:
        """While it waited a successor of its sender was heard, in a queue that goes first: too late (rule 12)."""
        outlived = self._window.outlived(message.sender, message.incarnation)
        if outlived:
            self.handler_counts[_REPLAYED] += 1
            self.tell_fate(message, stamp, "replayed")
        return outlived

    def take_message(self, message: Message, stamp: Stamp, now: float, noted: bool = False) -> None:
        """Handle a message that the network role queued. noted: only the sender's Swarm-ID is of interest."""
        self._heard_from = stamp.origin
        actions = self.machine.receive(message, now, noted)
        if self.witness is not None:
            self.witness.handled(self, Received(message, noted), actions, stamp, now)  # type: ignore[arg-type]
        self.perform(actions, now)

    def take_due(self, what: int) -> None:
        """Take up a timer, a landing, or what else this FLS waited for."""
        if what < LANDING:
            self.feed(DUE[what])
        elif what == LANDING:
            # Where the flight ends, whenever that is noticed.
            end = position_at(self.flight, NEVER, self.velocity)
            self.flight = Flight(end, ZERO, self.now(), 0.0, 0.0)
            self.moved()
            if self._legs:
                self._fly_legs(self._legs, self.now())
                self.perform([], self.now())  # nothing but what comes with it: to show where it flies now
            else:
                self.feed(self._landed())
        elif what == MEASURED:
            self._measure()
        elif what == LAUNCH:
            self.feed(self._landed() if self.spec.starts_lit else Launch(self.spec.begins_at))
        elif what == BATTERY:
            self.feed(BatteryLow())
        elif what == NEW_SHAPE:
            self.feed(NewShape())
        else:
            self.end(FAILED)

    def _landed(self) -> Landed:
        """To an oracle with how far it is from its point."""
        return Landed(way(self.position(), self.machine.truth)) if self.machine.oracle else _LANDED

    def feed(self, event: Event) -> None:
        """One event to the machine, and what it wants done."""
        now = self.now()
        actions = self.machine.handle(event, now)
        if self.witness is not None:
            self.witness.handled(self, event, actions, None, now)  # type: ignore[arg-type]
        self.perform(actions, now)

    def perform(self, actions: list[Action], now: float) -> None:
        """What the machine wants done, in this order."""
        if self.machine.swarm is not self.ears.swarm:
            self._retune()
        for action in actions:
            kind = type(action)
            if kind is Arm:
                self.wait(action.timer, action.at_s)  # type: ignore[union-attr]
            elif kind is Send:
                self.send(action.message, self.handler_counts)  # type: ignore[union-attr]
            elif kind is Disarm:
                self.due[action.timer] = NEVER  # type: ignore[union-attr]
            else:
                self._perform(action, now)

    def _perform(self, action: Action, now: float) -> None:
        """What is seldom asked for."""
        kind = type(action)
        if kind is Fly:
            self._fly_legs(action.legs or (action.vector,), now)  # type: ignore[union-attr]
        elif kind is Measure:
            self._measured_from = self._heard_from
            if self.sensor.delay_s > 0:
                self.wait(MEASURED, now + self.sensor.delay_s)
            else:
                self._measure()
        elif kind is ThawBegins:
            self.thaw_begins(action)  # type: ignore[arg-type]
        elif kind is Depart:
            self.end(DEPARTED)

    def _measure(self) -> None:
        vector = self.sensor.measure(way(self.position(), self._measured_from), self._sensor_rng)
        if self._sensor_faults:
            vector = sensed(vector, self._sensor_faults, self.now(), self._sensor_faults_rng)
        self.feed(Measured(vector))

    def _fly_legs(self, legs: tuple[Vec3, ...], now: float) -> None:
        vector, self._legs = legs[0], legs[1:]
        rules, counts = self.rules, self.handler_counts
        flown = self._dead_reckoning(vector, rules.epsilon, rules.dim, self._flight_rng)
        self.flight = flight = plan_flight(self.position(), flown, now, self.velocity)
        self.wait(LANDING, now + flight.duration_s)
        self.moved()
        if self.witness is not None:
            self.witness.flew(self, vector, flight, now)  # type: ignore[arg-type]
        counts[_FLIGHTS] += 1
        counts[_DISTANCE] += (microcells := round(flight.length * 1e6))
        if place := _FLOWN.get(self.machine.state):  # else it deploys, or leaves
            self.count_flown(place, microcells)

    def count_flown(self, place: int, microcells: int) -> None:
        self.handler_counts[place] += microcells

    def _retune(self) -> None:
        """Listen to the machine's swarm from now on, in the dark to none; and as who has its point."""
        machine, ears = self.machine, self.ears
        if machine.truth is not ears.truth:  # the next shape has begun
            self.spec = self.spec.changed()
            self._neighbours = machine.beliefs.neighbours
            self.ears = ears = Ears(ears.run, ears.fid, ears.swarm, machine.truth, self._neighbours)
            self.moved_on()
        swarm = machine.swarm if machine.awake else NO_SWARM
        if swarm is not ears.swarm:
            self.ears = Ears(ears.run, ears.fid, swarm, ears.truth, ears.neighbours)
            if swarm != ears.swarm:
                self.tuned(ears.swarm)

    # -- both ----------------------------------------------------------------------------------------------------

    def position(self) -> Vec3:
        """Where this FLS really is: for the radio's emulation of signals, never for the machine."""
        flight = self.flight
        if flight.length == 0.0:
            return flight.start
        return position_at(flight, self.now(), self.velocity)

    def stamp(self, message: Message, sent_at: float) -> Stamp:
        """What the radio adds to a message that leaves at an emulated second."""
        return Stamp(self._run_id, next(self._numbers), self.position(), sent_at)

    def send(self, message: Message, counts: Counters) -> None:
        """Stamp and send; `counts`: those of the thread that sends."""
        counts[_SENT] += 1
        counts[SENT_BY_KIND + message.kind] += 1
        if not self._ends.plain_out:
            self._send_by_chance(message, counts)
            return
        now = self.now()
        stamp = self.stamp(message, now)
        if self.witness is not None:
            self.witness.sent(self, message, stamp, 1, now)  # type: ignore[arg-type]
        self.transmit(message, stamp, counts)

    def _send_by_chance(self, message: Message, counts: Counters) -> None:
        """What this FLS's own end of the radio does to it."""
        now = self.now()
        copies = self._ends.sent(message, now)
        stamp = self.stamp(message, now + copies[0] if copies else now)
        if self.witness is not None:
            self.witness.sent(self, message, stamp, len(copies), now)  # type: ignore[arg-type]
        if not copies:
            counts[_LOST_SENDER] += 1
        for delay in copies:
            if delay > 0.0:
                self.send_later(delay, message, stamp)
            else:
                self.transmit(message, stamp, counts)
