"""A rerun viewer that is fed while a run lives. It may be slow, stuck or killed: the run does not notice.

It reads on its standard input what goes into the recording's file, through a thread and a bounded queue: nothing that a
viewer does reaches the thread that observes the run, and rerun itself never waits for one.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections import deque

from swarmer.errors import BadInput, RunFailed
from swarmer.observe.viewer import (
    GRPC_PORT,
    HOST,
    STDIN,
    WEB_PORT,
    display_available,
    free_port,
    native_command,
    serves_viewers,
)
from swarmer.observe.viewer_process import quiet_environment

WAYS = ("auto", "desktop", "web")
HELD_MAX = 128 << 20  # bytes that may wait for a viewer
CLOSE_S = 2.0  # how long the end of a run waits for a viewer to read the rest
FORWARD_GRACE_S = 5.0  # how long a viewer that was there may take for the rest after that

_left_open: list[subprocess.Popen[bytes]] = []  # desktop viewers: the user closes them


def check_way(way: str) -> str:
    """`way` as `open_viewer` takes it. Raises BadInput."""
    if way in WAYS or (way.isdecimal() and 1 <= int(way) <= 65535):
        return way
    raise BadInput(
        "live", way, f"one of {', '.join(WAYS)}, or the port of a viewer on this machine, 1 to 65535"
    )


def open_viewer(way: str, title: str) -> LiveViewer:
    """Start a viewer, or find one: auto is the one that is there, else the desktop's, else a page.

    title: any text, what the page is called. Raises RunFailed, in one line, where there is none to be had.
    """
    if way == "auto":
        if serves_viewers(GRPC_PORT):
            return _there(GRPC_PORT)
        way = "desktop" if display_available() else "web"
    try:
        if way == "desktop":
            return _desktop()
        return _page(title) if way == "web" else _there(int(way))
    except OSError as error:
        raise RunFailed(f"the live viewer did not start: {error}") from None


def _there(port: int) -> LiveViewer:
    if not serves_viewers(port):
        raise RunFailed(f"no viewer listens at {HOST}:{port}")
    return LiveViewer(
        _kept(FORWARD_GRACE_S, native_command((STDIN,), port)), [f"live: in the viewer at {HOST}:{port}"]
    )


def _desktop() -> LiveViewer:
    if not display_available():
        raise RunFailed("no display for a viewer; --live=web makes a page of it")
    return LiveViewer(native_command((STDIN,), free_port()), ["live: rerun's viewer opens"], stays=True)


def _page(title: str) -> LiveViewer:
    with _listening() as page:
        port, host = page.getsockname()[1], socket.gethostname()
        command = [sys.executable, "-m", "swarmer.observe.live_page", str(page.fileno()), title]
        lines = [
            f"live: http://{HOST}:{port}/ until the run ends",
            f"live: from another machine, ssh -L {port}:{HOST}:{port} {host} and the same address there",
        ]
        return LiveViewer(command, lines, page=page)


def _listening() -> socket.socket:
    """On the usual port of a page, or any that is free. Raises OSError."""
    try:
        return socket.create_server((HOST, WEB_PORT))
    except OSError:
        return socket.create_server((HOST, 0))


def _kept(grace_s: float, command: list[str]) -> list[str]:
    """The command, ended some seconds after its input, however the run ends."""
    return [sys.executable, "-m", "swarmer.observe.live_keeper", str(grace_s), *command]


class LiveViewer:
    """A process that is given bytes, as long as it takes them."""

    def __init__(
        self, command: list[str], lines: list[str], stays: bool = False, page: socket.socket | None = None
    ) -> None:
        """lines: what the user should know of it. stays: it outlives the run. Raises OSError.

        page: where it is to listen; the process has it under the same number, and ours may be closed.
        """
        self._lines = list(lines)
        self._queue: deque[bytes] = deque()
        self._held = 0
        self._closing = self._gone = False
        self._stays = stays
        self._turn = threading.Condition()
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=() if page is None else (page.fileno(),),
            start_new_session=True,  # a terminal's Ctrl-C ends the run, not what one looks at
            env={**quiet_environment(), "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        )
        if stays:
            _left_open.append(self._process)
        self._thread = threading.Thread(target=self._carry, name="live viewer", daemon=True)
        self._thread.start()

    def feed(self, data: bytes) -> None:
        """Leave some bytes to be read. Returns at once."""
        with self._turn:
            if self._gone:
                return
            self._queue.append(data)
            self._held += len(data)
            if self._held > HELD_MAX:
                self._lose("does not keep up")
            self._turn.notify()

    def _carry(self) -> None:
        assert self._process.stdin is not None
        fd = self._process.stdin.fileno()
        while data := self._next():
            try:
                while data:
                    data = data[os.write(fd, data) :]
            except OSError:
                with self._turn:
                    self._lose("is gone")
                return
        self._process.stdin.close()

    def _next(self) -> bytes:
        """What comes next; nothing at the end."""
        with self._turn:
            while not (self._queue or self._closing or self._gone):
                self._turn.wait()
            if self._gone or not self._queue:
                return b""
            data = self._queue.popleft()
            self._held -= len(data)
            return data

    def _lose(self, how: str) -> None:
        self._gone = True
        self._queue.clear()
        instead = "; --live=web makes a page" if self._stays else ""
        self._lines.append(f"live: the viewer {how}; the run goes on without it{instead}")

    def news(self) -> list[str]:
        """Lines for the user that were not taken yet."""
        lines, self._lines = self._lines, []
        return lines

    def close(self) -> None:
        """There is nothing more to come. Waits a little for the rest to be read."""
        with self._turn:
            self._closing = True
            self._turn.notify()
        self._thread.join(CLOSE_S)
        status = self._process.poll()
        if self._stays and status is not None and not self._gone:  # it read all, and then could not show it
            self._lines.append(f"live: the viewer has ended with status {status}; --live=web makes a page")
