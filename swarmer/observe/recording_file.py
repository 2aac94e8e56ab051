"""A recording as a viewer reads it best: whole, compact, not newer than the viewer, and under a name that it takes.

While a run lives, its recording grows by many small pieces. A viewer takes them up some a frame, so that 20 s of a
dragon came in over a minute where software draws; put together they are there at once, and a quarter as large.
"""

from __future__ import annotations

import contextlib
import struct
import subprocess
import tempfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from swarmer.errors import BadInput
from swarmer.observe.viewer import rerun_command
from swarmer.observe.viewer_process import quiet_environment

MAGIC, KIND = b"RRF", b"2"  # the four bytes a recording begins with
FOOTER = b"FOOT"  # near the end of a whole one
TAIL_BYTES = 16
HEADER = struct.Struct(
    "<4s4B"
)  # magic and kind; then 0, and the version of rerun that wrote it, but in that order
WHERE = "recording"
EMPTY_BYTES = 200  # a recording of no message is smaller
COMPACTED_BYTES = 128 << 20  # some 7 MB are put together in a second
PATIENCE_S, TIMED_OUT = 120.0, 124


def check_format(path: Path) -> None:
    """Raise BadInput, with a line that says what to do, for what the installed viewer cannot read."""
    head = _bytes(path, 0, HEADER.size)
    if len(head) < HEADER.size or not head.startswith(MAGIC):
        raise BadInput(
            WHERE, str(path), "it is not a recording of rerun; `swarmer replay --terminal` needs none"
        )
    if head[3:4] != KIND:
        raise BadInput(
            WHERE,
            str(path),
            f"its format, {head[:4].decode('ascii', 'replace')}, is not the one that rerun {installed()} reads; "
            "`swarmer replay --terminal` needs no recording",
        )
    if (made := _version(head)) > tuple(map(int, installed().split(".")[:2])):
        version = ".".join(map(str, made))
        raise BadInput(
            WHERE,
            str(path),
            f"it was written by rerun {version}, and rerun {installed()} is installed: "
            f"pip install 'rerun-sdk>={version}', or `swarmer replay --terminal`",
        )


def _version(head: bytes) -> tuple[int, int]:
    """Major and minor of the rerun that wrote it.

    >>> _version(b"RRF2" + bytes([0, 41, 0, 0]))
    (0, 41)
    """
    _, major, minor, _, _ = HEADER.unpack(head)
    return major, minor


def installed() -> str:
    """The version of rerun here."""
    return metadata.version("rerun-sdk")


def is_whole(path: Path) -> bool:
    """True if the recording was closed by who wrote it: it has its footer."""
    return FOOTER in _bytes(path, max(0, path.stat().st_size - TAIL_BYTES), TAIL_BYTES)


def _bytes(path: Path, start: int, count: int) -> bytes:
    try:
        with path.open("rb") as file:
            file.seek(start)
            return file.read(count)
    except OSError as error:
        raise BadInput(WHERE, str(path), f"it cannot be read ({error.strerror})") from None


@contextlib.contextmanager
def readable(path: Path) -> Iterator[Path]:
    """What is whole of the recording, put together in a temporary place, for as long as the block lasts.

    Viewers refuse a recording without a footer, as a killed run leaves it; here it gets one. A whole recording of more
    than COMPACTED_BYTES is given as it is. Raises BadInput if nothing can be read.
    """
    check_format(path)
    whole = path.suffix == ".rrd" and is_whole(path)
    if whole and path.stat().st_size > COMPACTED_BYTES:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="swarmer-") as place:
        compact = Path(place) / "recording.rrd"
        status = _put_together(path, compact)
        if compact.exists() and compact.stat().st_size >= EMPTY_BYTES and not (whole and status):
            yield compact
        elif whole:
            yield path  # the viewer may make more of it
        else:
            reason = f" (rerun ended with status {status})" if status else ""
            raise BadInput(
                WHERE, str(path), f"nothing of it is whole{reason}; `swarmer replay --terminal` may show more"
            )


def _put_together(path: Path, compact: Path) -> int:
    """Every whole message, in few pieces, and a footer; the status of the program that does it."""
    source = compact.with_name("source.rrd")  # rerun goes by the ending
    source.symlink_to(path.resolve())
    command = [*rerun_command(), "rrd", "optimize", "--profile", "live", str(source), "-o", str(compact)]
    try:
        return subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, env=quiet_environment(),
            timeout=PATIENCE_S, check=False,
        ).returncode  # fmt: skip
    except subprocess.TimeoutExpired:
        compact.unlink(missing_ok=True)
        return TIMED_OUT
