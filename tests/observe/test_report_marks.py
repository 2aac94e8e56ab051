"""Faults and lost hosts in the report's figures: when each began and ended, and never so many that nothing is seen."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from swarmer.engines.fault_events import event_of
from swarmer.engines.result import Event
from swarmer.faults import Schedule, from_data
from swarmer.observe.report import make_report
from swarmer.observe.report_drawing import SECONDS
from swarmer.observe.report_marks import MARKS_MAX, Mark, marks_of, most_marked, over_run, said_of
from swarmer.observe.saved_run import load

POINTS = np.arange(24.0).reshape(8, 3)


def events(*faults, calm=None):
    """Those of a schedule, as every engine tells them."""
    schedule: Schedule = from_data({"faults": list(faults), "calm": calm}, 8, POINTS.tolist())
    return [event_of(turn) for turn in schedule.turns()]


def test_a_fault_lasts_from_its_beginning_to_its_end():
    told = events(
        {"at": 2, "for": 3, "what": "partition", "parts": 3},
        {"at": 4, "for": 2, "what": "loss", "where": [1, 2], "p": 0.5},
        {"at": 5, "what": "delay", "where": [1, 2], "delay": 0.5},
    )
    assert marks_of(told, 20.0) == [Mark(2, 5, "cut"), Mark(4, 6, "loss"), Mark(5, 20, "delay")]


def test_what_is_alike_ends_in_the_order_in_which_it_began():
    loss = {"what": "loss", "where": [1, 2], "p": 0.5}
    told = events(loss | {"at": 1, "for": 3}, loss | {"at": 2, "for": 5})
    assert marks_of(told, 20.0) == [Mark(1, 4, "loss"), Mark(2, 7, "loss")]


def test_the_calm_ends_what_lasts_for_good():
    told = events({"at": 1, "what": "cut", "where": [1]}, {"at": 2, "what": "hang", "where": [1]}, calm=9)
    assert marks_of(told, 20.0) == [Mark(1, 9, "cut"), Mark(2, 9, "hang")]


def test_a_kill_and_the_loss_of_a_host_are_moments():
    told = events({"at": 1, "for": 4, "what": "kill", "where": [1, 2]})
    told.append(
        Event(3.0, "host", 0, "oak is gone (the connection has ended); its 4 FLSs are replaced on elm")
    )
    assert marks_of(told, 20.0) == [Mark(1, 1, "kill"), Mark(3, 3, "oak lost")]


def test_other_events_and_ends_without_a_beginning_are_none():
    told = [
        Event(1.0, "thaw", 0, "thaw 1 began"),
        Event(2.0, "fault", 0, "over: cut: 3 FLSs"),
        Event(3.0, "fault", 0, "?"),
    ]
    assert marks_of(told, 20.0) == []
    assert said_of([], SECONDS) == ""


@pytest.fixture
def many():
    """Hundreds of faults, among them one that lasts longest, and a lost host."""
    short = [Mark(0.01 * at, 0.01 * at + 0.005, "slow") for at in range(500)]
    return sorted([*short, Mark(1, 4, "cut"), Mark(2, 2, "oak lost")])


def test_of_many_the_longest_are_marked_and_every_lost_host(many):
    shown = most_marked(many)
    assert len(shown) == MARKS_MAX
    assert {Mark(1, 4, "cut"), Mark(2, 2, "oak lost")} <= set(shown)
    assert f"faults and lost hosts, {MARKS_MAX} of 502 (" in said_of(many, SECONDS)
    axes = Figure().add_subplot()
    axes.plot([0, 5], [1, 10])
    axes.set_yscale("log")
    over_run(axes, SECONDS, many, named=True)
    assert 1 <= len(axes.patches) < MARKS_MAX
    assert len(axes.lines) <= 1 + 2 * MARKS_MAX
    assert 1 <= len(axes.texts) <= MARKS_MAX


def test_names_do_not_lie_on_each_other():
    axes = Figure().add_subplot()
    axes.plot([0, 40], [1, 10])
    axes.set_yscale("log")
    marks = [
        Mark(10, 20, "cut"),
        Mark(10.1, 10.1, "localhost-2 lost"),
        Mark(10.2, 11, "loss"),
        Mark(30, 31, "slow"),
    ]
    over_run(axes, SECONDS, marks, named=True)
    assert [text.get_text() for text in axes.texts] == ["cut", "localhost-2 lost", "slow"]
    assert len({text.get_position()[1] for text in axes.texts[:2]}) == 2


def test_the_report_says_what_the_bands_are(finished_run, quick):
    run = load(finished_run)
    assert "Grey bands" not in make_report([run])
    run.events += events({"at": 2, "for": 3, "what": "partition"})
    assert "faults and lost hosts (cut 2.0 s to 5.0 s)" in make_report([run])
