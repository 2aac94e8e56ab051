"""A rerun that swarmer starts and ends: it tells its makers nothing, and does not outlive who started it."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys

PR_SET_PDEATHSIG = 1
END_S = 5.0  # how long a process may take to end before it is killed


def quiet_environment() -> dict[str, str]:
    """Of a rerun that sends no usage figures: it sends none where it takes itself to run in CI."""
    return {**os.environ, "CI": "true"}


def start(command: list[str], quiet: bool = True) -> subprocess.Popen[bytes]:
    """Start it, to be ended by `end`; it ends, too, when this process is killed. Raises OSError.

    quiet: without our input and output.
    """
    files = subprocess.DEVNULL if quiet else None
    return subprocess.Popen(
        command, stdin=files, stdout=files, stderr=files, env=quiet_environment(), preexec_fn=die_with_parent
    )


def die_with_parent() -> None:
    """In the child, before it becomes the program."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def end(process: subprocess.Popen[bytes]) -> None:
    """End it and wait until it is gone; one that does not listen is killed."""
    process.terminate()
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
