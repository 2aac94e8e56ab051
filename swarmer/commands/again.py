"""`swarmer replay --again RUN`: a run in virtual time is made once more, and must be the same to the last event."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmer.errors import BadInput, RunFailed, shown

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.observe.saved_run import SavedRun

VIRTUAL = "virtual"
SURROUNDINGS = ("swarmer", "python", "platform")  # of a manifest: what a rounding may depend on
LIBRARIES = ("numpy", "scipy")
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
    summary, manifest = _run(saved.path, config)
    then, now = (_outcome(one) for one in (saved.summary, summary))
    if then != now:
        changed = changed_since(saved.manifest, manifest)
        raise RunFailed(
            f"not the same run: then {_in_words(then)}, now {_in_words(now)}"
            + (f"; since then {changed}" if changed else "")
        )
    click.echo(f"the same run: {now[0]:,} events, trace {now[1]}")


def _outcome(summary: dict[str, Any]) -> tuple[int, str]:
    return summary["events"], summary["trace_sha256"]


def _in_words(outcome: tuple[int, str]) -> str:
    return f"{outcome[0]:,} events, trace {outcome[1][:SHORT]}…"


def changed_since(then: dict[str, Any], now: dict[str, Any]) -> str:
    """What two manifests say of the program and the machine, where they differ.

    >>> changed_since({"python": "3.11.2", "libraries": {"numpy": "1.26.4"}}, {"python": "3.12.1", "libraries": {}})
    'python was 3.11.2, is 3.12.1, numpy was 1.26.4, is not known'
    """
    was, now_is = ({name: one.get(name) for name in SURROUNDINGS} | _libraries(one) for one in (then, now))
    return ", ".join(
        f"{name} was {_plain(value)}, is {_plain(now_is.get(name) or 'not known')}"
        for name, value in was.items()
        if value is not None and value != now_is.get(name)
    )


def _plain(value: object) -> str:
    return shown(value).strip("'\"")


def _libraries(manifest: dict[str, Any]) -> dict[str, Any]:
    libraries = manifest.get("libraries")
    return {name: libraries.get(name) for name in LIBRARIES} if isinstance(libraries, dict) else {}


def _refuse_what_cannot_repeat(saved: SavedRun) -> None:
    from swarmer.observe.run_directory import MANIFEST_FORMAT
    from swarmer.observe.summary import FORMAT

    summary, path = saved.summary, str(saved.path)
    if not summary:
        raise BadInput("run", path, "a run that ended: this one has no summary.json that can be read")
    if (version := summary.get("format")) != FORMAT:
        raise BadInput("run", path, f"a run of format {FORMAT}; this one's is {version or 'not known'}")
    if saved.manifest and (version := saved.manifest.get("format")) != MANIFEST_FORMAT:
        raise BadInput(
            "run", path, f"a manifest.json of format {MANIFEST_FORMAT}; this one's is {shown(version)}"
        )
    if summary.get("engine") != VIRTUAL:
        engine = summary.get("engine")
        why = "has no events to compare" if engine == "rounds" else "is never twice the same"
        raise BadInput("run", path, f"a run with --engine {VIRTUAL}; the engine {engine} {why}")
    if (status := summary.get("status")) != "done":
        how = f"this one is {status}" if status else "of this one nobody knows"
        raise BadInput("run", path, f"a run that came to its end; {how}")
    if not isinstance(summary.get("trace_sha256"), str) or not isinstance(summary.get("events"), int):
        raise BadInput(
            "run", path, "there is nothing to compare with: its summary.json has no events and trace_sha256"
        )


def _its_settings(saved: SavedRun) -> RunConfig:
    """The settings in config.yaml. Raises BadInput if they are not those of the run any more."""
    from swarmer.config import load_config
    from swarmer.observe.run_directory import CONFIG

    file = saved.path / CONFIG
    if not file.is_file():
        raise BadInput("run", str(saved.path), f"its settings are not known: it has no {CONFIG}")
    config = load_config(str(file))
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
    if not version or not isinstance(saved.manifest.get("settings"), dict):
        said = "the manifest of the run cannot tell whether settings and versions are as they were"
        click.echo(f"note: {said}", err=True)
    elif version != __version__:
        click.echo(f"note: the run was made by swarmer {_plain(version)}, this is {__version__}", err=True)


def _run(path: Path, config: RunConfig) -> tuple[dict[str, Any], dict[str, Any]]:
    """Summary and manifest of the run made once more, in a directory that is gone afterwards.

    Raises BadInput where the points of its shape are not those of the run in `path` any more.
    """
    from swarmer.engines.virtual import VirtualEngine
    from swarmer.observe.collector import Collector
    from swarmer.observe.run_directory import MANIFEST, RunDirectory
    from swarmer.observe.same_shape import shape_changed
    from swarmer.plan import make_plan

    plan = make_plan(config.changed(**{"recording.enabled": False}))
    if shape_changed(path, plan):
        raise BadInput("run", str(path), f"its shape as it was: {config.shape} has other points by now")
    with tempfile.TemporaryDirectory(prefix="swarmer-again-") as room, VirtualEngine(plan) as engine:
        collector = Collector(RunDirectory.create(Path(room) / "run", config.shape, config.seed, sys.argv))
        summary = collector.finish(engine.run(collector))
        manifest = json.loads((Path(room) / "run" / MANIFEST).read_text("utf-8"))
    if collector.failure is not None:
        raise collector.failure
    if summary["status"] == "interrupted":
        raise KeyboardInterrupt
    return summary, manifest
