"""An experiment's runs in one directory: what is missing is made, what is there is kept, results.csv has all of it.

A run is there when its directory has a summary that says `done`. Anything else, half a run of a killed sweep, an
interrupted or a failed one, is made anew. More values, seeds or blocks in the file are simply missing runs. A change
of the settings of a run that is there is refused: the rows of one table are comparable or they are worthless.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

from swarmer.engines.limits import available_mb
from swarmer.errors import RunFailed
from swarmer.experiments.board import Board
from swarmer.experiments.experiment import Experiment
from swarmer.experiments.needs import Needs, Room
from swarmer.experiments.one_run import Outcome
from swarmer.experiments.pool import Pool
from swarmer.experiments.results import RESULTS, Results, check_ours
from swarmer.experiments.runs import Run, by_seed, varied_names
from swarmer.experiments.sweep_directory import SweepDirectory

WRITE_EVERY_S = 1.0
MEMORY_SHARE = 0.9  # of what is free as a sweep begins


class Ended(NamedTuple):
    """What a sweep has to say at its end."""

    total: int
    made: int  # in this go
    failures: list[tuple[Run, Outcome]]


class Place(Protocol):
    """Where runs are made."""

    def at_once(self, runs: list[Run]) -> int:
        """How many of the runs are at work at a time, at most. Raises BadInput for one that fits nowhere."""

    def notes(self, runs: list[Run]) -> list[str]:
        """What a user should know before: a line each."""

    def outcomes(self, runs: list[Run], out: Path, board: Board) -> Iterator[tuple[Run, Outcome]]:
        """Make the runs, each in its directory below `out`, and give each as it ends."""


class ThisMachine:
    """Processes here, as many as fit: one core for each job, and the memory that is free."""

    def __init__(self, jobs: int, memory_mb: float | None = None) -> None:
        """memory_mb: what is free, unless it is given; None where the system does not tell."""
        free = available_mb()
        self.room = Room(jobs, memory_mb or (free and free * MEMORY_SHARE))

    def at_once(self, runs: list[Run]) -> int:
        """See Place; a run that is too large for the machine is made alone."""
        return self.room.at_once([run.needs for run in runs])

    def notes(self, runs: list[Run]) -> list[str]:
        """See Place."""
        there = self.room.memory_mb
        large = [run for run in runs if there is not None and run.needs.memory_mb > there]
        if not large:
            return []
        most = max(run.needs.memory_mb for run in large)
        return [f"{len(large)} runs need up to {most:,.0f} MB, and {there:,.0f} are free: each is made alone"]

    def outcomes(self, runs: list[Run], out: Path, board: Board) -> Iterator[tuple[Run, Outcome]]:
        """See Place: first those that can stand side by side, then one by one those that need the machine."""
        needs: dict[Path, Needs] = {}  # an estimate looks at the shape; once is enough

        def need(run: Run) -> Needs:
            if run.path not in needs:
                needs[run.path] = run.needs
            return needs[run.path]

        def fits(run: Run, beside: list[Run]) -> bool:
            return self.room.fits(need(run), [need(other) for other in beside])

        for alone in (False, True):
            part = [run for run in runs if run.whole_machine == alone]
            if part:
                with Pool(1 if alone else min(self.room.cores, len(part)), out) as pool:
                    yield from pool.outcomes(part, board.started, board.tick, fits)


def sweep(experiment: Experiment, runs: list[Run], out: Path, place: Place, board: Board) -> Ended:
    """Make what is missing of `runs` in the directory `out`.

    Raises BadInput for a directory that is not this experiment's, RunFailed if the disk is full. On Ctrl-C the workers
    end at once, the table is written and KeyboardInterrupt goes on.
    """
    with SweepDirectory(out) as directory:
        check_ours(out / RESULTS)
        there = directory.finished(runs)
        notes = directory.notes(experiment, runs)
        missing = [run for run in runs if run.path not in there]
        at_once = place.at_once(missing)
        directory.write(experiment)
        results = Results(out / RESULTS, runs, varied_names(experiment))
        for run in runs:
            if run.path in there:
                results.add(run, there[run.path])
        results.write()
        for note in [*notes, *place.notes(missing)]:
            board.say(f"note: {note}")
        board.planned(experiment.name, len(runs), len(there), at_once)
        try:
            return Ended(len(runs), len(missing), _make(missing, out, place, board, results))
        finally:
            board.close()
            for run in missing:  # also one that had just ended when we were interrupted
                if summary := directory.summary_of(run):
                    results.add(run, summary)
            results.write()


def _make(
    missing: Iterable[Run], out: Path, place: Place, board: Board, results: Results
) -> list[tuple[Run, Outcome]]:
    """Make runs, every cell once before any has its next seed; those that failed."""
    failures: list[tuple[Run, Outcome]] = []
    written = time.monotonic()
    for run, outcome in place.outcomes(by_seed(missing), out, board):
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
