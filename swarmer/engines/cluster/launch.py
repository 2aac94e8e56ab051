"""How host agents are started: by a command for each host (ssh, a network namespace, nothing), or by Ray (`on_ray`).

Either way the agent is `python -m swarmer.engines.cluster.agent`, gets its orders as one line on stdin, ends when stdin
does, and says on stderr what went wrong before it could say so to the engine.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import socket
import subprocess
import sys
import threading
from collections import Counter, deque
from typing import Protocol

from swarmer.config_groups import Cluster
from swarmer.errors import BadInput

AGENT = "swarmer.engines.cluster.agent"
HERE = "localhost"
WORDS_MAX = 20  # lines of stderr that are kept
WORDS_TOLD = 3


class Launched(Protocol):
    """An agent that was started."""

    def ended(self) -> bool:
        """Whether it has, as far as is known."""

    def last_words(self) -> str:
        """What it said last on stderr; empty if nothing."""

    def end(self) -> None:
        """End it, at once."""


class Launcher(Protocol):
    """A way to start agents."""

    setting: str  # that the hosts come from
    names: list[str]  # of the hosts, each once
    patience_s: float  # wall: for an agent to call

    def address(self) -> str:
        """This machine's, as the hosts reach it. Raises BadInput."""

    def start(self, name: str, orders: bytes) -> Launched:
        """Start the agent of a host. Raises BadInput."""

    def close(self) -> None:
        """Whatever was started is over."""


class Commands:
    """A command for each host: `cluster.launch`, with the host's name in it."""

    setting = "cluster.hosts"
    patience_s = 30.0

    def __init__(self, cluster: Cluster) -> None:
        """Raises BadInput for hosts that are none."""
        assert cluster.hosts is not None
        self._cluster = cluster
        self._hosts = [host.strip() for host in cluster.hosts.split(",")]
        if not all(self._hosts) or any(host.startswith("-") for host in self._hosts):
            raise BadInput("cluster.hosts", cluster.hosts, "names with commas between, as a,b,c")
        often, seen = Counter(self._hosts), Counter[str]()
        self.names = []
        for host in self._hosts:
            seen[host] += 1
            self.names.append(host if often[host] == 1 else f"{host}-{seen[host]}")

    def address(self) -> str:
        """As `cluster.listen` says; else the one from which the first host is reached."""
        if self._cluster.listen is not None:
            return self._cluster.listen
        other = next((host for host in self._hosts if host != HERE), None)
        if other is None:
            return "127.0.0.1"
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.connect((other.rpartition("@")[2], 9))  # nothing is sent
            return str(sock.getsockname()[0])
        raise BadInput.saying(
            f"cluster.hosts: {other} is no name on this network, nor an IPv4 address; where only cluster.launch knows "
            "it, as ~/.ssh/config does, give cluster.listen the IPv4 address at which hosts reach this machine"
        )

    def start(self, name: str, orders: bytes) -> Launched:
        """As the command says; `localhost` needs none."""
        host = self._hosts[self.names.index(name)]
        program = [self._cluster.python or sys.executable, "-m", AGENT]
        if host != HERE or self._cluster.launch != Cluster().launch:
            before = [part.replace("{host}", host) for part in shlex.split(self._cluster.launch)]
            program = [*before, *program]
        try:
            return Program(program, orders)
        except OSError as error:
            setting = "cluster.python" if program[0] == self._cluster.python else "cluster.launch"
            raise BadInput.saying(f"{setting}: {program[0]}: {error.strerror}") from None

    def close(self) -> None:
        """Nothing is left: every agent was ended by itself."""


class Program:
    """An agent as a child of this process, or what leads to it."""

    def __init__(self, command: list[str], orders: bytes) -> None:
        """Raises OSError if there is no such command."""
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,  # a terminal's Ctrl-C reaches only the engine
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        )
        self._words: deque[str] = deque(maxlen=WORDS_MAX)
        self._reader = threading.Thread(target=self._read, daemon=True, name="agent's stderr")
        self._reader.start()
        with contextlib.suppress(OSError):
            assert self._process.stdin is not None
            self._process.stdin.write(orders + b"\n")
            self._process.stdin.flush()

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if text := line.decode(errors="replace").strip():
                self._words.append(text)

    def ended(self) -> bool:
        """Whether the command has."""
        return self._process.poll() is not None

    def last_words(self) -> str:
        """The last lines of its stderr: a shell or ssh may add one to that which says why."""
        if self.ended():
            self._reader.join(1.0)
        return "; ".join(list(self._words)[-WORDS_TOLD:])

    def end(self) -> None:
        """Close its stdin, then kill it."""
        with contextlib.suppress(OSError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(2.0)
        self._process.kill()
        self._process.wait()
        self._reader.join(1.0)


def make_launcher(cluster: Cluster) -> Launcher:
    """By commands if hosts are named, else Ray. Raises BadInput."""
    if cluster.hosts is not None:
        return Commands(cluster)
    from swarmer.engines.cluster.on_ray import RayNodes

    return RayNodes(cluster)
