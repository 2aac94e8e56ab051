"""What it takes to get processes on the air: time, memory, and how long waking all of them takes."""

from __future__ import annotations

from bench.runs import middle
from bench.tables import show
from swarmer.config import load_config
from swarmer.engines.measured import MeasuredEngine
from swarmer.engines.result import Snapshot
from swarmer.engines.trial import Watch
from swarmer.plan import make_plan

COUNTS = (100, 760, 1727)
WAKES = 8
COLUMNS = ("FLSs", "launch s", "ms per FLS", "private MB each", "woken at once: p50 ms", "p99 ms")


class FirstLook(Watch):
    """Ends the run at its first sample."""

    def sample(self, snapshot: Snapshot) -> bool:
        return True


def run(repeat: int) -> None:
    """Print the table."""
    rows = []
    for count in COUNTS:
        tries = [launch(count) for _ in range(repeat)]
        rows.append([count, *(middle([one[at] for one in tries]) for at in range(len(COLUMNS) - 1))])
    show(
        "launch: processes, sockets, ready",
        COLUMNS,
        rows,
        ["ms per FLS: without the start of the dispatcher"],
    )


def launch(count: int) -> list[float | None]:
    """Launch a sphere, wake all some times, end."""
    plan = make_plan(load_config(None, [], shape="sphere", points=count, time_scale=0.1))
    watch = FirstLook()
    with MeasuredEngine(plan, wakes=WAKES) as engine:
        result = engine.run(watch)
    wake = engine.cost.wake_ms
    late = [None, None] if wake is None else [wake.p50, wake.p99]
    return [result.launch_s, watch.ms_per_fls(), result.memory_mb_per_fls, *late]
