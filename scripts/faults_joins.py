"""How soon replacements join a swarm, from when they light up: what one run shows of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from swarmer.config import load_config
from swarmer.engines.result import Witness
from swarmer.engines.virtual import VirtualEngine
from swarmer.experiments.worlds import Onlooker
from swarmer.messages import Swarm
from swarmer.metrics.intervals import NEVER
from swarmer.observe.saved_run import load
from swarmer.plan import make_plan


class Joins(Witness):
    """How long each replacement, once it is lit, is in a swarm of its own: to the event, in emulated seconds.

    Samples would not do: whoever joins the swarm that only waited for it is thawed with all others at once.
    """

    def __init__(self) -> None:
        self.waits_s: list[float] = []
        self._lit_s: dict[Swarm, float] = {}  # who is still alone, by the swarm that it is

    def handled(self, fls: Any, event: Any, actions: Any, cause: Any, now_s: float) -> None:
        machine = fls.machine
        if not machine.incarnation or not machine.awake:
            return
        own = Swarm(machine.fid, machine.incarnation)
        if machine.swarm == own:
            self._lit_s.setdefault(own, now_s)
        elif self._lit_s.get(own, NEVER) < NEVER:
            self.waits_s.append(now_s - self._lit_s[own])
            self._lit_s[own] = NEVER  # it has joined; later thaws are another matter

    @property
    def failed(self) -> int:
        """Replacements that failed while they were alone, or were alone at the end."""
        return sum(lit_s < NEVER for lit_s in self._lit_s.values())


def seen(run: Path) -> tuple[float, list[float], int]:
    """λ, how long each replacement was lit and alone, seconds, by the samples of any engine; how many never joined.

    Whoever has just landed and lit up stands still until it localizes, or follows: so it has joined when it moves, also
    where it is alone again at the next sample. To a sample, either way.
    """
    saved = load(run)
    if (timeline := saved.timeline) is None:
        raise ValueError(f"{run}: no timeline")
    launched = {event.fid: event.t_s for event in reversed(saved.events) if event.kind == "replacement"}
    waits_s: list[float] = []
    failed = 0
    for fid, first_s in launched.items():
        lit, place = timeline.lit[:, fid - 1], timeline.position[:, fid - 1]
        alone = timeline.swarm[:, fid - 1] == fid
        for at in np.flatnonzero(lit[1:] & ~lit[:-1]) + 1:
            if timeline.t_s[at] < first_s:
                continue
            dark = np.flatnonzero(~lit[at:])
            ends = at + int(dark[0]) if len(dark) else len(lit)
            joined = ~alone[at:ends] | (place[at:ends] != place[at]).any(axis=1)
            if joined.any():
                waits_s.append(float(timeline.t_s[at + int(joined.argmax())] - timeline.t_s[at]))
            else:
                failed += 1
    return float(saved.config["lambda_ms"]) / 1e3, waits_s, failed


def played(run: Path) -> tuple[float, list[float], int]:
    """What `seen` gives, when the run is played once more. Raises ValueError for another engine's."""
    plan = make_plan(load_config(run / "config.yaml"))
    if plan.config.engine != "virtual":
        raise ValueError(
            f"{run}: of the engine {plan.config.engine}; only virtual plays the same run again; joins_seen"
        )
    found = Joins()
    with VirtualEngine(plan, (found,)) as engine:
        engine.run(Onlooker())
    return plan.rules.lambda_s, found.waits_s, found.failed
