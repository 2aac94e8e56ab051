"""FLSs that know where they are, in rounds: the display comes to stand where it should, as in virtual time."""

import numpy as np
import pytest
from rounds_runs import plan_of, play

from swarmer.config import load_config
from swarmer.engines.rounds_world import World
from swarmer.errors import BadInput
from swarmer.observe.summary import make_summary

CAT = {"shape": "cat", "points": None}


def absolute(result):
    return [row.hd_absolute_cells for row in result.round_rows]


@pytest.mark.parametrize("strategy", ["largest", "lowest", "challenger"])
@pytest.mark.parametrize("m", ["inf", 2])
def test_one_oracle_puts_the_display_where_it_should_stand(strategy, m):
    settings = {**CAT, "m": m, "rounds.anchor": strategy, "rounds.max_rounds": 30, "rounds.stop": "none"}
    (relative, one), (result, other) = play(**settings), play(**settings, **{"oracle.count": 1})
    assert absolute(relative) == [None] * len(relative.round_rows)
    assert result.round_rows[-1].hd_cells < 0.05
    assert absolute(result)[-1] < 0.05
    assert beside(other) < 0.02 < beside(one)


def beside(watcher):
    """How far the mean of all FLSs is from the mean of their points at the end."""
    return np.linalg.norm((watcher.samples[-1].position - watcher.plan.cloud.points).mean(axis=0))


@pytest.mark.parametrize(("m", "pairing"), [("inf", "fast"), (2, "fast"), (2, "exact")])
def test_oracles_never_move_once_they_have_landed(m, pairing):
    settings = {**CAT, "m": m, "rounds.pairing": pairing, "oracle.count": 3, "rounds.stop": "none"}
    result, watcher = play(**settings, **{"rounds.max_rounds": 25})
    rows = np.array(watcher.plan.rules.oracles) - 1
    truth = watcher.plan.cloud.points[rows]
    for sample in watcher.samples:
        assert np.abs(sample.position[rows] - truth).max() < watcher.plan.config.flight_threshold_cells
    assert result.counters["thaws"] >= 2


def test_all_others_have_the_flight_errors_that_they_have_without():
    plans = [plan_of(**CAT, **{"oracle.count": count}) for count in (0, 2)]
    without, with_two = map(World, plans)
    others = np.setdiff1d(np.arange(len(without)), with_two.oracles)
    assert (without.position[others] == with_two.position[others]).all()
    assert with_two.flown_cells > without.flown_cells
    assert sorted(with_two.point[with_two.oracles] + 1) == sorted(plans[1].rules.oracles)


def test_where_everybody_knows_nobody_measures():
    result, watcher = play(points=20, **{"oracle.count": 20, "epsilon_deg": 5})
    assert result.extra["converged"]
    assert result.counters["localizations"] == 0
    summary = make_summary(watcher.progress, result, "sphere", 20, 1)
    assert summary["rounds_to_hd_absolute"]["0.01"] == 0
    assert summary["time_to_hd_absolute_s"] is None


def test_an_absolute_hd_of_exactly_nothing_counts():
    _, watcher = play(points=20, **{"oracle.count": 1, "epsilon_deg": 0})
    assert watcher.progress.time_to_hd_absolute_s == dict.fromkeys(watcher.progress.time_to_hd_s, 0.0)


@pytest.mark.parametrize("technique", ["trilateration", "dead_reckoning"])
def test_a_technique_without_swarms_has_no_use_for_oracles(technique):
    with pytest.raises(BadInput) as refused:
        plan_of(shape="butterfly", points=None, technique=technique, **{"oracle.count": 1})
    assert f"oracle.count: 1 is not allowed; 0, for technique {technique} has no swarms" in str(refused.value)


def test_what_has_an_effect_is_not_said_to_have_none():
    settings = {"engine": "rounds", "flight_threshold_cells": 0.01}
    assert load_config(None, (), **settings, **{"oracle.count": 1}).ignored() == []
    [line] = load_config(None, (), **settings).ignored()
    assert line.startswith("flight_threshold_cells: no effect with the engine rounds")
