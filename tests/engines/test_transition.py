"""A formed swarm becomes the next shape, in virtual time, with every invariant checked."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from virtual_runs import Watcher

from swarmer.config import load_config
from swarmer.engines.specs import fls_rows, fls_spec
from swarmer.engines.virtual import VirtualEngine
from swarmer.errors import BadInput
from swarmer.faults import Fault, Schedule
from swarmer.fls_spec import successor
from swarmer.metrics.hausdorff import hausdorff
from swarmer.next_shape import standing_at
from swarmer.observe.invariants import Checks
from swarmer.plan import make_plan
from swarmer.protocol.records import SHAPE_EPOCHS, shape_of

PAGE = Path(__file__).parents[2] / "docs" / "transition.md"
AT_S = 6.0
CHANGE = {
    "shape": "sphere", "points": 30, "duration_s": 12, "transition.shape": "cube", "transition.at_s": AT_S,
}  # fmt: skip


def plan_of(points, **settings):
    return make_plan(load_config(None, (), **{**CHANGE, "transition.points": points, **settings}))


def fly(points, faults=None, **settings):
    """A checked run; result, watcher and checks."""
    plan = plan_of(points, **settings)
    checks, watcher = Checks(plan, faults), Watcher()
    with VirtualEngine(plan, (checks,), *([] if faults is None else [faults])) as engine:
        result = engine.run(watcher)
    assert result.status == "done", result.message
    return result, watcher, checks


@pytest.mark.parametrize("points", [30, 45, 20])
def test_the_next_shape_forms_and_localizes(points):
    result, watcher, checks = fly(points)
    plan, last = watcher.plan, watcher.samples[-1]
    member = plan.standings()[1].member
    assert member.sum() == points
    assert (last.lit == member).all()
    assert hausdorff(last.position[member], plan.standings()[1].truth[member]) < 0.01
    assert len(set(last.swarm[member].tolist())) == 1
    assert result.counters["departures"] == max(0, 30 - points)
    assert checks._named("S15").looked > 30, "each of the first shape, and the plan"
    assert watcher.progress.hd < 0.01
    assert 0 < watcher.progress.next_time_to_hd_s["0.1"] < 4


def test_hd_is_of_the_shape_of_the_moment():
    _, watcher, _ = fly(30)
    first, after = watcher.plan.standings()
    for snapshot in watcher.samples:
        if abs(snapshot.t_s - (AT_S - 0.1)) < 1e-6:
            assert hausdorff(snapshot.position, first.truth) < 0.1
        if abs(snapshot.t_s - AT_S) < 1e-6:
            assert hausdorff(snapshot.position, after.truth) > 1
    assert watcher.progress.time_to_hd_s["0.1"] < AT_S


def test_everybody_stays_lit_on_the_way():
    _, watcher, _ = fly(30)
    assert all(snapshot.lit.all() for snapshot in watcher.samples if snapshot.t_s >= AT_S - 1)


@pytest.mark.parametrize("policy", ["timer", "census", "corner", "centralized", "off"])
@pytest.mark.parametrize("points", [20, 45])
def test_every_thaw_policy_knows_the_new_count(policy, points):
    result, watcher, _ = fly(points, **{"thaw.policy": policy, "thaw.h_s": 1.0})
    assert watcher.progress.hd < 0.2
    assert result.counters.get("wrong_thaws", 0) == 0
    assert result.counters["thaws"] < 100, "an epoch of the next shape is no count of thaws"
    if policy != "off":
        last = [event.t_s for event in watcher.events if event.kind == "thaw"][-1]
        assert last > AT_S


@pytest.mark.parametrize("at_s", [0.2, 0.5, 0.8, 1.1])
def test_a_change_in_the_middle_of_the_deployment(at_s):
    for points in (20, 45):
        _, watcher, _ = fly(points, **{"transition.at_s": at_s, "radio.loss": 0.1, "deploy.rate_per_s": 40})
        assert watcher.progress.lit_share == 1
        assert watcher.progress.hd < 0.1


def test_losses_failures_and_late_clocks():
    hang = Schedule((Fault(AT_S - 0.5, "hang", (3, 4, 5), 1.5), Fault(AT_S - 0.2, "kill", (7, 9), 0.5)), 9.0)
    result, watcher, _ = fly(30, hang, **{"radio.loss": 0.1, "failure.rate": 0.02, "duration_s": 16})
    assert result.counters["replacements"] >= 2
    assert watcher.progress.hd < 0.1
    assert watcher.progress.swarms.single


@pytest.mark.parametrize(
    "settings",
    [{"failure.rate": 0.1}, {"failure.battery_s": 4.0}, {"battery.light_s": 4.0, "failure.rate": 0.1}],
)
def test_who_fails_while_it_waits_for_the_next_shape_is_not_replaced_before_that(settings):
    """Its replacement would be of a later epoch than all others, and would take them along to the next shape."""
    kill = Schedule((Fault(2.0, "kill", (31, 40), 0.5),), 9.0)
    result, watcher, _ = fly(45, kill, **settings)
    assert result.counters["replacements"] > 5
    for snapshot in watcher.samples:
        if snapshot.t_s < AT_S:
            assert not snapshot.lit[30:].any()
    assert watcher.samples[-1].lit[30:].any()


def test_a_life_is_counted_from_the_launch():
    _, watcher, _ = fly(45, **{"failure.battery_s": 4.0})
    joiners = [event.t_s for event in watcher.events if event.kind == "departure" and event.fid > 30]
    assert len(joiners) == 15
    assert min(joiners) >= AT_S + 4.0


def test_who_is_late_learns_it_from_a_datagram():
    """FLS 3 has a slow clock and datagrams up to 4 s late: the first that comes begins the next shape."""
    plan = plan_of(30)
    late = Schedule((Fault(AT_S - 0.01, "slow", (3,), 2.0, 4.0),), None)
    seen = []

    class Ear(Checks):
        def handled(self, fls, event, actions, cause, now_s):
            before = self.facts.lives[fls.fid].epoch
            super().handled(fls, event, actions, cause, now_s)
            if shape_of(fls.machine.epoch) > shape_of(before) and cause is not None:
                seen.append((fls.fid, now_s))

    with VirtualEngine(plan, (Ear(plan, late),), late) as engine:
        assert engine.run(Watcher()).status == "done"
    assert [fid for fid, _ in seen] == [3]


def test_the_same_seed_gives_the_same_transition():
    one, two = fly(45)[0], fly(45)[0]
    assert one.extra["trace_sha256"] == two.extra["trace_sha256"]


def test_until_the_change_the_run_is_what_it_is_without():
    calm = {"duration_s": 8, "neighbours": "nearest", "range.max_cells": 50}
    changing = fly(30, **calm)[1].samples
    plan = make_plan(
        load_config(None, (), **{**CHANGE, **calm, "transition.shape": None, "transition.at_s": None})
    )
    watcher = Watcher()
    with VirtualEngine(plan) as engine:
        engine.run(watcher)
    for one, two in zip(changing, watcher.samples, strict=True):
        if one.t_s < AT_S:
            assert np.array_equal(one.position, two.position)


def test_specs_name_flss_and_not_rows():
    plan = plan_of(45)
    shape = plan.next
    specs = {row[0]: fls_spec(row) for row in fls_rows(plan)}
    assert sorted(specs) == list(range(1, 46))
    truth = {fid: tuple(shape.cloud.points[row].tolist()) for row, fid in enumerate(shape.fids.tolist())}
    place = {fid: row for row, fid in enumerate(shape.fids.tolist())}
    for fid, spec in specs.items():
        after = spec.changed()
        assert (after.truth, after.epoch, after.then) == (truth[fid], SHAPE_EPOCHS, None)
        distances = [np.linalg.norm(np.subtract(truth[other], after.truth)) for other in after.near]
        assert np.allclose(distances, after.distances)
        rows = {shape.fids[n - 1] for n in shape.neighbours.neighbours[place[fid]]}
        assert set(after.neighbours) == rows
    joiners = [specs[fid] for fid in shape.joiners]
    assert {spec.launch_at_s for spec in joiners} == {AT_S}
    assert {spec.epoch for spec in joiners} == {SHAPE_EPOCHS}


def test_a_successor_has_the_point_of_its_time():
    stays, leaves = plan_of(45), plan_of(20)
    spec = fls_spec(fls_rows(stays)[0])
    assert successor(spec, AT_S - 0.1, AT_S).truth == spec.truth
    assert successor(spec, AT_S - 0.1, AT_S).launch_at_s == AT_S - 0.1
    assert successor(spec, AT_S, AT_S).truth == spec.then.truth
    joiner = fls_spec(fls_rows(stays)[40])
    assert [successor(joiner, t_s, AT_S).launch_at_s for t_s in (2.0, AT_S + 1)] == [AT_S, AT_S + 1]
    gone = fls_spec(fls_rows(leaves)[leaves.next.leavers[0] - 1])
    assert successor(gone, AT_S - 0.1, AT_S).incarnation == 1
    assert successor(gone, AT_S, AT_S) is None


def test_standings_are_by_fid():
    plan = plan_of(20)
    first, after = plan.standings()
    assert first.member.all()
    assert np.flatnonzero(~after.member).tolist() == [fid - 1 for fid in plan.next.leavers]
    assert standing_at((first, after), AT_S - 1e-9) is first
    assert standing_at((first, after), AT_S) is after
    assert sorted(map(tuple, after.truth[after.member])) == sorted(map(tuple, plan.next.cloud.points))


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"transition.at_s": None}, "transition.at_s"),
        ({"transition.shape": None}, "transition.shape"),
        ({"transition.at_s": 12.0}, "transition.at_s"),
        ({"epochs": False, "thaw.policy": "timer"}, "epochs"),
        ({"transition.shape": "cubr"}, "transition.shape: no 'cubr'"),
        ({"transition.shape": "cat", "transition.points": 500}, "transition.points: 500"),
        ({"transition.points": 1}, "transition.points"),
    ],
)
def test_what_cannot_be_is_one_line(settings, name):
    flags = {**CHANGE, **settings}
    nulls = [f"{key}=null" for key, value in flags.items() if value is None]
    with pytest.raises(BadInput) as refused:
        make_plan(load_config(None, nulls, **flags))
    [line] = str(refused.value).splitlines()
    assert name in line


def test_the_example_of_the_page(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from swarmer.commands.run import command
    from swarmer.observe.saved_run import load

    line = next(line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("    swarmer-run"))
    monkeypatch.chdir(tmp_path)
    words = [*shlex.split(line)[1:], "--no-recording", "--out", "run"]
    done = CliRunner().invoke(command, words, standalone_mode=False)
    assert done.exception is None, done.output
    run = load(tmp_path / "run")
    summary = run.summary
    assert (summary["points"], summary["next_shape"], summary["next_points"]) == (114, "teapot", 100)
    assert (summary["joins"], summary["leaves"], summary["assigned_optimally"]) == (0, 14, True)
    assert summary["hd_cells"] < 0.01
    assert summary["next_time_to_hd_s"]["0.1"] < 10
    timeline = run.timeline
    assert timeline.truths.shape == (2, 114, 3)
    assert len(timeline.truth_at(14.9)) == 114
    assert len(timeline.truth_at(15.0)) == 100
    assert [event.kind for event in run.events].count("next_shape") == 1
    assert sum("no point" in event.text for event in run.events) == 14
