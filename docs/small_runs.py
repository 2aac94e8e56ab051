"""Runs in virtual time that the pages draw: made when the docs are built, by the commands that the pages show."""

from __future__ import annotations

import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from swarmer.engines.result import Event
from swarmer.observe.moves import Moves
from swarmer.observe.saved_run import load
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.trace_file import TraceFile

WAIT_S = 100


class Drawn(NamedTuple):
    """What is left of a run to draw."""

    timeline: SavedTimeline
    events: list[Event]
    log: Moves | None  # None without --trace


@cache
def made(command: str) -> Drawn:
    """Run a command of a page, `swarmer-run ...`, and read what it left. Raises RuntimeError with its last words."""
    program, *options = shlex.split(command)
    if program != "swarmer-run":
        raise ValueError(f"no run: {command}")
    with TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        line = [sys.executable, "-m", "swarmer", "run", *options, "--no-recording", "--out", str(out)]
        done = subprocess.run(line, capture_output=True, text=True, timeout=WAIT_S, check=False)
        if done.returncode:
            raise RuntimeError(f"{command}: {done.stderr[-800:]}")
        run = load(out)
        log = _log(out) if "--trace" in options else None
    if run.timeline is None:
        raise RuntimeError(f"{command}: {run.missing}")
    return Drawn(run.timeline, run.events, log)


def _log(path: Path) -> Moves:
    log = Moves()
    for record in TraceFile(path).records():
        log.add(record)
    return log
