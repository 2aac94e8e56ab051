"""An experiment's runs in one directory: what is missing is made, what is there is kept, results.csv has all of it.

A run is there when its directory has a summary that says `done`. Anything else, half a run of a killed sweep, an
interrupted or a failed one, is made anew. More values, seeds or blocks in the file are simply missing runs. A change
of the settings of a run that is there is refused: the rows of one table are comparable or they are worthless.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

from swarmer.errors import RunFailed
from swarmer.experiments.board import Board
from swarmer.experiments.experiment import Experiment
from swarmer.experiments.one_run import Outcome
from swarmer.experiments.pool import Pool
from swarmer.experiments.results import RESULTS, Results
from swarmer.experiments.runs import Run, by_seed, varied_names
from swarmer.experiments.sweep_directory import SweepDirectory

WRITE_EVERY_S = 1.0


class Ended(NamedTuple):
    """What a sweep has to say at its end."""

    total: int
    made: int  # in this go
    failures: list[tuple[Run, Outcome]]


def sweep(experiment: Experiment, runs: list[Run], out: Path, jobs: int, board: Board) -> Ended:
    """Make what is missing of `runs` in the directory `out`, `jobs` at a time.

    Raises BadInput for a directory that is not this experiment's, RunFailed if the disk is full. On Ctrl-C the workers
    end at once, the table is written and KeyboardInterrupt goes on.
    """
    with SweepDirectory(out) as directory:
        there = directory.finished(runs)
        notes = directory.notes(experiment, runs)
        directory.write(experiment)
        results = Results(out / RESULTS, runs, varied_names(experiment))
        for run in runs:
            if run.path in there:
                results.add(run, there[run.path])
        results.write()
        missing = [run for run in runs if run.path not in there]
        for note in notes:
            board.say(f"note: {note}")
        board.planned(experiment.name, len(runs), len(there), min(jobs, len(missing)))
        try:
            return Ended(len(runs), len(missing), _make(missing, out, jobs, board, results))
        finally:
            board.close()
            for run in missing:  # also one that had just ended when we were interrupted
                if summary := directory.summary_of(run):
                    results.add(run, summary)
            results.write()


def _make(
    missing: list[Run], out: Path, jobs: int, board: Board, results: Results
) -> list[tuple[Run, Outcome]]:
    """Make runs: first those that can stand side by side, then one by one those that need the machine."""
    failures: list[tuple[Run, Outcome]] = []
    written = time.monotonic()
    for alone in (False, True):
        part = by_seed(run for run in missing if run.whole_machine == alone)
        workers = 1 if alone else min(jobs, len(part))
        if not part:
            continue
        with Pool(workers, out) as pool:
            for run, outcome in pool.outcomes(part, board.started, board.tick):
                if outcome.disk_full:
                    raise RunFailed(outcome.message)
                board.ended(run, outcome)
                results.add(run, outcome.summary, outcome.message)
                if outcome.status != "done":
                    failures.append((run, outcome))
                if time.monotonic() - written >= WRITE_EVERY_S:
                    results.write()
                    written = time.monotonic()
    return failures
