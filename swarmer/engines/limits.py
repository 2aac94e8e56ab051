"""What this machine allows: open files, processes, memory. Linux is the platform of the process engine."""

from __future__ import annotations

import contextlib
import os
import resource
import select
import socket
import sys
from pathlib import Path

from swarmer.engines import control_groups
from swarmer.errors import BadInput
from swarmer.udp_wrapper import LARGEST_FID

FILES_OWN = 64  # the engine's own open files
PROCESSES_OWN = 8
MEMORY_MB_PER_FLS = 4.5  # private to it some 3.4 to 4.25, and what the kernel keeps of a process


def check_limits(count: int) -> None:
    """Raise soft limits where they are too low for `count` FLSs.

    Raises BadInput (`points`) where a hard one is, or the system cannot run FLS processes at all.
    """
    if not sys.platform.startswith("linux"):
        raise BadInput("engine", "process", "it needs Linux; this system is " + sys.platform)
    if count > LARGEST_FID:
        raise BadInput(
            "points", count, f"at most {LARGEST_FID} FLSs have an address on the loopback interface"
        )
    _raise_soft(resource.RLIMIT_NPROC, count + PROCESSES_OWN, count, "processes", "ulimit -u")
    for path, name in (
        ("/proc/sys/kernel/threads-max", "kernel.threads-max"),
        ("/proc/sys/kernel/pid_max", "kernel.pid_max"),
    ):
        _check_kernel(path, name, count)
    granted = control_groups.processes()
    if granted is not None and granted.left < count + PROCESSES_OWN:
        raise BadInput(
            "points",
            count,
            f"the control group allows {granted.left} more processes, {count + PROCESSES_OWN} are needed; "
            "raise its pids.max (docker: --pids-limit)",
        )
    free = available_mb()
    if free is not None and count * MEMORY_MB_PER_FLS > free:
        raise BadInput(
            "points",
            count,
            f"at most {int(free / MEMORY_MB_PER_FLS)} FLSs fit into the {free:.0f} MB of free memory",
        )


def _raise_soft(limit: int, needed: int, count: int, what: str, how: str) -> None:
    soft, hard = resource.getrlimit(limit)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        with contextlib.suppress(ValueError, OSError):  # root may
            resource.setrlimit(limit, (needed, needed))
            return
        raise BadInput(
            "points",
            count,
            f"the hard limit on {what} is {hard}, {needed} are needed; raise it with `{how} {needed}`",
        )
    resource.setrlimit(limit, (needed, hard))


def _check_kernel(path: str, name: str, count: int) -> None:
    with contextlib.suppress(OSError, ValueError):
        allowed = int(Path(path).read_text())
        if allowed < count + 100:
            raise BadInput(
                "points", count, f"{name} is {allowed}; raise it with `sysctl {name}={count + 1000}`"
            )


def check_loop() -> None:
    """Raises OSError where an event loop finds no files: asyncio itself leaves half a loop then, and a traceback."""
    with contextlib.ExitStack() as files:
        files.enter_context(select.epoll())
        for end in socket.socketpair():
            files.enter_context(end)


def available_mb() -> float | None:
    """Memory that new processes can have, in MB, of the machine and of its control group; None if neither tells."""
    lines = (control_groups.read_text("/proc/meminfo") or "").splitlines()
    known = [int(line.split()[1]) / 1024 for line in lines if line.startswith("MemAvailable:")]
    if granted := control_groups.memory():
        known.append(granted.left / 2**20)
    return min(known, default=None)


def die_first() -> None:
    """Where memory ends the kernel ends this process rather than others, the engine and its results among them."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def children_of(pid: int) -> list[int]:
    """Process ids of the children of `pid`."""
    with contextlib.suppress(OSError):
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


def private_mb(pid: int) -> float | None:
    """Private memory of a process in MB; None if it is gone."""
    with contextlib.suppress(OSError, ValueError):
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        return sum(int(line.split()[1]) for line in lines if line.startswith("Private_")) / 1024
    return None


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0))
