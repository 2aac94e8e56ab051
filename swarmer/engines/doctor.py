"""What this machine allows a run to have: limits, buffers, and the kernel's services, each tried where it can be.

Nothing here changes the machine. Every look is a `Check`: what was found, whether it is enough, and what to do.
"""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import NamedTuple

from swarmer.engines import control_groups
from swarmer.engines.control_groups import read_number, read_text

DRAGON = 760  # FLSs; below what they need no run of it is possible
MANY = 2000  # FLSs; below what they need there is a warning
OK, WARN, FAIL, INFO = "ok", "warn", "fail", ""
ALWAYS = 100  # what else runs on a machine, in processes


class Check(NamedTuple):
    """One thing that was looked at."""

    name: str
    found: str
    mark: str  # ok | warn | fail, or nothing where it only informs
    advice: str = ""  # what to do, as a command where there is one


def all_checks() -> list[Check]:
    """Everything, in the order one reads it. Linux only."""
    from swarmer.engines import kernel_services

    return [
        system(), cores(), load(), memory(), processes(), open_files(), machine_files(),
        kernel_number("kernel.threads-max", MANY, DRAGON), kernel_number("kernel.pid_max", MANY, DRAGON),
        container_processes(), *kernel_services.checks(), other_hosts(),
    ]  # fmt: skip


def other_hosts() -> Check:
    """What there is to reach other hosts with, for the engine cluster and for sweeps on Ray."""
    ways = ["ssh"] if shutil.which("ssh") else []
    with contextlib.suppress(PackageNotFoundError):
        ways.append(f"Ray {version('ray')}")
    if not ways:
        return Check("ways to other hosts", "none", INFO, "install ssh, or: pip install 'swarmer[cluster]'")
    return Check("ways to other hosts", ", ".join(ways), INFO)


def is_linux() -> bool:
    return sys.platform.startswith("linux")


def possible_engines() -> list[str]:
    """The engines of this version that run on this system."""
    from swarmer.config import setting_facts

    engines = next(fact.words for fact in setting_facts() if fact.name == "engine")
    return [str(name) for name in engines if is_linux() or name not in ("process", "cluster")]


def verdict(
    found: int | None, name: str, advice: str, needs: tuple[int, int] = (MANY, DRAGON), text: str = ""
) -> Check:
    """A number against what 2000 FLSs, and what the dragon, need; None is no limit."""
    shown = text or ("no limit" if found is None else str(found))
    if found is None or found >= needs[0]:
        return Check(name, shown, OK)
    return Check(name, shown, WARN if found >= needs[1] else FAIL, advice)


def system() -> Check:
    return Check(
        "system", f"{platform.system()} {platform.release()}, Python {platform.python_version()}", INFO
    )


def cores() -> Check:
    """Cores this process may use, and the share of them that a container grants."""
    allowed, all_of_them = len(os.sched_getaffinity(0)), os.cpu_count() or 1
    share = control_groups.cores()
    found = f"{allowed} of {all_of_them}" if allowed < all_of_them else str(allowed)
    if share is not None and share < allowed:
        return Check(
            "cores",
            f"{found}, of which the container may use {share:g}",
            WARN,
            "give the container more CPU (docker: --cpus)",
        )
    return Check("cores", found, INFO)


def load() -> Check:
    """What else runs: it takes part in whatever is measured."""
    return Check("load now", " ".join(f"{value:.1f}" for value in os.getloadavg()), INFO)


def memory() -> Check:
    from swarmer.engines.limits import MEMORY_MB_PER_FLS as EACH
    from swarmer.engines.limits import available_mb

    free = available_mb()
    if free is None:
        return Check("free memory", "the system does not tell", INFO)
    return verdict(
        int(free / EACH), "free memory", f"2000 FLSs are given {MANY * EACH:.0f} MB; close something, or add memory",
        text=f"{free:.0f} MB, for {int(free / EACH)} FLSs",
    )  # fmt: skip


def processes() -> Check:
    """RLIMIT_NPROC: a run raises the soft limit by itself, up to the hard one."""
    import resource

    from swarmer.engines.limits import PROCESSES_OWN

    soft, hard = (none_if_infinite(limit) for limit in resource.getrlimit(resource.RLIMIT_NPROC))
    text = f"soft {shown(soft)}, hard {shown(hard)}"
    return verdict(
        hard, "processes", f"ulimit -Hu {MANY + ALWAYS}   (as root; for good: nproc in /etc/security/limits.conf)",
        (MANY + PROCESSES_OWN, DRAGON + PROCESSES_OWN), text,
    )  # fmt: skip


def open_files() -> Check:
    """RLIMIT_NOFILE: an FLS needs few; the engine some more."""
    import resource

    from swarmer.engines.limits import FILES_OWN

    soft, hard = (none_if_infinite(limit) for limit in resource.getrlimit(resource.RLIMIT_NOFILE))
    advice = f"ulimit -Hn {4 * FILES_OWN}   (as root)"
    return verdict(
        hard, "open files", advice, (FILES_OWN, FILES_OWN), f"soft {shown(soft)}, hard {shown(hard)}"
    )


def machine_files() -> Check:
    """fs.file-max: each FLS opens some eight files, its two sockets among them."""
    words = (read_text("/proc/sys/fs/file-nr") or "").split()
    if len(words) != 3:
        return Check("open files of all", "the system does not tell", INFO)
    free = int(words[2]) - int(words[0])
    advice = f"sudo sysctl -w fs.file-max={int(words[0]) + 8 * (MANY + ALWAYS)}"
    text = f"{free} more" if free < 10**9 else "no limit"
    return verdict(free, "open files of all", advice, (8 * MANY, 8 * DRAGON), text)


def kernel_number(name: str, many: int, few: int) -> Check:
    """A number of /proc/sys that must leave room for that many processes."""
    found = read_number("/proc/sys/" + name.replace(".", "/"))
    if found is None:
        return Check(name, "the system does not tell", INFO)
    return verdict(found, name, f"sudo sysctl -w {name}={2 * (many + ALWAYS)}", (many + ALWAYS, few + ALWAYS))


def container_processes() -> Check:
    """The control group's limit of processes, which is what binds in a container."""
    grant = control_groups.processes()
    if grant is None:
        return Check("pids of the control group", "no limit", OK)
    return verdict(
        grant.left, "pids of the control group",
        f"systemctl set-property --runtime user-$(id -u).slice TasksMax={MANY + 1000}   (docker: --pids-limit)",
        text=f"{grant.left} of {grant.most} left",
    )  # fmt: skip


def none_if_infinite(limit: int) -> int | None:
    return None if limit < 0 else limit


def shown(limit: int | None) -> str:
    return "no limit" if limit is None else str(limit)
