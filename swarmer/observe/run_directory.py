"""The directory of one run: who may write there, what is in it, and that a file that is there is whole.

`--out` takes a directory that does not exist, is empty, or holds a run that did not finish and is not running: the
remains of that run are replaced. A finished run, a run in progress and any other content are refused. Without `--out`
the directory is always a new one, `runs/<shape>-<time>-<seed>`.
"""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import platform
import re
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import swarmer
from swarmer.engines.result import Event, HostRow, RoundRow
from swarmer.errors import BadInput, RunFailed
from swarmer.observe.files import PARTIAL, TEMPORARY, Stream, disk_errors, write_text

if TYPE_CHECKING:
    from swarmer.config import RunConfig

ROOT = Path("runs")
NAME_LENGTH = 60
CONFIG, MANIFEST, SUMMARY, EVENTS, LOG = (
    "config.yaml",
    "manifest.json",
    "summary.json",
    "events.csv",
    "log.txt",
)
RECORDING, TIMELINE, REPORT, TRACE = "recording.rrd", "timeline.npz", "report.html", "trace.jsonl.gz"
ROUNDS, HOSTS = "rounds.csv", "hosts.csv"
CAUSE = "cause.html"  # beside a report, if there is a trace
MANIFEST_FORMAT = 1
FILES = (CONFIG, MANIFEST, SUMMARY, EVENTS, LOG, RECORDING, TIMELINE, REPORT, TRACE, ROUNDS, HOSTS, CAUSE)
DISK_FULL = {errno.ENOSPC, errno.EDQUOT}
NOT_OURS = {errno.EACCES, errno.EPERM, errno.EROFS}  # where nobody, or not this user, may write
EVENT_COLUMNS = ("t_s", "kind", "fid", "text")
LIBRARIES = ("numpy", "scipy", "rerun-sdk", "pydantic", "click", "rich")


class RunDirectory:
    """An open run directory. Made by `create`; `close` ends every stream in it."""

    def __init__(self, path: Path, shape: str, seed: int, command: Sequence[str]) -> None:
        self.path = path
        self._lock = hold(path)
        self._manifest: dict[str, Any] = _manifest(shape, seed, command)
        self._streams: list[Stream] = []
        try:
            self._write_manifest()
            self._events = self.stream(EVENTS)
            self._log = self.stream(LOG)
            self._events.write(_csv_line(EVENT_COLUMNS))
        except BaseException:
            self._release()
            raise

    @classmethod
    def create(
        cls, out: Path | None, shape: str, seed: int, command: Sequence[str], root: Path = ROOT
    ) -> RunDirectory:
        """Make the directory, or take over the one named by `out`.

        shape: a catalogue name or a path, of which the stem is used. command: the argument vector.
        Raises BadInput where `out` may not be written, RunFailed where it cannot.
        """
        path = (
            _fresh(root, f"{safe_name(shape)}-{time.strftime('%Y%m%d-%H%M%S')}-{seed}")
            if out is None
            else out
        )
        if out is not None:
            _take(out)
        try:
            return cls(path, safe_name(shape), seed, command)
        except RunFailed as failure:
            if out is not None and getattr(failure.__cause__, "errno", None) in NOT_OURS:
                raise _no_directory(out, failure.__cause__) from None  # type: ignore[arg-type]
            raise

    def stream(self, name: str) -> Stream:
        """A new stream, closed with the directory. Raises RunFailed."""
        stream = Stream(self.path / name)
        self._streams.append(stream)
        return stream

    def write_config(self, config: RunConfig, points_sha256: str) -> None:
        """Write the resolved settings; the manifest gets those that are not the default, and the hash of the points.

        Raises RunFailed.
        """
        write_text(self.path / CONFIG, config.to_yaml())
        self._manifest["settings"] = config.unusual()
        self._manifest["points_sha256"] = points_sha256
        self._write_manifest()

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write summary.json, the mark of a finished run. Raises RunFailed, ValueError for NaN or infinity."""
        write_text(
            self.path / SUMMARY, json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
        )

    def write_rounds(self, rows: Sequence[RoundRow]) -> None:
        """Write rounds.csv, a line for each round; what was not read is empty. Raises RunFailed."""
        write_text(self.path / ROUNDS, b"".join(map(_csv_line, (RoundRow._fields, *rows))).decode())

    def write_hosts(self, rows: Sequence[HostRow]) -> None:
        """Write hosts.csv, a line for each host. Raises RunFailed."""
        write_text(self.path / HOSTS, b"".join(map(_csv_line, (HostRow._fields, *rows))).decode())

    def event(self, event: Event) -> None:
        """Append a line to events.csv. Raises RunFailed."""
        self._events.write(_csv_line((f"{event.t_s:.4f}", event.kind, event.fid, event.text)))

    def log(self, line: str) -> None:
        """Append a line to log.txt, with the wall clock's time. Raises RunFailed."""
        self._log.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {line}\n".encode())

    def close(self, status: str) -> None:
        """Close all streams and complete the manifest, as far as the disk allows. Raises the first RunFailed."""
        failures: list[RunFailed] = []
        endings: list[Callable[[], None]] = [stream.close for stream in self._streams]
        endings.append(partial(self._end_manifest, status))
        for end in endings:
            try:
                end()
            except RunFailed as failure:
                failures.append(failure)
        self._release()
        if failures:
            raise failures[0]

    def _release(self) -> None:
        let_go(self._lock)
        self._lock = None

    def _end_manifest(self, status: str) -> None:
        self._manifest.update(ended=_now(), status=status)
        self._write_manifest()

    def _write_manifest(self) -> None:
        write_text(self.path / MANIFEST, json.dumps(self._manifest, indent=2, ensure_ascii=False) + "\n")


def safe_name(shape: str) -> str:
    r"""A shape's name as part of a file name; of a path the stem.

    >>> safe_name("../clouds/my dragon.xyz"), safe_name("/"), safe_name("a\0b")
    ('my-dragon', 'shape', 'a-b')
    """
    name = shape.replace("\\", "/").rstrip("/").rpartition("/")[2]
    stem = Path(name).stem if name not in ("", ".", "..") else ""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.")[:NAME_LENGTH] or "shape"


def _fresh(root: Path, name: str) -> Path:
    """A directory that nobody had before."""
    with disk_errors(root / name):
        root.mkdir(parents=True, exist_ok=True)
        for number in range(1, 10_000):
            path = root / (name if number == 1 else f"{name}-{number}")
            try:
                path.mkdir()
            except FileExistsError:
                continue
            return path
    raise BadInput("out", str(root / name), "9999 runs of this name exist; choose another with --out")


def check_out(out: Path) -> list[Path]:
    """What an unfinished run left in `out`. Raises BadInput where `create` would, as far as one sees."""
    text = str(out)
    if not text.strip() or "\0" in text:
        raise BadInput("out", text, "the path of a directory that is new or empty")
    try:
        if out.is_symlink() and not out.exists():
            raise BadInput(
                "out", text, "it is a link to nothing; the path of a directory that is new or empty"
            )
        if not out.exists():
            above = next((path for path in out.parents if path.exists()), None)
            if above is not None and not above.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
            return []
    except (ValueError, OSError) as error:
        raise _no_directory(out, error) from None
    if not out.is_dir():
        raise BadInput("out", text, "it is a file; the path of a directory that is new or empty")
    try:
        names = {path.name for path in out.iterdir()}
    except OSError as error:
        raise _no_directory(out, error) from None
    if not os.access(out, os.W_OK | os.X_OK):
        raise _no_directory(out, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
    if SUMMARY in names:
        raise BadInput("out", str(out), "a finished run is there; choose another directory, or remove it")
    ours = {name + suffix for name in FILES for suffix in ("", PARTIAL, TEMPORARY)}
    if strange := sorted(names - ours):
        raise BadInput(
            "out", str(out), f"it holds other files ({strange[0]}); choose a new or empty directory"
        )
    if names:
        let_go(hold(out))
    return [out / name for name in names]


def _no_directory(out: Path, error: OSError | ValueError) -> BadInput:
    reason = getattr(error, "strerror", None) or str(error)
    return BadInput("out", str(out), f"the path of a directory that is new or empty ({reason})")


def _take(out: Path) -> None:
    """Make `out` an empty directory of ours; what an unfinished run left there goes. Raises BadInput, RunFailed."""
    remains = check_out(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        if getattr(error, "errno", None) in DISK_FULL:
            raise RunFailed(f"cannot make {out}: {error.strerror}") from None  # type: ignore[union-attr]
        raise _no_directory(out, error) from None
    lock = hold(out)
    try:
        with disk_errors(out):
            for path in remains:
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    finally:
        let_go(lock)


def let_go(lock: int | None) -> None:
    """Let another write there."""
    if lock is not None:
        os.close(lock)


def hold(path: Path) -> int | None:
    """Hold a directory as its one writer until `let_go`, or the end of this process. Raises BadInput if another does.

    None where nothing can be held: not a Unix, or a file system without locks.
    """
    try:
        import fcntl
    except ImportError:
        return None
    with disk_errors(path):
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(fd)
        raise BadInput("out", str(path), "another run is writing there; choose another directory") from None
    except OSError:
        os.close(fd)
        return None
    return fd


def _manifest(shape: str, seed: int, command: Sequence[str]) -> dict[str, Any]:
    return {
        "format": MANIFEST_FORMAT,
        "shape": shape,
        "seed": seed,
        "command": shlex.join(command),
        "started": _now(),
        "ended": None,
        "status": "running",
        "swarmer": swarmer.__version__,
        "python": sys.version.split()[0],
        "libraries": {name: _version(name) for name in LIBRARIES},
        "platform": platform.platform(),
        "cpus": os.cpu_count(),
    }


def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")


def _csv_line(cells: Sequence[object]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()
