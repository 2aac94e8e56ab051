"""A fake swarm that deploys, merges and converges: feeds an Observer without any engine. Fixtures give its parts."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swarmer.config import RunConfig
from swarmer.engines.result import Event, Lateness, Live, RunResult, Snapshot
from swarmer.next_shape import Standing
from swarmer.observe.collector import Collector
from swarmer.observe.run_directory import RunDirectory
from swarmer.shapes.cloud import PointCloud, make_cloud

sys.path.insert(
    0, str(Path(__file__).parent)
)  # `rrd_rows`, which tests of this room share, is a plain module


def ball(count: int, seed: int = 0) -> PointCloud:
    rng = np.random.default_rng(seed)
    points = np.unique(np.rint(rng.normal(size=(count * 3, 3)) * count ** (1 / 3) * 2 + 40), axis=0)
    return make_cloud("ball", rng.permutation(points)[:count], licence="-", source="-")


def fake_plan(cloud: PointCloud | None = None, **settings: Any) -> Any:
    cloud = ball(40) if cloud is None else cloud
    standings = (Standing(0.0, cloud.points, np.ones(len(cloud), bool)),)
    return SimpleNamespace(
        config=RunConfig(**settings), cloud=cloud, neighbours=None, size=len(cloud), next=None,
        standings=lambda: standings,
    )  # fmt: skip


class FakeSwarm:
    """Lands by 2 s, one swarm at 4 s, HD falls tenfold every 2 s; thaws twice."""

    def __init__(self, cloud: PointCloud, seed: int = 1) -> None:
        self.truth = cloud.points
        rng = np.random.default_rng(seed)
        self.error = rng.normal(size=self.truth.shape) * 2
        self.landing = rng.uniform(0.5, 2.0, len(self.truth))
        self.rng = rng

    def snapshot(self, t_s: float) -> Snapshot:
        count = len(self.truth)
        lit = t_s >= self.landing
        share = np.clip(t_s / self.landing, 0, 1)[:, None]
        position = share * self.truth + lit[:, None] * self.error * 10 ** (-max(0.0, t_s - 2) / 2)
        groups = max(1, int(count * 0.25 ** max(0.0, t_s - 2)))
        swarm = np.where(lit, np.arange(count) % groups + 1, 0).astype(np.int32)
        state = np.where(lit, self.rng.integers(1, 5, count), 0).astype(np.int8)
        counters = {
            "datagrams_sent": 900 * t_s,
            "handled": 1700 * t_s,
            "thaws": t_s // 5,
            "distance_cells": 40.0 * count,
            "localizing_cells": 1.5 * t_s * count,
            "following_cells": 0.5 * t_s * count,
            "localizations": 20 * t_s,
            "anchorings": 15 * t_s,
            "leases_granted": 25 * t_s,
            "leases_expired": t_s // 2,
            "sent_challenge_init": 500 * t_s,
            "delivered_challenge_init": 1000 * t_s,
            "sent_merge": 400 * t_s,
            "delivered_merge": 700 * t_s,
            "bytes_sent": 900 * 154 * t_s,
        }
        late = Lateness(12.0, 85.0, 190.0)
        live = Live(1.0, late, late, count, 2.0 * count, True)
        flown = np.column_stack([np.full(count, 1.5 * t_s), np.linspace(0, t_s, count)])
        return Snapshot(t_s, position, swarm, state, lit, np.ones(count, bool), counters, live, None, flown)


def feed(observer: Any, plan: Any, seconds: float = 8.0, rate_hz: float = 10.0) -> RunResult:
    swarm = FakeSwarm(plan.cloud)
    observer.planned(plan)
    observer.launching(plan.size, plan.size)
    observer.go(0.5)
    t_s, snapshot = 0.0, swarm.snapshot(0.0)
    for step in range(int(seconds * rate_hz) + 1):
        t_s = step / rate_hz
        snapshot = swarm.snapshot(t_s)
        if step and step % 50 == 0:
            observer.event(Event(t_s, "thaw", 3, 'thaw 1, "quoted"\nand a line'))
        if observer.sample(snapshot):
            break
    late = Lateness(12.0, 85.0, 190.0)
    return RunResult("process", "done", t_s, t_s, 0.5, counters=snapshot.counters, time_scale=1.0, timer_late_ms=late,
                     handled_late_ms=late, processes=plan.size, memory_mb_per_fls=2.0, faithful=True)  # fmt: skip


def record(
    path: Path, panel: Any = None, seconds: float = 8.0, **settings: Any
) -> tuple[Any, dict[str, Any]]:
    """A run of the fake swarm into `path`: the collector and its summary."""
    directory = RunDirectory.create(path, "ball", 1, ["swarmer-run", "--shape", "ball"])
    collector = Collector(directory, panel)
    result = feed(collector, fake_plan(**settings), seconds)
    return collector, collector.finish(result)


@pytest.fixture(scope="session")
def fake() -> Any:
    """The parts of the fake swarm, by name."""
    return SimpleNamespace(ball=ball, plan=fake_plan, swarm=FakeSwarm, feed=feed, record=record)


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a finished run; look, do not touch."""
    path = tmp_path_factory.mktemp("runs") / "ball-run"
    record(path, duration_s=8.0, seed=7)
    return path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports without matplotlib, which takes a second for each: their data and words are made, nothing is drawn."""
    from swarmer.observe import report_costs, report_figures, report_several

    for module in (report_costs, report_figures, report_several):
        monkeypatch.setattr(module, "svg_of", lambda key, alt, draw, *size, **sizes: "<svg></svg>")
