"""Starting rerun's viewer: its command, free ports, is there a display. All of it stays on this machine.

The viewer and its server listen on every interface unless told otherwise, so each start here says 127.0.0.1.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

from swarmer.errors import RunFailed

HOST = "127.0.0.1"
GRPC_PORT = 9876
WEB_PORT = 9090
THREADS_MIN = 4
STDIN = Path("-")  # in place of a file: what comes on the standard input
HTTP2_GREETING, HTTP2_SETTINGS = (
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    bytes((0, 0, 0, 4, 0, 0, 0, 0, 0)),
)  # RFC 9113
SETTINGS_AT = 3  # of a frame: its type


def rerun_command() -> list[str]:
    """How to start rerun: the program in its package, else what the shell finds, else the module.

    The script that its package installs starts that program as a child, which outlives the script when that is ended.
    """
    package = importlib.util.find_spec("rerun_cli")
    if package is not None and package.origin is not None:
        program = Path(package.origin).with_name("rerun")
        if program.exists():
            return [str(program)]
    found = shutil.which("rerun")
    return [found] if found else [sys.executable, "-m", "rerun"]


def native_command(files: Sequence[Path], port: int) -> list[str]:
    """The desktop viewer, listening on `port`, showing `files`; in one that listens there already, if there is one.

    Reading the standard input takes one of its threads until the end, and without another no window opens so long. Of
    itself it has two fewer than there are cores, and at least one.
    """
    threads = max(THREADS_MIN, (os.cpu_count() or 1) - 2)
    return [
        *rerun_command(),
        "--bind",
        HOST,
        "--port",
        str(port),
        "--threads",
        str(threads),
        *map(str, files),
    ]


def serves_viewers(port: int, wait_s: float = 1.0) -> bool:
    """True if what listens on the port speaks rerun's kind of protocol: it greets over HTTP/2 without being upgraded.

    Other programs may have that port; most answer such a greeting by an error, or not at all.
    """
    with socket.socket() as probe:
        probe.settimeout(wait_s)
        try:
            probe.connect((HOST, port))
            probe.sendall(HTTP2_GREETING + HTTP2_SETTINGS)
            answer = probe.recv(len(HTTP2_SETTINGS))
        except OSError:
            return False
    return len(answer) > SETTINGS_AT and answer[SETTINGS_AT] == HTTP2_SETTINGS[SETTINGS_AT]


def display_available() -> bool:
    """True if a window can be opened, as far as the environment tells."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_port(first: int = GRPC_PORT) -> int:
    """`first` if it is free on this machine, else any free port. Raises RunFailed if there is none."""
    for port in (first, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise RunFailed(f"no free TCP port on {HOST}")
