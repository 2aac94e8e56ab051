"""Every byte a run directory gets goes through this file: whole under its final name, or not at all.

A finished file is written to a temporary name, synced and renamed. A stream grows as `NAME.partial`, readable at any
moment, and is renamed when it is closed. An OSError becomes RunFailed: one line that says what could not be written.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from swarmer.errors import RunFailed

PARTIAL = ".partial"
TEMPORARY = ".tmp"


def write_bytes(fd: int, data: bytes | memoryview) -> int:
    """The one place that writes; tests make it fail."""
    return os.write(fd, data)


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn an OSError while writing `path` into RunFailed."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or type(error).__name__
        kept = f"; what was finished is in {path.parent}" if path.parent.is_dir() else ""
        raise RunFailed(f"cannot write {path}: {reason}{kept}") from error


def _open_own(path: Path, flags: int) -> int:
    """Open a file of ours to write it. A link that lies in its place goes; what it leads to stays as it is."""
    flags |= os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0)
    try:
        return os.open(path, flags, 0o666)
    except OSError as error:
        if error.errno != errno.ELOOP or not path.is_symlink():
            raise
    path.unlink()
    return os.open(path, flags, 0o666)


class _Raw(io.RawIOBase):
    """A file descriptor whose writes all go through `write_bytes`."""

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def give_up(self) -> None:
        """Write nothing any more: what still holds this file must not reach whoever gets the descriptor next."""
        self._fd = -1

    def write(self, data: object) -> int:
        if self._fd < 0:
            return memoryview(data).nbytes  # type: ignore[arg-type]
        return write_bytes(self._fd, memoryview(data).cast("B"))  # type: ignore[arg-type]

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return os.lseek(self._fd, offset, whence) if self._fd >= 0 else 0

    def tell(self) -> int:
        return self.seek(0, os.SEEK_CUR)


def write_file(path: Path, fill: Callable[[BinaryIO], None], durable: bool = True) -> None:
    """Make the file `path` of what `fill` writes; nobody ever sees it half done. Raises RunFailed.

    durable: also wait until the disk has it.
    """
    temporary = path.with_name(path.name + TEMPORARY)
    with disk_errors(path):
        fd = _open_own(temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        try:
            raw = _Raw(fd)
            try:
                buffered = io.BufferedWriter(raw, 1 << 16)
                fill(buffered)
                buffered.flush()
            finally:
                raw.give_up()
            if durable:
                os.fsync(fd)
            temporary.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        finally:
            os.close(fd)
    if durable:
        sync_directory(path.parent)


def write_text(path: Path, text: str, durable: bool = True) -> None:
    """Make the file `path` of a text in UTF-8. Raises RunFailed."""
    data = text.encode()

    def fill(file: BinaryIO) -> None:
        file.write(data)

    write_file(path, fill, durable)


def sync_directory(path: Path) -> None:
    """Make the names in a directory durable, where the file system can."""
    with contextlib.suppress(OSError):
        fd = os.open(path, os.O_RDONLY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


class Stream:
    """A file that grows while the run lives: `NAME.partial` until `close` gives it its name."""

    def __init__(self, path: Path) -> None:
        """path: the final name. Raises RunFailed."""
        self.path = path
        self.partial = path.with_name(path.name + PARTIAL)
        with disk_errors(path):
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
            self._fd: int | None = _open_own(self.partial, flags)

    def write(self, data: bytes) -> None:
        """Append, at once visible to readers. Without effect once closed.

        Raises RunFailed; the stream is then abandoned, for what follows a gap is worth less than the gap shows.
        """
        if self._fd is None:
            return
        try:
            with disk_errors(self.path):
                view = memoryview(data)
                while view:
                    view = view[write_bytes(self._fd, view) :]
        except RunFailed:
            self.abandon()
            raise

    def close(self) -> None:
        """Sync and rename. A second call does nothing. Raises RunFailed."""
        if self._fd is None:
            return
        fd, self._fd = self._fd, None
        with disk_errors(self.path):
            try:
                os.fsync(fd)
            finally:
                os.close(fd)
            self.partial.replace(self.path)

    def abandon(self) -> None:
        """Stop writing and leave it partial: something in it is missing."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None
