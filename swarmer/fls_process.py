"""One FLS as an OS process (section 6): what its network thread and its handler thread do, whichever loop runs them.

The network role (`hear`) reads what the handler last published and nothing else of it: it validates, filters, answers
races at once (rules 8 and 9) and queues the rest by priority. The handler role (`work`) alone mutates: it takes one
queued message, timer or landing, feeds the pure state machine and performs the actions that come back.
"""

from __future__ import annotations

import heapq
import os
from collections import deque
from itertools import count as counting
from time import monotonic
from typing import Any, NamedTuple

from swarmer.messages import (
    CHALLENGE_INIT,
    CONTROL,
    ENGINE_FID,
    NO_SWARM,
    BadDatagram,
    Kind,
    Message,
    Stamp,
    Swarm,
    Vec3,
    decode,
    encode,
)
from swarmer.physics.dead_reckoning import MODELS as DEAD_RECKONING
from swarmer.physics.flight import Flight, plan_flight, position_at
from swarmer.plan import Rules, make_machine, make_sensor, make_velocity
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
    Received,
    Send,
    Timer,
)
from swarmer.radio import DELIVERED_NOW, Ears, EndRules, Grid, ReplayWindow, fate, heard
from swarmer.state_machine import Identity, State
from swarmer.streams import stream
from swarmer.telemetry import Clock, Life, Phase, Row, SharedMemory, Slot, Wire
from swarmer.udp_wrapper import UdpWrapper, Wires

FAILED_EXIT = 17  # an FLS that failed as scheduled, without a word (rule 13)
DEPARTED_EXIT = 18  # one that left to charge

_SENT, _BYTES_SENT, _DELIVERED, _BYTES_DELIVERED = (
    Wire.SENT,
    Wire.BYTES_SENT,
    Wire.DELIVERED,
    Wire.BYTES_DELIVERED,
)
_LOST_SENDER, _LOST_RECEIVER, _REPLAYED, _BAD = Wire.LOST_SENDER, Wire.LOST_RECEIVER, Wire.REPLAYED, Wire.BAD
_ANSWERED_AT_ONCE, _DISTANCE_MICROCELLS = Wire.ANSWERED_AT_ONCE, Wire.DISTANCE_MICROCELLS
_FLIGHTS, _SEND_FAILED, _WOKEN = Wire.FLIGHTS, Wire.SEND_FAILED, Wire.WOKEN
_WAIT, _GO, _STOP = Phase

# Lower goes first: control and thaw, then what a whole swarm waits for, then the rest.
_FIRST = {Kind.THAW, Kind.THAW_ANNOUNCE, Kind.THAW_ABORT}
_SECOND = {
    Kind.SET_WAITING, Kind.SET_AVAILABLE, Kind.FOLLOW, Kind.MERGE, Kind.FOLLOW_MERGE, Kind.CHALLENGE_FIN, Kind.COUNT,
    Kind.ROLL_CALL,
}  # fmt: skip
PRIORITY = tuple(0 if n in _FIRST else 1 if n in _SECOND else 2 for n in range(max(Kind) + 1))

# What an FLS waits for, besides the machine's timers, which come first: places in the list of deadlines.
LANDING, MEASURED, LAUNCH, BATTERY, FAILURE = range(len(Timer), len(Timer) + 5)
NEVER = float("inf")


class RunSpec(NamedTuple):
    """What all FLSs of a run share."""

    run: int
    seed: int
    key: bytes  # of the MAC; empty without
    rules: Rules
    wires: Wires
    steps_per_cell: float  # of the radio's grid
    loop: str
    cpus: tuple[int, ...]  # cores to pin to, by turns; empty: do not pin


class FlsSpec(NamedTuple):
    """What one FLS is."""

    fid: int
    incarnation: int
    truth: Vec3
    neighbours: tuple[int, ...]
    reach: float  # cells to the farthest planned neighbour
    near: tuple[int, ...]  # FIDs nearest in ground truth, nearest first
    distances: tuple[float, ...]
    origin: Vec3  # where it starts from
    launch_at_s: float
    epoch: int


class Fls:
    """The two roles and what they share. A loop (`fls_loops`) calls them."""

    def __init__(self, run: RunSpec, spec: FlsSpec, shared: SharedMemory) -> None:
        """Raises OSError where sockets are not to be had."""
        rules = run.rules
        self.run, self.spec, self.rules = run, spec, rules
        self.clock = Clock(shared)
        self.slot = Slot(shared, spec.fid)
        self.handler_counts, self.network_counts = self.slot.handler_counts, self.slot.network_counts
        self.velocity, self.sensor = make_velocity(rules), make_sensor(rules)
        self._dead_reckoning = DEAD_RECKONING[rules.dead_reckoning]
        self._sender_rules, self._receiver_rules = EndRules(*rules.sender), EndRules(*rules.receiver)
        self._sends_perfectly, self._hears_perfectly = (
            self._sender_rules.perfect,
            self._receiver_rules.perfect,
        )
        self._draw_streams()
        self.machine = make_machine(
            rules, Identity(spec.fid, spec.incarnation, spec.truth), spec.neighbours, spec.reach,
            self._machine_rng, self.handler_counts, spec.epoch,
        )  # fmt: skip
        self.published: race.Published = self.machine
        self.flight = Flight(spec.origin, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
        self._grid = Grid(run.steps_per_cell)
        self._cell = self._grid.of(spec.truth)
        self.ears = Ears(run.run, spec.fid, NO_SWARM, spec.truth, self.machine.beliefs.neighbours)
        self.udp = UdpWrapper(
            self.ears, shared.directory(), run.wires, self._grid, spec.near, spec.distances,
            not rules.range_estimated,
        )  # fmt: skip
        self._window = ReplayWindow()
        self._numbers = counting(1)
        self._order = counting()
        self._queues: tuple[deque[tuple[Message, Stamp]], ...] = (deque(), deque(), deque())
        self._notes: deque[Message] = deque(maxlen=1024)
        self._held: list[tuple[float, int, Message, Stamp]] = []  # arrived, not yet due
        self._outgoing: list[tuple[float, int, Message, bytes]] = []  # sent, not yet on the air
        self._due = [NEVER] * (FAILURE + 1)
        self._due[LAUNCH] = spec.launch_at_s
        self._heard_from: Vec3 = (0.0, 0.0, 0.0)  # where the sender of the message in hand is
        self._measured_from: Vec3 = (
            0.0,
            0.0,
            0.0,
        )  # where the anchor is: samples take time, others speak meanwhile
        self._shown: tuple[object, ...] = ()
        self.exit_status: int | None = None
        if rules.failure_rate > 0:
            self._due[FAILURE] = max(self.clock.now(), 0.0) + self._failure_rng.expovariate(
                rules.failure_rate
            )
        if rules.battery_s > 0:
            self._due[BATTERY] = max(self.clock.now(), 0.0) + rules.battery_s

    def _draw_streams(self) -> None:
        seed, fid, incarnation = self.run.seed, self.spec.fid, self.spec.incarnation

        def own(purpose: str) -> Any:
            return stream(seed, purpose, fid, incarnation)

        # The authors' processes fork with one state of the generator: the first draws of all are the same.
        shared = self.rules.deploy_shared_error and incarnation == 0
        self._flight_rng = stream(seed, "flight") if shared else own("flight")
        self._machine_rng = stream(seed, "machine") if shared else own("machine")
        self._sender_rng, self._receiver_rng = own("sender"), own("receiver")
        self._sensor_rng, self._failure_rng = own("sensor"), own("failure")

    # -- the network role ----------------------------------------------------------------------------------------

    def hear(self, data: memoryview | bytes) -> None:
        """Take one datagram off a socket."""
        counts = self.network_counts
        try:
            message, stamp = decode(data, self.run.key)
        except BadDatagram:
            counts[_BAD] += 1
            return
        here = self.position() if self.rules.range_estimated else None
        refusal = heard(message, stamp, self.ears, self.rules.count, here)
        if refusal is not None:
            counts[_REFUSED[refusal]] += 1
            return
        if message.kind == CONTROL:
            self._wake(stamp)
            return
        copies = DELIVERED_NOW
        if not self._hears_perfectly and message.sender != ENGINE_FID:
            copies = fate(self._receiver_rules, self._receiver_rng)
            if not copies:
                counts[_LOST_RECEIVER] += 1
                return
        for delay in copies:
            if delay > 0.0:
                due = self.clock.now() + delay
                # What the radio delays on purpose is not lateness.
                late = stamp._replace(sent_at=stamp.sent_at + delay)
                heapq.heappush(self._held, (due, next(self._order), message, late))
            else:
                self._arrive(message, stamp, len(data))

    def _wake(self, stamp: Stamp) -> None:
        """The engine wants everybody to look at the control page, which the clock does by itself."""
        self.network_counts[_WOKEN] += 1
        self.clock.now()
        if self.clock.phase == _WAIT:  # a rehearsal: how long does it take to wake us all?
            self.udp.tune(self.ears)
            self.slot.handled_late((monotonic() - stamp.sent_at) * 1e3)

    def _arrive(self, message: Message, stamp: Stamp, size: int) -> None:
        counts = self.network_counts
        if not self._window.fresh(message.sender, message.incarnation, stamp.number):
            counts[_REPLAYED] += 1
            return
        counts[_DELIVERED] += 1
        counts[_BYTES_DELIVERED] += size
        verdict = race.judge(
            message, self.published, self.machine.beliefs.neighbours, self.rules.neighbour_reply
        )
        if verdict.note:
            self._notes.append(message)
        if verdict.reply is not None:
            counts[_ANSWERED_AT_ONCE] += 1
            spec = self.spec
            reply = race.answer(
                message, verdict.reply, self.published, spec.fid, spec.incarnation, spec.truth
            )
            self.send(reply, counts)
        if verdict.queue:
            self._queues[PRIORITY[message.kind]].append((message, stamp))

    def network_deadline(self) -> float:
        """Emulated second at which the network role has something to do by itself."""
        return min(
            self._held[0][0] if self._held else NEVER, self._outgoing[0][0] if self._outgoing else NEVER
        )

    def release(self) -> None:
        """Let go of datagrams whose delay is over."""
        now = self.clock.now()
        while self._held and self._held[0][0] <= now:
            _, _, message, stamp = heapq.heappop(self._held)
            self._arrive(message, stamp, _size(self.run))
        while self._outgoing and self._outgoing[0][0] <= now:
            _, _, message, data = heapq.heappop(self._outgoing)
            self._transmit(data, message, self.network_counts)

    # -- the handler role ----------------------------------------------------------------------------------------

    @property
    def has_messages(self) -> bool:
        return bool(self._queues[0] or self._queues[1] or self._queues[2])

    def deadline(self) -> float:
        """Emulated second of the next timer, landing or measurement."""
        return min(self._due)

    def work(self) -> bool:
        """Handle the one thing that is most urgent; False if there is nothing to do now."""
        if self._notes:
            self._take_notes()
        clock = self.clock
        now = clock.now()
        if clock.phase != _GO:
            return self._before_or_after()
        queues = self._queues
        if queues[0]:
            return self._take_message(queues[0], now)
        due_s = min(self._due)
        if due_s <= now:
            what = self._due.index(due_s)
            self._due[what] = NEVER
            self.slot.timer_late((now - due_s) * 1e3)
            self._take_due(what, now)
            return True
        if queues[1]:
            return self._take_message(queues[1], now)
        if queues[2]:
            return self._take_message(queues[2], now)
        return False

    def _before_or_after(self) -> bool:
        if self.clock.phase == _STOP:
            self.exit_status = 0
        return False

    def _take_notes(self) -> None:
        notes = self._notes
        while notes:
            self._feed(Received(notes.popleft(), noted=True), self.clock.now())

    def _take_message(self, queue: deque[tuple[Message, Stamp]], now: float) -> bool:
        message, stamp = queue.popleft()
        self.slot.handled_late((now - stamp.sent_at) * 1e3)
        self._heard_from = stamp.origin
        self._feed(Received(message), now)
        return True

    def _take_due(self, what: int, now: float) -> None:
        if what < LANDING:
            self._feed(_DUE[what], now)
        elif what == LANDING:
            # Where the flight ends, whenever that is noticed.
            end = position_at(self.flight, NEVER, self.velocity)
            self.flight = Flight(end, (0.0, 0.0, 0.0), now, 0.0, 0.0)
            self._feed(_LANDED, now)
        elif what == MEASURED:
            self._measure(now)
        elif what == LAUNCH:
            self._launch(now)
        elif what == BATTERY:
            self._feed(BatteryLow(), now)
        else:
            os._exit(FAILED_EXIT)

    def _launch(self, now: float) -> None:
        self._feed(_LANDED if self.rules.deploy_random else Launch(self.spec.origin), now)

    def _measure(self, now: float) -> None:
        x, o = self.position(), self._measured_from
        vector = self.sensor.measure((o[0] - x[0], o[1] - x[1], o[2] - x[2]), self._sensor_rng)
        self._feed(Measured(vector), now)

    def _feed(self, event: Event, now: float) -> None:
        actions = self.machine.handle(event, now)
        self._retune()
        for action in actions:
            self._perform(action, now)
        self._publish()

    def _perform(self, action: Action, now: float) -> None:
        kind = type(action)
        if kind is Send:
            self.send(action.message, self.handler_counts)  # type: ignore[union-attr]
        elif kind is Arm:
            self._due[action.timer] = action.at_s  # type: ignore[union-attr]
        elif kind is Disarm:
            self._due[action.timer] = NEVER  # type: ignore[union-attr]
        elif kind is Fly:
            self._fly(action.vector, now)  # type: ignore[union-attr]
        elif kind is Measure:
            self._measured_from = self._heard_from
            if self.sensor.delay_s > 0:
                self._due[MEASURED] = now + self.sensor.delay_s
            else:
                self._measure(now)
        elif kind is Depart:
            self.exit_status = DEPARTED_EXIT

    def _fly(self, vector: Vec3, now: float) -> None:
        rules = self.rules
        flown = self._dead_reckoning(vector, rules.epsilon, rules.dim, self._flight_rng)
        self.flight = flight = plan_flight(self.position(), flown, now, self.velocity)
        self._due[LANDING] = now + flight.duration_s
        self.handler_counts[_FLIGHTS] += 1
        self.handler_counts[_DISTANCE_MICROCELLS] += round(flight.length * 1e6)

    def _retune(self) -> None:
        machine = self.machine
        swarm = machine.swarm if machine.awake else NO_SWARM
        if swarm != self.ears.swarm:
            self.ears = self.ears._replace(swarm=swarm)
            self.udp.tune(self.ears)

    def _publish(self) -> None:
        m = self.machine
        shown = (m.state, m.swarm, m.epoch, self.flight)
        if shown != self._shown:
            self._shown = shown
            lit = m.state is not State.DEPLOYING and not m.departed
            swarm = m.swarm if lit else Swarm(0, 0)
            self.slot.publish(
                Row(m.incarnation, m.epoch, swarm.xi, swarm.incarnation, m.state, lit, m.flying, self.flight)
            )

    # -- both ----------------------------------------------------------------------------------------------------

    def position(self) -> Vec3:
        """Where this FLS really is: for the radio's emulation of signals, never for the machine."""
        flight = self.flight
        if flight.length == 0.0:
            return flight.start
        return position_at(flight, self.clock.now(), self.velocity)

    def send(self, message: Message, counts: memoryview) -> None:
        """Stamp and send; `counts`: those of the thread that sends."""
        reach2 = self._grid.reach2(message.range) if message.kind == CHALLENGE_INIT else 0xFFFFFFFF
        now = self.clock.now()
        copies = DELIVERED_NOW
        if not self._sends_perfectly:
            copies = fate(self._sender_rules, self._sender_rng)
        delay = copies[0] if copies else 0.0
        stamp = Stamp(self.run.run, next(self._numbers), self.position(), now + delay, self._cell, reach2)
        data = encode(message, stamp, self.run.key)
        counts[_SENT] += 1
        counts[_BYTES_SENT] += len(data)
        if not copies:
            counts[_LOST_SENDER] += 1
        for delay in copies:
            if delay > 0.0:
                heapq.heappush(self._outgoing, (now + delay, next(self._order), message, data))
            else:
                self._transmit(data, message, counts)

    def _transmit(self, data: bytes, message: Message, counts: memoryview) -> None:
        if not self.udp.send(data, message):
            counts[_SEND_FAILED] += 1

    def start(self) -> None:
        """Show the FLS at its start, and that it is ready."""
        self._publish()
        self.slot.live(Life.READY)

    def close(self) -> None:
        self.slot.live(Life.ENDED)
        self.udp.close()


_REFUSED = {
    "run": Wire.OTHER_RUN, "sender": Wire.BAD, "address": Wire.NOT_ADDRESSED, "range": Wire.OUT_OF_RANGE,
    "own": Wire.OWN_SWARM,
}  # fmt: skip

_DUE = tuple(map(Due, Timer))
_LANDED = Landed()


def _size(run: RunSpec) -> int:
    from swarmer.messages import MAX_SIZE, SIZE

    return MAX_SIZE if run.key else SIZE
