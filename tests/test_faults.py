"""Fault schedules as data: read, written, refused, made smaller."""

import json
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.errors import BadInput
from swarmer.faults import WAYS, WHAT, Fault, Schedule, from_text, shrink, simpler, to_yaml

SECONDS = st.floats(0.0, 1e6, allow_nan=False)
FIDS = st.lists(st.integers(1, 50), min_size=1, max_size=8, unique=True).map(lambda fids: tuple(sorted(fids)))


@st.composite
def faults(draw):
    what = draw(st.sampled_from(WHAT))
    late = draw(SECONDS) if what == "slow" else 0.0
    way = draw(st.sampled_from(WAYS)) if what == "cut" else "both"
    return Fault(draw(SECONDS), what, draw(FIDS), draw(st.none() | SECONDS), late, way)


SCHEDULES = st.builds(
    lambda listed, calm_s: Schedule(tuple(sorted(listed, key=lambda fault: fault.at_s)), calm_s),
    st.lists(faults(), max_size=6), st.none() | SECONDS,
)  # fmt: skip


@given(SCHEDULES)
def test_a_schedule_survives_its_text(schedule):
    assert from_text(to_yaml(schedule), 50) == schedule


def test_json_is_yaml():
    data = {"calm": 9, "faults": [{"at": 2, "what": "kill", "where": [3, 1], "for": 0.5}]}
    assert from_text(json.dumps(data), 3) == Schedule((Fault(2.0, "kill", (1, 3), 0.5),), 9.0)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("faults: [", "faults: line 1, column"),
        ("- 1", "faults: [1] is not allowed; a mapping with `faults`"),
        ("fault: []", "faults: {'fault': []} is not allowed"),
        ("calm: -1", "calm: -1 is not allowed; emulated seconds"),
        ("calm: .nan", "calm: nan is not allowed"),
        ("faults: 3", "faults: 3 is not allowed; a list"),
        ("faults: [3]", "faults[0]: 3 is not allowed; a mapping"),
        (
            "faults: [{at: 1, what: kil, where: [1]}]",
            "faults[0].what: 'kil' is not allowed; one of kill, hang",
        ),
        ("faults: [{what: kill, where: [1]}]", "faults[0].at: None is not allowed"),
        ("faults: [{at: 1, what: kill, where: [1], for: -2}]", "faults[0].for: -2 is not allowed"),
        (
            "faults: [{at: 1, what: kill, where: []}]",
            "faults[0].where: [] is not allowed; a list of FIDs, 1 to 9",
        ),
        ("faults: [{at: 1, what: kill, where: [0]}]", "faults[0].where: [0] is not allowed"),
        ("faults: [{at: 1, what: kill, where: [10]}]", "faults[0].where: [10] is not allowed"),
        ("faults: [{at: 1, what: kill, where: [true]}]", "faults[0].where: [True] is not allowed"),
        ("faults: [{at: 1, what: kill, where: [1], late: 1}]", "faults[0].late: 1 is not allowed"),
        ("faults: [{at: 1, what: slow, where: [1]}]", "faults[0].late: 0.0 is not allowed"),
        (
            "faults: [{at: 1, what: cut, where: [1], way: up}]",
            "faults[0].way: 'up' is not allowed; one of both",
        ),
        ("faults: [{at: 1, what: hang, where: [1], way: in}]", "faults[0].way: 'in' is not allowed"),
        ("faults: [{at: 1, what: kill, where: [1], why: x}]", "faults[0]: {'at': 1"),
        ("a: &b [1]\nfaults: *b", "faults: not YAML: line 2, column 9: an alias"),
    ],
)
def test_a_wrong_schedule_is_refused_in_one_line(text, line):
    with pytest.raises(BadInput) as caught:
        from_text(text, 9)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_how_long_a_fault_lasts():
    kill, hang = Fault(2.0, "kill", (1,)), Fault(3.0, "hang", (1, 2), 4.0)
    assert (kill.ends_s, hang.ends_s) == (inf, 7.0)
    schedule = Schedule((kill, hang, Fault(1.0, "slow", (2,), 9.0, 0.25)), 5.0)
    assert [schedule.length_s(fault) for fault in schedule.faults] == [3.0, 2.0, 4.0]
    assert [schedule.late_s(fid) for fid in (1, 2, 3)] == [2.0, 2.25, 0.0]


@given(SCHEDULES)
def test_what_is_simpler_has_less(schedule):
    def size(one):
        return sum(1 + len(fault.where) for fault in one.faults)

    assert all(size(less) < size(schedule) for less in simpler(schedule))


def test_shrinking_keeps_what_is_needed():
    guilty = Fault(1.0, "cut", (3, 5, 8), 2.0)
    others = tuple(Fault(float(at), "kill", tuple(range(1, 9))) for at in range(7))
    small = shrink(
        Schedule((*others, guilty)), lambda one: any(f.what == "cut" and 5 in f.where for f in one.faults)
    )
    assert small == Schedule((guilty._replace(where=(5,)),))


def test_shrinking_ends_in_time():
    schedule = Schedule(tuple(Fault(float(at), "kill", (1,)) for at in range(9)))
    assert shrink(schedule, lambda one: True, wall_s=-1.0) == schedule
