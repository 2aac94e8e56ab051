"""The page of `--live=web`: that of the replay, with a recording that grows while it is sent.

`python -m swarmer.observe.live_page SOCKET TITLE` serves on a socket that listens already, and reads on its standard
input what goes into the recording's file. The viewer takes a recording as it comes, so it is one answer that ends
with the run: nothing but this port is open, and the page may ask this server alone, as in the replay. What came is kept
in a temporary file without a name, for a browser that comes later or is slower. Ends with its input, by whatever
death the run dies; a browser that still reads the rest is waited for, no longer than GRACE_S.
"""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator

from swarmer.observe.replay_server import RRD, PageHandler, PageServer, page_files, viewer_files
from swarmer.observe.viewer import HOST

NOTE = "Live: the run goes on."
OVER = "The run is over. All that it showed is here until this page is closed."
GRACE_S = 10.0  # how long a browser may take for the rest
QUIET_S = 0.5  # a page that loads asks for the next thing within this time


class Growing:
    """Bytes that come from somewhere until they end, each to be read as often as wanted, from several threads."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  open as long as we are
        self._size, self._ended = 0, False
        self._turn = threading.Condition()

    def fill(self, fd: int) -> None:
        """Take all that comes from a file descriptor, until its end or a full disk."""
        try:
            while data := os.read(fd, 1 << 18):
                self._file.write(data)
                self._file.flush()
                with self._turn:
                    self._size += len(data)
                    self._turn.notify_all()
        finally:
            with self._turn:
                self._ended = True
                self._turn.notify_all()

    def read(self, start: int) -> bytes:
        """Some of what comes at `start`, as soon as there is any; nothing at the end."""
        with self._turn:
            self._turn.wait_for(lambda: self._size > start or self._ended)
            size = self._size
        return os.pread(self._file.fileno(), min(size - start, 1 << 18), start)


class LiveServer(PageServer):
    """Serves the page of a recording that grows."""

    def __init__(self, listening: socket.socket, recording: Growing) -> None:
        """On a socket that listens already."""
        super().__init__((HOST, 0), _LiveHandler, bind_and_activate=False)
        self.socket.close()
        self.socket, self.server_address = listening, listening.getsockname()
        self.recording = recording
        self._answering = 0
        self._answered_wall = time.monotonic()
        self._turn = threading.Lock()

    @contextlib.contextmanager
    def answering(self) -> Iterator[None]:
        """Around each answer."""
        with self._turn:
            self._answering += 1
        try:
            yield
        finally:
            with self._turn:
                self._answering -= 1
                self._answered_wall = time.monotonic()

    def wait_until_quiet(self) -> None:
        """Until nobody reads anything and nobody asks for more, or GRACE_S are over."""
        began = time.monotonic()
        while time.monotonic() < began + GRACE_S:
            with self._turn:
                quiet_since = max(began, self._answered_wall)
                if not self._answering and time.monotonic() > quiet_since + QUIET_S:
                    return
            time.sleep(0.05)


class _LiveHandler(PageHandler):
    server: LiveServer

    def answer(self, body: bool) -> None:
        with self.server.answering():
            super().answer(body)

    def send_recording(self, body: bool) -> None:
        self.head(RRD, None)
        sent = 0
        while body and (data := self.server.recording.read(sent)):
            self.wfile.write(data)
            sent += len(data)


def main() -> None:
    """Until the input ends."""
    listening, title = socket.socket(fileno=int(sys.argv[1])), sys.argv[2]
    recording = Growing()
    with LiveServer(listening, recording) as server:
        reader = threading.Thread(target=recording.fill, args=(0,), daemon=True)
        reader.start()
        server.files = {**page_files(title, NOTE, OVER), **viewer_files()}  # who asks meanwhile waits
        threading.Thread(target=server.serve_forever, daemon=True).start()
        reader.join()
        server.wait_until_quiet()
        server.shutdown()


if __name__ == "__main__":
    main()
