"""An experiment's runs in one directory: what is missing is made, what is there is kept, results.csv has all of it.

A run is there when its directory has a summary that says `done`. Anything else, half a run of a killed sweep, an
interrupted or a failed one, is made anew. More values, seeds or blocks in the file are simply missing runs. A change
of the settings of a run that is there is refused: the rows of one table are comparable or they are worthless.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

import swarmer
from swarmer.errors import BadInput, RunFailed
from swarmer.experiments.board import Board
from swarmer.experiments.experiment import Experiment
from swarmer.experiments.one_run import Outcome
from swarmer.experiments.pool import Pool
from swarmer.experiments.results import RESULTS, Results
from swarmer.experiments.runs import Run, by_seed, varied_names
from swarmer.observe.files import PARTIAL, TEMPORARY, write_text
from swarmer.observe.run_directory import MANIFEST, SUMMARY, lock_directory
from swarmer.settings import as_yaml

EXPERIMENT = "experiment.yaml"
WRITE_EVERY_S = 1.0
CHANGES_SHOWN = 4


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
    with opened(out):
        there = finished(out, runs)
        write_text(out / EXPERIMENT, as_file(experiment))
        results = Results(out / RESULTS, runs, varied_names(experiment))
        for run in runs:
            if run.path in there:
                results.add(run, there[run.path])
        results.write()
        missing = [run for run in runs if run.path not in there]
        board.planned(experiment.name, len(runs), len(there), min(jobs, max(len(missing), 1)))
        try:
            return Ended(len(runs), len(missing), _make(missing, out, jobs, board, results))
        finally:
            board.close()
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
                if outcome.status == "interrupted":
                    raise KeyboardInterrupt  # the terminal told the worker, too, and it was first
                board.ended(run, outcome)
                results.add(run, outcome.summary, outcome.message)
                if outcome.status != "done":
                    failures.append((run, outcome))
                if time.monotonic() - written >= WRITE_EVERY_S:
                    results.write()
                    written = time.monotonic()
    return failures


# -- the directory ---------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def opened(out: Path) -> Iterator[None]:
    """The sweep's directory, made or taken up again, and held as long as this lasts. Raises BadInput, RunFailed."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        names = {path.name for path in out.iterdir()}
    except (NotADirectoryError, FileExistsError):
        raise BadInput("out", str(out), "it is a file; the path of a directory") from None
    except OSError as error:
        raise RunFailed(f"cannot make {out}: {error.strerror}") from error
    if names and not names & {EXPERIMENT, RESULTS, EXPERIMENT + TEMPORARY, RESULTS + PARTIAL}:
        raise BadInput(
            "out", str(out), f"it holds other files ({min(names)}); choose a new or empty directory"
        )
    lock = lock_directory(out)
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


def finished(out: Path, runs: list[Run]) -> dict[Path, dict[str, Any]]:
    """The summaries of the runs that are there. Raises BadInput if one of them has other settings by now."""
    there: dict[Path, dict[str, Any]] = {}
    changes: dict[str, int] = {}
    for run in runs:
        summary = _read(out / run.path / SUMMARY)
        if summary.get("status") != "done":
            continue
        there[run.path] = summary
        then = _read(out / run.path / MANIFEST).get("settings")
        now = run.config.unusual()
        if then != now:
            for change in _changes(then if isinstance(then, dict) else {}, now):
                changes[change] = changes.get(change, 0) + 1
    if changes:
        said = [f"{change} (runs: {number})" for change, number in changes.items()]
        more = f" and {len(said) - CHANGES_SHOWN} more changes" if len(said) > CHANGES_SHOWN else ""
        raise BadInput(
            "out", str(out),
            f"its runs were made with other settings: {'; '.join(said[:CHANGES_SHOWN])}{more}; "
            "choose another directory with --out",
        )  # fmt: skip
    return there


def _changes(then: dict[str, str], now: dict[str, str]) -> list[str]:
    names = sorted(name for name in {*then, *now} if then.get(name) != now.get(name))
    return [
        f"{name} was {then.get(name, 'the default')}, is {now.get(name, 'the default')}" for name in names
    ]


def _read(path: Path) -> dict[str, Any]:
    """What a JSON file holds; nothing if it is not there or not whole."""
    try:
        data = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}


def as_file(experiment: Experiment) -> str:
    """The experiment as a file that `swarmer sweep` takes: presets resolved, overrides in it."""
    from swarmer.experiments.experiment import FACTS

    base = {name: value for name, value in experiment.base.items() if value != FACTS[name].default}
    blocks = [
        {"base": dict(block.own), "grid": {name: list(values) for name, values in block.grid.items()},
         "seeds": list(block.seeds)}
        for block in experiment.blocks
    ]  # fmt: skip
    head = f"# swarmer {swarmer.__version__}: the experiment {experiment.name}; `swarmer sweep FILE` goes on with it\n"
    return head + yaml.safe_dump(
        {"base": _plain(base), "blocks": _plain(blocks)}, sort_keys=False, allow_unicode=True
    )


def _plain(value: Any) -> Any:
    """As YAML keeps it: lists for tuples, 500 for 500.0."""
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return int(as_yaml(value)) if isinstance(value, float) and value.is_integer() else value
