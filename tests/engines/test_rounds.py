"""Whole runs in rounds: what must hold for any seed, how they end, and the figures of the paper that they reach."""

import math
import os
import signal
from statistics import mean

import numpy as np
import pytest
from rounds_runs import plan_of, play

from swarmer.errors import BadInput
from swarmer.metrics.hausdorff import hausdorff
from swarmer.shapes.generators import sphere
from swarmer.state_machine import State

RANDOM = {"deploy.start": "random"}


def cloud_file(tmp_path, points, name="cloud.xyz"):
    path = tmp_path / name
    np.savetxt(path, points, fmt="%.9f")
    return str(path)


def path_of(watcher):
    return np.stack([snapshot.position for snapshot in watcher.samples])


def test_without_error_the_deployment_is_the_shape():
    result, watcher = play(epsilon_deg=0)
    assert result.status == "done"
    assert watcher.samples[0].hd_cells == pytest.approx(0, abs=1e-9)
    assert result.extra["converged"]
    assert result.extra["rounds"] == result.extra["first_single_swarm_round"]
    assert result.extra["distance_localizing_cells"] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("settings", [{}, {"m": 2}, {"technique": "physical_movement"}])
@pytest.mark.parametrize("shape", ["sphere", "butterfly"])
def test_without_error_one_formation_makes_the_shape_of_any_placement(shape, settings):
    points = 60 if shape == "sphere" else None
    result, watcher = play(shape=shape, points=points, epsilon_deg=0, **RANDOM, **settings)
    assert watcher.samples[0].hd_cells > 1
    assert result.extra["converged"]
    assert len(result.extra["formation_rounds"]) == 1
    assert watcher.samples[-1].hd_cells == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("pairing", ["fast", "exact"])
@pytest.mark.parametrize("count", [2, 3, 5, 8, 33, 64])
def test_pairs_make_one_swarm_in_the_logarithm_of_the_number_of_flss(count, pairing):
    result, watcher = play(
        points=count, m=2, **{"rounds.pairing": pairing, "rounds.stop": "none", "rounds.max_rounds": 12}
    )
    first = math.ceil(math.log2(count))
    assert result.extra["formation_rounds"] == list(range(first, 13, first))
    swarms = [len(np.unique(snapshot.swarm)) for snapshot in watcher.samples[: first + 1]]
    assert swarms == [math.ceil(count / 2**turn) for turn in range(first + 1)]


@pytest.mark.parametrize("seed", range(1, 5))
def test_every_round_merges_something_and_ids_are_those_of_members(seed):
    result, watcher = play(seed=seed, m="inf", **RANDOM)
    before = 60
    for row, snapshot in zip(result.round_rows[1:], watcher.samples[1:], strict=True):
        assert row.swarms < before
        assert row.swarms == before - row.localizing
        assert 2 <= row.group_min <= row.group_mean <= row.group_max
        for swarm in np.unique(snapshot.swarm):
            assert snapshot.swarm[swarm - 1] == swarm
        before = 60 if row.swarms == 1 else row.swarms


def test_roles_are_told_as_states():
    result, watcher = play(m=2)
    row, state = result.round_rows[1], watcher.samples[1].state
    assert (state == State.BUSY_LOCALIZING).sum() == row.localizing == 30
    assert (state == State.BUSY_ANCHOR).sum() == row.anchors == 30
    assert set(watcher.samples[0].state) == {State.AVAILABLE}
    later = watcher.samples[3].state
    assert (later == State.WAITING).sum() > 0


def test_the_same_seed_is_the_same_run_and_another_another():
    one, again, other = (play(seed=seed)[1] for seed in (3, 3, 4))
    assert np.array_equal(path_of(one), path_of(again))
    assert one.samples[0].position != pytest.approx(other.samples[0].position)


@pytest.mark.parametrize("translation", ["centroid", "sampled", "none"])
def test_reading_the_hd_changes_nothing(translation):
    settings = {"rounds.hd_translation": translation, "rounds.stop": "none", "rounds.max_rounds": 15}
    often, seldom = (play(**settings, **{"rounds.hd_every": every})[1] for every in ("round", "formation"))
    assert np.array_equal(path_of(often), path_of(seldom))
    read = [not math.isnan(snapshot.hd_cells) for snapshot in seldom.samples]
    single = [len(np.unique(snapshot.swarm)) == 1 for snapshot in seldom.samples]
    assert read[1:-1] == single[1:-1]
    assert read[0]
    assert read[-1]


def test_the_hd_is_that_of_the_translation_named():
    points = plan_of().cloud.points
    for translation, translate in (("centroid", True), ("none", False)):
        _, watcher = play(**{"rounds.hd_translation": translation, "rounds.max_rounds": 3})
        for snapshot in watcher.samples:
            assert snapshot.hd_cells == pytest.approx(hausdorff(snapshot.position, points, translate))


def test_a_shape_elsewhere_makes_the_same_run_elsewhere(tmp_path):
    shape, away = sphere(50), np.array([40.0, -7.0, 12.0])
    here = {"shape": cloud_file(tmp_path, shape), "points": None, "deploy.dispatchers": [[1.0, 2.0, 3.0]]}
    there = {
        "shape": cloud_file(tmp_path, shape + away, "there.xyz"),
        "points": None,
        "deploy.dispatchers": [[41.0, -5.0, 15.0]],
    }
    one, other = play(**here), play(**there)
    assert path_of(other[1]) == pytest.approx(path_of(one[1]) + away, abs=1e-7)
    assert [row.hd_cells for row in other[0].round_rows] == pytest.approx(
        [row.hd_cells for row in one[0].round_rows]
    )


def test_a_flat_shape_turned_makes_the_same_run_turned(tmp_path):
    shape = sphere(50)[:, :2]
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    one, other = (
        play(shape=cloud_file(tmp_path, points, f"{name}.xyz"), points=None)
        for name, points in (("one", shape), ("other", shape @ quarter))
    )
    assert path_of(other[1])[:, :, :2] == pytest.approx(path_of(one[1])[:, :, :2] @ quarter, abs=1e-7)
    assert (path_of(one[1])[:, :, 2] == 0).all()


def test_a_run_ends_where_it_is_told_to():
    assert play(**{"rounds.max_rounds": 4})[0].extra["rounds"] == 4
    capped = play(epsilon_deg=20, **{"rounds.max_thaws": 1, "rounds.stop_hd_cells": 1e-9})[0]
    assert len(capped.extra["formation_rounds"]) == 2
    assert not capped.extra["converged"]
    assert capped.counters["thaws"] == 1
    assert capped.extra["rounds"] == capped.extra["formation_rounds"][-1]
    result, watcher = play(lambda snapshot: snapshot.t_s >= 2)
    assert result.extra["rounds"] == 2
    assert len(watcher.samples) == 3
    reached, _ = play(until_hd_cells=1.0)
    assert reached.round_rows[-1].hd_cells < 1
    assert all(row.hd_cells >= 1 for row in reached.round_rows[:-1])


def test_dead_reckoning_alone_is_the_deployment():
    result, watcher = play(technique="dead_reckoning")
    assert result.extra["rounds"] == 0
    assert np.array_equal(watcher.samples[0].position, play()[1].samples[0].position)


def test_ctrl_c_ends_the_run_in_good_order():
    def press(snapshot):
        if snapshot.t_s == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return False

    result, watcher = play(press, **{"rounds.stop": "none"})
    assert result.status == "interrupted"
    assert len(result.round_rows) == len(watcher.samples) == 4


def test_distances_add_up():
    result, watcher = play()
    flown = result.extra["distance_localizing_cells"] + result.extra["distance_swarm_cells"]
    deployed = np.linalg.norm(watcher.samples[0].position, axis=1).sum()
    assert result.counters["distance_cells"] == pytest.approx(flown + deployed)
    by_fls = watcher.samples[-1].flown
    assert by_fls.sum(axis=0) == pytest.approx(
        [result.counters["localizing_cells"], result.counters["following_cells"]]
    )
    assert result.counters["localizations"] == sum(row.localizing for row in result.round_rows)


def test_planned_neighbours_join_every_shape_too():
    result, _ = play(**{"rounds.neighbours": "planned"})
    assert result.extra["converged"]


@pytest.mark.parametrize("start", [{}, {"deploy.start": "random", "rounds.box_cells": 10}])
def test_where_flss_begin(start):
    _, watcher = play(epsilon_deg=0, **start)
    first = watcher.samples[0].position
    if start:
        assert first.min() >= 0
        assert first.max() <= 10
    else:
        assert first == pytest.approx(plan_of().cloud.points)


def test_dimensions():
    flat = {"shape": "butterfly", "points": None}
    assert (path_of(play(**flat)[1])[:, :, 2] == 3).all(), "the depth of the shape"
    assert (path_of(play(**flat, **{"rounds.dim": 3})[1])[:, :, 2] != 3).any()
    flattened = play(**{"rounds.dim": "flatten"})[1]
    assert (path_of(flattened)[:, :, 2] == 0).all()
    with pytest.raises(BadInput, match=r"rounds\.dim: 2 is not allowed; sphere is .* deep"):
        plan_of(**{"rounds.dim": 2})


def test_flattened_points_are_checked_for_duplicates_anew(tmp_path):
    deep = cloud_file(tmp_path, [[0, 0, 0], [0, 0, 5], [3, 1, 0], [4, 4, 1]])
    with pytest.raises(BadInput, match="1 of 4 points are duplicates"):
        plan_of(shape=deep, points=None, **{"rounds.dim": "flatten"})
    assert plan_of(shape=deep, points=None, duplicates="drop", **{"rounds.dim": "flatten"}).size == 3


# What the paper reports, by the rules of the authors' program; the bands of the specification, section 6.
BANDS = {
    "dragon": ({"shape": "dragon"}, (14, 22)),
    "dragon, 1 degree": ({"shape": "dragon", "epsilon_deg": 1}, (5, 10)),
    "dragon, M 2": ({"shape": "dragon", "m": 2}, (30, 40)),
    "skateboard": ({"shape": "skateboard"}, (15, 21)),
    "skateboard, M 2": ({"shape": "skateboard", "m": 2}, (33, 44)),
    "dragon, random placement": ({"shape": "dragon", "deploy.start": "random"}, (20, 30)),
    "butterfly1008, M 2": ({"shape": "butterfly1008", "m": 2}, (30, 40)),
}


@pytest.mark.parametrize("name", BANDS)
def test_rounds_until_the_shape_is_there(name):
    settings, (low, high) = BANDS[name]
    runs = [
        play(preset="authors_code", seed=seed, points=None, **{"m": "inf", **settings})[0]
        for seed in range(1, 5)
    ]
    assert all(run.extra["converged"] for run in runs)
    assert low <= mean(run.extra["rounds"] for run in runs) <= high
    if settings.get("m") != 2:
        assert all(4 <= run.extra["first_single_swarm_round"] <= 7 for run in runs)
        first = runs[0].round_rows[1]
        assert min(first.localizing, first.anchors) > 2
        assert 3 <= first.group_mean <= 4
