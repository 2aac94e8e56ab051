"""Batteries, leaving to charge and standbys, in virtual time, with every invariant checked."""

import shlex
from math import dist
from pathlib import Path

import numpy as np
import pytest
from virtual_runs import Watcher

from swarmer.config import load_config
from swarmer.engines.specs import fls_rows, fls_spec, standby_groups
from swarmer.engines.virtual import VirtualEngine
from swarmer.errors import BadInput
from swarmer.fls_spec import successor
from swarmer.observe.invariants import Checks
from swarmer.physics.battery import Battery
from swarmer.physics.flight import Velocity, duration
from swarmer.plan import make_plan
from swarmer.standbys import Standbys, handover_s

PAGE = Path(__file__).parents[2] / "docs" / "charging.md"
CHARGING = {
    "shape": "random", "points": 20, "duration_s": 20, "battery.light_s": 12, "battery.flight_s": 12,
    "battery.charge_s": 2,
}  # fmt: skip


def fly(**settings):
    plan = make_plan(load_config(None, (), **{**CHARGING, **settings}))
    checks, watcher = Checks(plan), Watcher()
    with VirtualEngine(plan, (checks,)) as engine:
        result = engine.run(watcher)
    assert result.status == "done", result.message
    return result, watcher


def test_more_standbys_more_light():
    found = [fly(**{"battery.standby_group": group})[1].progress.illumination() for group in (0, 10, 3, 1)]
    means = [one["illumination_mean"] for one in found]
    assert means == sorted(means)
    assert means[0] < 0.85
    assert found[-1]["illumination_min"] == 1.0, (
        "each light has a standby of its own, which comes before it goes out"
    )


@pytest.mark.parametrize("replace", [True, False], ids=["", "failures are not replaced"])
def test_who_leaves_comes_back_charged(replace):
    result, watcher = fly(**{"battery.stagger": False, "duration_s": 13, "failure.replace": replace})
    left = [event.t_s for event in watcher.events if event.kind == "departure"]
    assert result.counters["departures"] == result.counters["replacements"] == 20
    assert min(left) == pytest.approx(0.8 * 12, abs=1.5), "all at about the same time, with the reserve left"
    dark = [snapshot.t_s for snapshot in watcher.samples if snapshot.t_s > 5 and not snapshot.lit.any()]
    assert 1.0 < max(dark) - min(dark) < 3.5, "home, charging, and in again"
    assert watcher.samples[-1].lit.all()


def test_a_display_with_standbys_stays_localized():
    _, watcher = fly(**{"battery.standby_group": 5, "radio.loss": 0.1, "failure.rate": 0.02})
    assert watcher.progress.illumination()["hd_median_cells"] < 1


def test_without_a_battery_nothing_changes():
    from virtual_runs import trace

    assert trace() == trace(**{"battery.charge_s": 99, "battery.reserve": 0.5})


def test_flying_and_shining_draw_on_one_battery():
    battery = Battery(flight_s=10.0, light_s=100.0, reserve=0.2)
    assert battery.low_at(0.0) == float("inf")
    battery.flies(2.0)
    battery.lights_up(5.0)
    assert battery.low_at(5.0) == pytest.approx(5.0 + 60.0)
    battery.flies(5.0)
    assert battery.low_at(20.0) == pytest.approx(20.0), "it has shone for longer than there is left: now"
    endless = Battery(0.0, 0.0, 0.2)
    endless.lights_up(0.0)
    endless.flies(1e6)
    assert endless.low_at(1.0) == float("inf")


def test_a_standby_is_in_the_air_before_its_owner_goes():
    plan = make_plan(load_config(None, (), **{**CHARGING, "battery.standby_group": 4}))
    flss = [fls_spec(row) for row in fls_rows(plan)]
    velocity = Velocity(*plan.rules.velocity)
    pool = Standbys(flss, velocity, charge_s=3.0)
    one = flss[0]
    mates = [spec for spec in flss if spec.group == one.group and spec is not one]
    first = pool.relieved(successor(one, 50.0, None), 50.0)
    assert first.launch_at_s == pytest.approx(50.0 - handover_s(one, velocity))
    assert (first.begins_at, first.incarnation) == (one.standby, 1)
    second = pool.relieved(successor(mates[0], 50.0, None), 50.0)
    assert second.launch_at_s > 53.0, "the only standby is gone: it waits for the first one to have charged"
    third = pool.relieved(successor(mates[1], 500.0, None), 500.0)
    assert third.launch_at_s < 500.0


CHANGE = {
    "transition.shape": "cube",
    "transition.at_s": 8,
    "duration_s": 16,
    "deploy.dispatchers": [[0, 0, 0], [20, 20, 20]],
}


@pytest.mark.parametrize("points", [20, 27, 12])
def test_standbys_go_with_the_display_to_its_next_shape(points):
    """With one for each light nobody leaves a gap, before, during and after: what is dark is on its way to join."""
    change = {**CHANGE, "transition.points": points}
    _, watcher = fly(**change, **{"battery.standby_group": 1})
    lit = next(snapshot.t_s for snapshot in watcher.samples if snapshot.lit[:20].all())
    for snapshot in watcher.samples:
        joining = points > 20 and 8 <= snapshot.t_s < 10
        member = watcher.plan.standings()[snapshot.t_s >= 8].member
        if snapshot.t_s >= lit and not joining:
            assert snapshot.lit[member].all(), snapshot.t_s
    departed = [event.t_s for event in watcher.events if event.kind == "departure"]
    assert min(departed) < 8
    assert max(departed) > 9
    assert watcher.progress.hd < 1


def test_standbys_pay_over_a_transition_too():
    change = {**CHANGE, "transition.points": 30}
    found = [fly(**change, **{"battery.standby_group": group})[1].progress.illumination() for group in (0, 5)]
    assert found[1]["illumination_mean"] > found[0]["illumination_mean"] + 0.05


@pytest.mark.parametrize("points", [20, 27, 12])
def test_the_groups_of_the_next_shape_take_over_the_nearest_standbys(points):
    from swarmer.shapes.assignment import assign

    change = {**CHANGE, "transition.points": points, "battery.standby_group": 5}
    plan = make_plan(load_config(None, (), **{**CHARGING, **change}))
    flss = [fls_spec(row) for row in fls_rows(plan)]
    before = {spec.group: spec.standby for spec in flss[:20]}
    after = {}
    for spec in (spec.changed() for spec in flss if not spec.leaves):
        assert after.setdefault(spec.group, spec.standby) == spec.standby
        group = [
            other.changed() for other in flss if not other.leaves and other.changed().group == spec.group
        ]
        assert np.allclose(np.mean([one.truth for one in group], axis=0), spec.standby)
    assert len(after) == -(-points // 5)
    assert sorted(after)[: min(4, len(after))] == sorted(set(before) & set(after)), (
        "as few new ones as can be"
    )
    ways = [np.subtract(after[group], before[group]) for group in after if group in before]
    best = assign(np.array(list(before.values())), np.array(list(after.values())))
    assert np.square(ways).sum() == pytest.approx(best.squared_cells)


def test_where_a_standby_is_when_the_next_shape_begins():
    """One waits and flies over, one is on its way in and flies on, one still charges and comes straight."""
    change = {**CHANGE, "transition.points": 30, "battery.standby_group": 5}
    plan = make_plan(load_config(None, (), **{**CHARGING, **change}))
    flss = [fls_spec(row) for row in fls_rows(plan)]
    velocity = Velocity(*plan.rules.velocity)

    def way_s(a, b):
        return duration(dist(a, b), velocity)

    def ready_s(spec, left_s):
        """When the standby of its group is ready for its next light, if an FLS of it left at `left_s`."""
        pool = Standbys(flss, velocity, 2.0, 8.0)
        if left_s is not None:
            pool.relieved(successor(spec, left_s, 8.0), left_s)
        return pool.relieved(successor(spec, 8.0, 8.0), 8.0).launch_at_s

    for group in range(4):
        spec = next(spec for spec in flss if spec.group == group and spec.then.group == group)
        there = spec.then.standby
        home_s = way_s(spec.truth, spec.origin)
        out_s = way_s(spec.origin, spec.standby)
        over_s = way_s(spec.standby, there)
        assert ready_s(spec, None) == pytest.approx(8.0 + over_s)
        coming_s = 8.0 - 2.0 - home_s - out_s / 2
        assert ready_s(spec, coming_s) == pytest.approx(8.0 + out_s / 2 + over_s)
        charging_s = 8.0 - home_s
        assert ready_s(spec, charging_s) == pytest.approx(10.0 + way_s(spec.origin, there))
    new = next(spec for spec in flss if spec.then is None or spec.then.group > 3)
    assert ready_s(new, None) == pytest.approx(8.0 + way_s(new.origin, new.changed().standby))


def test_groups_are_near_and_small():
    points = np.random.default_rng(3).uniform(0, 10, (23, 3))
    groups, places = standby_groups(points, 5)
    sizes = np.bincount(groups)
    assert sizes.max() <= 5
    assert sizes.sum() == 23
    assert len(places) == 5
    for group, place in enumerate(places):
        assert np.allclose(points[groups == group].mean(axis=0), place)
    assert len(standby_groups(points, 0)[1]) == 0


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"battery.light_s": 1e-6}, "battery.light_s"),
        ({"battery.light_s": 0, "battery.flight_s": 0, "battery.standby_group": 3}, "battery.standby_group"),
        ({"battery.reserve": 1.0}, "battery.reserve"),
    ],
)
def test_what_cannot_be_is_one_line(settings, name):
    with pytest.raises(BadInput) as refused:
        load_config(None, (), **{**CHARGING, **settings})
    [line] = str(refused.value).splitlines()
    assert line.startswith(name)


def test_the_example_of_the_page(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from swarmer.commands.run import command
    from swarmer.observe.saved_run import load

    line = next(line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("    swarmer-run"))
    monkeypatch.chdir(tmp_path)
    words = [*shlex.split(line)[1:], "--no-recording", "--out", "run"]
    done = CliRunner().invoke(command, words, standalone_mode=False)
    assert done.exception is None, done.output
    summary = load(tmp_path / "run").summary
    assert summary["departures"] > 50
    assert summary["illumination_mean"] > 0.9
