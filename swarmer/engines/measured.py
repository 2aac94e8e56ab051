"""The process engine with its cost measured: processor time of the FLSs and of the engine, and how late everything was.

For `swarmer doctor` and for the benchmarks. The run itself is the same.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from swarmer.engines.limits import children_of
from swarmer.engines.process import ProcessEngine, _Run
from swarmer.engines.result import Lateness
from swarmer.metrics.lateness import percentiles, quantile

if TYPE_CHECKING:
    from swarmer.engines.result import Observer, RunResult
    from swarmer.plan import Plan


@dataclass
class Cost:
    """What a run took from the machine, from the go signal to its end."""

    cores: int
    wall_s: float = 0.0
    fls_cpu_s: float = 0.0  # of all FLSs together
    engine_cpu_s: float = 0.0  # of the engine with its collector
    wake_ms: Lateness | None = None  # wake-ups of all FLSs at once, before the go signal
    timer_late: list[int] = field(default_factory=list)  # histograms, emulated ms
    handled_late: list[int] = field(default_factory=list)

    @property
    def busy(self) -> float:
        """Share of all cores that the FLSs and the engine used."""
        return (self.fls_cpu_s + self.engine_cpu_s) / (self.wall_s * self.cores) if self.wall_s else 0.0

    def handled_ms(self, share: float) -> float | None:
        """A percentile of the lateness of messages."""
        return quantile(self.handled_late, share)


class MeasuredEngine(ProcessEngine):
    """`cost` holds what the run cost, once it is over. wakes: how often all are woken at once before the go signal."""

    def __init__(self, plan: Plan, wakes: int = 0) -> None:
        super().__init__(plan)
        self.wakes = wakes
        self.cost = Cost(len(os.sched_getaffinity(0)))

    def run(self, observer: Observer) -> RunResult:
        """As the engine it is; `cost` is filled."""
        observer.planned(self.plan)
        run = _MeasuredRun(self.plan, observer, self._lock)
        run.cost, run.wakes = self.cost, self.wakes
        return asyncio.run(run.play())


class _MeasuredRun(_Run):
    cost: Cost
    wakes: int

    async def _rehearse(self) -> None:
        if self.wakes:
            await self._wake_often()
        await super()._rehearse()

    async def _wake_often(self) -> None:
        """Wake all, wait until they are done, and again."""
        first = self.reader.load().handled_late
        for _ in range(self.wakes):
            before = int(self.reader.load().handled_late.sum())
            self.wake_all()
            deadline = time.monotonic() + WAKE_PATIENCE_S
            while (
                int(self.reader.load().handled_late.sum()) < before + self.count
                and time.monotonic() < deadline
            ):
                await self._sleep(0.01)
        late = percentiles((self.reader.load().handled_late - first).tolist())
        self.cost.wake_ms = None if late is None else Lateness(*late)
        self.tally.add(self.reader.sample())
        self.tally.start()

    async def _fly(self) -> None:
        before = {pid: cpu_seconds(pid) for pid in fls_pids()}
        load_before = self.reader.load()
        cpu, wall = time.process_time(), time.monotonic()
        await super()._fly()
        cost = self.cost
        cost.wall_s, cost.engine_cpu_s = time.monotonic() - wall, time.process_time() - cpu
        after = {pid: cpu_seconds(pid) for pid in fls_pids()}
        cost.fls_cpu_s = sum(max(0.0, now - before.get(pid, 0.0)) for pid, now in after.items())
        load = self.reader.load()
        cost.timer_late = (load.timer_late - load_before.timer_late).tolist()
        cost.handled_late = (load.handled_late - load_before.handled_late).tolist()


WAKE_PATIENCE_S = 2.0


def fls_pids() -> list[int]:
    """The FLSs that this process's dispatcher has started."""
    found: list[int] = []
    for pid in children_of(os.getpid()):
        with contextlib.suppress(OSError):
            if b"swarmer.engines.dispatcher" in Path(f"/proc/{pid}/cmdline").read_bytes():
                found += children_of(pid)
    return found


def cpu_seconds(pid: int) -> float:
    """Processor time that a process has had, all its threads; 0 if it is gone."""
    total = 0
    with contextlib.suppress(OSError, ValueError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            total += int((task / "schedstat").read_text().split()[0])
    return total / 1e9
