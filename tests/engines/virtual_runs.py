"""What the tests of the virtual-time engine share: an observer that keeps everything, and small runs."""

from __future__ import annotations

from swarmer.config import load_config
from swarmer.engines.result import RunResult
from swarmer.engines.virtual import VirtualEngine
from swarmer.observe.progress import Progress
from swarmer.plan import Plan, make_plan

SMALL = {"shape": "sphere", "points": 40, "duration_s": 12}


class Watcher:
    """An Observer; `on_sample` is called with each snapshot and may end the run."""

    def __init__(self, on_sample=lambda snapshot: False) -> None:
        self.calls: list[str] = []
        self.samples: list = []
        self.events: list = []
        self._on_sample = on_sample

    def planned(self, plan: Plan) -> None:
        self.calls.append("planned")
        self.plan, self.progress = plan, Progress.through(plan.standings(), plan.config.oracle.count > 0)

    def launching(self, ready: int, total: int) -> None:
        self.calls.append("launching")
        self.ready = (ready, total)

    def go(self, launch_s: float) -> None:
        self.calls.append("go")

    def sample(self, snapshot) -> bool:
        self.calls.append("sample")
        self.samples.append(snapshot)
        self.progress.update(snapshot)
        goal = self.plan.config.until_hd_cells
        return bool(self._on_sample(snapshot)) or self.progress.reached(goal)

    def beat(self, t_s: float) -> None:
        self.calls.append("beat")

    def event(self, event) -> None:
        self.calls.append("event")
        self.events.append(event)

    def kinds(self) -> set[str]:
        return {event.kind for event in self.events}


def fly(on_sample=lambda snapshot: False, preset=None, **settings) -> tuple[RunResult, Watcher]:
    """Run a small shape; the result, and who watched."""
    plan = make_plan(load_config(preset, (), **{**SMALL, **settings}))
    watcher = Watcher(on_sample)
    with VirtualEngine(plan) as engine:
        return engine.run(watcher), watcher


def trace(**settings) -> str:
    return fly(**settings)[0].extra["trace_sha256"]
