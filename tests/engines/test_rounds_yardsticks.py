"""Triangulation and trilateration round by round."""

import numpy as np
import pytest
from rounds_runs import plan_of, play

from swarmer.engines.array_technique import ArrayTechnique
from swarmer.engines.rounds_world import World
from swarmer.engines.rounds_yardsticks import YardstickRounds
from swarmer.errors import BadInput

YARDSTICKS = ("triangulation", "trilateration")
yardsticks = pytest.mark.parametrize("technique", YARDSTICKS)


def made(technique="trilateration", **settings):
    plan = plan_of(
        technique=technique, **{"shape": "butterfly", "points": None, "rounds.fids": "shape", **settings}
    )
    world = World(plan)
    return YardstickRounds(plan, world, ArrayTechnique(plan)), world


def test_confidence_by_hand():
    """R = L tan ε; a neighbour at distance D takes min(1/n, R / D), one that is missing 1/n."""
    rounds, world = made(epsilon_deg=2, eta=3)
    world.position = world.truth.copy()
    world.last_flight[:] = 0.0
    assert rounds.confidence() == pytest.approx(1.0)
    world.last_flight[0] = 5.0
    distance = np.sort(np.linalg.norm(world.truth - world.truth[0], axis=1))[1:4]
    radius = 5.0 * np.tan(np.radians(2))
    assert rounds.confidence()[0] == pytest.approx(1 - np.minimum(1 / 3, radius / distance).sum())
    world.last_flight[0] = 1e6
    assert rounds.confidence()[0] == pytest.approx(0.0)
    world.last_flight[0] = 0.0
    nearest = np.argsort(np.linalg.norm(world.truth - world.truth[0], axis=1))[1]
    world.position[nearest] += 50.0
    assert rounds.confidence()[0] == pytest.approx(1 - 1 / 3)
    half, of_half = made(epsilon_deg=2, eta=3, **{"rounds.yardstick_radius": "average"})
    of_half.position, of_half.last_flight[0] = of_half.truth.copy(), 5.0
    assert half.confidence()[0] == pytest.approx(1 - np.minimum(1 / 3, radius / 2 / distance).sum())


def test_those_who_move_together_are_no_neighbours():
    rounds, world = made(**{"rounds.fids": "drawn"})
    near = {row: set(rounds._near[row].tolist()) for row in range(len(world))}
    for _ in range(10):
        movers = set(rounds._movers().tolist())
        assert len(movers) > 1
        assert all(not near[row] & movers for row in movers)
        rounds.step()


def test_one_after_the_other_the_least_sure_moves():
    rounds, _ = made(**{"rounds.yardstick_order": "sequential"})
    sure = rounds.confidence()
    assert rounds._movers().tolist() == [int(np.argmin(sure))]
    assert rounds.step().localizing == 1


def test_with_all_others_in_place_one_comes_home():
    for technique in YARDSTICKS:
        rounds, world = made(technique)
        world.position = world.truth.copy()
        world.position[10] += [0.7, -0.4, 0.0]
        world.last_flight[:] = 0.0
        world.last_flight[10] = 20.0
        step = rounds.step()
        assert step.localizing == 1
        assert world.position[10] == pytest.approx(world.truth[10], abs=1e-6)
        assert world.last_flight[10] == pytest.approx(np.hypot(0.7, 0.4), abs=1e-6)


def test_one_that_fails_keeps_its_place_until_a_neighbour_moves():
    rounds, world = made()
    world.position = world.truth.copy()
    world.last_flight[:] = 0.0
    world.last_flight[10] = 20.0
    near = rounds._near[10]
    world.position[near] = world.position[near[0]]  # nobody's circles meet
    before = world.position.copy()
    movers = rounds._movers()
    assert 10 in movers
    step = rounds.step()
    assert step.failed >= 1
    assert world.position[10] == pytest.approx(before[10])
    assert rounds.frozen[10]
    assert rounds.failures["no_intersection"] >= 1
    world.position = world.truth.copy()
    world.last_flight[:] = 0.0
    world.last_flight[near[0]] = 20.0
    assert rounds.step().localizing == 1
    assert not rounds.frozen[10]


@yardsticks
def test_without_error_nobody_has_a_reason_to_move(technique):
    result, watcher = play(shape="butterfly", points=None, technique=technique, epsilon_deg=0)
    assert result.extra["rounds"] == 0
    assert "end" in watcher.kinds()
    assert watcher.samples[0].hd_cells == pytest.approx(0, abs=1e-9)


@yardsticks
def test_a_run_with_a_yardstick(technique):
    result, watcher = play(shape="butterfly", points=None, technique=technique, **{"rounds.max_rounds": 30})
    assert result.status == "done"
    assert not result.extra["converged"]
    assert result.extra["first_single_swarm_round"] is None
    assert "thaws_at_one_swarm" not in result.counters
    assert "single_swarm_count" not in result.extra
    assert all(len(np.unique(snapshot.swarm)) == 94 for snapshot in watcher.samples)
    again = play(shape="butterfly", points=None, technique=technique, **{"rounds.max_rounds": 30})[1]
    assert np.array_equal(watcher.samples[-1].position, again.samples[-1].position)


@yardsticks
def test_yardsticks_are_worse_than_swarmer(technique):
    """SwarMer, figure 25: at 1 degree both end above dead reckoning, SwarMer far below."""
    settings = {"shape": "butterfly", "points": None, "epsilon_deg": 1}
    worse = play(technique=technique, **settings)[0].round_rows
    swarmer = play(**settings)[0].round_rows
    assert worse[-1].hd_cells > worse[0].hd_cells > 0.3
    assert swarmer[-1].hd_cells < 0.09


@yardsticks
def test_in_3d_they_run(technique):
    result, _ = play(technique=technique, **{"rounds.max_rounds": 5})
    assert result.status == "done"
    assert result.counters["localizations"] > 0


def test_a_flight_error_is_flown_if_it_is_asked_for():
    settings = {"shape": "butterfly", "points": None, "technique": "trilateration", "rounds.max_rounds": 3}
    exact, erring = (
        play(**settings, **{"rounds.yardstick_flight_error": error})[1].samples[-1].position
        for error in (False, True)
    )
    assert exact != pytest.approx(erring)


@yardsticks
def test_too_few_points(technique):
    with pytest.raises(BadInput, match="too few points: it needs 4 or more, 3 are there"):
        plan_of(technique=technique, points=3, **{"rounds.dim": "flatten"})


@yardsticks
def test_only_rounds_have_several_references(technique):
    from swarmer.config import load_config
    from swarmer.plan import make_plan

    with pytest.raises(BadInput, match="needs 3 references at a time; only --engine rounds has them"):
        make_plan(load_config(engine="virtual", shape="butterfly", technique=technique))
