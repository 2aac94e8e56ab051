"""SwarMer round by round: swarms gather, localize, merge and thaw (docs/rounds.md)."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.engines.array_technique import ArrayTechnique
from swarmer.engines.rounds_groups import (
    Groups,
    group_all,
    merged,
    pair_exact,
    pair_fast,
    select_anchors,
)
from swarmer.engines.rounds_links import Nearest, Planned, Rows, Sight, Swarms, challengers, live_links
from swarmer.engines.rounds_moves import Moves, carry_out
from swarmer.engines.rounds_world import World, generator
from swarmer.state_machine import State

if TYPE_CHECKING:
    from swarmer.engines.result import Localized
    from swarmer.plan import Plan


class Step(NamedTuple):
    """What one round did; lengths in cells."""

    localizing: int
    anchors: int
    busy_joins: int
    waves: int
    groups: Rows  # swarms of each group: those that localized relative to one swarm, and that one
    flights: NDArray[np.float64]  # |V| of each localization
    localizing_cells: float
    swarm_cells: float
    failed: int = 0
    localized: Localized | None = None


class SwarmRounds:
    """Swarm-IDs and roles of all FLSs, and the rule that takes them from one round to the next."""

    def __init__(self, plan: Plan, world: World, technique: ArrayTechnique) -> None:
        config = plan.config
        self._world, self._technique, self._settings = world, technique, config.rounds
        planned = config.rounds.neighbours == "planned"
        self._planned = Planned(plan.neighbours.neighbours, world.point) if planned else None
        self._eta, self._pairs = plan.neighbours.eta, config.m == 2
        self._rng = generator(config.seed, "pairing")
        self._oracles = world.oracles
        self.failures: Counter[str] = Counter()
        self.xi: Rows = np.arange(len(world))  # lowest row of the swarm of each FLS
        self.state: NDArray[np.int8] = np.full(len(world), State.AVAILABLE, dtype=np.int8)

    @property
    def single(self) -> bool:
        """Whether all FLSs are one swarm."""
        return not self.xi.any()

    def thaw(self) -> None:
        """Every FLS is a swarm of its own again, where it is."""
        self.xi = np.arange(len(self._world))

    def step(self) -> Step:
        """Play one round. Raises PluginFailed."""
        swarms = Swarms.of_ids(self.xi)
        absolute = np.zeros(len(swarms), dtype=np.bool_)
        absolute[swarms.of[self._oracles]] = True
        groups = self._groups(swarms, absolute)
        measuring = groups.measuring(absolute)
        moves = carry_out(
            self._world,
            self._technique,
            swarms,
            measuring,
            self._settings.threshold_cells,
            self._settings.pm_first_leg == "exact",
        )
        self.xi = merged(swarms, groups)
        self._tell_roles(swarms, measuring)
        return _summed_up(groups, measuring, moves)

    def _groups(self, swarms: Swarms, absolute: NDArray[np.bool_]) -> Groups:
        settings, position = self._settings, self._world.position
        if self._pairs and settings.pairing == "exact":
            return pair_exact(position, swarms, absolute)
        selection = select_anchors(settings.anchor, swarms, self._rng, absolute)
        sight: Sight = self._planned or Nearest(position, self._eta, self._world.dim)
        if self._pairs:
            return pair_fast(live_links(sight, swarms), position, swarms, selection)
        order = self._rng.permutation(len(swarms)) if settings.order == "random" else np.arange(len(swarms))
        return group_all(challengers(sight, swarms), swarms, order, selection)

    def _tell_roles(self, swarms: Swarms, groups: Groups) -> None:
        """States as the emulator's recordings show them: what each FLS did in this round."""
        busy = np.zeros(len(swarms), dtype=np.bool_)
        busy[groups.swarm] = busy[groups.anchor_swarm] = True
        self.state = np.where(busy[swarms.of], State.WAITING, State.AVAILABLE).astype(np.int8)
        self.state[groups.anchor] = State.BUSY_ANCHOR
        self.state[groups.localizer] = State.BUSY_LOCALIZING


def _summed_up(groups: Groups, measuring: Groups, moves: Moves) -> Step:
    return Step(
        localizing=len(measuring.localizer),
        anchors=len(np.unique(measuring.anchor)),
        busy_joins=groups.busy_joins,
        waves=int(measuring.wave.max(initial=0)),
        groups=np.unique(groups.anchor_swarm, return_counts=True)[1] + 1,
        flights=moves.lengths,
        localizing_cells=moves.localizing_cells,
        swarm_cells=moves.swarm_cells,
        localized=moves.localized,
    )
