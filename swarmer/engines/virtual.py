"""The virtual-time engine: all FLSs in one process, event by event, the same from the same seed (docs/virtual-time.md).

It holds the run together: makes the FLSs, takes what is next from the agenda, samples, thaws if the policy is
`centralized`, replaces who is gone. What an FLS does is in `virtual_fls`, whom a datagram reaches in `virtual_radio`.
"""

from __future__ import annotations

import contextlib
import gc
import time
from array import array
from collections.abc import Iterator, Sequence
from heapq import heappop
from itertools import count as counting
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from swarmer.engines.fidelity import faithful
from swarmer.engines.localized import take_localized
from swarmer.engines.reading import totals_of
from swarmer.engines.result import Event, Lateness, Live, Observer, RunResult, Snapshot, Witness
from swarmer.engines.specs import fls_rows, fls_spec, why_it_left
from swarmer.engines.stopping import told_to_stop
from swarmer.engines.thaws import Sight, ThawTally, ThawWatch
from swarmer.engines.virtual_faults import Weather
from swarmer.engines.virtual_fls import DEPARTED, FAILED, Shared, VirtualFls
from swarmer.engines.virtual_radio import RUN, Air
from swarmer.engines.virtual_time import DATAGRAM, FREE, GROUP, HELD, SAMPLE, SLOT, TURN, Agenda, Trace
from swarmer.engines.witnesses import witness_of
from swarmer.errors import RunFailed
from swarmer.faults import NO_FAULTS, Schedule
from swarmer.fls import LANDING, NEVER
from swarmer.fls_spec import successor
from swarmer.messages import ENGINE_FID, NO_SWARM, ZERO, Kind, Message, Stamp, To
from swarmer.metrics.lateness import BUCKETS, bucket, percentiles
from swarmer.metrics.swarms import swarm_names
from swarmer.next_shape import standing_at
from swarmer.plan import make_velocity
from swarmer.protocol.events import Count, ThawBegins
from swarmer.standbys import Standbys
from swarmer.streams import stream
from swarmer.telemetry import COUNTERS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swarmer.fls_spec import FlsSpec
    from swarmer.plan import Plan

TOLD_EVERY = 500  # FLSs made between two words on how far the launch is
NEVER_LATE = Lateness(0.0, 0.0, 0.0)
BEAT_S = 1.0  # wall seconds without a sample after which the observer is told that the run lives
COLLECT_EVERY = 100_000  # objects more than before: Python's own 700 costs some per cent of a run
_state, _epoch = attrgetter("machine.state"), attrgetter("machine.epoch")


class VirtualEngine:
    """Runs one plan in virtual time. Made and given back as a context; `run` runs once."""

    name = "virtual"

    def __init__(self, plan: Plan, witnesses: Sequence[Witness] = (), faults: Schedule | None = None) -> None:
        """witnesses: told of every event, in this order. faults: in place of those of the plan."""
        self.plan, self.witnesses = plan, tuple(witnesses)
        self.faults = plan.faults if faults is None else faults

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is held beyond `run`."""

    def run(self, observer: Observer) -> RunResult:
        """Run to the end, the goal, Ctrl-C or a failure; the result says which. Raises RunFailed if `observer` does."""
        observer.planned(self.plan)
        return _Run(self.plan, observer, self.witnesses, self.faults).play()


class _Run:
    def __init__(
        self, plan: Plan, observer: Observer, witnesses: tuple[Witness, ...], faults: Schedule
    ) -> None:
        self.plan, self.observer, self.config = plan, observer, plan.config
        virtual = plan.config.virtual
        self.agenda, self.trace = Agenda(), Trace()
        latency_s = (virtual.latency_min_ms / 1e3, virtual.latency_max_ms / 1e3)
        self.standings = plan.standings()
        now, *later = (standing.truth for standing in self.standings)
        self.air = Air(self.agenda, latency_s, now, plan.rules, *later)
        self.shared = Shared(
            plan.config.seed, plan.rules, self.agenda, self.air, self._ended, virtual.handling_ms / 1e3,
            [0] * COUNTERS, [0] * BUCKETS, [0] * BUCKETS, witness_of(witnesses), self._thaw_begins,
            array("Q", bytes(16 * (plan.size + 1))), faults,
        )  # fmt: skip
        self.witnesses = witnesses
        failing = plan.config.failure
        self.weather = Weather(self, faults, failing.hang_s, failing.replace) if faults != NO_FAULTS else None
        self.flss: list[VirtualFls] = []  # row i is FID i + 1, also when it has failed
        self.thaws, self.begun = ThawWatch(plan.rules), ThawTally(plan.rules)
        if plan.rules.thaw_policy == "centralized":
            self.air.on_single = self._look_at_thaws
        self.ends = {"failed": 0, "departed": 0, "replaced": 0}
        self.stopping = False
        self.result = RunResult(VirtualEngine.name, "done", 0.0, 0.0)
        self.batteries = any(plan.rules.battery[:2])
        self._latency_rng = stream(plan.config.seed, "latency")  # of what the engine says
        self._numbers = counting(1)
        self._samples = self._obeyed = 0
        self._went_wall = self._told_wall = 0.0

    # -- the life of a run ---------------------------------------------------------------------------------------

    def play(self) -> RunResult:
        result = self.result
        with told_to_stop(self._interrupt), _undisturbed():
            try:
                began = time.monotonic()
                self._launch()
                self._went_wall = time.monotonic()
                result.launch_s = self._went_wall - began
                gc.freeze()
                if not self.stopping:
                    self.observer.go(result.launch_s)
                    self.agenda.put(0.0, SAMPLE, None)
                    self._live()
                if result.status == "done":
                    for witness in self.witnesses:
                        witness.finished(self.agenda.now)
            except KeyboardInterrupt:  # where the signals are not ours to catch
                result.status = "interrupted"
            except RunFailed as failure:
                result.status, result.message = "failed", str(failure)
            self._sum_up()
        return result

    def _interrupt(self) -> None:
        self.result.status = "interrupted"
        self.stopping = True

    def _launch(self) -> None:
        rows = fls_rows(self.plan)
        rules = self.plan.rules
        flss = [fls_spec(row) for row in rows] if self.batteries else []
        self.standbys = Standbys(flss, make_velocity(rules), rules.charge_s, rules.change_s)
        for row in rows:
            if self.stopping:
                return
            if len(self.flss) % TOLD_EVERY == 0:
                self.observer.launching(len(self.flss), self.plan.size)
            self.flss.append(self._make(fls_spec(row)))
        if self.weather is not None:
            self.weather.begin()
        self.observer.launching(self.plan.size, self.plan.size)

    def _make(self, spec: FlsSpec) -> VirtualFls:
        if self.weather is not None:
            return self.weather.make(self.shared, spec)
        return VirtualFls(self.shared, spec)

    def _live(self) -> None:
        """Take what is next, until told to stop. There is always a sample to come, so the agenda is never empty."""
        agenda, trace = self.agenda, self.trace
        heap, values = agenda.heap, trace.values
        while not self.stopping:
            at, _, what, fls, one, two = heappop(heap)
            agenda.now = at
            if what == GROUP:
                self._deliver(one, two)
            elif what == DATAGRAM:
                if fls.alive:
                    values += (at, fls.fid, one.kind, one.sender)
                    if fls.tuned_at == NEVER:
                        fls.hear(one, two)
                    else:
                        fls.take(one, two)  # it is for this FLS alone, whatever its swarm
            elif what < DATAGRAM:
                if fls.look(what, at):  # else it was disarmed, armed anew, or its FLS is gone
                    values += (at, fls.fid, -1 - what, 0)
                    fls.fall_due(what)
                    if what == LANDING:
                        values += (*fls.position(), 0)
                        trace.places += 1
            elif what == SLOT:
                self._next_slot()
            elif what == SAMPLE:
                self._look()
            elif fls.alive:
                self._go_on(what, fls, one, two)

    def _next_slot(self) -> None:
        """On to the next part of a second, with what came in this one hashed if that is much."""
        self.agenda.next_slot()
        if len(self.trace.values) >= self.trace.BATCH:
            self.trace.hash_values()
            self._beat()

    def _beat(self) -> None:
        """Between two samples may pass long: let the observer show that the run lives."""
        if time.monotonic() - self._told_wall > BEAT_S:
            self._told_wall = time.monotonic()
            self.observer.beat(self.agenda.now)

    def _deliver(
        self, arrivals: list[tuple[float, VirtualFls]], datagram: tuple[Message, Stamp, float]
    ) -> None:
        """A datagram to many: one after the other, until something else comes before the next one.

        The radio's rules let it reach all of them when it was sent, at the last number: only those who have begun to
        listen to another swarm since are asked again.
        """
        agenda, values = self.agenda, self.trace.values
        message, stamp, tunings = datagram
        heap, kind, sender = agenda.heap, message.kind, message.sender
        while True:
            at, fls = arrivals.pop()
            if fls.alive:
                agenda.now = at
                values += (at, fls.fid, kind, sender)
                if fls.tuned_at <= tunings:
                    fls.take(message, stamp)
                else:
                    fls.hear(message, stamp)
            if not arrivals:
                return
            at = arrivals[-1][0]
            if at > heap[0][0]:  # what was put down for the same moment came later
                agenda.put(at, GROUP, None, arrivals, datagram)
                return

    def _go_on(self, what: int, fls: VirtualFls, message: Any, stamp: Stamp) -> None:
        """What was put off, by the radio at one of its ends or by a handler that was busy; or a turn of the weather."""
        self.trace.values += (self.agenda.now, fls.fid, -1 - what, 0)
        if what == HELD:
            fls.arrive(message, stamp)
        elif what == FREE:
            fls.wake()
        elif what == TURN:
            assert self.weather is not None
            self.weather.turn(message)
        else:
            fls.transmit(message, stamp, self.shared.counts)

    # -- ends and beginnings -------------------------------------------------------------------------------------

    def _ended(self, fls: VirtualFls, how: str) -> None:
        """An FLS has gone dark: say so, and launch its replacement (rule 13)."""
        self.ends[how] += 1
        now, fid = self.agenda.now, fls.fid
        why = why_it_left(self.plan.rules, fid, now)
        kind, text = ("failure", "went dark") if how == FAILED else ("departure", why)
        self.observer.event(Event(now, kind, fid, text))
        charges, weather = how == DEPARTED and self.batteries, self.weather
        replaced = self.config.failure.replace if weather is None else weather.replaces(fid)
        if charges or replaced:  # who charges is no failure, and comes back
            self.replace(fid, charges)

    def replace(self, fid: int, charges: bool = False) -> None:
        """Launch the successor of an FLS that has gone dark. charges: it is relieved, or comes back (rule 13)."""
        now = self.agenda.now
        spec = successor(self.flss[fid - 1].spec, now, self.plan.rules.change_s)
        if spec is None:  # its point is no more
            return
        if charges:
            spec = self.standbys.relieved(spec, now)
        self.flss[fid - 1] = self._make(spec)
        self.ends["replaced"] += 1
        self.observer.event(Event(now, "replacement", fid, f"incarnation {spec.incarnation} launched"))

    # -- looking -------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Take a sample, and put down the next one."""
        now, config = self.agenda.now, self.config
        self.result.emulated_s = now
        self._told_wall = time.monotonic()
        snapshot = self._snapshot(now)
        self._look_at_thaws()
        if self.observer.sample(snapshot) or now >= config.duration_s:
            self.stopping = True
        self._samples += 1
        self.agenda.put(min(self._samples / config.recording.rate_hz, config.duration_s), SAMPLE, None)

    def _snapshot(self, now: float) -> Snapshot:
        air, flss = self.air, self.flss
        wall = time.monotonic() - self._went_wall
        late = self._lateness()
        swarm = np.array(air.listens, np.int32)[1:]  # the machines' own: they are asked after every event
        return Snapshot(
            t_s=now,
            position=air.places()[1:].copy(),
            swarm=swarm,
            state=np.frombuffer(bytearray(map(_state, flss)), np.int8),
            lit=swarm != 0,
            alive=air.alive[1:].copy(),
            counters=self._counters(),
            live=Live(
                now / wall if wall > 0 else None, *late, 1, None, faithful(*late, self.config.lease_ms)
            ),
            swarm_incarnation=self._swarm_incarnation(),
            flown=np.array(self.shared.flown, np.float64).reshape(-1, 2)[1:] / 1e6,
            localized=take_localized(self.shared.localized),
        )

    def _swarm_incarnation(self) -> NDArray[np.int32] | None:
        """Of the owner of each FLS's swarm; None while nobody has been replaced."""
        if not self.ends["replaced"]:
            return None
        owners = (fls.ears.swarm.incarnation for fls in self.flss)
        return np.fromiter(owners, np.int32, len(self.flss))

    def _counters(self) -> dict[str, float]:
        """By the names that the process engine has."""
        return totals_of(self.shared.counts, self.config.radio.mac) | {
            "thaws": self.thaws.seen,
            **self.begun.counters(),
            "failures": self.ends["failed"],
            "departures": self.ends["departed"],
            "replacements": self.ends["replaced"],
        }

    def _lateness(self) -> tuple[Lateness | None, Lateness | None]:
        """Of timers and of messages, in the handlers' queues; None where there were none."""
        timer, handled = percentiles(self.shared.timer_late), percentiles(self.shared.handled_late)
        if self.shared.handling_s == 0:  # nothing ever waits, which a histogram cannot say
            return (timer and NEVER_LATE, handled and NEVER_LATE)
        return (timer and Lateness(*timer), handled and Lateness(*handled))

    def _thaw_begins(self, fls: VirtualFls, begins: ThawBegins) -> None:
        """Were all lit FLSs one swarm of the epoch that ends? `fls` itself is in the next one by now."""
        others = (other.machine for other in self.flss if other.lit and other is not fls)
        single = all((m.swarm, m.epoch) == (begins.swarm, begins.epoch) for m in others)
        self.begun.note(self.agenda.now, begins, single)

    def _look_at_thaws(self) -> None:
        """Begin a thaw if that is the engine's to do, or see that one has begun."""
        obeyed = self.shared.counts[Count.THAWS_OBEYED]
        if obeyed == self._obeyed and not self.thaws.central:
            return  # no thaw has begun
        self._obeyed = obeyed
        swarm, alive = np.array(self.air.listens, np.int32)[1:], self.air.alive[1:]
        if self.plan.next is not None:
            alive = alive & standing_at(self.standings, self.agenda.now).member
        if not alive.any():
            return
        epoch = np.fromiter(map(_epoch, self.flss), np.int64, len(self.flss))
        started = self.shared.counts[Count.THAWS_STARTED]
        names = swarm_names(swarm, self._swarm_incarnation())
        sight = Sight(self.agenda.now, (swarm != 0)[alive], names[alive], epoch[alive], started)
        if order := self.thaws.order(sight):
            self.begun.ordered(sight.t_s, order)
            message = Message(Kind.THAW, ENGINE_FID, 0, order.epoch, NO_SWARM, 0, ZERO, To.ALL)
            stamp = Stamp(RUN, next(self._numbers), ZERO, sight.t_s)
            self.air.transmit(message, stamp, self._latency_rng, None)
            self.observer.event(Event(sight.t_s, "thaw", 0, order.why))
        elif number := self.thaws.begun(sight):
            self.observer.event(Event(sight.t_s, "thaw", 0, f"thaw {number} began"))

    # -- results -------------------------------------------------------------------------------------------------

    def _sum_up(self) -> None:
        result = self.result
        if self._went_wall:
            result.wall_s = time.monotonic() - self._went_wall
        result.counters = self._counters()
        result.processes = 1
        self._count_what_waits()
        late = result.timer_late_ms, result.handled_late_ms = self._lateness()
        result.faithful = faithful(*late, self.config.lease_ms)
        if result.wall_s > 0:
            result.time_scale = result.emulated_s / result.wall_s
        result.first_single_swarm_s = self.begun.first_s
        result.extra = {"events": self.trace.events(), "trace_sha256": self.trace.sha256()}
        for witness in self.witnesses:
            result.extra |= witness.summary()

    def _count_what_waits(self) -> None:
        """What nobody took up by the end is late, too, as far as the run went: or a hopeless one would look well."""
        now, shared = self.agenda.now, self.shared
        for fls in self.flss:
            for queue in fls.queues if fls.alive else ():
                for since, _, _ in queue:
                    shared.handled_late[bucket((now - since) * 1e3)] += 1
            for due_s in fls.due:
                if due_s < now:
                    shared.timer_late[bucket((now - due_s) * 1e3)] += 1


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """The garbage collector leaves alone what is there already, and looks seldom: the engine itself makes no cycles."""
    before = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(COLLECT_EVERY, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()
