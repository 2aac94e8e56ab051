"""A small display on the virtual-time engine whose story a test tells: what it is, what happens, who watches."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any

from swarmer.config import load_config
from swarmer.engines.result import RunResult, Snapshot, Witness
from swarmer.engines.virtual import VirtualEngine
from swarmer.experiments.worlds import Onlooker
from swarmer.faults import NO_FAULTS, Schedule
from swarmer.metrics.hausdorff import hausdorff
from swarmer.observe.invariants import Checks
from swarmer.plan import make_plan


class Log(Witness):
    """Keeps what tests ask for: every event, every message by kind, the FLSs that live."""

    def __init__(self) -> None:
        self.events: list[tuple[float, int, Any, Any]] = []
        self.sent_at: list[tuple[float, int]] = []
        self.flss: dict[int, Any] = {}
        self.taken: defaultdict[int, list[Any]] = defaultdict(
            list
        )  # by FID: datagrams that got past the radio
        self.fates: Counter[str] = Counter()

    def made(self, fls, now_s):
        self.flss[fls.fid] = fls

    def handled(self, fls, event, actions, cause, now_s):
        self.events.append((now_s, fls.fid, event, tuple(actions)))

    def sent(self, fls, message, stamp, copies, now_s):
        self.sent_at.append((now_s, message.kind))

    def heard(self, fls, message, stamp, fate, now_s):
        self.fates[fate] += 1
        if fate in ("queued", "answered", "noted", "dropped"):
            self.taken[fls.fid].append((message, stamp))

    def kinds_sent(self, from_s: float = 0.0) -> Counter:
        return Counter(kind for at_s, kind in self.sent_at if at_s >= from_s)


class Audience(Onlooker):
    """Keeps every sample; the run ends once `until` says so of one, or all is well and all are one swarm."""

    def __init__(self, checks: Checks, until) -> None:
        super().__init__(checks)
        self.until, self.samples = until, []

    def sample(self, snapshot: Snapshot) -> bool:
        self.samples.append(snapshot)
        return bool(self.until(snapshot)) or super().sample(snapshot)


class Story:
    """A run and all that is known of it. `broken` is None: every invariant held."""

    def __init__(
        self, preset=None, until=lambda snapshot: False, faults: Schedule = NO_FAULTS, **settings
    ) -> None:
        settings = {
            "engine": "virtual", "shape": "dragon", "points": 30, "seed": 1, "thaw.h_s": 3.0, "duration_s": 10.0,
            **({"thaw.policy": "timer"} if preset is None else {}),
        } | settings  # fmt: skip
        self.plan = make_plan(load_config(preset, [], **settings))
        self.checks, self.log = Checks(self.plan, faults), Log()
        self.audience = Audience(self.checks, until)
        with VirtualEngine(self.plan, (self.checks, self.log), faults) as engine:
            self.result: RunResult = engine.run(self.audience)
        assert self.result.status == "done", (self.result.message, self.result.extra.get("violation"))
        self.seen = {invariant.name: invariant.looked for invariant in self.checks.invariants}

    @property
    def flss(self) -> dict[int, Any]:
        return self.log.flss

    @property
    def end(self) -> Snapshot:
        return self.audience.samples[-1]

    def at(self, t_s: float) -> Snapshot:
        """The first sample that is not before a moment."""
        return next(snapshot for snapshot in self.audience.samples if snapshot.t_s >= t_s - 1e-9)

    def hd(self, snapshot: Snapshot) -> float:
        """HD of those that are lit, once all have been moved until their centroids coincide."""
        x, g = snapshot.position[snapshot.lit], self.plan.cloud.points[snapshot.lit]
        return hausdorff(x + (g - x).mean(axis=0), g)


def one_swarm(snapshot: Snapshot) -> bool:
    return bool(snapshot.lit.all() and (snapshot.swarm == snapshot.swarm[0]).all())


def swarms(snapshot: Snapshot) -> int:
    return len(set(snapshot.swarm[snapshot.lit].tolist()))
