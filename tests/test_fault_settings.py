"""The schedule that the settings mean: listed, from a file, drawn; and one line for what is wrong."""

import json
from random import Random

import pytest

from swarmer.config import load_config
from swarmer.errors import BadInput
from swarmer.fault_settings import draw_fault, too_late
from swarmer.faults import NO_FAULTS, WHAT, from_data
from swarmer.plan import make_plan

SMALL = {"shape": "random", "points": 12}
KILL = {"at": 2, "what": "kill", "where": [3], "for": 0.5}


def planned(file=None, overrides=(), **settings):
    return make_plan(load_config(file, overrides, **SMALL, **settings))


def test_without_any_there_is_none():
    assert planned().faults == NO_FAULTS


def test_a_list_in_a_settings_file(tmp_path):
    (tmp_path / "run.yaml").write_text(f"faults:\n- {json.dumps(KILL)}\n")
    plan = planned(tmp_path / "run.yaml")
    [fault] = plan.faults.faults
    assert (fault.at_s, fault.what, fault.where, fault.for_s) == (2.0, "kill", (3,), 0.5)


def test_a_group_in_a_settings_file_and_an_override(tmp_path):
    (tmp_path / "run.yaml").write_text(f"faults: {{schedule: [{json.dumps(KILL)}], calm_s: 4}}\n")
    assert planned(tmp_path / "run.yaml").faults.calm_s == 4.0
    override = "faults.schedule=[{at: 1, what: hang, where: all, for: 1}]"
    [fault] = planned(tmp_path / "run.yaml", [override]).faults.faults
    assert (fault.what, len(fault.where)) == ("hang", 12)


def test_a_file_and_more(tmp_path, monkeypatch):
    (tmp_path / "storm.yaml").write_text(
        "calm: 9\nfaults:\n- {at: 1, what: cut, where: {half: low, axis: L}}\n"
    )
    monkeypatch.chdir(tmp_path)
    plan = planned(**{"faults.file": "storm.yaml", "faults.schedule": [KILL]})
    assert [fault.what for fault in plan.faults.faults] == ["cut", "kill"]
    assert plan.faults.calm_s == 9.0
    # The resolved settings make the same run from anywhere.
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "config.yaml").write_text(plan.config.to_yaml())
    monkeypatch.chdir(tmp_path / "elsewhere")
    (tmp_path / "storm.yaml").unlink()
    again = make_plan(load_config("config.yaml"))
    assert again.faults == plan.faults
    assert again.config.flat() == plan.config.flat()


def test_drawn_faults_are_of_the_seed_and_stand_in_the_resolved_settings():
    plan = planned(**{"faults.random": 30, "seed": 4})
    assert len(plan.faults.faults) == 30
    assert plan.config.faults.random == 0
    assert len(plan.config.faults.schedule) == 30
    assert make_plan(plan.config).faults == plan.faults
    assert planned(**{"faults.random": 30, "seed": 4}).faults == plan.faults
    assert planned(**{"faults.random": 30, "seed": 5}).faults != plan.faults
    assert (
        planned(**{"faults.random": 10, "seed": 4}).config.faults.schedule == plan.config.faults.schedule[:10]
    )


def test_every_kind_is_drawn_and_every_drawing_is_a_schedule():
    rng = Random(1)
    points = [(float(at), at % 3, 0.0) for at in range(20)]
    rows = [draw_fault(rng, 60.0, 0.5) for _ in range(400)]
    found = from_data({"faults": rows}, 20, points, 1).faults
    assert {fault.what for fault in found} == set(WHAT) - {"dead_sensor"}
    assert all(0.0 <= fault.at_s <= 60.0 and 0.05 <= fault.for_s <= 10.0 for fault in found)


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        (
            {"faults.schedule": 3},
            "faults.schedule: 3 is not a list of mappings; a list of up to 10000 mappings",
        ),
        ({"faults.schedule": [3]}, "faults.schedule: [3] is not a list of mappings"),
        ({"faults.schedule": [{}]}, "faults[0].what: None is not allowed; one of kill, hang, slow"),
        (
            {"faults.schedule": [KILL | {"where": [13]}]},
            "faults[0].where: [13] is not allowed; a list of FIDs",
        ),
        ({"faults.random": -1}, "faults.random: -1 is out of range"),
        ({"faults.calm_s": "x"}, "faults.calm_s: 'x' is not a number"),
        ({"faults.file": "nowhere.yaml"}, "nowhere.yaml: No such file"),
        (
            {"radio.burst": 5, "radio.loss": 0.5, "radio.burst_loss": 0.4},
            "radio.burst_loss: 0.4 is too little",
        ),
        ({"radio.burst": 0.5}, "radio.burst: 0.5 is not a whole number"),
        ({"radio.dead_links": 2}, "radio.dead_links: 2 is out of range"),
    ],
    ids=str,
)
def test_what_is_wrong_is_one_line(settings, line):
    with pytest.raises(BadInput) as caught:
        planned(**settings)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("- 1\n", "storm.yaml: [1] must be a mapping"),
        ("fault: []\n", "faults.file: storm.yaml is no schedule"),
        ("faults: 3\n", "faults.file: storm.yaml is no schedule"),
        ("calm: 3\nfaults: [{at: 1}]\n", "faults.calm_s: is given in faults.file, too"),
        ("faults: [{at: 1, what: kill, where: nobody}]\n", "faults[0].where: 'nobody' is not allowed"),
    ],
)
def test_a_file_that_is_no_schedule(tmp_path, monkeypatch, text, line):
    (tmp_path / "storm.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput) as caught:
        planned(**{"faults.file": "storm.yaml", "faults.calm_s": 2})
    assert str(caught.value).startswith(line)


@pytest.mark.parametrize(
    ("calm_s", "line"),
    [
        (
            None,
            "faults: 1 of 2 faults never begin: the end of the run comes at 60 s, the first of them would at 60 s",
        ),
        (2.0, "faults: 2 of 2 faults never begin: the calm comes at 2 s, the first of them would at 2 s"),
        (2.5, "faults: 1 of 2 faults never begin: the calm comes at 2.5 s, the first of them would at 60 s"),
    ],
)
def test_faults_that_come_too_late_are_told(calm_s, line):
    plan = planned(**{"faults.schedule": [KILL, {**KILL, "at": 60}], "faults.calm_s": calm_s})
    assert too_late(plan.faults, plan.config.duration_s) == [line]


def test_no_word_of_faults_that_come_in_time():
    plan = planned(**{"faults.schedule": [KILL], "faults.calm_s": 3.0})
    assert too_late(plan.faults, plan.config.duration_s) == []
    assert too_late(NO_FAULTS, 60.0) == []
