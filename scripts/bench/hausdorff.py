"""The Hausdorff distance: our meter against the naive way and against scipy's directed_hausdorff."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist, directed_hausdorff

from bench.tables import median_of, show
from swarmer.metrics.hausdorff import HausdorffMeter
from swarmer.shapes.generators import sphere

SIZES = (760, 1_727, 22_375, 200_000)
ERRORS = (
    (3.0, "after the deployment"),
    (0.3, "on the way"),
    (0.01, "at the end"),
)  # cells, of each coordinate
SOON_MAX = 5_000  # points; beyond, slow ways are measured once
NAIVE_MAX = 25_000  # points; beyond, the naive way takes minutes
BLOCK = 1_000  # rows of the naive way's table of distances at a time
COLUMNS = ("FLSs", "errors", "meter ms", "two k-d trees", "directed_hausdorff", "naive", "HD, cells")


def run(repeat: int) -> None:
    """Print the table."""
    rows = [row(repeat, count, spread, when) for count in SIZES for spread, when in ERRORS]
    notes = [
        "points of a sphere 2 cells apart; the others as multiples of the meter's time; all give the same HD",
        "meter: asks the tree only for the points that may change the answer, and at the end not at all",
    ]
    show("hausdorff: one reading of the HD", COLUMNS, rows, notes)


def row(repeat: int, count: int, spread: float, when: str) -> tuple[object, ...]:
    """One size and error; every way gives the same value, or this is no comparison."""
    truth = sphere(count)
    position = truth + np.random.default_rng(1).normal(scale=spread, size=truth.shape)
    meter = HausdorffMeter(truth)
    moved = position + (truth - position).mean(axis=0)
    ways: dict[str, Callable[[], float]] = {
        "meter": partial(meter.hd, position),
        "trees": partial(two_trees, moved, truth),
        "scipy": partial(scipys, moved, truth),
        "naive": partial(naive, moved, truth),
    }
    if count > NAIVE_MAX:
        del ways["naive"], ways["scipy"]
    values = {name: way() for name, way in ways.items()}
    assert np.ptp(list(values.values())) < 1e-9, values
    slow = {name for name in ("scipy", "naive") if count > SOON_MAX}
    took = {
        name: median_of(1 if name in slow else repeat, partial(seconds, way)) for name, way in ways.items()
    }
    return (
        f"{count:,}", when, 1e3 * took["meter"],
        *(times(took[name] / took["meter"]) if name in took else "-" for name in ("trees", "scipy", "naive")),
        values["meter"],
    )  # fmt: skip


def times(ratio: float) -> str:
    return f"{ratio:,.1f}x" if ratio < 100 else f"{ratio:,.0f}x"


def seconds(way: Callable[[], float]) -> float:
    began = time.perf_counter()
    way()
    return time.perf_counter() - began


def two_trees(moved: Any, truth: Any) -> float:
    """All points asked, both ways."""
    return float(max(cKDTree(truth).query(moved)[0].max(), cKDTree(moved).query(truth)[0].max()))


def scipys(moved: Any, truth: Any) -> float:
    return float(max(directed_hausdorff(moved, truth)[0], directed_hausdorff(truth, moved)[0]))


def naive(moved: Any, truth: Any) -> float:
    """All distances between all points, a block of rows at a time."""
    to_truth, to_moved = 0.0, np.full(len(truth), np.inf)
    for begin in range(0, len(moved), BLOCK):
        apart = cdist(moved[begin : begin + BLOCK], truth)
        to_truth = max(to_truth, float(apart.min(axis=1).max()))
        np.minimum(to_moved, apart.min(axis=0), out=to_moved)
    return max(to_truth, float(to_moved.max()))
