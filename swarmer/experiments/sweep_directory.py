"""The directory of a sweep: whose it is, which runs in it are finished, what has changed since it was begun.

It holds `experiment.yaml` (the experiment, presets resolved), `results.csv`, and a folder for each cell with a run
directory for each seed.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import yaml

import swarmer
from swarmer.errors import BadInput, RunFailed, shown
from swarmer.experiments.experiment import EXPERIMENT, FACTS, Block, Experiment
from swarmer.experiments.results import RESULTS
from swarmer.experiments.runs import Run
from swarmer.experiments.samples import KINDS
from swarmer.fault_settings import with_schedule
from swarmer.observe.files import TEMPORARY, write_text
from swarmer.observe.run_directory import DISK_FULL, MANIFEST, ROOT, SUMMARY, hold, let_go
from swarmer.settings import as_yaml
from swarmer.shapes.catalogue import CATALOGUE, load_shape
from swarmer.yaml_file import parse

BEGUN = {EXPERIMENT + TEMPORARY}  # all that is there of a sweep that was killed with its first breath
HEAD = re.compile(r"# The experiment (.+), by swarmer ")
CHANGES_SHOWN = 4
VALUE_LENGTH = 60
HEAD_LENGTH = 1000
IN_EVERY_SUMMARY = ("format", "engine", "shape", "points", "seed", "status", "wall_s")


class SweepDirectory:
    """Held by one sweep at a time. A context."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock: int | None = None

    def __enter__(self) -> Self:
        """Make it, or take it up again. Raises BadInput for one that is somebody else's, RunFailed."""
        path = self.path
        try:
            path.mkdir(parents=True, exist_ok=True)
            names = {entry.name for entry in path.iterdir()}
        except (NotADirectoryError, FileExistsError):
            raise BadInput("out", str(path), "it is a file; the path of a directory") from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            if getattr(error, "errno", None) in DISK_FULL:
                raise RunFailed(f"cannot make {path}: {reason}") from error
            raise BadInput("out", str(path), f"the path of a directory ({reason})") from None
        if names - BEGUN and written_name(path / EXPERIMENT) is None:
            allowed = f"it holds other files ({min(names)}); choose a new or empty directory"
            raise BadInput("out", str(path), allowed)
        try:
            self._lock = hold(path)
        except BadInput:
            allowed = "another sweep is writing there; choose another directory"
            raise BadInput("out", str(path), allowed) from None
        return self

    def __exit__(self, *_: object) -> None:
        let_go(self._lock)
        self._lock = None

    def write(self, experiment: Experiment) -> None:
        """Write the experiment down, for whoever reads the table and for the next start. Raises RunFailed."""
        write_text(self.path / EXPERIMENT, as_file(experiment))

    def finished(self, runs: list[Run]) -> dict[Path, dict[str, Any]]:
        """The summaries of the runs that are there, by the run's path.

        Raises BadInput if one of them has other settings by now, or the file of its shape other points: a table has
        comparable rows or is worthless.
        """
        hashes: dict[tuple[Any, ...], str] = {}
        there: dict[Path, dict[str, Any]] = {}
        changes: dict[str, int] = {}
        for run in runs:
            if summary := self.summary_of(run):
                there[run.path] = summary
                for change in self._changes(run, hashes):
                    changes[change] = changes.get(change, 0) + 1
        if changes:
            allowed = f"runs there were made otherwise: {_some(changes)}; choose another directory with --out"
            raise BadInput("out", str(self.path), allowed)
        return there

    def summary_of(self, run: Run) -> dict[str, Any] | None:
        """The summary of a run that is done, if it is whole, else None."""
        summary = _read(self.path / run.path / SUMMARY)
        whole = all(summary.get(name) is not None for name in IN_EVERY_SUMMARY)
        return summary if whole and summary["status"] == "done" else None

    def _changes(self, run: Run, hashes: dict[tuple[Any, ...], str]) -> list[str]:
        """hashes: of the clouds that were read already; gets those that are read now."""
        manifest = _read(self.path / run.path / MANIFEST)
        then, now = manifest.get("settings"), with_schedule(run.config).unusual()  # as a run writes them down
        then = then if isinstance(then, dict) else {}
        if "shape" in now and then.get("shape") == _whole_path(now["shape"]):
            now = now | {"shape": then["shape"]}
        names = sorted(name for name in {*then, *now} if then.get(name) != now.get(name))
        shape, hashed = run.config.shape, manifest.get("points_sha256")
        if not names and shape not in CATALOGUE and hashed not in (None, _hash_of(run, hashes)):
            return [f"{shape} has other points by now"]
        return [
            f"{name} was {then.get(name, 'the default')}, is {now.get(name, 'the default')}" for name in names
        ]

    def notes(self, experiment: Experiment, runs: list[Run]) -> list[str]:
        """What a user should know of a directory that is taken up again: a line each."""
        notes = []
        then, now = _sayings(self._text()), _sayings(as_file(experiment))
        if then and then != now:
            names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
            changes = [
                f"{name} was {then.get(name, 'not there')}, is {now.get(name, 'gone')}" for name in names
            ]
            notes.append(f"the experiment has changed: {_some(dict.fromkeys(changes, 0))}")
        known = {str(run.path) for run in runs}
        others = sum(str(path) not in known for path in self._summaries())
        if others:
            notes.append(
                f"{others} runs there are not of this experiment; they stay, and are not in {RESULTS}"
            )
        versions = {_read(self.path / path / MANIFEST).get("swarmer") for path in self._summaries()}
        strange = sorted(map(str, versions - {swarmer.__version__}))
        notes += [f"runs there were made by swarmer {one}, this is {swarmer.__version__}" for one in strange]
        return notes

    def _text(self) -> str:
        try:
            return (self.path / EXPERIMENT).read_text("utf-8")
        except (OSError, ValueError):
            return ""

    def _summaries(self) -> list[Path]:
        """The run directories that have a summary, as paths within this one."""
        found = [*self.path.glob(f"seed-*/{SUMMARY}"), *self.path.glob(f"*/seed-*/{SUMMARY}")]
        return [path.parent.relative_to(self.path) for path in found]


def _whole_path(shape: str) -> str:
    """A file of points as a run writes down where it is."""
    path = Path(shape)
    return str(path.parent.resolve() / path.name)


def _hash_of(run: Run, hashes: dict[tuple[Any, ...], str]) -> str:
    """The hash of the points that this run would have."""
    config = run.config
    key = (config.shape, config.points, config.duplicates, config.seed)
    if key not in hashes:
        hashes[key] = load_shape(*key).sha256
    return hashes[key]


def written_name(path: Path) -> str | None:
    """The name of the experiment in a file that `as_file` made; None for any other file, or none."""
    try:
        with path.open(encoding="utf-8") as file:
            head = HEAD.match(file.readline(HEAD_LENGTH))
    except (OSError, ValueError):
        return None
    return head.group(1) if head else None


def home_of(experiment: Experiment, file: Path) -> tuple[Experiment, Path]:
    """The experiment read from `file`, and the directory that it has unless the user names one.

    A sweep's own file stands for that sweep: its name is in it, its directory is where it lies.
    """
    name = written_name(file) if file.name == EXPERIMENT and (file.parent / RESULTS).is_file() else None
    return (replace(experiment, name=name), file.parent) if name else (experiment, ROOT / experiment.name)


def as_file(experiment: Experiment) -> str:
    """The experiment as a file that `swarmer sweep` takes: presets resolved, overrides in it."""
    base = {name: value for name, value in experiment.base.items() if value != FACTS[name].default}
    blocks = [_block_as_file(block) for block in experiment.blocks]
    head = f"# The experiment {experiment.name}, by swarmer {swarmer.__version__}; `swarmer sweep FILE` takes it\n"
    return head + yaml.safe_dump(
        _plain({"base": base, "blocks": blocks}), sort_keys=False, allow_unicode=True
    )


def _block_as_file(block: Block) -> dict[str, Any]:
    """The parts of a block; those that few have only where they say something."""
    rare = {"list": block.listed, "needs": block.needs}
    rare |= {block.sample.kind: block.sample.plain()} if block.sample else {}
    parts = {"base": block.own, "grid": block.grid, "seeds": list(block.seeds)}
    return parts | {name: part for name, part in rare.items() if part}


def _plain(value: Any) -> Any:
    """As YAML keeps it: lists for tuples, 500 for 500.0."""
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _sayings(text: str) -> dict[str, str]:
    """What an experiment written by `as_file` says, each under the name of its place; nothing if it cannot be read."""
    try:
        whole = parse(text)
        said = {f"base: {name}": as_yaml(value) for name, value in whole["base"].items()}
        for number, block in enumerate(whole["blocks"], 1):
            where = f"block {number} " if len(whole["blocks"]) > 1 else ""
            said |= {f"{where}base: {name}": as_yaml(value) for name, value in block["base"].items()}
            said |= {f"{where}grid: {name}": as_yaml(value) for name, value in block["grid"].items()}
            said |= {
                f"{where}{part}": as_yaml(block[part]) for part in ("seeds", "list", *KINDS) if part in block
            }
    except (yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return {name: shown(value, VALUE_LENGTH).strip("'") for name, value in said.items()}


def _some(changes: dict[str, int]) -> str:
    """The first few, with the number of runs that each of them concerns."""
    said = [f"{change} (runs: {number})" if number else change for change, number in changes.items()]
    more = f" and {len(said) - CHANGES_SHOWN} more" if len(said) > CHANGES_SHOWN else ""
    return "; ".join(said[:CHANGES_SHOWN]) + more


def _read(path: Path) -> dict[str, Any]:
    """What a JSON file holds; nothing if it is not there or not whole."""
    try:
        data = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}
