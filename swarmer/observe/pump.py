"""What rerun writes, on its way to the disk and to a live viewer.

rerun writes from a thread of its own, which waits for ever on a full disk. So it writes into a pipe, and a thread here
carries the bytes on: a full disk becomes RunFailed like everywhere else, closing never hangs, and a viewer gets the
same bytes as the file without rerun knowing of it.
"""

from __future__ import annotations

import os
import select
import threading
import time
from typing import TYPE_CHECKING

from swarmer.errors import RunFailed

if TYPE_CHECKING:
    from swarmer.observe.files import Stream
    from swarmer.observe.live import LiveViewer

SILENCE_S = 0.5
VIEWER_S = 1.0  # how long what is on its way to a viewer may take


class Pump:
    """Carries what comes through `path` to a stream, a viewer, or both; after a failure it still drains the pipe."""

    def __init__(self, stream: Stream | None, viewer: LiveViewer | None = None) -> None:
        self._stream, self._viewer = stream, viewer
        self._failure: RunFailed | None = None
        self._ended, self._turn = threading.Event(), threading.Lock()
        self._reader, self._writer = os.pipe()
        self.path = f"/dev/fd/{self._writer}"
        self._thread = threading.Thread(target=self._carry, name="recording", daemon=True)

    def opened(self) -> None:
        """rerun has opened the pipe by its path: give up our end, and start."""
        os.close(self._writer)
        self._thread.start()

    def _carry(self) -> None:
        while self._wait():
            with self._turn:
                data = os.read(self._reader, 1 << 20)
                if self._viewer is not None:
                    self._viewer.feed(data)
                self._write(data)
            if not data:
                break
        os.close(self._reader)

    def _write(self, data: bytes) -> None:
        if self._stream is not None and self._failure is None:
            try:
                self._stream.write(data)
            except RunFailed as failure:
                self._failure = failure

    def _wait(self) -> bool:
        """True if there is something to read, be it the end; False if there will be nothing more.

        The end is the pipe's, or silence after rerun has ended: a child forked meanwhile may hold the pipe open.
        """
        while not select.select([self._reader], [], [], SILENCE_S)[0]:
            if self._ended.is_set():
                return False
        return True

    def let_viewer_go(self) -> None:
        """What is written from now on is for the file alone; the viewer gets all that rerun has flushed before."""
        until = time.monotonic() + VIEWER_S
        while time.monotonic() < until and select.select([self._reader], [], [], 0)[0]:
            time.sleep(0.001)
        with self._turn:  # what has been read is carried
            self._viewer = None

    def check(self) -> None:
        """Raises RunFailed if the disk has refused something."""
        if self._failure is not None:
            raise self._failure

    def finish(self, timeout_s: float, ended: bool) -> None:
        """Wait until all is carried. ended: rerun has written all. Raises RunFailed if the file is not whole."""
        if ended:
            self._ended.set()
            self._thread.join(timeout_s)
        if self._thread.is_alive() and self._failure is None:
            self._failure = RunFailed("the recorder did not end; the recording stays partial")
        if self._failure is not None:
            if self._stream is not None:
                self._stream.abandon()
            raise self._failure
