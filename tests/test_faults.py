"""Fault schedules as data: read, written, refused, made smaller."""

import json
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.errors import BadInput
from swarmer.faults import (
    OF_SENSORS,
    ON_THE_AIR,
    WAYS,
    WHAT,
    Fault,
    Schedule,
    from_data,
    from_text,
    shrink,
    simpler,
    to_data,
    to_yaml,
    words,
)
from swarmer.messages import Kind

SECONDS = st.floats(0.0, 1e6, allow_nan=False)
FIDS = st.lists(st.integers(1, 50), min_size=1, max_size=8, unique=True).map(lambda fids: tuple(sorted(fids)))


SHARE = st.floats(0.0, 1.0)
CELLS = st.floats(-1e6, 1e6)
KINDS = st.lists(st.sampled_from([int(k) for k in Kind if k != Kind.CONTROL]), max_size=3, unique=True)


@st.composite
def faults(draw):
    what = draw(st.sampled_from(WHAT))
    swarm_of = draw(st.sampled_from((0, 0, 7))) if what in ("kill", "hang", "slow") else 0
    fault = Fault(draw(SECONDS), what, () if swarm_of else draw(FIDS), draw(st.none() | SECONDS))
    fault = fault._replace(swarm_of=swarm_of)
    if what in ON_THE_AIR:
        fault = fault._replace(way=draw(st.sampled_from(WAYS)), kinds=tuple(sorted(draw(KINDS))))
        if fault.way == "in" and what != "cut":
            fault = fault._replace(source=draw(st.just(()) | FIDS))
    own = {
        "slow": {"late_s": SECONDS}, "loss": {"p": SHARE, "burst": st.just(0.0) | st.floats(1.0, 1e6)},
        "delay": {"delay_s": SECONDS, "jitter_s": SECONDS}, "duplicate": {"p": SHARE},
        "reorder": {"p": SHARE, "delay_s": SECONDS}, "bias": {"by": CELLS}, "outliers": {"p": SHARE, "by": CELLS},
    }.get(what, {})  # fmt: skip
    return fault._replace(**{name: draw(values) for name, values in own.items()})


SCHEDULES = st.builds(
    lambda listed, calm_s: Schedule(tuple(sorted(listed, key=lambda fault: fault.at_s)), calm_s),
    st.lists(faults(), max_size=6), st.none() | SECONDS,
)  # fmt: skip


@given(SCHEDULES)
def test_a_schedule_survives_its_text(schedule):
    assert from_text(to_yaml(schedule), 50) == schedule
    assert from_data(json.loads(json.dumps(to_data(schedule))), 50) == schedule


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
        ("faults: [{what: kill, where: [1]}]", "faults[0].at: is missing; kill has at, for, what, where"),
        ("faults: [{at: 1, what: kill}]", "faults[0].where: is missing"),
        ("faults: [{at: -1, what: kill, where: [1]}]", "faults[0].at: -1 is not allowed; emulated seconds"),
        (
            "faults: [{at: 1.0e+308, for: 1.0e+308, what: kill, where: [1]}]",
            "faults[0].at: 1e+308 is not allowed",
        ),
        ("faults: [{at: 1, what: kill, where: [1], for: 2000000}]", "faults[0].for: 2000000 is not allowed"),
        (
            "faults: [{at: 1, what: slow, where: [1], late: 1.0e+300}]",
            "faults[0].late: 1e+300 is not allowed",
        ),
        ("faults: [{at: 1, what: kill, where: [1], for: -2}]", "faults[0].for: -2 is not allowed"),
        (
            "faults: [{at: 1, what: kill, where: []}]",
            "faults[0].where: [] is not allowed; a list of FIDs, 1 to 9",
        ),
        ("faults: [{at: 1, what: kill, where: [0]}]", "faults[0].where: [0] is not allowed"),
        ("faults: [{at: 1, what: kill, where: [10]}]", "faults[0].where: [10] is not allowed"),
        ("faults: [{at: 1, what: kill, where: [true]}]", "faults[0].where: [True] is not allowed"),
        ("faults: [{at: 1, what: kill, where: [1], late: 1}]", "faults[0].late: 1 is not allowed"),
        ("faults: [{at: 1, what: slow, where: [1]}]", "faults[0].late: is missing; slow has at, for"),
        ("faults: [{at: 1, what: loss, where: [1], p: 2}]", "faults[0].p: 2 is not allowed; a probability"),
        ("faults: [{at: 1, what: loss, where: [1], p: .nan}]", "faults[0].p: nan is not allowed"),
        (
            "faults: [{at: 1, what: loss, where: [1], p: 1, burst: 0.5}]",
            "faults[0].burst: 0.5 is not allowed",
        ),
        (
            "faults: [{at: 1, what: loss, where: [1], p: 1, kinds: [FIN]}]",
            "faults[0].kinds: ['FIN'] is not all",
        ),
        ("faults: [{at: 1, what: loss, where: [1], p: 1, kinds: 4}]", "faults[0].kinds: 4 is not allowed"),
        ("faults: [{at: 1, what: loss, where: [1], p: 1, from: [2]}]", "faults[0].from: [2] is not allowed"),
        (
            "faults: [{at: 1, what: loss, where: {swarm_of: 1}, p: 1}]",
            "faults[0].where: {'swarm_of': 1} is not",
        ),
        ("faults: [{at: 1, what: losss, where: [1]}]", "faults[0].what: 'losss' is not allowed"),
        ("faults: [{at: 1, what: [kill], where: [1]}]", "faults[0].what: ['kill'] is not allowed"),
        ("faults: [{at: 1, what: partition, where: [1]}]", "faults[0].where: [1] is not allowed; nothing"),
        ("faults: [{at: 1, what: partition, parts: 1}]", "faults[0].parts: 1 is not allowed"),
        ("faults: [{at: 1, what: bias, where: [1], by: x}]", "faults[0].by: 'x' is not allowed; cells"),
        (
            "faults: [{at: 1, what: cut, where: [1], way: up}]",
            "faults[0].way: 'up' is not allowed; one of both",
        ),
        ("faults: [{at: 1, what: hang, where: [1], way: in}]", "faults[0].way: 'in' is not allowed"),
        (
            "faults: [{at: 1, what: kill, where: [1], why: x}]",
            "faults[0].why: 'x' is not allowed; kill has only",
        ),
        ("a: &b [1]\nfaults: *b", "faults: not YAML: line 2, column 9: an alias"),
    ],
)
def test_a_wrong_schedule_is_refused_in_one_line(text, line):
    with pytest.raises(BadInput) as caught:
        from_text(text, 9)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_a_number_larger_than_any_is_refused_in_one_line():
    with pytest.raises(BadInput, match=r"^faults\[0\]\.at: .* is not allowed; emulated seconds"):
        from_data({"faults": [{"at": 10**400, "what": "kill", "where": [1]}]}, 9)


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


def test_of_what_comes_at_one_moment_ends_come_first_but_of_what_lasts_no_time():
    kill, cut, loss = (
        Fault(2.0, "kill", (1,), 0.0),
        Fault(1.0, "cut", (2,), 1.0),
        Fault(2.0, "loss", (3,), 9.0),
    )
    turns = Schedule((cut, kill, loss), 4.0).turns()
    told = [(turn.at_s, turn.begins, turn.fault and turn.fault.what) for turn in turns]
    assert told == [
        (1.0, True, "cut"), (2.0, False, "cut"), (2.0, True, "kill"), (2.0, True, "loss"), (2.0, False, "kill"),
        (4.0, False, "loss"), (4.0, True, None),
    ]  # fmt: skip
    assert [turn.fault for turn in Schedule((kill,), 1.0).turns()] == [None], "after the calm nothing comes"


def test_a_partition_becomes_cuts_side_by_side():
    points = [(float(x), 0.0, 0.0) for x in (3, 1, 4, 2, 5, 9, 8)]
    text = "faults: [{at: 1, for: 2, what: partition, parts: 3}]"
    found = from_text(text, 7, points)
    assert [fault.where for fault in found.faults] == [(2, 4), (1, 3)]
    assert {(fault.what, fault.for_s, fault.way) for fault in found.faults} == {("cut", 2.0, "both")}
    one = from_text("faults: [{at: 1, what: partition, axis: H}]", 7, points).faults
    assert [fault.where for fault in one] == [(1, 2, 3)], "all as high: of equal ones the lower FIDs"


def test_a_fault_in_words():
    assert words(Fault(1.0, "kill", (), swarm_of=4)) == "kill: the swarm of FLS 4"
    fin = Fault(1.0, "loss", (1, 2), way="in", kinds=(int(Kind.CHALLENGE_FIN),))
    assert words(fin) == "loss: 2 FLSs, way in, CHALLENGE_FIN only"


def test_whose_sensor_is_spoilt():
    schedule = Schedule((Fault(1.0, "bias", (2, 3), None, by=0.5), Fault(2.0, "kill", (2,))), 4.0)
    assert schedule.of_sensors(1) == ()
    [fault] = schedule.of_sensors(3)
    assert (fault.what, fault.begins_s, fault.ends_s, fault.by) == ("bias", 1.0, 4.0, 0.5)
    assert {fault.what for fault in schedule.faults} & set(OF_SENSORS) == {"bias"}
