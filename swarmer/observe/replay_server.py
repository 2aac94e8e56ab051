"""The page of `swarmer replay --web`: rerun's viewer, the recording, and nothing that is not on this machine.

`live_page` serves the same page with a recording that still grows.

rerun's own page asks for a web font, and its viewer tells its makers that it was used and looks for a newer version.
So the page here is ours, which loads that viewer from the program in the installed package, and forbids the browser to
ask anybody but this server, which listens on 127.0.0.1 alone. Everything comes from one port: over ssh one is carried.
"""

from __future__ import annotations

import errno
import http.client
import shutil
import string
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

from swarmer.errors import BadInput, RunFailed
from swarmer.observe.viewer import HOST, WEB_PORT, free_port, rerun_command
from swarmer.observe.viewer_process import end, start

NAMES_OF_HERE = (HOST, "localhost")
PAGE = "replay_page"  # the folder beside this file
VIEWER = ("re_viewer.js", "re_viewer_bg.wasm")  # what the program in the package serves
RECORDING, RRD = "recording.rrd", "application/octet-stream"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".css": "text/css",
    ".wasm": "application/wasm",
}
START_S = 30.0
TRIES = 3
# The page may load and ask what this server has, and nothing else; wasm is compiled, nothing is evaluated.
POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


def page_files(title: str, note: str, over: str = "") -> dict[str, bytes]:
    """The files of our page by name; the texts are any text, and shown as text.

    over: stands in the place of the note once the recording has ended; nothing: the note stays.
    """
    files = {file.name: file.read_bytes() for file in resources.files(__package__).joinpath(PAGE).iterdir()}
    page = string.Template(files["index.html"].decode())
    files["index.html"] = page.substitute(title=escape(title), note=escape(note), over=escape(over)).encode()
    return files


def viewer_files() -> dict[str, bytes]:
    """The web viewer out of the program in the installed package. Raises RunFailed."""
    for _ in range(TRIES):
        with _rerun_serving() as (server, port):
            if _comes_up(server, port):
                return {name: _get(port, name) for name in VIEWER}
    raise RunFailed("rerun did not give its web viewer; `swarmer replay --terminal` needs nothing of it")


@contextmanager
def _rerun_serving() -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """rerun's own server for as long as the block lasts; with an address to show it opens no port but the page's."""
    port = free_port(0)
    command = [*rerun_command(), "--serve-web", "--bind", HOST, "--web-viewer-port", str(port)]
    server = start([*command, f"http://{HOST}:{port}/{RECORDING}"])
    try:
        yield server, port
    finally:
        end(server)


def _comes_up(server: subprocess.Popen[bytes], port: int) -> bool:
    """True as soon as it answers; False if it ends, as it does when another took the port meanwhile."""
    until = time.monotonic() + START_S
    while time.monotonic() < until and server.poll() is None:
        try:
            _get(port, VIEWER[0])
        except (OSError, RunFailed, http.client.HTTPException):
            time.sleep(0.05)
        else:
            return server.poll() is None
    return False


def _get(port: int, name: str) -> bytes:
    connection = http.client.HTTPConnection(HOST, port, timeout=START_S)
    try:
        connection.request("GET", f"/{name}")
        answer = connection.getresponse()
        if answer.status != http.client.OK:
            raise RunFailed(f"rerun's web viewer has no {name}: another version than this swarmer knows?")
        return answer.read()
    finally:
        connection.close()


class PageServer(ThreadingHTTPServer):
    """Serves the page until it is closed: `files` by name, and a recording as its handler sends it."""

    daemon_threads = True
    files: Mapping[str, bytes] = {}

    @property
    def address(self) -> str:
        """What to open."""
        return f"http://{HOST}:{self.server_address[1]}/"

    def handle_error(self, *_: Any) -> None:
        """A browser that goes away in the middle of an answer is no error."""


class PageHandler(BaseHTTPRequestHandler):
    """Answers this machine alone."""

    server: PageServer

    def do_GET(self) -> None:
        self.answer(body=True)

    def do_HEAD(self) -> None:
        self.answer(body=False)

    def answer(self, body: bool) -> None:
        """A file by its name. A name that is not of this machine stands for a foreign page that rebound its own."""
        if (self.headers.get("Host") or "").rpartition(":")[0] not in NAMES_OF_HERE:
            self.send_error(http.client.FORBIDDEN)
            return
        name = self.path.partition("?")[0].removeprefix("/") or "index.html"
        if name == RECORDING:
            self.send_recording(body)
        elif name in self.server.files:
            data = self.server.files[name]
            self.head(TYPES[Path(name).suffix], len(data))
            if body:
                self.wfile.write(data)
        else:
            self.send_error(http.client.NOT_FOUND)

    def send_recording(self, body: bool) -> None:
        """The answer whose name is RECORDING; only its head without `body`."""
        raise NotImplementedError

    def head(self, kind: str, length: int | None) -> None:
        """length: None if it ends with the connection."""
        self.send_response(http.client.OK)
        sizes = {} if length is None else {"Content-Length": str(length)}
        for name, value in {"Content-Type": kind, **sizes, **HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Nothing: the terminal is the user's."""


class ReplayServer(PageServer):
    """Serves the page of a recording that lies in a file."""

    def __init__(self, recording: Path, port: int) -> None:
        """port: 0 takes any free one. Raises OSError if the port is taken. Then give it `files`, by name."""
        self.recording = recording
        super().__init__((HOST, port), _ReplayHandler)


class _ReplayHandler(PageHandler):
    server: ReplayServer

    def send_recording(self, body: bool) -> None:
        try:
            with self.server.recording.open("rb") as file:
                self.head(RRD, self.server.recording.stat().st_size)
                if body:
                    shutil.copyfileobj(file, self.wfile, 1 << 18)
        except FileNotFoundError:
            self.send_error(http.client.NOT_FOUND)


def bound_server(recording: Path, port: int | None) -> ReplayServer:
    """A server on `port`; None: on the usual one or any that is free. Raises BadInput if `port` cannot be had."""
    for wanted in (WEB_PORT, 0) if port is None else (port,):
        try:
            return ReplayServer(recording, wanted)
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
            reason = error.strerror
    raise BadInput("port", port, f"a free port of {HOST} ({reason}); without --port one is found")
