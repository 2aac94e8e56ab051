"""An engine: FLSs that know where they are. Each flies straight to its point; what a run of theirs leaves is a run.

    python perfect.py RUN shape=cat points=100

RUN is the directory to write, and the other arguments are settings, as after `--set`.
"""

import sys
import time
from pathlib import Path

import numpy as np

from swarmer.config import load_config
from swarmer.engines.result import Live, RunResult, Snapshot
from swarmer.observe.collector import Collector
from swarmer.observe.run_directory import RunDirectory
from swarmer.physics.flight import duration, travelled
from swarmer.plan import make_plan, make_velocity
from swarmer.state_machine import State


class Perfect:
    """What any engine has: a name, and `run`, which tells an observer all it needs and gives a RunResult."""

    name = "perfect"

    def __init__(self, plan):
        self.plan, self.velocity = plan, make_velocity(plan.rules)

    def run(self, observer):
        """Fly until everybody is there, or the observer has seen enough."""
        plan, began = self.plan, time.monotonic()
        truth = plan.cloud.points
        lengths = np.linalg.norm(truth, axis=1)  # of the ways from the origin
        until_s = np.array([duration(length, self.velocity) for length in lengths])
        observer.planned(plan)
        observer.go(0.0)
        t_s, step_s = 0.0, 1 / plan.config.recording.rate_hz
        while (
            not observer.sample(self.snapshot(t_s, truth, lengths, until_s)) and t_s < plan.config.duration_s
        ):
            t_s += step_s
        counters = {"distance_cells": float(lengths.sum())}
        return RunResult(self.name, "done", t_s, time.monotonic() - began, counters=counters)

    def snapshot(self, t_s, truth, lengths, until_s):
        """Everybody at one moment; row i is FID i + 1."""
        ways = zip(lengths, until_s, strict=True)
        share = np.array([travelled(t_s, length, until, self.velocity) / length for length, until in ways])
        lit = share >= 1.0
        return Snapshot(
            t_s=t_s,
            position=truth * share[:, None],
            swarm=lit.astype(np.int32),  # all are swarm 1; 0 while dark
            state=np.where(lit, State.AVAILABLE, State.DEPLOYING).astype(np.int8),
            lit=lit,
            alive=np.ones(len(truth), dtype=bool),
            counters={},
            live=Live(None, None, None, None, None, None),
        )


if __name__ == "__main__":
    out, *settings = sys.argv[1:]
    config = load_config(None, settings)
    directory = RunDirectory.create(Path(out), config.shape, config.seed, sys.argv)
    collector = Collector(directory)  # the observer that makes a run directory
    summary = collector.finish(Perfect(make_plan(config)).run(collector))
    print(f"HD {summary['hd_cells']:.3g} cells after {summary['emulated_s']:.1f} s")
