"""What a round does to positions: localizing FLSs and their swarms fly, wave after wave (rule 8, docs/rounds.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.engines.result import Localized
from swarmer.engines.rounds_groups import Groups
from swarmer.engines.rounds_links import Rows, Swarms, Vectors, ranges
from swarmer.engines.rounds_world import FOLLOWING, LOCALIZING
from swarmer.physics.dead_reckoning_arrays import lengths

if TYPE_CHECKING:
    from swarmer.engines.array_technique import ArrayTechnique
    from swarmer.engines.rounds_world import World

BESIDE_CELLS = 0.1  # how far beside the anchor the authors' first leg of Physical Movement ends


class Moves(NamedTuple):
    """How far everybody flew in a round."""

    lengths: NDArray[np.float64]  # |V| of each localization, cells, 0 where it was too short to fly
    localizing_cells: float  # by the localizing FLSs
    swarm_cells: float  # by all members of their swarms besides
    localized: Localized  # who flew to where a localization led, from where it was to where it came


def carry_out(
    world: World,
    technique: ArrayTechnique,
    swarms: Swarms,
    groups: Groups,
    threshold_cells: float = 0.0,
    exact_first_leg: bool = False,
) -> Moves:
    """Fly all localizations of a round, each wave's V measured when the wave starts.

    threshold_cells: shorter vectors are not flown. exact_first_leg: of a technique with legs, as the authors' program.
    """
    flown, localized = np.zeros(len(groups.swarm)), []
    localizing = swarm_cells = 0.0
    last = int(groups.wave.max(initial=0))
    for wave in range(1, last + 1):
        at = np.flatnonzero(groups.wave == wave)
        j, i, swarm = groups.localizer[at], groups.anchor[at], groups.swarm[at]
        measured = world.position[i] - world.position[j]
        ground_truth = world.truth[i] - world.truth[j]
        vectors = technique.displacements(measured, ground_truth)
        length = lengths(vectors)
        flies = length > 0 if threshold_cells == 0 else length >= threshold_cells
        at, j, swarm, vectors, length = at[flies], j[flies], swarm[flies], vectors[flies], length[flies]
        flown[at] = length
        start = world.position[j]
        members, of = _members(swarms, swarm)
        swarm_cells += float((length * (swarms.sizes[swarm] - 1)).sum())
        if not technique.has_legs:
            localizing += float(length.sum())
            world.fly(members, vectors[of], np.where(members == j[of], LOCALIZING, FOLLOWING))
        else:
            follows = members != j[of]
            world.fly(members[follows], vectors[of[follows]], FOLLOWING)
            localizing += _fly_legs(
                world, technique, j, measured[flies], ground_truth[flies], exact_first_leg
            )
        localized.append((j, i[flies], start, world.position[j] - start))
    return Moves(flown, localizing, swarm_cells, _told(world, localized))


def _told(world: World, localized: list[tuple[Rows, Rows, Vectors, Vectors]]) -> Localized:
    """Rows of localizing FLSs and of their anchors, starts and vectors, wave by wave, as an observer is told."""
    none: tuple[Rows, Rows, Vectors, Vectors] = (
        np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3))
    )  # fmt: skip
    j, i, start, vector = (np.concatenate(parts) for parts in zip(none, *localized, strict=True))
    return Localized(
        (world.point[j] + 1).astype(np.int32), (world.point[i] + 1).astype(np.int32),
        start.astype(np.float32), vector.astype(np.float32),
    )  # fmt: skip


def _members(swarms: Swarms, moving: Rows) -> tuple[Rows, Rows]:
    """All members of swarms, and of which entry of `moving` each is one."""
    counts = swarms.sizes[moving]
    return swarms.members[ranges(swarms.starts[moving], counts)], np.repeat(np.arange(len(moving)), counts)


def _fly_legs(
    world: World,
    technique: ArrayTechnique,
    rows: Rows,
    measured: Vectors,
    ground_truth: Vectors,
    exact_first_leg: bool,
) -> float:
    """The localizing FLSs fly leg after leg; the cells they flew."""
    cells = 0.0
    legs = technique.legs(measured, ground_truth)
    if exact_first_leg:
        beside = np.sign(legs[0][:, 0]) * BESIDE_CELLS
        legs[0] = legs[0] - np.stack([beside, 0 * beside, 0 * beside], axis=1)
        legs[1] = legs[1] + np.stack([beside, 0 * beside, 0 * beside], axis=1)
    for number, leg in enumerate(legs):
        world.fly(rows, leg, exact=exact_first_leg and number == 0)
        cells += float(lengths(leg).sum())
    return cells
