"""What the tests of the rounds engine share: runs without files, and worlds made by hand."""

from __future__ import annotations

import numpy as np
from virtual_runs import Watcher

from swarmer.config import load_config
from swarmer.engines.array_technique import ArrayTechnique
from swarmer.engines.result import RunResult
from swarmer.engines.rounds import RoundsEngine
from swarmer.engines.rounds_world import World
from swarmer.plan import Plan, make_plan


def plan_of(preset=None, **settings) -> Plan:
    return make_plan(
        load_config(preset, (), engine="rounds", **{"shape": "sphere", "points": 60, **settings})
    )


def play(on_sample=lambda snapshot: False, preset=None, **settings) -> tuple[RunResult, Watcher]:
    """Run a small shape in rounds; the result, and who watched."""
    watcher = Watcher(on_sample)
    with RoundsEngine(plan_of(preset, **settings)) as engine:
        return engine.run(watcher), watcher


def in_rows(values, as_type=np.int64):
    return np.array(values, dtype=as_type)


def world_at(position, **settings) -> tuple[World, ArrayTechnique]:
    """FLSs of a line of points 2 cells apart that are where the test wants them, and fly without error."""
    position = np.array(position, dtype=float)
    plan = plan_of(points=len(position), **{"epsilon_deg": 0, "rounds.fids": "shape", **settings})
    world = World(plan)
    world.truth = np.arange(len(position))[:, None] * np.array([[2.0, 0.0, 0.0]])
    world.position = position
    return world, ArrayTechnique(plan)
