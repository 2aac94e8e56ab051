"""How far more cores carry: a run pinned to some and to twice as many, and the largest shapes on all there are."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from itertools import product

from bench.runs import Run, middle, middle_of, repeated
from bench.tables import show
from swarmer.engines.limits import MEMORY_MB_PER_FLS, available_mb
from swarmer.shapes.catalogue import load_shape

PINNED = ("dragon", "skateboard")  # until HD < 0.1 cells
LARGE = ("racecar", "statue")  # until HD < 1 cell: what takes long is to get there
SETTINGS = {"duration_s": 45.0, "recording.enabled": False}
COLUMNS = (
    "shape", "FLSs", "cores", "launch s", "HD < 1 at s", "< 0.1", "wall s", "time scale", "faithful",
    "timers p99 ms", "messages p99 ms", "MB each", "cores busy %",
)  # fmt: skip


def pinned(repeat: int) -> None:
    """Print the table of cores."""
    rows: list[list[object]] = []
    try:
        for shape, count in product(PINNED, doubled(len(os.sched_getaffinity(0)))):
            with on_cores(count):
                rows.append(row(count, repeated(repeat, shape=shape, until_hd_cells=0.1, **SETTINGS)))
    finally:  # stopped early, it shows what it has
        show("cores: one shape on more and more, default settings, until HD < 0.1", COLUMNS, rows)


def large(repeat: int) -> None:
    """Print the table of the largest shapes, of those for which there is memory."""
    cores, free = len(os.sched_getaffinity(0)), available_mb() or 0.0
    settings = {**SETTINGS, "until_hd_cells": 1.0, "thaw.policy": "centralized"}
    rows: list[list[object]] = []
    notes = []
    try:
        for shape in LARGE:
            needed = len(load_shape(shape).points) * MEMORY_MB_PER_FLS
            if needed <= free:
                rows.append(row(cores, repeated(repeat, shape=shape, **settings)))
            else:
                notes.append(f"{shape} takes {needed / 1000:.0f} GB of memory, {free / 1000:.0f} are free")
    finally:
        show("large: the largest shapes on all cores, centralized thaws, until HD < 1", COLUMNS, rows, notes)


def row(cores: int, runs: list[Run]) -> list[object]:
    first = runs[0].summary
    return [
        first["shape"], first["points"], cores,
        middle_of(runs, "launch_s"), middle_of(runs, "time_to_hd_s", "1"), middle_of(runs, "time_to_hd_s", "0.1"),
        middle_of(runs, "wall_s"), middle_of(runs, "time_scale"), all(one.summary["faithful"] for one in runs),
        middle_of(runs, "timer_late_ms", "p99"), middle_of(runs, "handled_late_ms", "p99"),
        middle_of(runs, "memory_mb_per_fls"), middle([100 * one.cost.busy for one in runs]),
    ]  # fmt: skip


def doubled(most: int) -> list[int]:
    """..., most / 4, most / 2, most: four at most."""
    return sorted({most >> power for power in range(4)} - {0})


@contextlib.contextmanager
def on_cores(count: int) -> Iterator[None]:
    """What begins here, and all that it forks, gets so many cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
