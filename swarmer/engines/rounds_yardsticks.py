"""The yardsticks round by round: no swarms, each FLS takes its position from some neighbours (docs/rounds.md).

Who is least sure of where it is moves first: an FLS loses confidence with the length of its last flight, and with
neighbours that are not where they should be. Measurements are exact, the paper's favour to the yardsticks.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations
from math import comb, tan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmer.engines.array_technique import ArrayTechnique
from swarmer.engines.rounds_links import Rows, Vectors
from swarmer.engines.rounds_swarms import Step
from swarmer.engines.rounds_world import World, generator
from swarmer.physics.dead_reckoning_arrays import lengths
from swarmer.plugins.fixing import FIXED
from swarmer.shapes.neighbours import nearest_table
from swarmer.state_machine import State

if TYPE_CHECKING:
    from swarmer.plan import Plan

TRIES = 20  # sets of references that an FLS tries in a round
LISTED = 500  # sets: where there are more they are drawn, not listed
MISSING = 2.0  # a neighbour farther than this times the planned distance is not seen


class YardstickRounds:
    """Who moves in a round, and where to."""

    def __init__(self, plan: Plan, world: World, technique: ArrayTechnique) -> None:
        config = plan.config
        self._world, self._technique, self._settings = world, technique, config.rounds
        k = min(max(technique.references, plan.neighbours.eta), len(world) - 1)
        near, distance = nearest_table(world.truth, k)
        self._near: Rows = near.astype(np.int64) - 1  # (F, k)
        self._distance: Vectors = distance  # (F, k), planned, cells
        share = {"worst": 1.0, "average": 0.5}[config.rounds.yardstick_radius]
        self._error_per_cell = share * tan(plan.rules.epsilon)
        self._rng = generator(config.seed, "references")
        self.frozen = np.zeros(len(world), dtype=np.bool_)  # failed, and no neighbour has moved since
        self.failures: Counter[str] = Counter()
        self.xi: Rows = np.arange(len(world))
        self.state: NDArray[np.int8] = np.full(len(world), State.AVAILABLE, dtype=np.int8)

    @property
    def single(self) -> bool:
        """There are no swarms."""
        return False

    def thaw(self) -> None:
        """There is nothing to thaw."""

    def confidence(self) -> NDArray[np.float64]:
        """(F,): C = 1 - sum over the n neighbours of min(1/n, R / |g_f - g_k|), and 1/n for one that is missing.

        R = L tan ε of the latest flight, of length L, or half of it.
        """
        position, n = self._world.position, self._near.shape[1]
        radius = self._error_per_cell * self._world.last_flight
        lost = np.minimum(1 / n, radius[:, None] / self._distance)
        apart = np.linalg.norm(position[self._near] - position[:, None], axis=2)
        lost[apart > MISSING * self._distance] = 1 / n
        sure: NDArray[np.float64] = 1 - lost.sum(axis=1)
        return sure

    def step(self) -> Step | None:
        """Play one round; None if nobody has a reason to move. Raises PluginFailed."""
        movers = self._movers()
        if not len(movers):
            return None
        vectors, references, reasons = self._fixes(movers)
        fixed = reasons == FIXED
        rows, vectors = movers[fixed], vectors[fixed]
        self._world.fly(rows, vectors, exact=not self._settings.yardstick_flight_error)
        self._world.last_flight[rows] = lengths(vectors)
        self.failures.update(reasons[~fixed].tolist())
        self.frozen[movers[~fixed]] = True
        self.frozen[np.isin(self._near, rows).any(axis=1)] = False
        used = np.unique(references[fixed])
        self.state = np.full(len(self._world), State.AVAILABLE, dtype=np.int8)
        self.state[used] = State.BUSY_ANCHOR
        self.state[rows] = State.BUSY_LOCALIZING
        return Step(
            localizing=len(rows),
            anchors=len(used),
            busy_joins=0,
            waves=1,
            groups=np.zeros(0, dtype=np.int64),
            flights=lengths(vectors),
            localizing_cells=float(lengths(vectors).sum()),
            swarm_cells=0.0,
            failed=int((~fixed).sum()),
        )

    def _movers(self) -> Rows:
        """Who is eligible, and least sure of itself and its neighbours; of equal ones the lower FID."""
        sure = self.confidence()
        eligible = (sure < self._settings.yardstick_confidence) & ~self.frozen
        count = len(sure)
        rank = np.empty(count, dtype=np.int64)
        rank[np.argsort(sure, kind="stable")] = np.arange(count)
        rank[~eligible] = count
        if self._settings.yardstick_order == "sequential":
            return np.flatnonzero(eligible & (rank == rank.min()))
        least = rank[self._near].min(axis=1)
        # Neighbourhood is not mutual: whom I see may not see me, and must not move when I do either.
        np.minimum.at(least, self._near.ravel(), np.repeat(rank, self._near.shape[1]))
        return np.flatnonzero(eligible & (rank < least))

    def _fixes(self, movers: Rows) -> tuple[Vectors, Rows, NDArray[np.str_]]:
        """Vector, references and reason of failure of each mover, from the first set of references that gives a fix."""
        position, truth = self._world.position, self._world.truth
        sets = self._sets(len(movers))  # (n, tries, references), places among the neighbours
        vectors = np.full((len(movers), 3), np.nan)
        references = np.zeros((len(movers), sets.shape[2]), dtype=np.int64)
        reasons = np.full(len(movers), "", dtype="<U32")
        left = np.arange(len(movers))
        for attempt in range(sets.shape[1]):
            rows = movers[left]
            chosen = np.take_along_axis(self._near[rows], sets[left, attempt], axis=1)
            measured, planned = (where[chosen] - where[rows][:, None] for where in (position, truth))
            found = self._technique.fixes(measured, planned, self._world.dim)
            vectors[left], references[left], reasons[left] = found.vector, chosen, found.failure
            left = left[found.failure != FIXED]
            if not len(left):
                break
        return vectors, references, reasons

    def _sets(self, count: int) -> Rows:
        """(count, tries, references): sets of references in a random order."""
        k, needed = self._near.shape[1], self._technique.references
        number = comb(k, needed)
        if number > LISTED:
            return self._rng.random((count, TRIES, k)).argsort(axis=2)[:, :, :needed]
        every = np.array(list(combinations(range(k), needed)))
        return every[self._rng.random((count, number)).argsort(axis=1)[:, :TRIES]]
