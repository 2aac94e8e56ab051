"""What the tests on real processes share."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

RUN = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer-run'; cli.main_run()"


def start(
    *arguments: str, cwd: Path, deaf_to: int | None = None, before: Sequence[str] = ()
) -> subprocess.Popen[str]:
    """Start `swarmer-run`, with Ctrl-C as a terminal has it.

    deaf_to: a signal that it ignores, as under nohup. before: a command that starts it.
    """

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if deaf_to is not None:
            signal.signal(deaf_to, signal.SIG_IGN)

    return subprocess.Popen(
        [*before, sys.executable, "-c", RUN, *arguments],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=prepare,
    )


def run(*arguments: str, cwd: Path, timeout: float = 90) -> subprocess.CompletedProcess[str]:
    process = start(*arguments, cwd=cwd)
    out, err = process.communicate(timeout=timeout)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def small(tmp_path: Path, *arguments: str, points: int = 16, duration: float = 4) -> dict:
    """A small finished run; its summary, with the run directory under `dir`."""
    out = tmp_path / "run"
    done = run(
        "--shape", "random", "--points", str(points), "--duration", str(duration), "--no-recording",
        "--out", str(out), *arguments, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == str(out)
    return {**json.loads((out / "summary.json").read_text()), "dir": out, "stderr": done.stderr}


def events(directory: Path) -> list[dict[str, str]]:
    name = "events.csv" if (directory / "events.csv").exists() else "events.csv.partial"
    with (directory / name).open(newline="") as file:
        return list(csv.DictReader(file))


def dispatcher_of(pid: int) -> int | None:
    """The dispatcher among the children of an engine's process."""
    for child in children(pid):
        try:
            if b"swarmer.engines.dispatcher" in Path(f"/proc/{child}/cmdline").read_bytes():
                return child
        except OSError:
            pass
    return None


def children(pid: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def wait_for(condition, seconds: float = 30, every: float = 0.05):
    """Its first true value; fails if there is none in time."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(every)
    raise AssertionError(f"not within {seconds} s")


def flss_of(process: subprocess.Popen[str], count: int) -> list[int]:
    """Process ids of the FLSs of a run, once all of them fly."""

    def found():
        dispatcher = dispatcher_of(process.pid)
        pids = children(dispatcher) if dispatcher else []
        return pids if len(pids) >= count else None

    return wait_for(found)


def gone(pids) -> bool:
    """True once none of these processes runs any more (a zombie waiting for its parent does not run)."""
    return not any(running(pid) for pid in pids)


def running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False
