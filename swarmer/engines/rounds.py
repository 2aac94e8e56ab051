"""The rounds engine: the paper's simulator, array at a time, the same from the same seed (docs/rounds.md).

No clock, radio, lease, loss or failure: in a round every swarm may move once. This file holds a run together: it
deploys, plays rounds, reads the HD, samples, and ends. What a round does is in `rounds_swarms`, and for triangulation
and trilateration in `rounds_yardsticks`.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swarmer.engines.array_technique import ArrayTechnique
from swarmer.engines.result import Event, Live, Observer, RoundRow, RunResult, Snapshot, Witness
from swarmer.engines.rounds_swarms import Step, SwarmRounds
from swarmer.engines.rounds_world import HdReader, Rows, World
from swarmer.engines.stopping import told_to_stop
from swarmer.errors import RunFailed

if TYPE_CHECKING:
    from swarmer.plan import Plan

SMALL = 50_000  # FLSs: up to so many the HD is read in each round, if nobody says otherwise
NO_HEALTH = Live(None, None, None, None, None, None)


class Rounds(Protocol):
    """What is played round by round."""

    xi: Rows
    state: NDArray[np.int8]
    failures: Counter[str]  # fixes that failed, by reason; a yardstick's

    @property
    def single(self) -> bool: ...

    def thaw(self) -> None: ...

    def step(self) -> Step | None: ...


class RoundsEngine:
    """Runs one plan in rounds. Made and given back as a context; `run` runs once."""

    name = "rounds"

    def __init__(self, plan: Plan, witnesses: Sequence[Witness] = ()) -> None:
        """witnesses: nobody sees a round from inside, so there are none."""
        self.plan = plan

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is held beyond `run`."""

    def run(self, observer: Observer) -> RunResult:
        """Run to the end, the goal, Ctrl-C or a failure; the result says which. Raises RunFailed if `observer` does."""
        observer.planned(self.plan)
        return _Run(self.plan, observer).play()


class _Run:
    def __init__(self, plan: Plan, observer: Observer) -> None:
        self.plan, self.observer, self.settings = plan, observer, plan.config.rounds
        self.result = RunResult(RoundsEngine.name, "done", 0.0, 0.0, in_rounds=True)
        self.rows: list[RoundRow] = self.result.round_rows
        self.number = 0  # of the round
        self.thaws = 0
        self.formations: list[int] = []  # rounds that ended with one swarm
        self.converged = False
        self.stopping = False
        self._went_wall = 0.0

    def play(self) -> RunResult:
        result = self.result
        with told_to_stop(self._interrupt):
            try:
                self._launch()
                self._live()
            except KeyboardInterrupt:  # where the signals are not ours to catch
                result.status = "interrupted"
            except RunFailed as failure:
                result.status, result.message = "failed", str(failure)
            self._sum_up()
        return result

    def _interrupt(self) -> None:
        self.result.status = "interrupted"
        self.stopping = True

    def _launch(self) -> None:
        began = time.monotonic()
        self.observer.launching(0, self.plan.size)
        self.world = World(self.plan)
        self.technique = ArrayTechnique(self.plan)
        self.hd = HdReader(self.plan, self.world)
        self.rounds: Rounds = make_rounds(self.plan, self.world, self.technique)
        self.observer.launching(self.plan.size, self.plan.size)
        self._went_wall = time.monotonic()
        self.result.launch_s = self._went_wall - began
        self.observer.go(self.result.launch_s)

    def _live(self) -> None:
        """The deployment, then round after round until told to stop."""
        self._look(None, self.hd.read())
        while not self.stopping and self.number < self.settings.max_rounds and self.technique.references:
            step = self.rounds.step()
            if step is None:
                self._say("end", "nobody moves any more")
                break
            self.number += 1
            single = self.rounds.single
            last = self.number == self.settings.max_rounds
            hd = self.hd.read() if single or last or self._reads_every_round() else math.nan
            self._look(step, hd)
            if single:
                self._formed(hd)

    def _reads_every_round(self) -> bool:
        every = self.settings.hd_every
        return every == "round" or (every == "auto" and self.plan.size <= SMALL)

    def _formed(self, hd: float) -> None:
        """All FLSs are one swarm: the end, or a thaw."""
        self.formations.append(self.number)
        if self.settings.stop == "hd" and hd < self.settings.stop_hd_cells:
            self.converged = self.stopping = True
        elif self.thaws == self.settings.max_thaws:
            self.stopping = True
        elif self.number < self.settings.max_rounds and not self.stopping:
            self.rounds.thaw()
            self.thaws += 1
            self._say("thaw", f"thaw {self.thaws}, HD {hd:.3g} cells")

    def _look(self, step: Step | None, hd: float) -> None:
        """Write the round down, and show it."""
        self.result.emulated_s = float(self.number)
        row = row_of(self.number, step, self.rounds.xi, hd)
        if len(self.world.oracles) and row.hd_cells is not None:
            row = row._replace(hd_absolute_cells=self.hd.absolute())
        self.rows.append(row)
        everybody = np.ones(self.plan.size, dtype=np.bool_)
        snapshot = Snapshot(
            t_s=float(self.number),
            position=self.world.by_point(self.world.position),
            swarm=self.world.by_point(self.world.point[self.rounds.xi] + 1).astype(np.int32),
            state=self.world.by_point(self.rounds.state),
            lit=everybody,
            alive=everybody.copy(),
            counters=self._counters(),
            live=NO_HEALTH,
            flown=self.world.by_point(self.world.flown),
            hd_cells=hd,
            localized=step.localized if step is not None and step.localizing else None,
        )
        if self.observer.sample(snapshot):
            self.stopping = True

    def _say(self, kind: str, text: str) -> None:
        self.observer.event(Event(float(self.number), kind, 0, text))

    def _counters(self) -> dict[str, float]:
        swarms = self.technique.references == 1
        return {
            "localizations": sum(row.localizing for row in self.rows),
            "anchorings": sum(row.anchors for row in self.rows),
            "thaws": self.thaws,
            # Every one is, but the last formation may end the run.
            **({"thaws_at_one_swarm": self.thaws} if swarms else {}),
            "distance_cells": self.world.flown_cells,
            "localizing_cells": sum(row.localizing_cells for row in self.rows),
            "following_cells": sum(row.swarm_cells for row in self.rows),
        }

    def _sum_up(self) -> None:
        result = self.result
        if not self._went_wall:
            return
        result.wall_s = time.monotonic() - self._went_wall
        result.counters = self._counters()
        result.processes = 1
        result.extra = {
            "rounds": self.number,
            "converged": self.converged,
            "first_single_swarm_round": self.formations[0] if self.formations else None,
            "formation_rounds": self.formations,
            "distance_localizing_cells": result.counters["localizing_cells"],
            "distance_swarm_cells": result.counters["following_cells"],
        }
        if self.technique.references == 1:
            result.extra["single_swarm_count"] = len(
                self.formations
            )  # also where two rounds in a row made one
        else:  # no swarms: the HD at the end says it
            hd = self.rows[-1].hd_cells
            result.extra["converged"] = hd is not None and hd < self.settings.stop_hd_cells
        if self.technique.references > 1:
            result.extra["fixes_failed"] = dict(self.rounds.failures)


def make_rounds(plan: Plan, world: World, technique: ArrayTechnique) -> Rounds:
    """Swarms, or for a technique of several references FLSs that move each for itself."""
    if technique.references > 1:
        from swarmer.engines.rounds_yardsticks import YardstickRounds

        return YardstickRounds(plan, world, technique)
    return SwarmRounds(plan, world, technique)


def row_of(number: int, step: Step | None, xi: Rows, hd: float) -> RoundRow:
    """The line of a round; step: what it did, None for the deployment. xi: the swarms at its end."""
    sizes = np.unique(xi, return_counts=True)[1]
    groups = step.groups if step is not None else np.zeros(0)
    flights = step.flights if step is not None else np.zeros(0)
    return RoundRow(
        round=number,
        swarms=len(sizes),
        hd_cells=None if math.isnan(hd) else hd,
        localizing=step.localizing if step else 0,
        anchors=step.anchors if step else 0,
        busy_joins=step.busy_joins if step else 0,
        waves=step.waves if step else 0,
        size_min=int(sizes.min()),
        size_mean=float(sizes.mean()),
        size_max=int(sizes.max()),
        group_min=int(groups.min()) if len(groups) else 0,
        group_mean=float(groups.mean()) if len(groups) else 0.0,
        group_max=int(groups.max()) if len(groups) else 0,
        flight_min=float(flights.min()) if len(flights) else 0.0,
        flight_mean=float(flights.mean()) if len(flights) else 0.0,
        flight_max=float(flights.max()) if len(flights) else 0.0,
        localizing_cells=step.localizing_cells if step else 0.0,
        swarm_cells=step.swarm_cells if step else 0.0,
        failed=step.failed if step else 0,
    )
