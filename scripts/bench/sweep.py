"""What a sweep adds to its runs: `bench.py sweep`.

64 runs of the dragon in virtual time, once by hand, one after the other in processes that have imported everything, and
once by `swarmer sweep` on two workers. By hand, too, two processes have half of the runs each: cores slow each other,
whoever keeps them busy, and one seed costs more than another. Processor time is compared, for a machine that does other
things lengthens the wall's; how busy the workers are is the share of the sweep's time in which each had a run.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from bench.tables import show
from swarmer.experiments.board import Board
from swarmer.experiments.experiment import Experiment, experiment_of
from swarmer.experiments.one_run import Outcome, perform
from swarmer.experiments.runs import Run, expand
from swarmer.experiments.sweep import ThisMachine, sweep

RUNS, JOBS, DURATION_S = 64, 2, 10
SAID = {"base": {"engine": "virtual", "shape": "dragon", "duration_s": DURATION_S}, "seeds": RUNS}


class Watch(Board):
    """How long workers had runs, in wall seconds."""

    def __init__(self) -> None:
        super().__init__()
        self.since: dict[Any, float] = {}
        self.busy_s, self.first, self.last = 0.0, 0.0, 0.0

    def started(self, run: Run) -> None:
        self.since[run.path] = time.monotonic()
        self.first = self.first or self.since[run.path]

    def ended(self, run: Run, outcome: Outcome) -> None:
        if outcome.status != "done":
            raise SystemExit(f"{run.path}: {outcome.message}")
        self.last = time.monotonic()
        self.busy_s += self.last - self.since[run.path]

    def tick(self) -> None:
        """Silent."""

    def say(self, line: str) -> None:
        """Silent."""


def run(repeat: int) -> None:
    """Measure and print."""
    experiment = experiment_of(SAID, "bench", "bench")
    rows = []
    for _ in range(repeat):
        runs = expand(experiment)
        each, (total, busy) = by_hands(runs), swept(experiment)
        rows.append(
            [f"{each:.2f} s", f"{total / RUNS:.2f} s", f"{total / RUNS / each - 1:+.1%}", f"{busy:.1%}"]
        )
    show(
        f"{RUNS} runs of the dragon, {DURATION_S} emulated s, virtual time, {JOBS} workers; processor time of a run",
        ["by hand", "in a sweep", "more", "workers busy"], rows,
    )  # fmt: skip


def by_hand(runs: list[Run]) -> float:
    """Processor seconds of a run, made as a sweep's worker makes it; the first one imports and does not count."""
    with tempfile.TemporaryDirectory(prefix="swarmer-bench-") as room:
        perform(runs[0].config, Path(room) / "first")
        began = time.process_time()
        for at, one in enumerate(runs):
            perform(one.config, Path(room) / str(at))
        return (time.process_time() - began) / len(runs)


def by_hands(runs: list[Run]) -> float:
    """The same, in as many processes at once as the sweep has workers."""
    with ProcessPoolExecutor(JOBS, get_context("spawn")) as pool:
        return sum(pool.map(by_hand, [runs[job::JOBS] for job in range(JOBS)])) / JOBS


def swept(experiment: Experiment) -> tuple[float, float]:
    """Processor seconds of the whole sweep, its own and its workers'; the share of its wall time they had runs."""
    watch = Watch()
    before = spent()
    with tempfile.TemporaryDirectory(prefix="swarmer-bench-") as room:
        sys.stderr.flush()
        sweep(experiment, expand(experiment), Path(room) / "sweep", ThisMachine(JOBS), watch)
    return spent() - before, watch.busy_s / (JOBS * (watch.last - watch.first))


def spent() -> float:
    """Processor seconds of this process and its ended children."""
    its = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in its)
