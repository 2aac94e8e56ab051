"""Runs that are ended in every way there is, at random moments: what test_endings.py and scripts/endings.py play.

`draw(seed)` makes a case as data; `play` starts the run, ends it, and says what is wrong with what is left: a process,
a segment of shared memory, a lock, a half-written file under a final name, a summary that does not say how it ended.
"""

from __future__ import annotations

import contextlib
import csv
import fcntl
import gzip
import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import termios
import time
import uuid
from collections.abc import Callable, Iterable
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
import yaml

HERE = Path(__file__).resolve().parent
RUN = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer-run'; cli.main_run()"
# Stands in for rerun's window, which reads its input to the end.
DESKTOP = (
    "from swarmer.observe import viewer; import sys; "
    "viewer.rerun_command = lambda: [sys.executable, '-c', 'import sys; sys.stdin.buffer.read()']; "
)
MARK = "SWARMER_ENDINGS_CASE"
CLEAN_WITHIN_S = 3.0
PATIENCE_S = 60.0
POINTS, DURATION_S = 8, 1.0
VIEWED_S = 3.0  # of a run whose viewer is killed: that comes well before its end
KB = 1024

# Ways to end, and what the run may then say: exit statuses, and what the summary's status may be.
SIGNALS = {
    "ctrl_c": [signal.SIGINT], "ctrl_c_twice": [signal.SIGINT, signal.SIGINT], "terminate": [signal.SIGTERM],
    "hang_up": [signal.SIGHUP], "kill": [signal.SIGKILL],
}  # fmt: skip
CALLS = (
    "os.fork",
    "mmap.mmap",
    "os.memfd_create",
    "os.ftruncate",
    "socket:socket.bind",
    "os.pipe2",
    "subprocess._fork_exec",
)
# Ends with a signal that nobody sends: the kernel does as a terminal goes.
ENDED_BY = SIGNALS | {"terminal_closed": [signal.SIGHUP]}
# What a run must survive, however late or early it comes.
SURVIVED = ("viewer_killed", "second_run")
WAYS = (
    *ENDED_BY, *SURVIVED, "dispatcher_killed", "call_fails", "disk_full", "no_shared_memory", "few_files",
)  # fmt: skip


# What has come about when a moment is counted from there, so that a busy machine has the same moments; and how many
# wall seconds later it may be.
STAGES = {"started": 1.0, "directory": 0.2, "planned": 0.3, "flying": 1.5}


class Case(NamedTuple):
    """One run and how it ends."""

    seed: int
    way: str
    engine: str
    stage: str  # one of STAGES, for what comes from outside
    moment_s: float  # wall seconds after that
    call: str = ""  # that fails, as the sabotage has it
    limit: int = 0  # bytes that a file may have, or files that may be open
    viewer: str = ""  # what --live opens

    def words(self) -> str:
        more = (
            self.call
            or self.viewer
            or (f"limit {self.limit}" if self.limit else f"{self.stage} + {self.moment_s:.2f} s")
        )
        return f"{self.way} ({self.engine}, {more})"


def draw(seed: int) -> Case:
    """The case of a seed."""
    rng = Random(f"ending {seed}")
    way = WAYS[seed % len(WAYS)]
    engine = (
        "process"
        if way not in ("ctrl_c", "terminate", "hang_up", "kill") or rng.random() < 0.7
        else "virtual"
    )
    stage = rng.choice(sorted(STAGES))
    case = Case(seed, way, engine, stage, rng.uniform(0.0, STAGES[stage]))
    if way == "call_fails":
        call = rng.choice(CALLS)
        which = rng.randint(1, POINTS + 1) if call == "os.fork" else rng.randint(1, 2)
        return case._replace(call=f"{call} {which} {rng.choice(('EAGAIN', 'ENOMEM', 'EMFILE'))}")
    if way == "dispatcher_killed":
        return case._replace(stage=rng.choice(("planned", "flying")))
    if way == "viewer_killed":  # the moment counts from where there is one
        viewer = ("web", "desktop")[seed // len(WAYS) % 2]
        return case._replace(stage="directory", moment_s=rng.uniform(0.0, VIEWED_S - 1.0), viewer=viewer)
    if way == "second_run":
        return case._replace(stage="flying", moment_s=rng.uniform(0.0, 1.0), limit=free_port())
    if way == "disk_full":
        return case._replace(limit=rng.randint(20, 60) * KB)
    if way == "no_shared_memory":
        return case._replace(limit=rng.randint(1, 6) * KB)
    return case._replace(limit=rng.randint(8, 40)) if way == "few_files" else case


def play(case: Case, room: Path) -> str | None:
    """Make the run in `room`; what is wrong, or None."""
    out, mark = room / f"run-{case.seed}", uuid.uuid4().hex
    terminal = Terminal() if case.way == "terminal_closed" else None
    with _start(case, out, mark, terminal) as process:
        segments = _end(case, process, out, mark, terminal)
        try:
            err = process.communicate(timeout=PATIENCE_S)[1] or ""
        except subprocess.TimeoutExpired:
            process.kill()
            err = process.communicate()[1] or ""
            return f"still runs {PATIENCE_S:g} s after that: {err[-300:]}"
    wrong = _left_over(mark, segments, out) or _status(case, process.returncode, err, out) or _files(out)
    wrong = wrong or ("a traceback" if "Traceback" in err else None)
    return None if wrong is None else f"{wrong} [exit {process.returncode}; stderr: {err.strip()[-600:]}]"


class Terminal:
    """One of which somebody reads, until it is closed."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        os.set_blocking(self.master, False)

    def read(self) -> None:
        with contextlib.suppress(OSError):
            while os.read(self.master, 65536):
                pass

    def close(self) -> None:
        os.close(self.master)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def _start(case: Case, out: Path, mark: str, terminal: Terminal | None = None) -> subprocess.Popen[str]:
    arguments = [
        "--shape", "random", "--points", str(POINTS), "--duration", str(DURATION_S), "--engine", case.engine,
        "--out", str(out), *(["--set", "recording.rate_hz=60"] if case.way == "disk_full" else ["--no-recording"]),
    ]  # fmt: skip
    if case.viewer:
        arguments += [f"--live={case.viewer}", "--duration", str(VIEWED_S)]
    if case.way == "second_run":
        arguments += ["--set", f"radio.port={case.limit}"]
    if case.engine == "virtual":  # as long as a moment may be late
        arguments += ["--duration", "20000", "--set", "lambda_ms=50"]
    environment = {**os.environ, MARK: mark}
    program = RUN
    if case.viewer == "desktop":
        program, environment["DISPLAY"] = DESKTOP + RUN, ":99"
    if case.call:
        paths = [str(HERE / "sabotage"), os.environ.get("PYTHONPATH", "")]
        environment |= {"SWARMER_SABOTAGE": case.call, "PYTHONPATH": os.pathsep.join(filter(None, paths))}

    def before() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # as a terminal has it
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        if terminal is not None:
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        if case.way == "few_files":
            resource.setrlimit(resource.RLIMIT_NOFILE, (case.limit, case.limit))
        elif case.limit and case.way != "second_run":
            resource.setrlimit(resource.RLIMIT_FSIZE, (case.limit, case.limit))

    ends = subprocess.PIPE if terminal is None else terminal.slave
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments], stdin=None if terminal is None else ends, stdout=ends, stderr=ends,
        text=True, env=environment, preexec_fn=before, start_new_session=terminal is not None,
    )  # fmt: skip
    if terminal is not None:
        os.close(terminal.slave)
    return process


def _reached(case: Case, process: subprocess.Popen[str], out: Path, mark: str) -> bool:
    if case.way == "viewer_killed":
        return any(not _is_dispatcher(pid) for pid in _children(process.pid, mark))
    if case.stage == "directory":
        return out.exists()
    if case.stage == "planned" or (case.stage == "flying" and case.engine == "virtual"):
        return (out / "config.yaml").exists()
    return case.stage == "started" or (out.exists() and len(processes(mark)) >= POINTS + 2)


def _end(
    case: Case, process: subprocess.Popen[str], out: Path, mark: str, terminal: Terminal | None
) -> set[str]:
    """Do to it from outside what the case has. Gives the names of the shared memory that its processes have."""
    if case.way in ENDED_BY or case.way in SURVIVED or case.way == "dispatcher_killed":
        while process.poll() is None and not _reached(case, process, out, mark):
            _pause(terminal)
        until = time.monotonic() + case.moment_s
        while process.poll() is None and time.monotonic() < until:
            _pause(terminal)
    segments = {name for pid in processes(mark) for name in segments_of(pid)}
    for number in SIGNALS.get(case.way, ()):
        process.send_signal(number)
        time.sleep(0.05)
    if terminal is not None:
        terminal.close()
    elif case.way == "dispatcher_killed":
        _kill(pid for pid in _children(process.pid, mark) if _is_dispatcher(pid))
    elif case.way == "viewer_killed":
        viewers = [pid for pid in _children(process.pid, mark) if not _is_dispatcher(pid)]
        assert len(viewers) == 1, f"of {len(viewers)} viewers one is to be killed"
        _kill(viewers)
    elif case.way == "second_run":
        second = out.with_name("second")
        with _start(case, second, mark) as other:
            err = other.communicate(timeout=PATIENCE_S)[1]
        told = other.returncode == 2 and err.count("\n") == 1 and not second.exists()
        assert other.returncode == 0 or told, f"the second run: exit {other.returncode}: {err}"
    return segments


def _pause(terminal: Terminal | None) -> None:
    if terminal is not None:
        terminal.read()
    time.sleep(0.005)


def _children(parent: int, mark: str) -> list[int]:
    return [pid for pid in processes(mark) if _parent(pid) == parent]


def _is_dispatcher(pid: int) -> bool:
    return b"swarmer.engines.dispatcher" in _read(pid, "cmdline")


def _kill(pids: Iterable[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


# -- what is left ----------------------------------------------------------------------------------------------------


def _left_over(mark: str, segments: set[str], out: Path) -> str | None:
    deadline = time.monotonic() + CLEAN_WITHIN_S
    while left := processes(mark):
        if time.monotonic() > deadline:
            told = [_read(pid, "cmdline").replace(b"\0", b" ").decode(errors="replace")[:80] for pid in left]
            for pid in left:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            return f"{len(left)} processes are left: {told[:3]}"
        time.sleep(0.02)
    if kept := [name for name in segments if Path(name).exists()]:
        return f"shared memory is left: {kept}"
    if out.exists():
        from swarmer.observe.run_directory import hold, let_go

        let_go(hold(out))  # BadInput: locked
    return None


def _status(case: Case, code: int, err: str, out: Path) -> str | None:
    """Does the run say how it ended?"""
    if case.way in SIGNALS and not out.exists() and "Traceback" in err and "swarmer" not in err:
        return None  # Python itself was still being started
    if "Traceback" in err:
        return "a traceback for the user"
    summary = json.loads((out / "summary.json").read_text()) if (out / "summary.json").exists() else None
    status = summary and summary["status"]
    if case.way in SURVIVED:
        return _went_on(case, code, err, summary)
    numbers = ENDED_BY.get(case.way)
    if numbers is None:
        may = {0: "done", 1: "failed", 2: None}
        if code not in may:
            return "an exit status that is none of ours"
        if code == 1 and status is None and not err.strip():
            return "failed, and does not say why"
        if status != may[code] and not (status is None and code == 1):
            return f"the summary says {status}"
        return "failed without a reason" if status == "failed" and not summary["message"] else None
    if code == 0:
        return None if status == "done" else f"done, and the summary says {status}"
    if case.way == "kill":
        return None if summary is None else "killed, and there is a summary"
    if code == 130:
        return (
            None
            if status == "interrupted" or not out.exists()
            else f"interrupted, and the summary says {status}"
        )
    # Before it had begun anything a signal may simply end it.
    return None if -code in numbers and not out.exists() else "an exit status that is none of ours"


def _went_on(case: Case, code: int, err: str, summary: dict[str, Any] | None) -> str | None:
    if code != 0 or summary is None or summary["status"] != "done":
        return f"it should have gone on: {summary and summary['status']}"
    if case.viewer and err.count("live: the viewer is gone; the run goes on without it") != 1:
        return "it does not say that its viewer is gone"
    return "it heard the other run" if summary["rejected"] else None


def _files(out: Path) -> str | None:
    """Is every file whole that is there under its final name?"""
    for path in sorted(out.iterdir()) if out.exists() else ():
        if path.suffix == ".tmp":
            return f"{path.name} is left"
        try:
            READERS.get(path.name, lambda path: None)(path)
        except Exception as error:
            return f"{path.name} is not whole: {error!r}"
    return None


def _npz(path: Path) -> None:
    with np.load(path) as data:
        assert "hd_cells" in data
        assert all(data[name].size >= 0 for name in data)  # every array is read


def _events(path: Path) -> None:
    text = path.read_text()
    assert text.endswith("\n")
    assert all(len(row) == 4 for row in csv.reader(text.splitlines()))


READERS: dict[str, Callable[[Path], object]] = {
    "summary.json": lambda path: json.loads(path.read_text()),
    "manifest.json": lambda path: json.loads(path.read_text()),
    "config.yaml": lambda path: yaml.safe_load(path.read_text()),
    "timeline.npz": _npz, "events.csv": _events,
    "trace.jsonl.gz": lambda path: gzip.decompress(path.read_bytes()),
}  # fmt: skip


# -- processes -------------------------------------------------------------------------------------------------------


def processes(mark: str) -> list[int]:
    """Ids of the living processes that were started for one case, whoever their parent is by now."""
    wanted, names = f"{MARK}={mark}".encode(), [entry.name for entry in Path("/proc").iterdir()]
    return [
        int(name) for name in names if name.isdigit() and wanted in _read(int(name), "environ").split(b"\0")
    ]


def _read(pid: int, name: str) -> bytes:
    """Empty for who is gone, for a zombie, and for the processes of others."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError, PermissionError):
        return Path(f"/proc/{pid}/{name}").read_bytes()
    return b""


def _parent(pid: int) -> int:
    fields = _read(pid, "stat").rpartition(b")")[2].split()
    return int(fields[1]) if fields else 0


def segments_of(pid: int) -> set[str]:
    """Names of the shared memory, and of named semaphores, that a process has mapped."""
    return set(re.findall(r"(/dev/shm/\S+)", _read(pid, "maps").decode(errors="replace")))
