"""The rounds engine: whole runs, and how time and memory grow with the number of FLSs, to a million.

Times are of the process, so that others on the machine count for little; each run is in a process of its own, so that
its peak of memory is its own.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.tables import show
from bench.virtual import Meter, exponent
from swarmer.config import load_config
from swarmer.engines.rounds import RoundsEngine
from swarmer.plan import make_plan

RUNS: tuple[tuple[str, int], ...] = (("dragon", 40), ("skateboard", 40), ("racecar", 60), ("statue", 60))
SIZES = (1_000, 10_000, 100_000, 1_000_000)
ROUNDS = 60  # of the runs that grow
COLUMNS = ("", "FLSs", "rounds", "formations", "process s", "wall s", "peak MB", "HD at the end")
TORUS = (2.0, 0.5)  # radii, in one another's unit
AREA = 4.0  # square cells for each point


def run(repeat: int) -> None:
    """Print both tables. repeat: so often is each run made, and its fastest taken."""
    rows = [row(name, best(repeat, {"shape": name, "rounds.max_rounds": rounds})) for name, rounds in RUNS]
    rows += [
        row(f"{name}, M 2", best(repeat, {"shape": name, "rounds.max_rounds": rounds, "m": 2}))
        for name, rounds in RUNS[::3]
    ]
    notes = [
        "no end before the last round, thaws at each formation, HD each round, no files; without the plan"
    ]
    show("rounds: whole runs in rounds", COLUMNS, rows, notes)
    costs = [
        best(1 if size > 100_000 else repeat, {"points": size, "rounds.max_rounds": ROUNDS}) for size in SIZES
    ]
    grows = exponent(list(SIZES), [cost["process_s"] for cost in costs])
    last = exponent(list(SIZES[-2:]), [cost["process_s"] for cost in costs[-2:]])
    notes = [
        "random points of a torus; HD each round to 50,000 FLSs, above at each formation;",
        f"process s grow as F^{grows:.2f}, from {SIZES[-2]:,} to {SIZES[-1]:,} as F^{last:.2f};",
        "half of it is the search for neighbours, most of that in the first round after a thaw",
    ]
    show("rounds: more FLSs", COLUMNS, [row("torus", cost) for cost in costs], notes)


def row(name: str, cost: dict[str, Any]) -> tuple[object, ...]:
    return (
        name, f"{cost['points']:,}", cost["rounds"], cost["formations"], cost["process_s"], cost["wall_s"],
        round(cost["peak_mb"]), cost["hd"],
    )  # fmt: skip


def best(repeat: int, settings: dict[str, Any]) -> dict[str, Any]:
    """The fastest of so many runs, each in a process of its own."""
    return min((in_its_own_process(settings) for _ in range(repeat)), key=lambda cost: cost["process_s"])


def in_its_own_process(settings: dict[str, Any]) -> dict[str, Any]:
    """`measured`, where nothing else has taken memory before."""
    here = str(Path(__file__).resolve().parent.parent)
    words = [sys.executable, "-c", f"from bench.rounds import measured; measured({settings!r})"]
    done = subprocess.run(
        words, env={**os.environ, "PYTHONPATH": here}, stdout=subprocess.PIPE, text=True, check=True
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def measured(settings: dict[str, Any]) -> None:
    """Make one run, and print what it cost as JSON. Without a shape it is a torus."""
    if "shape" in settings:
        plan = make_plan(load_config(engine="rounds", **settings, **{"rounds.stop": "none"}))
    else:
        settings = dict(settings)
        with tempfile.TemporaryDirectory(prefix="swarmer-bench-") as room:
            path = Path(room) / "torus.npy"
            np.save(path, torus(settings.pop("points")))
            plan = make_plan(
                load_config(engine="rounds", shape=str(path), **settings, **{"rounds.stop": "none"})
            )
    meter = Meter()
    with RoundsEngine(plan) as engine:
        wall, process = time.perf_counter(), time.process_time()
        result = engine.run(meter)
        wall, process = time.perf_counter() - wall, time.process_time() - process
    print(
        json.dumps({
            "points": plan.size,
            "rounds": result.extra["rounds"],
            "formations": len(result.extra["formation_rounds"]),
            "process_s": process,
            "wall_s": wall,
            "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            "hd": meter.progress.hd,
        })
    )  # fmt: skip


def torus(count: int) -> Any:
    """Points (count, 3) uniform on a torus, of `AREA` square cells each."""
    rng = np.random.default_rng(1)
    large, small = TORUS
    turn, around = rng.uniform(0, 2 * np.pi, (2, 2 * count))
    keep = rng.random(2 * count) * (large + small) < large + small * np.cos(around)
    turn, around = turn[keep][:count], around[keep][:count]
    ring = large + small * np.cos(around)
    points = np.column_stack([ring * np.cos(turn), small * np.sin(around), ring * np.sin(turn)])
    cells = np.sqrt(AREA * count / (4 * np.pi**2 * large * small))
    return (points - points.min(axis=0)) * cells + 3
