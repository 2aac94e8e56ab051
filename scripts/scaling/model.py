"""From what one formation takes on the air to how many hosts carry it.

Costs are measured, each by a command that stands beside it, on one core of the machine of `docs/time.md`; what a host
is, is an assumption.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

Measured = dict[str, Any]  # of one formation, as `measure` gives it


class Cost(NamedTuple):
    """What one thing costs."""

    what: str
    value: float
    unit: str
    how: str  # the command that prints it


HANDLE = Cost("an FLS process takes up a message: it wakes, reads, judges, handles, answers and shows", 171, "µs",
              "scripts/bench.py loops")  # fmt: skip
FILTER = Cost(
    "a broadcast asks the filter of one socket of its host", 0.5, "µs", "scripts/bench.py datagrams"
)
MEMORY = Cost("an FLS process holds", 3.85, "MB", "swarmer-run --shape dragon")
LAUNCH = Cost("an FLS process is forked and ready after", 5.0, "ms", "scripts/bench.py launch")
RELAY = Cost("a datagram crosses: processor time of both relays", 12, "µs", "scripts/bench.py cluster")
COSTS = (HANDLE, FILTER, MEMORY, LAUNCH, RELAY)
OWNER_MS = 0.15  # virtual.handling_ms: what an owner needs to take up a report


@dataclass(frozen=True)
class Host:
    """What a host is taken to be."""

    cores: int = 64
    memory_gb: int = 256
    busy: float = 0.3  # of its cores in the mean: beyond, bursts make FLSs late (the dragon's, on two cores)


HOST = Host()


class Need(NamedTuple):
    """What a display of F FLSs asks for at a time scale."""

    points: int
    scale: float
    hosts: int
    each: int  # FLSs on a host
    bound: str  # what bounds them: processors or memory
    relayed: float  # copies that a host's relay takes or gives in a wall second, in the mean
    relay_busy: float  # of one core, by the relay of a host
    filters: float  # of one core, by the filters of a host for broadcasts


def power(sizes: list[float], values: list[float]) -> tuple[float, float]:
    """(factor, exponent) of the power law through the values, by least squares of the logarithms.

    >>> factor, exponent = power([10, 20, 40], [5.0, 20.0, 80.0])
    >>> round(factor, 6), round(exponent, 6)
    (0.05, 2.0)
    """
    slope, height = np.polyfit(np.log(sizes), np.log(values), 1)
    return math.exp(height), float(slope)


def per_fls(one: Measured, what: str, *kinds: str) -> float:
    """`sent`, `delivered` or `broadcasts` of these kinds, or of all, by FLS and formation."""
    counts = one["kinds"]
    return sum(counts[kind][what] for kind in kinds or counts if kind in counts) / float(one["points"])


def seconds(one: Measured) -> float:
    """Emulated, of the formation that was counted."""
    return float(one["thaws_s"][1] - one["thaws_s"][0])


class Growth:
    """Power laws through what was measured, of a formation that nobody's queue holds up."""

    def __init__(self, measured: list[Measured]) -> None:
        self.sizes = [float(one["points"]) for one in measured]
        self._laws = {
            "seconds": self._law([seconds(one) for one in measured]),
            "delivered": self._law([per_fls(one, "delivered") for one in measured]),
            "broadcasts": self._law([per_fls(one, "broadcasts") for one in measured]),
        }
        shared = [
            (one["points"], per, index, one) for one in measured for index, per in enumerate(one["per_host"])
        ]
        # Of an area the rim grows as its root: copies by FLS fall with the FLSs of a host, and rise with the display.
        rows = np.array([[1.0, math.log(points), math.log(per)] for points, per, *_ in shared])
        for name in ("crossings", "airings"):
            values = [
                math.log(sum(kind[name][index] for kind in one["kinds"].values()) / points)
                for points, _, index, one in shared
            ]
            self._laws[name] = tuple(np.linalg.lstsq(rows, np.array(values), rcond=None)[0])

    def _law(self, values: list[float]) -> tuple[float, ...]:
        return power(self.sizes, values)

    def exponent(self, name: str) -> float:
        """By which power of F it grows."""
        return self._laws[name][1]

    def of(self, name: str, points: float) -> float:
        """`seconds` of a formation; `delivered`, `broadcasts`: by FLS and formation."""
        factor, exponent = self._laws[name]
        return float(factor * points**exponent)

    def copies(self, name: str, points: float, per_host: float) -> float:
        """`crossings` between hosts, or `airings` of broadcasts on hosts, by FLS and formation."""
        constant, by_points, by_host = self._laws[name]
        return math.exp(constant + by_points * math.log(points) + by_host * math.log(per_host))


def need(growth: Growth, points: int, scale: float, host: Host = HOST) -> Need:
    """How many hosts, and what their relays and filters do. scale: emulated seconds per wall second."""
    formation_s = growth.of("seconds", points) / scale  # wall
    by_processors = (
        host.busy * host.cores * formation_s / (growth.of("delivered", points) * HANDLE.value * 1e-6)
    )
    by_memory = 0.9 * host.memory_gb * 1e3 / MEMORY.value
    each = min(by_processors, by_memory, points)
    hosts = math.ceil(points / each)
    each = points / hosts
    bound = "memory" if by_memory < by_processors else "processors"
    relayed = 0.0
    if hosts > 1:
        # A copy has a relay at both ends.
        relayed = 2 * growth.copies("crossings", points, each) * each / formation_s
    airings = growth.copies("airings", points, each) if hosts > 1 else growth.of("broadcasts", points)
    filters = airings * each * each * FILTER.value * 1e-6 / formation_s
    return Need(points, scale, hosts, round(each), bound, relayed, relayed / 2 * RELAY.value * 1e-6, filters)
