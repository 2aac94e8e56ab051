"""A real run for a table: as `swarmer-run` makes it, in a directory that is gone afterwards, with its cost measured."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from swarmer.config import load_config
from swarmer.engines.measured import Cost, MeasuredEngine
from swarmer.observe.collector import Collector
from swarmer.observe.run_directory import RunDirectory
from swarmer.plan import make_plan


class Run(NamedTuple):
    """summary.json of a run, and what it cost."""

    summary: dict[str, Any]
    cost: Cost


def run_once(preset: str | None = None, **settings: Any) -> Run:
    """Make one run. Raises SwarmerError where it is not possible, KeyboardInterrupt where it was stopped."""
    plan = make_plan(load_config(preset, [], **settings))
    with tempfile.TemporaryDirectory(prefix="swarmer-bench-") as room, MeasuredEngine(plan) as engine:
        directory = RunDirectory.create(Path(room) / "run", plan.config.shape, plan.config.seed, sys.argv)
        collector = Collector(directory)
        summary = collector.finish(engine.run(collector))
    if summary["status"] == "interrupted":
        raise KeyboardInterrupt
    return Run(summary, engine.cost)


def repeated(repeat: int, preset: str | None = None, **settings: Any) -> list[Run]:
    """Runs of the seeds 1, 2, ..."""
    return [run_once(preset, seed=seed, **settings) for seed in range(1, repeat + 1)]


def middle(values: list[float | None]) -> float | None:
    """The median of what is known; None if a half or more is not."""
    known = [value for value in values if value is not None]
    return median(known) if 2 * len(known) > len(values) else None


def middle_of(runs: list[Run], *path: str) -> float | None:
    """The median of a figure of the summary; `path`: its name, and where it has parts, the part."""
    return middle([figure(run.summary, path) for run in runs])


def figure(summary: dict[str, Any], path: tuple[str, ...]) -> float | None:
    value: Any = summary
    for name in path:
        value = None if value is None else value.get(name)
    return None if value is None else float(value)
