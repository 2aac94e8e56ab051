"""What it takes to have a shape: load it, sample it, plan its neighbours, pair it with the next: time and memory."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.runs import middle
from bench.tables import median_of, show
from swarmer.shapes import generators
from swarmer.shapes.assignment import assign
from swarmer.shapes.catalogue import CATALOGUE, load_shape
from swarmer.shapes.neighbours import neighbour_plan

COUNTS = (760, 22_375, 1_000_000)
SAMPLED = (760, 22_375)
PAIRED = ((760, 760), (2_000, 2_000), (22_375, 11_894), (100_000, 100_000))
COLUMNS = ("", "points", "s", "peak MB", "what came of it")


def run(repeat: int) -> None:
    """Print the tables."""
    heavy = [("plan", (count,)) for count in COUNTS]
    heavy += [("bridges", (count,)) for count in COUNTS[1:]]
    heavy += [("sample", (count,)) for count in SAMPLED]
    heavy += [("pair", counts) for counts in PAIRED]
    show(
        "clouds: planning, sampling, pairing", COLUMNS, [row(repeat, name, counts) for name, counts in heavy],
        ["each in a process of its own; peak MB with Python, numpy and scipy",
         "plan, bridges: uniform points, η 5 and η 1, where a third of them begin a part of their own",
         "sample: of the surface of a torus; pair: uniform points with those of a cube"],
    )  # fmt: skip
    rows = [
        (
            name,
            len(load_shape(name)),
            1e3 * median_of(max(3, repeat), partial(seconds, partial(load_shape, name))),
        )
        for name in CATALOGUE
    ]
    show(
        "clouds: loading",
        ("", "points", "ms"),
        rows,
        ["warm; shipped ones read their file, the others are made"],
    )


def row(repeat: int, name: str, counts: tuple[int, ...]) -> tuple[object, ...]:
    """A row of the first table: the medians of so many processes."""
    tries = [in_its_own_process(name, counts) for _ in range(repeat)]
    return (
        name,
        " -> ".join(f"{count:,}" for count in counts),
        middle([one["seconds"] for one in tries]),
        round(max(one["peak_mb"] for one in tries)),
        tries[0]["result"],
    )


def in_its_own_process(name: str, counts: tuple[int, ...]) -> dict[str, Any]:
    """`measured`, where nothing else has taken memory before."""
    here = str(Path(__file__).resolve().parent.parent)
    words = [sys.executable, "-c", f"from bench.shapes import measured; measured({name!r}, {counts!r})"]
    done = subprocess.run(
        words, env={**os.environ, "PYTHONPATH": here}, stdout=subprocess.PIPE, text=True, check=True
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def measured(name: str, counts: tuple[int, ...]) -> None:
    """Do it once, and print time, peak memory of this process, and what came of it, as JSON."""
    act = TASKS[name](*counts)
    results: list[str] = []
    took = seconds(lambda: results.append(act()))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"seconds": took, "peak_mb": peak, "result": results[0]}))


def seconds(act: Callable[[], object]) -> float:
    began = time.perf_counter()
    act()
    return time.perf_counter() - began


# -- what is measured: each is prepared, and gives the action whose time counts ------------------------------------


def plan(count: int) -> Callable[[], str]:
    return partial(planned, uniform(count), None)


def bridges(count: int) -> Callable[[], str]:
    return partial(planned, uniform(count), 1)


def planned(points: Any, eta: int | None) -> str:
    made = neighbour_plan(points, eta)
    return f"parts {made.components:,}, links added {made.added_links:,}"


def sample(count: int) -> Callable[[], str]:
    import trimesh

    from swarmer.shapes.sampling import surface_sample

    torus = trimesh.creation.torus(2, 0.5, major_sections=96, minor_sections=48)
    vertices, faces = np.asarray(torus.vertices), np.asarray(torus.faces)
    return lambda: f"points {len(surface_sample(vertices, faces, count, seed=1)):,}"


def pair(current: int, target: int) -> Callable[[], str]:
    one, other = uniform(current), generators.cube(target)
    other = other * (np.ptp(one, axis=0).max() / np.ptp(other, axis=0).max())

    def act() -> str:
        found = assign(one, other)
        mean = (found.squared_cells / min(current, target)) ** 0.5
        return f"way {mean:.2f} cells (rms), {'optimal' if found.optimal else 'by blocks'}"

    return act


def uniform(count: int) -> Any:
    """Points (count, 3), 27 cells³ for each."""
    return np.random.default_rng(1).random((count, 3)) * 3 * count ** (1 / 3)


TASKS: dict[str, Callable[..., Callable[[], str]]] = {
    "plan": plan,
    "bridges": bridges,
    "sample": sample,
    "pair": pair,
}
