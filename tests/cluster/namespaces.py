"""Hosts made of network namespaces: a bridge in one, in which the engine runs, and a veth to each of the others.

Their names carry this process's id, so tests may run side by side; whatever happens, `__exit__` leaves none, and no
process in one.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
from pathlib import Path


def why_not() -> str | None:
    """Why this machine makes no namespaces; None if it does."""
    if shutil.which("ip") is None or shutil.which("nsenter") is None:
        return "iproute2 or nsenter is missing"
    if os.geteuid() != 0:
        return "only root makes network namespaces"
    name = f"sw{os.getpid()}-try"
    done = ip("netns", "add", name, check=False)
    if done.returncode:
        return f"no privilege for network namespaces: {done.stderr.strip()}"
    ip("netns", "del", name, check=False)
    return None


def ip(*words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["ip", *words], check=check, capture_output=True, text=True, timeout=60)


class Namespaces:
    """`hosts` host namespaces a, b, c ... and one for the engine."""

    _made = 0

    def __init__(self, hosts: int, before: tuple[str, ...] = ()) -> None:
        """before: a command that the second host's programs are started by, besides."""
        Namespaces._made += 1
        self.prefix = f"sw{os.getpid()}n{Namespaces._made}"
        self.engine = f"{self.prefix}-engine"
        self.hosts = [f"{self.prefix}-{letter}" for letter in "abcdefgh"[:hosts]]

    def __enter__(self) -> Namespaces:
        try:
            self._make()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _make(self) -> None:
        ip("netns", "add", self.engine)
        self._in(self.engine, "link", "set", "lo", "up")
        self._in(self.engine, "link", "add", "bridge", "type", "bridge")
        self._in(self.engine, "addr", "add", "10.77.0.1/24", "dev", "bridge")
        self._in(self.engine, "link", "set", "bridge", "up")
        for number, host in enumerate(self.hosts, start=2):
            ip("netns", "add", host)
            self._in(host, "link", "set", "lo", "up")
            self._in(
                self.engine,
                "link",
                "add",
                f"to{number}",
                "type",
                "veth",
                "peer",
                "name",
                "eth",
                "netns",
                host,
            )
            self._in(self.engine, "link", "set", f"to{number}", "master", "bridge", "up")
            self._in(host, "addr", "add", f"10.77.0.{number}/24", "dev", "eth")
            self._in(host, "link", "set", "eth", "up")

    def __exit__(self, *_: object) -> None:
        for name in (self.engine, *self.hosts):
            self.kill(name)
            ip("netns", "del", name, check=False)

    def _in(self, name: str, *words: str) -> None:
        ip("-n", name, *words)

    def inside(self, name: str) -> list[str]:
        """What runs a command in a namespace."""
        return ["nsenter", f"--net=/run/netns/{name}", "--"]

    def pids(self, name: str) -> list[int]:
        """Processes in a namespace."""
        done = ip("netns", "pids", name, check=False)
        return [int(word) for word in done.stdout.split()]

    def kill(self, name: str) -> list[int]:
        """End all that runs there, as a machine that loses power does; their ids."""
        killed = []
        for pid in self.pids(name):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
        return killed

    def unplug(self, name: str) -> None:
        """Its cable is pulled: nothing gets in or out any more, and all in it goes on."""
        self._in(name, "link", "set", "eth", "down")

    def part(self, *names: str) -> None:
        """A firewall: these hosts reach the engine, and not each other."""
        for name in names:
            port = f"to{self.hosts.index(name) + 2}"
            self._in(self.engine, "link", "set", port, "type", "bridge_slave", "isolated", "on")

    def settings(self) -> list[str]:
        """For `swarmer-run`."""
        return [
            "--engine", "cluster", "--set", f"cluster.hosts={','.join(self.hosts)}", "--set",
            "cluster.launch=nsenter --net=/run/netns/{host} --", "--set", "cluster.listen=10.77.0.1",
        ]  # fmt: skip


def left(prefix: str) -> list[str]:
    """Namespaces of ours that are still there."""
    place = Path("/run/netns")
    return [path.name for path in place.iterdir() if path.name.startswith(prefix)] if place.is_dir() else []
