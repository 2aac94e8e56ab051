"""A recording as a viewer can read it: whole, not newer than the viewer, and under a name that it takes."""

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
EMPTY_BYTES = 200  # a mended recording of no message is smaller
MENDING_S = 120.0


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
    """The recording, or in a temporary place what is whole of it, for as long as the block lasts.

    Viewers refuse a recording without a footer, as a killed run leaves it. Raises BadInput if nothing can be read.
    """
    check_format(path)
    if path.suffix == ".rrd" and is_whole(path):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="swarmer-") as place:
        yield _mended(path, Path(place) / "recording.rrd")


def _mended(path: Path, mended: Path) -> Path:
    """Every whole message of a cut recording, and a footer."""
    source = mended.with_name("cut.rrd")  # rerun goes by the ending
    source.symlink_to(path.resolve())
    done = subprocess.run(
        [*rerun_command(), "rrd", "filter", str(source), "-o", str(mended)],
        stdin=subprocess.DEVNULL, capture_output=True, env=quiet_environment(), timeout=MENDING_S, check=False,
    )  # fmt: skip
    if not mended.exists() or mended.stat().st_size < EMPTY_BYTES:
        reason = f" (rerun ended with status {done.returncode})" if done.returncode else ""
        raise BadInput(
            WHERE, str(path), f"nothing of it is whole{reason}; `swarmer replay --terminal` may show more"
        )
    return mended
