"""What a run needs of a machine, so that no more are begun than it carries: cores, memory, or all of it.

Estimated from the engine and the number of FLSs; an experiment file says otherwise with `needs: {cores: 2,
memory_mb: 900}`. The estimates are peaks measured with Python 3.11 on Linux, rounded up (docs/sweeps.md).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmer.engines.limits import MEMORY_MB_PER_FLS
from swarmer.errors import BadInput, shown
from swarmer.settings import did_you_mean, is_number

if TYPE_CHECKING:
    from swarmer.config import RunConfig

CORES, MEMORY = "cores", "memory_mb"
BOUNDS = {CORES: (1, 1024), MEMORY: (1, 10_000_000)}
PROCESS_MB = 110  # Python and the libraries
MB_PER_FLS = {"virtual": 0.04, "rounds": 0.002, "process": MEMORY_MB_PER_FLS}
SAMPLE_MB = 60e-6  # of the timeline, per FLS and sample, when it is written
RECORDING_MB = 150
OF_PROCESSES = ("process", "cluster")  # engines whose FLSs are processes


class Needs(NamedTuple):
    """What one run needs."""

    cores: int
    memory_mb: float
    machine: bool = False  # all of a machine: its FLSs are processes that must not be late

    def __str__(self) -> str:
        cores = "a machine" if self.machine else f"{self.cores} core{'s' * (self.cores > 1)}"
        return f"{cores} and {self.memory_mb:,.0f} MB"


def needs_said(given: Any) -> dict[str, float]:
    """The part `needs` of a file. Raises BadInput with a line for all that is wrong."""
    if not isinstance(given, dict):
        raise BadInput.saying(f"needs: {shown(given)} is not a mapping with {', '.join(BOUNDS)}")
    lines = []
    for name, value in given.items():
        if name not in BOUNDS:
            hint = did_you_mean(str(name), BOUNDS)
            lines.append(f"needs: {shown(name)[1:-1]}: no such need;{hint} there are {', '.join(BOUNDS)}")
            continue
        low, high = BOUNDS[name]
        whole = name != CORES or (is_number(value) and value % 1 == 0)
        if not (is_number(value) and low <= value <= high and whole):
            kind = "a whole number" if name == CORES else "megabytes"
            lines.append(f"needs: {name}: {shown(value)} is not {kind}, {low} to {high}")
    if lines:
        raise BadInput.saying(*lines)
    return dict(given)


def needs_of(config: RunConfig, said: Mapping[str, float] | None = None) -> Needs:
    """What a run with these settings needs. said: what its experiment says instead."""
    said = said or {}
    count = fls_of(config)
    samples = 0.0 if config.engine == "rounds" else config.duration_s * config.recording.rate_hz
    memory = PROCESS_MB + count * (MB_PER_FLS.get(config.engine, MEMORY_MB_PER_FLS) + SAMPLE_MB * samples)
    memory += RECORDING_MB if config.recording.enabled else 0
    return Needs(int(said.get(CORES, 1)), said.get(MEMORY, memory), config.engine in ("process", "cluster"))


def fls_of(config: RunConfig) -> int:
    """How many FLSs a run has: the points of its shape, or of the larger one of two."""
    count = _count(config.shape, config.points, config.duplicates, config.seed if config.points else 0)
    after = config.transition
    return (
        count if after.shape is None else max(count, _count(after.shape, after.points, config.duplicates, 0))
    )


@lru_cache(maxsize=256)
def _count(shape: str, points: int | None, duplicates: str, seed: int) -> int:
    """How many points a shape has, which is how many FLSs fly."""
    if points is not None:
        return points
    from swarmer.shapes.catalogue import CATALOGUE, load_shape

    return CATALOGUE[shape].points if shape in CATALOGUE else len(load_shape(shape, None, duplicates, seed))


class Room:
    """What a machine has: may one more run begin beside those that are at work?"""

    def __init__(self, cores: int, memory_mb: float | None) -> None:
        """memory_mb: None where nobody knows."""
        self.cores, self.memory_mb = cores, memory_mb

    def fits(self, need: Needs, beside: Collection[Needs]) -> bool:
        """A run that nothing stands beside may always begin: it is as small as it gets."""
        if not beside:
            return True
        if need.machine or any(other.machine for other in beside):
            return False
        cores = need.cores + sum(other.cores for other in beside)
        memory = need.memory_mb + sum(other.memory_mb for other in beside)
        return cores <= self.cores and (self.memory_mb is None or memory <= self.memory_mb)

    def at_once(self, needs: Collection[Needs]) -> int:
        """How many of these are at work at a time, at most; in order, as a sweep makes them."""
        beside: list[Needs] = []
        for need in sorted(needs, key=lambda need: (need.machine, need.cores, need.memory_mb)):
            if not self.fits(need, beside):
                break
            beside.append(need)
        return len(beside)
