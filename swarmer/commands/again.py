"""`swarmer replay --again RUN`: a run in virtual time is made once more, and must be the same to the last event."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmer.errors import BadInput, RunFailed

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.observe.saved_run import SavedRun

VIRTUAL = "virtual"
SHORT = 16  # digits of a hash that tell two runs apart for a reader


def run_again(path: Path) -> None:
    """Run it again and compare the traces; one line on stdout if they are the same.

    Raises BadInput for a run that cannot be repeated, and says what is in the way; RunFailed if it went another way.
    """
    from swarmer.observe.saved_run import load

    saved = load(path)
    _refuse_what_cannot_repeat(saved)
    config = _its_settings(saved)
    _tell_of_another_version(saved)
    summary = _run(saved.path, config)
    then, now = saved.summary["trace_sha256"], summary["trace_sha256"]
    if then != now:
        raise RunFailed(
            f"not the same run: then {saved.summary.get('events')} events, trace {then[:SHORT]}…, "
            f"now {summary['events']} events, trace {now[:SHORT]}…"
        )
    click.echo(f"the same run: {summary['events']:,} events, trace {now}")


def _refuse_what_cannot_repeat(saved: SavedRun) -> None:
    from swarmer.observe.summary import FORMAT

    summary, path = saved.summary, str(saved.path)
    if not summary:
        raise BadInput("run", path, "a run that ended: this one has no summary.json that can be read")
    if summary.get("format") != FORMAT:
        raise BadInput("run", path, f"a run of format {FORMAT}; this one's is {summary.get('format')}")
    if summary.get("engine") != VIRTUAL:
        raise BadInput(
            "run",
            path,
            f"a run with --engine {VIRTUAL}; the engine {summary.get('engine')} is never twice the same",
        )
    if summary.get("status") != "done" or not isinstance(summary.get("trace_sha256"), str):
        raise BadInput("run", path, f"a run that came to its end; this one is {summary.get('status')}")


def _its_settings(saved: SavedRun) -> RunConfig:
    """The settings in config.yaml. Raises BadInput if they are not those of the run any more."""
    from swarmer.config import load_config
    from swarmer.observe.run_directory import CONFIG

    config = load_config(str(saved.path / CONFIG))
    then, now = saved.manifest.get("settings"), config.unusual()
    if isinstance(then, dict) and then != now:
        names = sorted(name for name in {*then, *now} if then.get(name) != now.get(name))
        changes = ", ".join(
            f"{name} was {then.get(name, 'the default')}, is {now.get(name, 'the default')}" for name in names
        )
        raise BadInput("run", str(saved.path), f"its {CONFIG} as the run wrote it; since then {changes}")
    return config


def _tell_of_another_version(saved: SavedRun) -> None:
    from swarmer import __version__

    version = saved.manifest.get("swarmer")
    if version != __version__:
        click.echo(f"note: the run was made by swarmer {version}, this is {__version__}", err=True)


def _run(path: Path, config: RunConfig) -> dict[str, Any]:
    """The summary of the run made once more, in a directory that is gone afterwards.

    Raises BadInput where the points of its shape are not those of the run in `path` any more.
    """
    from swarmer.engines.virtual import VirtualEngine
    from swarmer.observe.collector import Collector
    from swarmer.observe.run_directory import RunDirectory
    from swarmer.observe.same_shape import shape_changed
    from swarmer.plan import make_plan

    plan = make_plan(config.changed(**{"recording.enabled": False}))
    if shape_changed(path, plan):
        raise BadInput("run", str(path), f"its shape as it was: {config.shape} has other points by now")
    with tempfile.TemporaryDirectory(prefix="swarmer-again-") as room, VirtualEngine(plan) as engine:
        collector = Collector(RunDirectory.create(Path(room) / "run", config.shape, config.seed, sys.argv))
        summary = collector.finish(engine.run(collector))
    if collector.failure is not None:
        raise collector.failure
    if summary["status"] == "interrupted":
        raise KeyboardInterrupt
    return summary
