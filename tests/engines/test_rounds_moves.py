"""What a round does to positions, by hand: a line of points 2 cells apart, flights without error."""

import numpy as np
import pytest
from rounds_runs import in_rows, world_at

from swarmer.engines.rounds_groups import Groups
from swarmer.engines.rounds_links import Swarms
from swarmer.engines.rounds_moves import carry_out
from swarmer.errors import RunFailed

PLACES = [[0, 0, 0], [5, 1, 0], [3, 3, 3], [6, 0, 0.5]]


def groups(*rows):
    localizer, anchor, swarm, anchor_swarm, wave = map(in_rows, zip(*rows, strict=True))
    return Groups(localizer, anchor, swarm, anchor_swarm, wave, 0)


def test_after_a_localization_both_stand_as_their_points_do():
    world, technique = world_at(PLACES)
    moves = carry_out(world, technique, Swarms.of_ids(np.arange(4)), groups((1, 0, 1, 0, 1)))
    assert world.position[1] == pytest.approx([2, 0, 0])
    assert moves.lengths == pytest.approx([np.sqrt(10)])
    assert moves.localizing_cells == pytest.approx(np.sqrt(10))
    assert moves.swarm_cells == 0


def test_the_swarm_flies_the_same_vector():
    world, technique = world_at(PLACES)
    swarms = Swarms.of_ids(in_rows([0, 1, 1, 3]))
    moves = carry_out(world, technique, swarms, groups((1, 0, 1, 0, 1)))
    assert world.position[1] == pytest.approx([2, 0, 0])
    assert world.position[2] == pytest.approx([0, 2, 3])  # [3, 3, 3] + [-3, -1, 0]
    assert world.position[3] == pytest.approx(PLACES[3])
    assert moves.swarm_cells == pytest.approx(np.sqrt(10))
    assert world.last_flight.tolist()[1:3] == pytest.approx([np.sqrt(10)] * 2)


def test_a_later_wave_measures_where_its_anchor_has_come_to():
    world, technique = world_at(PLACES)
    carry_out(world, technique, Swarms.of_ids(np.arange(4)), groups((2, 1, 2, 1, 2), (1, 0, 1, 0, 1)))
    assert world.position[:3] == pytest.approx(np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0]]))


def test_what_is_shorter_than_the_threshold_is_not_flown_and_counts_nothing():
    world, technique = world_at(PLACES)
    one, both = groups((1, 0, 1, 0, 1)), groups((1, 0, 1, 0, 1), (3, 0, 3, 0, 1))
    assert carry_out(world, technique, Swarms.of_ids(np.arange(4)), one, 4.0).lengths.tolist() == [0]
    assert world.position == pytest.approx(np.array(PLACES))
    moves = carry_out(world, technique, Swarms.of_ids(np.arange(4)), both, 3.0)
    assert moves.lengths == pytest.approx([np.sqrt(10), 0.0])  # that of 3 is half a cell


def test_physical_movement_flies_to_the_anchor_first_and_its_swarm_straight():
    world, technique = world_at(PLACES, technique="physical_movement")
    swarms = Swarms.of_ids(in_rows([0, 1, 1, 3]))
    moves = carry_out(world, technique, swarms, groups((1, 0, 1, 0, 1)))
    assert world.position[1] == pytest.approx([2, 0, 0])
    assert world.position[2] == pytest.approx([0, 2, 3])
    assert moves.localizing_cells == pytest.approx(np.sqrt(26) + 2)
    assert moves.swarm_cells == pytest.approx(np.sqrt(10))


def test_the_authors_first_leg_ends_beside_the_anchor_without_error():
    world, technique = world_at(PLACES, technique="physical_movement", epsilon_deg=45)
    moves = carry_out(world, technique, Swarms.of_ids(np.arange(4)), groups((1, 0, 1, 0, 1)), 0.0, True)
    # to [0.1, 0, 0], for it comes from larger L, and from there 1.9 cells, with error
    assert moves.localizing_cells == pytest.approx(np.hypot(4.9, 1) + 1.9)
    assert np.linalg.norm(world.position[1] - [0.1, 0, 0]) == pytest.approx(1.9)


def test_nobody_groups_nobody_flies():
    world, technique = world_at(PLACES)
    none = Groups(*[in_rows([])] * 5, 0)
    assert carry_out(world, technique, Swarms.of_ids(np.arange(4)), none).localizing_cells == 0


def test_a_technique_that_answers_no_vectors_ends_the_round(monkeypatch):
    world, technique = world_at(PLACES)
    plugin = type("Bad", (), {"displacements": lambda self, d, g: d[:, :2]})()
    monkeypatch.setattr(technique, "_plugin", plugin)
    with pytest.raises(
        RunFailed,
        match=r"technique: 'signal_strength' of the package swarmer .*: displacements gave an array",
    ):
        carry_out(world, technique, Swarms.of_ids(np.arange(4)), groups((1, 0, 1, 0, 1)))
