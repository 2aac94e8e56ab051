"""Runs a command, hands it what comes on the standard input, and ends it some seconds after that has ended.

`python -m swarmer.observe.live_keeper SECONDS COMMAND ...`: a server that knows no end of its own so ends with the run
that feeds it, by whatever death that dies; and with this process, if that is what is killed.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys

from swarmer.observe.viewer_process import die_with_parent


def main() -> None:
    grace_s, command = float(sys.argv[1]), sys.argv[2:]
    with subprocess.Popen(command, stdin=subprocess.PIPE, preexec_fn=die_with_parent) as child:
        assert child.stdin is not None
        with contextlib.suppress(OSError):  # it is gone
            while data := os.read(0, 1 << 16):
                while data:
                    data = data[os.write(child.stdin.fileno(), data) :]
        with contextlib.suppress(OSError):
            child.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(grace_s)
        child.kill()


if __name__ == "__main__":
    main()
