"""Run a swarm from Python and watch it: who is farthest from its point each second, and how far everybody flew.

    python watch.py points=100 duration_s=10

The arguments are settings, as after `--set`.
"""

import sys

import numpy as np

from swarmer.config import load_config
from swarmer.engines.named import make_engine
from swarmer.engines.result import Witness
from swarmer.plan import make_plan


class Farthest:
    """An observer: any engine calls these six, from one thread, and waits until they are done."""

    def planned(self, plan):
        """The plan stands and nothing has started."""
        self.truth, self.next_s = plan.cloud.points, 1.0

    def launching(self, ready, total):
        """So many FLSs are ready."""

    def go(self, launch_s):
        """Time 0."""

    def sample(self, snapshot):
        """Take a sample; True would end the run."""
        if snapshot.t_s >= self.next_s and snapshot.lit.any():
            self.next_s += 1.0
            error = np.linalg.norm(snapshot.position - self.truth, axis=1) * snapshot.lit
            print(
                f"{snapshot.t_s:5.1f} s  FLS {error.argmax() + 1} is {error.max():.3f} cells from its point"
            )
        return False

    def event(self, event):
        """Something worth a line: a failure, a replacement, a thaw."""
        print(f"{event.t_s:5.1f} s  {event.kind} {event.text}")

    def beat(self, t_s):
        """The run lives."""


class Flights(Witness):
    """A witness sees every event at every FLS, in virtual time alone; override what is of interest."""

    def __init__(self):
        self.cells = []

    def flew(self, fls, asked, flight, now_s):
        """A flight begins."""
        self.cells.append(flight.length)


if __name__ == "__main__":
    flights = Flights()
    plan = make_plan(load_config(None, ["engine=virtual", *sys.argv[1:]]))
    with make_engine(plan, [flights]) as engine:
        result = engine.run(Farthest())
    print(f"{result.status}: {len(flights.cells)} flights, {sum(flights.cells):.0f} cells in all")
