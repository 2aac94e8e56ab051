"""A few seconds of a real run, to learn what this machine can carry; and what follows from it for larger shapes.

The trial is the process engine itself on a sphere of 100 points: every FLS is woken at once some times, then they fly
and become one swarm at time scale 1. What follows is an estimate: lateness comes from bursts, in which every FLS is
woken and waits for its turn on a core, so it grows with the number of FLSs; and the cores' time is shared by all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmer.engines.measured import MeasuredEngine

if TYPE_CHECKING:
    from swarmer.engines.measured import Cost
    from swarmer.engines.result import Event, RunResult, Snapshot
    from swarmer.plan import Plan

POINTS = 100
WAKES = 15
RUN_S = 5.0
SHAPES = (760, 1727)  # the dragon, the skateboard of the paper

# How much later a run's messages are than a wake-up of all, and how much of the cores FLSs may use before
# lateness has nothing left to be caught up with. From runs of 100 to 1727 FLSs beside their wake-ups (`make bench`).
BURST = 2.0
BUSY_MAX = 0.8
FAITHFUL = 0.5  # share of a lease within which messages and timers must be, at the 99th percentile


@dataclass(frozen=True)
class Trial:
    """What was measured."""

    points: int
    launch_s: float
    fork_ms: float  # per FLS
    memory_mb: float  # private, per FLS
    wake_p99_ms: float  # all FLSs woken at once: how late the last are
    handled_p99_ms: float  # in the run
    cpu_ms: float  # processor time per FLS and emulated second, launch apart
    cores: int
    lease_ms: float

    def scale_for(self, points: int) -> float:
        """The largest time scale, at most 1, at which a run of that many FLSs should be faithful."""
        return min(1.0, self._scale_by_bursts(points), self._scale_by_cores(points))

    def largest(self, memory_mb: float | None = None) -> int:
        """How many FLSs should be faithful at time scale 1, and fit into memory."""
        by_bursts = self._scale_by_bursts(1)
        by_cores = self._scale_by_cores(1)
        by_memory = memory_mb / self.memory_mb if memory_mb and self.memory_mb else float("inf")
        return int(min(by_bursts, by_cores, by_memory))

    def _scale_by_bursts(self, points: int) -> float:
        """A burst of F FLSs is F / 100 times as late as the trial's; in slower emulated time it counts for less."""
        late_ms = max(BURST * self.wake_p99_ms, self.handled_p99_ms) * points / self.points
        return FAITHFUL * self.lease_ms / max(late_ms, 1e-6)

    def _scale_by_cores(self, points: int) -> float:
        return BUSY_MAX * self.cores * 1e3 / max(self.cpu_ms * points, 1e-6)

    def as_data(self) -> dict[str, Any]:
        """Names and numbers for `--json`."""
        return {
            "points": self.points, "launch_s": self.launch_s, "fork_ms_per_fls": self.fork_ms,
            "memory_mb_per_fls": self.memory_mb, "wake_p99_ms": self.wake_p99_ms,
            "handled_late_p99_ms": self.handled_p99_ms, "cpu_ms_per_fls_and_s": self.cpu_ms,
        }  # fmt: skip


class Watch:
    """An observer that only looks at how the launch goes."""

    def __init__(self) -> None:
        self.ready: list[tuple[float, int]] = []

    def planned(self, plan: Plan) -> None:
        pass

    def launching(self, ready: int, total: int) -> None:
        import time

        self.ready.append((time.monotonic(), ready))

    def go(self, launch_s: float) -> None:
        pass

    def sample(self, snapshot: Snapshot) -> bool:
        return False

    def event(self, event: Event) -> None:
        pass

    def beat(self, t_s: float) -> None:
        pass

    def ms_per_fls(self) -> float | None:
        """From the first FLSs that were ready to the last; the dispatcher's own start is not in it."""
        seen = [mark for mark in self.ready if mark[1]]
        if len(seen) < 2 or seen[-1][1] == seen[0][1]:
            return None
        return 1e3 * (seen[-1][0] - seen[0][0]) / (seen[-1][1] - seen[0][1])


def run_trial(points: int = POINTS, run_s: float = RUN_S) -> Trial:
    """Some seconds of a real run. Raises BadInput where this machine refuses even that, RunFailed where it breaks."""
    from swarmer.config import load_config
    from swarmer.errors import RunFailed
    from swarmer.plan import make_plan

    plan = make_plan(load_config(shape="sphere", points=points, duration_s=run_s, time_scale=1))
    watch = Watch()
    with MeasuredEngine(plan, wakes=WAKES) as engine:
        result = engine.run(watch)
    if result.status == "interrupted":
        raise KeyboardInterrupt
    if result.status != "done" or engine.cost.wake_ms is None:
        raise RunFailed(
            f"the trial run with {points} FLSs did not work: {result.message or 'no FLS woke up'}"
        )
    return read(plan, result, engine.cost, watch)


def read(plan: Plan, result: RunResult, cost: Cost, watch: Watch) -> Trial:
    """The figures of a run that went well."""
    launch_s = result.launch_s or 0.0
    assert cost.wake_ms is not None
    return Trial(
        points=plan.size,
        launch_s=launch_s,
        fork_ms=watch.ms_per_fls() or 1e3 * launch_s / plan.size,
        memory_mb=result.memory_mb_per_fls or 0.0,
        wake_p99_ms=cost.wake_ms.p99,
        handled_p99_ms=result.handled_late_ms.p99 if result.handled_late_ms else 0.0,
        cpu_ms=1e3 * cost.fls_cpu_s / max(result.emulated_s, 1e-9) / plan.size,
        cores=cost.cores,
        lease_ms=plan.config.lease_ms,
    )
