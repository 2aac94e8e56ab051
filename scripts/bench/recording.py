"""The recording: its size, and what the collector costs with it and without it, of one and the same run.

A run in virtual time is kept in memory and then given to the collector twice, once with the recording on and once with
it off, so that both see the same. Times are of this process with all its threads, so of rerun's, too.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.tables import show
from swarmer.config import load_config
from swarmer.engines.result import Event, Live, Localized, RunResult, Snapshot
from swarmer.engines.virtual import VirtualEngine
from swarmer.observe.collector import Collector
from swarmer.observe.recording import import_rerun
from swarmer.observe.run_directory import RECORDING, RunDirectory
from swarmer.plan import Plan, make_plan

RUNS: tuple[tuple[str, float], ...] = (("dragon", 60), ("hat", 60), ("skateboard", 60))
WORST: tuple[tuple[str, float], ...] = (("dragon", 10), ("racecar", 10), ("statue", 10))
NOT_LIVE = Live(None, None, None, None, None, None)


class Kept:
    """An observer that keeps everything in its order."""

    def __init__(self) -> None:
        self.seen: list[Snapshot | Event] = []

    def planned(self, plan: Plan) -> None:
        pass

    def launching(self, ready: int, total: int) -> None:
        pass

    def go(self, launch_s: float) -> None:
        pass

    def sample(self, snapshot: Snapshot) -> bool:
        self.seen.append(snapshot)
        return False

    def event(self, event: Event) -> None:
        self.seen.append(event)

    def beat(self, t_s: float) -> None:
        pass


class Collected(NamedTuple):
    """What it came to."""

    process_s: float
    file_mb: float


def run(repeat: int) -> None:
    """Print both tables. repeat: so often is each measured, and the fastest taken."""
    import_rerun()
    columns = ("", "FLSs", "emulated s", "MB", "MB/min", "core % on", "core % off")
    notes = ["10 samples a second, seed 1; core %: of one core, at time scale 1"]
    show("recording: runs in virtual time", columns, [row(*kept(*one), repeat) for one in RUNS], notes)
    notes = ["every FLS moves, and is in another swarm, at every sample: no run is as bad"]
    show("recording: the worst that can be", columns, [row(*turmoil(*one), repeat) for one in WORST], notes)


def kept(shape: str, duration_s: float) -> tuple[Plan, list[Snapshot | Event]]:
    """A run in virtual time."""
    plan = make_plan(load_config(shape=shape, duration_s=duration_s, engine="virtual"))
    watcher = Kept()
    with VirtualEngine(plan) as engine:
        engine.run(watcher)
    return plan, watcher.seen


def turmoil(shape: str, duration_s: float) -> tuple[Plan, list[Snapshot | Event]]:
    """No run, but samples in which everything changes, and a tenth of the FLSs localizes."""
    plan = make_plan(load_config(shape=shape, duration_s=duration_s, engine="virtual"))
    return plan, list(_turmoil(plan))


def _turmoil(plan: Plan) -> Iterator[Snapshot]:
    rng, count = np.random.default_rng(1), plan.size
    everybody = np.ones(count, np.bool_)
    for sample in range(int(plan.config.duration_s * plan.config.recording.rate_hz) + 1):
        position = plan.cloud.points + rng.normal(size=(count, 3))
        fids = rng.choice(count, count // 10, replace=False).astype(np.int32) + 1
        localized = Localized(
            fids,
            fids[::-1],
            position[fids - 1].astype(np.float32),
            rng.normal(size=(len(fids), 3)).astype(np.float32),
        )
        yield Snapshot(
            sample / plan.config.recording.rate_hz, position, rng.integers(1, count, count).astype(np.int32),
            rng.integers(1, 5, count).astype(np.int8), everybody, everybody, {"datagrams_sent": 1000.0 * sample},
            NOT_LIVE, None, localized=localized,
        )  # fmt: skip


def row(plan: Plan, seen: list[Snapshot | Event], repeat: int) -> tuple[object, ...]:
    """Of a table."""
    on, off = (min(collected(plan, seen, enabled) for _ in range(repeat)) for enabled in (True, False))
    seconds = plan.config.duration_s
    return (
        plan.cloud.name, plan.size, f"{seconds:g}", on.file_mb, 60 * on.file_mb / seconds,
        100 * on.process_s / seconds, 100 * off.process_s / seconds,
    )  # fmt: skip


def collected(plan: Plan, seen: list[Snapshot | Event], enabled: bool) -> Collected:
    """Have it observed by the collector, as a run is."""
    config = plan.config.changed(**{"recording.enabled": enabled})
    with tempfile.TemporaryDirectory(prefix="swarmer-bench-") as room:
        collector = Collector(RunDirectory.create(Path(room) / "run", plan.cloud.name, 1, sys.argv))
        began = time.process_time()
        collector.planned(replace(plan, config=config))
        collector.go(0.0)
        for one in seen:
            if isinstance(one, Snapshot):
                collector.sample(one)
            else:
                collector.event(one)
        collector.finish(RunResult("virtual", "done", config.duration_s, 1.0))
        process_s = time.process_time() - began
        file = Path(room) / "run" / RECORDING
        return Collected(process_s, file.stat().st_size / 1e6 if enabled else 0.0)
