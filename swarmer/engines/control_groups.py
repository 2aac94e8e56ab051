"""What the control groups of this process grant: in a container or a batch job less than the machine has.

Both versions are read, and of nested groups the one that grants least. A group that sets no limit is none.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path("/sys/fs/cgroup")
MEMBERSHIP = Path("/proc/self/cgroup")
NO_LIMIT = 1 << 60  # the first version writes a large number where there is none


class Grant(NamedTuple):
    """A limit, and what of it is taken."""

    most: int
    used: int

    @property
    def left(self) -> int:
        """What may still be had."""
        return max(self.most - self.used, 0)


def cores() -> float | None:
    """Cores that may be busy in the mean; None without a limit."""
    return min(_cores(), default=None)


def memory() -> Grant | None:
    """Bytes; what the kernel can take back without harm is not counted as used. None without a limit."""
    return min(_memory(), key=lambda grant: grant.left, default=None)


def processes() -> Grant | None:
    """Processes and threads; None without a limit."""
    grants = (_grant(group, "pids.max", "pids.current") for group in _groups("pids"))
    return min((grant for grant in grants if grant), key=lambda grant: grant.left, default=None)


def _cores() -> Iterator[float]:
    for group in _groups("cpu"):
        words = (read_text(group / "cpu.max") or "").split()
        if len(words) == 2 and words[0] != "max":
            yield int(words[0]) / int(words[1])
        quota, period = read_number(group / "cpu.cfs_quota_us"), read_number(group / "cpu.cfs_period_us")
        if quota and period and quota > 0:
            yield quota / period


def _memory() -> Iterator[Grant]:
    for group in _groups("memory"):
        for most, used, cache in (
            ("memory.max", "memory.current", "inactive_file"),
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
        ):
            if grant := _grant(group, most, used):
                yield grant._replace(used=max(grant.used - _statistic(group / "memory.stat", cache), 0))


def _grant(group: Path, most: str, used: str) -> Grant | None:
    limit = read_number(group / most)
    return None if limit is None or limit >= NO_LIMIT else Grant(limit, read_number(group / used) or 0)


def _statistic(file: Path, name: str) -> int:
    for line in (read_text(file) or "").splitlines():
        key, _, value = line.partition(" ")
        if key == name:
            return int(value)
    return 0


def _groups(controller: str) -> list[Path]:
    """The directories that rule `controller` for this process, its own first, then those above it.

    A container sees its own group as the root, whatever the path says, so the root always counts.
    """
    found = []
    for line in (read_text(MEMBERSHIP) or "").splitlines():
        _, names, path = line.split(":", 2)
        if names == "" or controller in names.split(","):
            root = ROOT / controller if names else ROOT
            own = root / path.strip("/")
            found += [place for place in (own, *own.parents) if place.is_relative_to(root) and place.is_dir()]
    return found


def read_text(path: Path | str) -> str | None:
    """What is in a file of the kernel's; None if it is not there."""
    with contextlib.suppress(OSError, UnicodeError):
        return Path(path).read_text().strip()
    return None


def read_number(path: Path | str) -> int | None:
    """The one number in a file; None if it is not there or says `max`."""
    with contextlib.suppress(ValueError):
        return int(read_text(path) or "")
    return None
