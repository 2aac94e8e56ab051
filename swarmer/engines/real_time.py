"""A run in real time, whatever machines its FLSs live on: launch, go, samples, thaws, time scale, end, result.

Whoever makes one says how the FLSs are started and ended, how all of them are spoken to, and how their memory is kept
up to date (`process`: it is theirs; `cluster`: a copy that hosts send).
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from swarmer.engines.fidelity import Tally
from swarmer.engines.governor import LOOK_S, Governor
from swarmer.engines.localized import LocalizedWatch
from swarmer.engines.reading import totals_of
from swarmer.engines.result import Event, Live, Observer, RunResult, Snapshot
from swarmer.engines.specs import why_it_left
from swarmer.engines.thaws import Sight, ThawsInHindsight, ThawTally, ThawWatch
from swarmer.errors import RunFailed
from swarmer.interrupts import ENDINGS, heeded, one_was_lost
from swarmer.messages import Kind
from swarmer.metrics.swarms import swarm_names
from swarmer.next_shape import standing_at
from swarmer.physics.flight import Velocity
from swarmer.protocol.events import Count
from swarmer.telemetry import Clock, Life, Phase, Reader, Sample, SharedMemory, Wire

if TYPE_CHECKING:
    from swarmer.plan import Plan

LAUNCH_PATIENCE_S = 60.0  # without any FLS getting ready
REHEARSALS = 3
REHEARSED = 0.98  # share of the FLSs that must have been woken before the next round
REHEARSAL_PATIENCE_S = 2.0
WEIGHED_LIVE, WEIGHED_LAST = 4, 24  # processes whose private memory is read
WEIGH_EVERY_S = 5.0
COMPLAINT_S = 0.2
COMPLAINTS_MAX = 200  # lines of stderr that become events
CRASHES_MAX = 0.05  # share of FLSs that may die unexpectedly before the run is given up


class RealTimeRun(ABC):
    """One run, played once by a method of the subclass."""

    def __init__(self, plan: Plan, observer: Observer, engine: str) -> None:
        """Raises OSError where there is no memory to share."""
        self.plan, self.observer = plan, observer
        self.config, self.count, self.standings = plan.config, plan.size, plan.standings()
        self.shared = SharedMemory(self.count)
        self.clock = Clock(self.shared)
        self.reader = Reader(self.shared, Velocity(*plan.rules.velocity))
        self.tally = Tally()
        self.governor = Governor(self.config.time_scale, self.config.lease_ms, self.count)
        self.result = RunResult(engine, "done", 0.0, 0.0)
        self.events: dict[str, int] = {"failed": 0, "departed": 0, "died": 0, "replaced": 0}
        self.stopping = asyncio.Event()
        self.thaws, self.begun = ThawWatch(plan.rules), ThawTally(plan.rules)
        self.hindsight = ThawsInHindsight(plan.rules, self.begun)
        self.localized = LocalizedWatch(self.count)
        self._went_wall = 0.0
        self._complaints, self._complaint = 0, ""
        self._memory_mb: float | None = None

    # -- what a subclass supplies --------------------------------------------------------------------------------

    @abstractmethod
    async def _set_clock(self, phase: Phase, scale: float, emulated_s: float | None = None) -> None:
        """Another phase or time scale for everybody, as `Clock.set`."""

    @abstractmethod
    def say(self, kind: Kind, epoch: int) -> None:
        """Say it to all FLSs, in the engine's name."""

    @abstractmethod
    def _mean_memory_mb(self, processes: int) -> float | None:
        """Mean private memory of about so many FLSs spread over all, MB."""

    @abstractmethod
    def _dropped_by_kernel(self) -> int:
        """Datagrams that full buffers have cost so far."""

    @abstractmethod
    def _end_at_once(self) -> None:
        """Asked to end for a second time: no more good order."""

    # -- the life of a run ---------------------------------------------------------------------------------------

    def _heed_endings(self) -> None:
        for number in filter(heeded, ENDINGS):
            # Not in the main thread: the caller's business.
            with contextlib.suppress(ValueError, RuntimeError):
                asyncio.get_running_loop().add_signal_handler(number, self._interrupt)
        if one_was_lost():
            self._interrupt()

    async def _all_ready(self) -> bool:
        """Wait until every FLS is ready; False if the run was stopped before."""
        last, since = -1, time.monotonic()
        while not self.stopping.is_set():
            ready = int((self.reader.life() == Life.READY).sum())
            if ready != last:
                last, since = ready, time.monotonic()
                self.observer.launching(ready, self.count)
            if ready == self.count:
                return True
            if time.monotonic() - since > LAUNCH_PATIENCE_S:
                raise RunFailed(f"only {ready} of {self.count} FLSs got ready in {LAUNCH_PATIENCE_S:g} s")
            await self._sleep(0.05)
        return False

    async def _rehearse(self) -> None:
        """Wake everybody at once, as a thaw will, and see how long the last one takes."""
        if not self.governor.auto:
            return
        for round_number in range(1, REHEARSALS + 1):
            self.wake_all()
            since = time.monotonic()
            while not self.stopping.is_set() and time.monotonic() - since < REHEARSAL_PATIENCE_S:
                await self._sleep(0.02)
                if int(self.reader.sample().counters[Wire.WOKEN]) >= REHEARSED * round_number * self.count:
                    break
        self.tally.add(self.reader.sample())
        late = self.tally.handled()
        if late is not None:
            self.governor.rehearsed(late.p99)
        self.tally.start()

    async def _fly(self) -> None:
        await self._set_clock(Phase.GO, self.governor.scale, 0.0)
        self._went_wall = time.monotonic()
        self.wake_all()
        self.observer.go(self.result.launch_s or 0.0)
        beside = [asyncio.create_task(self._govern()), asyncio.create_task(self._weigh())]
        try:
            await self._watch()
        finally:
            for task in beside:
                task.cancel()

    async def _watch(self) -> None:
        period = 1.0 / self.config.recording.rate_hz
        due = 0.0
        while not self.stopping.is_set():
            done = self._look()
            now = self.clock.now()
            if done or now >= self.config.duration_s:
                return
            due = max(due + period, now)
            await self._sleep(min(due, self.config.duration_s) - now, emulated=True)

    async def _sleep(self, seconds: float, emulated: bool = False) -> None:
        wall = seconds / self.clock.scale if emulated else seconds
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self.stopping.wait(), max(wall, 0.0))

    def _interrupt(self) -> None:
        """Ctrl-C ends the run in good order; a second one at once."""
        if self.result.status == "interrupted":
            self._end_at_once()
        self.result.status = "interrupted"
        self.stopping.set()

    def _fail(self, message: str) -> None:
        self.result.status, self.result.message = "failed", message
        self.stopping.set()

    # -- what happens to FLSs ------------------------------------------------------------------------------------

    def _complain(self, line: bytes) -> None:
        """A line of what somebody writes to stderr: a traceback, if an FLS has a bug."""
        self._complaints += 1
        text = line.decode(errors="replace").rstrip()
        if text and not text.startswith(
            (" ", "Traceback")
        ):  # of a traceback the line that says what is wrong
            self._complaint = text
        if self._complaints <= COMPLAINTS_MAX:
            self.observer.event(Event(max(self.clock.now(), 0.0), "stderr", 0, text))

    async def _heard(self, event: dict[str, Any]) -> None:
        """What a dispatcher tells of its FLSs."""
        kind = event["event"]
        if kind == "fork_failed":
            self._fail(f"only {event['running']} of {self.count} processes could be started: {event['text']}")
        elif kind == "plugin_failed":
            self._fail(event["text"])
        else:
            self._happened(kind, event)
            if kind == "died" and self.result.launch_s is None:
                fid, code = event["fid"], event["code"]
                await self._fail_with_last_words(
                    f"FLS {fid} could not begin: its process ended {how_it_ended(code)}"
                )

    async def _fail_with_last_words(self, message: str) -> None:
        """What a process had to say of its death may still be on its way."""
        await asyncio.sleep(COMPLAINT_S)
        self._fail(f"{message}: {self._complaint}" if self._complaint else message)

    def _happened(self, kind: str, event: dict[str, Any]) -> None:
        if kind == "fault":
            self.observer.event(Event(event["t_s"], kind, event["fid"], event["text"]))
            return
        self.events[kind] += 1
        fid, t_s = event["fid"], max(event["t_s"], 0.0)
        if kind == "replaced":
            text = f"incarnation {event['incarnation']} launched"
        elif kind == "died":
            text = f"process ended unexpectedly {how_it_ended(event['code'])}"
        else:
            text = "went dark" if kind == "failed" else why_it_left(self.plan.rules, fid, t_s)
        self.observer.event(Event(t_s, _EVENT_NAMES[kind], fid, text))
        if kind == "died" and self.events["died"] > max(3, CRASHES_MAX * self.count):
            how = how_it_ended(event["code"])
            words = f": {self._complaint}" if self._complaint else ""
            self._fail(f"{self.events['died']} FLS processes died unexpectedly, the last {how}{words}")

    # -- looking ---------------------------------------------------------------------------------------------------

    def _look(self) -> bool:
        sample = self.reader.sample()
        if self.plan.faults.calm_s is not None and sample.t_s >= self.plan.faults.calm_s:
            self.thaws.stop()
        self._watch_thaws(sample)
        self.tally.add(sample)
        self.result.emulated_s = sample.t_s
        return self.observer.sample(self._snapshot(sample))

    async def _govern(self) -> None:
        """Keep the time scale where this machine stays faithful."""
        while self.governor.auto:
            await asyncio.sleep(LOOK_S)
            now = self.clock.now()
            load = self.reader.load()
            thaws = max(load.epoch, self.thaws.seen)  # without epochs, or ordered by this engine: only seen
            scale = self.governor.judge(
                load.timer_late, load.handled_late, load.delivered, thaws, now, time.monotonic()
            )
            if scale != self.clock.scale and self.clock.phase == Phase.GO:
                faster = scale > self.clock.scale
                await self._set_clock(Phase.GO, scale)
                if faster:  # for slower, who sleeps wakes early, looks, and sleeps on
                    self.wake_all()
                self.observer.event(Event(now, "time_scale", 0, f"{scale:.2f}: {self.governor.reason}"))

    async def _weigh(self) -> None:
        """Estimate the private memory of all FLSs, now and then; reading it takes a millisecond for each process."""
        while True:
            mean = await asyncio.to_thread(self._mean_memory_mb, WEIGHED_LIVE)
            self._memory_mb = None if mean is None else mean * self.count
            await asyncio.sleep(WEIGH_EVERY_S)

    def _snapshot(self, sample: Sample) -> Snapshot:
        alive = sample.life == Life.READY
        live = Live(
            self.clock.scale,
            self.tally.recent_timer(),
            self.tally.recent_handled(),
            int(alive.sum()),
            self._memory_mb,
            self.tally.faithful(self.config.lease_ms),
        )
        return Snapshot(
            sample.t_s, sample.position, sample.swarm, sample.state, sample.lit & alive, alive,
            self._counters(sample), live, sample.swarm_incarnation, sample.flown,
            localized=self.localized.look(sample.localization),
        )  # fmt: skip

    def _counters(self, sample: Sample) -> dict[str, float]:
        return totals_of(sample.counters, self.config.radio.mac) | {
            "thaws": self.thaws.seen,
            **self.hindsight.counters(),
            "failures": self.events["failed"] + self.events["died"],
            "departures": self.events["departed"],
            "replacements": self.events["replaced"],
        }

    # -- speaking --------------------------------------------------------------------------------------------------

    def wake_all(self) -> None:
        """Have everybody look at the control page."""
        self.say(Kind.CONTROL, 0)

    def _watch_thaws(self, sample: Sample) -> None:
        started = int(sample.counters[Count.THAWS_STARTED])
        names = swarm_names(sample.swarm, sample.swarm_incarnation)
        there = standing_at(self.standings, sample.t_s).member
        sight = Sight(sample.t_s, sample.lit[there], names[there], sample.epoch[there], started)
        if order := self.thaws.order(sight):
            self.begun.ordered(sample.t_s, order)
            self.say(Kind.THAW, order.epoch)
            self.observer.event(Event(sample.t_s, "thaw", 0, order.why))
        elif number := self.thaws.begun(sight):
            self.observer.event(Event(sample.t_s, "thaw", 0, f"thaw {number} began"))
        self.hindsight.look(there & sample.lit & (sample.life == Life.READY), sample.epoch, sample.thawed)

    # -- results -----------------------------------------------------------------------------------------

    def _measure_end(self) -> None:
        if self.result.launch_s is None:
            return
        self.result.wall_s = time.monotonic() - self._went_wall
        sample = self.reader.sample()
        self._watch_thaws(sample)
        self.result.first_single_swarm_s = self.begun.first_s
        self.result.emulated_s = min(sample.t_s, max(self.config.duration_s, self.result.emulated_s))
        self.result.counters = self._counters(sample)
        self.result.counters["dropped_by_kernel"] = self._dropped_by_kernel()
        self.tally.add(sample)
        self.result.processes = int((sample.life == Life.READY).sum())
        self.result.memory_mb_per_fls = self._mean_memory_mb(WEIGHED_LAST)

    def _finish(self) -> None:
        result, lease_ms = self.result, self.config.lease_ms
        result.timer_late_ms, result.handled_late_ms = self.tally.timer(), self.tally.handled()
        if result.wall_s > 0:
            result.time_scale = result.emulated_s / result.wall_s
            result.faithful = self.tally.faithful(lease_ms)
            result.suggested_time_scale = self.tally.suggestion(result.time_scale, lease_ms)
        self.reader.close()
        self.shared.close()


def how_it_ended(code: int) -> str:
    """An exit status in words; below 0 it is a signal's number."""
    if code >= 0:
        return f"with status {code}"
    if code == -signal.SIGKILL:  # nobody of ours does that unawares; the kernel does where memory ends
        return "by SIGKILL; is the machine, or its control group, out of memory?"
    return f"by signal {-code} ({signal.strsignal(-code)})"


_EVENT_NAMES = {"failed": "failure", "departed": "departure", "died": "crash", "replaced": "replacement"}
