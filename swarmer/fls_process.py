"""One FLS as an OS process (section 6): what its network thread and its handler thread do, whichever loop runs them.

What becomes of a datagram, a timer, a landing is `fls.BaseFls`, as in every engine. Here are the sockets, the clock,
the slot in shared memory, and who may touch what: the network role reads what the handler last published and nothing
else of it.
"""

from __future__ import annotations

import heapq
import os
import signal
from itertools import count as counting
from time import monotonic
from typing import NamedTuple

from swarmer.faults import NO_FAULTS, Schedule
from swarmer.fls import DEPARTED, NEVER
from swarmer.fls_battery import ChargedFls
from swarmer.fls_calm import calm_down
from swarmer.fls_spec import FlsSpec
from swarmer.messages import (
    CHALLENGE_INIT,
    CONTROL,
    BadDatagram,
    Message,
    Stamp,
    Swarm,
    decode,
    encode,
)
from swarmer.physics.flight import Flight
from swarmer.protocol.events import Action, ThawBegins
from swarmer.protocol.race import PRIORITY
from swarmer.protocol.records import Counters
from swarmer.radio import Grid
from swarmer.rules import Rules
from swarmer.state_machine import State
from swarmer.telemetry import (
    NEVER_LOCALIZED,
    NOTHING_LEFT,
    Began,
    Clock,
    Life,
    Localization,
    Phase,
    Row,
    SharedMemory,
    Slot,
    Thawed,
    Wire,
)
from swarmer.udp_wrapper import RelayedUdpWrapper, UdpWrapper, Wires

DEPARTED_EXIT = 18  # one that left to charge
PLUGIN_EXIT = 19  # one whose plugin failed
WAITING_MAX = (
    4096  # messages taken off the sockets and not handled yet: some 4 MB; a thaw of 1,727 FLSs stays below
)

_BAD, _SEND_FAILED, _WOKEN = Wire.BAD, Wire.SEND_FAILED, Wire.WOKEN
_WAIT, _GO, _STOP = Phase


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
    faults: Schedule = NO_FAULTS
    hang_s: float = 0.0  # emulated seconds without a sign of life until an FLS is given up; 0: never


class Fls(ChargedFls):
    """The two roles over UDP. A loop (`fls_loops`) calls them."""

    def __init__(self, run: RunSpec, spec: FlsSpec, shared: SharedMemory) -> None:
        """Raises OSError where sockets are not to be had."""
        self.run = run
        self.clock = Clock(shared)
        self.slot = Slot(shared, spec.fid)
        super().__init__(
            run.run, run.seed, run.rules, spec, self.slot.handler_counts, self.slot.network_counts, None, run.faults
        )  # fmt: skip
        self._grid = Grid(run.steps_per_cell)
        self._cell = self._grid.of(spec.truth)
        wrapper = RelayedUdpWrapper if run.wires.relay_port else UdpWrapper
        self.udp = wrapper(
            self.ears, shared.directory(), run.wires, self._grid, spec.near, spec.distances,
            not run.rules.range_estimated,
        )  # fmt: skip
        self._order = counting()
        self._held: list[tuple[float, int, Message, Stamp]] = []  # arrived, not yet due
        self._outgoing: list[tuple[float, int, Message, Stamp]] = []  # sent, not yet on the air
        self._shown: tuple[State, Swarm, int, Flight] | None = None
        self._began, self._thawed, self._localization = Began.ANOTHER, NOTHING_LEFT, NEVER_LOCALIZED
        self.exit_status: int | None = None
        self._slows = run.faults.slows(spec.fid)
        self._watched = run.hang_s > 0
        self._calm_s = NEVER if run.faults.calm_s is None else run.faults.calm_s
        self.begin()

    def now(self) -> float:
        """The emulated second on the clock of the run."""
        return self.clock.now()

    # -- the network role ----------------------------------------------------------------------------------------

    def receive(self, data: memoryview | bytes) -> None:
        """Take one datagram off a socket."""
        try:
            message, stamp = decode(data, self.run.key)
        except BadDatagram:
            self.network_counts[_BAD] += 1
            return
        self.hear(message, stamp)

    def arrive(self, message: Message, stamp: Stamp) -> None:
        """As in every engine; but what the engine says to everybody is no message."""
        if message.kind == CONTROL:
            self._wake(stamp)
        else:
            super().arrive(message, stamp)

    def _wake(self, stamp: Stamp) -> None:
        """The engine wants everybody to look at the control page, which the clock does by itself."""
        self.network_counts[_WOKEN] += 1
        self.clock.now()
        if self.clock.phase == _WAIT:  # a rehearsal: how long does it take to wake us all?
            self.udp.tune(self.ears)
            self.slot.handled_late((monotonic() - stamp.sent_at) * 1e3)

    def queue(self, message: Message, stamp: Stamp) -> None:
        """Leave it to the handler; it counts as late from the moment when it was sent."""
        self.queues[PRIORITY[message.kind]].append((stamp.sent_at, message, stamp))

    def note(self, message: Message, stamp: Stamp) -> None:
        """Leave it to the handler, which takes up notes first."""
        self.notes.append((message, stamp))

    def hear_later(self, delay_s: float, message: Message, stamp: Stamp) -> None:
        """Hold it back; what the radio delays on purpose is not lateness."""
        late = stamp._replace(sent_at=stamp.sent_at + delay_s)
        heapq.heappush(self._held, (self.clock.now() + delay_s, next(self._order), message, late))

    def send_later(self, delay_s: float, message: Message, stamp: Stamp) -> None:
        """Hold it back on the way out."""
        heapq.heappush(self._outgoing, (self.clock.now() + delay_s, next(self._order), message, stamp))

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
            self.arrive(message, stamp)
        while self._outgoing and self._outgoing[0][0] <= now:
            _, _, message, stamp = heapq.heappop(self._outgoing)
            self.transmit(message, stamp, self.network_counts)

    # -- the handler role ----------------------------------------------------------------------------------------

    @property
    def full(self) -> bool:
        """So much waits that more is left to the kernel, whose buffer has an end, and which counts what it drops."""
        queues = self.queues
        return len(queues[0]) + len(queues[1]) + len(queues[2]) + len(self._held) >= WAITING_MAX

    @property
    def has_messages(self) -> bool:
        return bool(self.queues[0] or self.queues[1] or self.queues[2])

    def deadline(self) -> float:
        """Emulated second of the next timer, landing or measurement."""
        return min(self.due)

    def step(self) -> bool:
        """Handle the one thing that is most urgent, while the run runs; False if there is nothing to do now."""
        now = self.clock.now()
        if self._watched:
            self.slot.beat()
        if self.clock.phase == _GO:
            if now >= self._calm_s:
                self._calm_s = NEVER
                calm_down(self)
            return self.work(now)
        if self.clock.phase == _STOP:
            self.exit_status = 0
        return False

    def wait(self, what: int, at_s: float) -> None:
        """The loop looks at what is due."""
        self.due[what] = at_s

    def taken_up(self, late_s: float) -> None:
        if not self._slows or not self._by_a_fault(late_s):
            self.slot.handled_late(late_s * 1e3)

    def timer_taken_up(self, late_s: float) -> None:
        if not self._slows or not self._by_a_fault(late_s):
            self.slot.timer_late(late_s * 1e3)

    def _by_a_fault(self, late_s: float) -> bool:
        """What a schedule delays on purpose is not lateness: or the run would be slowed down for it, in vain."""
        now = self.clock.now()
        return any(begins_s <= now and now - late_s <= ends_s for begins_s, ends_s in self._slows)

    def perform(self, actions: list[Action], now: float) -> None:
        """What the machine wants done, and show what came of it."""
        super().perform(actions, now)
        self._publish()

    def tuned(self, old: Swarm) -> None:
        self.udp.tune(self.ears)

    def moved_on(self) -> None:
        self._cell = self._grid.of(self.spec.truth)
        self.udp.move(self.ears, self.spec.near, self.spec.distances)

    def moved(self) -> None:
        """Whoever looks sees the flight in the slot; one that localizes also when it is over, however short."""
        flight, machine = self.flight, self.machine
        if machine.state is State.BUSY_LOCALIZING and flight.length > 0.0:
            assert machine.anchor is not None
            self._localization = Localization(
                machine.anchor.sender, flight.start, flight.displacement, flight.begins_s
            )

    def thaw_begins(self, begins: ThawBegins) -> None:
        """The engine cannot see this moment; it is shown with what came of it."""
        self._began = Began.KNOWING if begins.known else Began.CLOCK

    def end(self, how: str) -> None:
        """Leave to charge; or fail, at once and without a word (rule 13)."""
        if how == DEPARTED:
            self.exit_status = DEPARTED_EXIT
        else:
            self.slot.live(Life.FAILING)  # for the count of failures, which are no crashes
            os.kill(os.getpid(), signal.SIGKILL)

    def _publish(self) -> None:
        m = self.machine
        shown = (m.state, m.swarm, m.epoch, self.flight)
        if shown != self._shown:
            if self._shown is not None and m.epoch != self._shown[2]:
                self._thawed = self._left(*self._shown[:3])
            self._shown = shown
            lit = m.state is not State.DEPLOYING and not m.departed
            swarm = m.swarm if lit else Swarm(0, 0)
            self.slot.publish(
                Row(
                    m.incarnation,
                    m.epoch,
                    swarm.xi,
                    swarm.incarnation,
                    m.state,
                    lit,
                    m.flying,
                    self.flight,
                    self._thawed,
                    self._localization,
                )
            )

    def _left(self, state: State, swarm: Swarm, epoch: int) -> Thawed:
        """As what, and how, it left an epoch just now."""
        began, self._began = self._began, Began.ANOTHER
        if state is State.DEPLOYING:
            return NOTHING_LEFT
        return Thawed(epoch, swarm.xi, swarm.incarnation, began, self.machine.thawed_s)

    # -- both ----------------------------------------------------------------------------------------------------

    def stamp(self, message: Message, sent_at: float) -> Stamp:
        """With what the kernel's filter computes with."""
        reach2 = self._grid.reach2(message.range) if message.kind == CHALLENGE_INIT else 0xFFFFFFFF
        number = next(self._numbers) & 0xFFFFFFFF  # the window knows that they wrap
        return Stamp(self.run.run, number, self.position(), sent_at, self._cell, reach2)

    def transmit(self, message: Message, stamp: Stamp, counts: Counters) -> None:
        """Pack it and send it."""
        if not self.udp.send(encode(message, stamp, self.run.key), message):
            counts[_SEND_FAILED] += 1

    def start(self) -> None:
        """Show the FLS at its start, and that it is ready."""
        self._publish()
        self.slot.live(Life.READY)

    def close(self) -> None:
        self.slot.live(Life.ENDED)
        self.udp.close()
