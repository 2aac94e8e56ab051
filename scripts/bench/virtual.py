"""The virtual-time engine: whole runs, and how their time grows with the number of FLSs.

Times are of this process, so that others on the machine count for little; a run is measured beside `reference`, a loop
that never changes, and costs so many of its turns per event.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.reference import turns_per_s
from bench.tables import show
from swarmer.config import load_config
from swarmer.engines.result import Event, Snapshot
from swarmer.engines.virtual import VirtualEngine
from swarmer.observe.progress import Progress
from swarmer.plan import Plan, make_plan

RUNS: tuple[tuple[str, float], ...] = (("dragon", 60), ("hat", 90), ("skateboard", 90))
SIZES = (250, 500, 1000, 2000, 4000, 8000)
BY_CLOCK = {"thaw.policy": "timer"}  # as many thaws on every machine and in every version
SCALING_S = 20.0  # emulated; a thaw and a half in each, by `timer`


class Meter:
    """An observer that reads the HD of every sample, and writes nothing."""

    def planned(self, plan: Plan) -> None:
        self.progress = Progress.of(plan.cloud.points)

    def launching(self, ready: int, total: int) -> None:
        pass

    def go(self, launch_s: float) -> None:
        pass

    def sample(self, snapshot: Snapshot) -> bool:
        self.progress.update(snapshot)
        return False

    def event(self, event: Event) -> None:
        pass

    def beat(self, t_s: float) -> None:
        pass


@dataclass(frozen=True)
class Cost:
    """What a run cost."""

    points: int
    events: int
    process_s: float
    turns_per_s: float  # of the reference loop, before and after
    hd: float

    @property
    def us(self) -> float:
        """Microseconds per event."""
        return 1e6 * self.process_s / self.events

    @property
    def turns(self) -> float:
        """Turns of the reference loop per event."""
        return self.turns_per_s * self.process_s / self.events


def run(repeat: int) -> None:
    """Print both tables. repeat: so often is each run made, and its fastest taken."""
    rows = []
    for shape, duration_s in RUNS:
        cost = best(repeat, shape=shape, duration_s=duration_s, **BY_CLOCK)
        rows.append(
            (shape, cost.points, f"{duration_s:.0f}", cost.events, cost.process_s, cost.events / cost.process_s,
             cost.us, cost.turns)
        )  # fmt: skip
    columns = ("", "FLSs", "emulated s", "events", "process s", "events/s", "µs/event", "turns/event")
    notes = ["timer, λ 500 ms, seed 1, 10 samples a second with their HD, no files"]
    show("virtual: whole runs in virtual time", columns, rows, notes)
    scaling(repeat)


def scaling(repeat: int) -> None:
    """Print how the time grows with F."""
    costs = [
        best(repeat, shape="sphere", points=points, duration_s=SCALING_S, **BY_CLOCK, **{"thaw.h_s": 12})
        for points in SIZES
    ]
    rows = [(str(cost.points), cost.events, cost.process_s, cost.us, cost.turns, cost.hd) for cost in costs]
    whole, events, each = (
        exponent([cost.points for cost in costs], [value(cost) for cost in costs])
        for value in (lambda cost: cost.process_s, lambda cost: cost.events, lambda cost: cost.us)
    )
    notes = [
        f"sphere, {SCALING_S:g} emulated s; process s grow as F^{whole:.2f}:",
        f"the number of events as F^{events:.2f}, for swarms grow and every message to a swarm reaches all of it,",
        f"and the time of each as F^{each:.2f}, for what more FLSs know fits the processor's caches less",
    ]
    columns = ("FLSs", "events", "process s", "µs/event", "turns/event", "HD at the end")
    show("virtual: more FLSs", columns, rows, notes)


def best(repeat: int, **settings: Any) -> Cost:
    """The fastest of so many runs."""
    return min((measured(**settings) for _ in range(repeat)), key=lambda cost: cost.process_s)


def measured(**settings: Any) -> Cost:
    """One run, its launch included."""
    plan = make_plan(load_config(engine="virtual", **settings))
    meter = Meter()
    before = turns_per_s()
    with VirtualEngine(plan) as engine:
        began = time.process_time()
        result = engine.run(meter)
        took = time.process_time() - began
    between = (before + turns_per_s()) / 2
    return Cost(plan.size, result.extra["events"], took, between, meter.progress.hd)


def exponent(sizes: list[int], values: list[float]) -> float:
    """The power of the size by which the values grow, by least squares of the logarithms.

    >>> round(exponent([10, 20, 40], [5.0, 20.0, 80.0]), 6)
    2.0
    """
    slope = np.polyfit([math.log(size) for size in sizes], [math.log(value) for value in values], 1)[0]
    return float(slope)
