"""Fault schedules in virtual time: what is seen from outside when each kind strikes, with every invariant checked."""

from itertools import pairwise

import numpy as np
import pytest
from stories import Story, one_swarm, swarms

from swarmer.fault_places import slabs
from swarmer.fault_settings import draw_fault
from swarmer.faults import Fault, Schedule, from_data
from swarmer.messages import Kind
from swarmer.protocol.events import Received
from swarmer.streams import stream

CALM = {"thaw.policy": "off"}
FIN = int(Kind.CHALLENGE_FIN)


def story(*faults, calm_s=None, **settings):
    return Story(faults=Schedule(faults, calm_s), **{**CALM, **settings})


def heard(one, from_s, to_s, kinds=None):
    """(receiver, message) of all that a machine was given in a time."""
    return [
        (fid, event.message)
        for t_s, fid, event, _ in one.log.events
        if from_s <= t_s < to_s and type(event) is Received and (kinds is None or event.message.kind in kinds)
    ]


# -- on the air ------------------------------------------------------------------------------------------------------


def test_a_partition_makes_two_swarms_and_healing_one():
    plan = Story(duration_s=0.1).plan
    rows = slabs(plan.cloud.points.tolist(), 2, "L")
    schedule = from_data(
        {"faults": [{"at": 0, "for": 10, "what": "partition", "axis": "L"}]}, 30, plan.cloud.points.tolist()
    )
    one = Story(faults=schedule, duration_s=20.0, **CALM)
    parted, end = one.at(9.9), one.end
    for part in rows:
        assert len(set(parted.swarm[part].tolist())) == 1, "each half is one swarm"
    assert swarms(parted) == 2
    assert one_swarm(end)
    healed = next(s.t_s for s in one.audience.samples if s.t_s >= 10.0 and one_swarm(s))
    assert healed - 10.0 < 2.0


def test_only_the_named_kind_is_lost():
    one = story(Fault(0.0, "loss", tuple(range(1, 31)), 6.0, way="in", p=1.0, kinds=(FIN,)), duration_s=9.0)
    assert not heard(one, 0.0, 6.0, {FIN})
    assert len(heard(one, 0.0, 6.0)) > 200
    assert one.result.counters["leases_expired"] > 5, "an anchor that hears no FIN waits for its lease to end"
    assert one_swarm(one.end)


def test_a_one_way_link_is_dead_one_way():
    near = story(duration_s=3.0)
    pairs = {(fid, m.sender) for fid, m in heard(near, 0.0, 3.0)}
    a, b = next((a, b) for a, b in sorted(pairs) if (b, a) in pairs)
    one = story(Fault(0.0, "loss", (a,), way="in", p=1.0, source=(b,)), duration_s=9.0)
    found = {(fid, m.sender) for fid, m in heard(one, 0.0, 9.0)}
    assert (a, b) not in found
    assert (b, a) in found
    assert one_swarm(one.end)


def test_dead_links_lose_what_they_would_carry_and_one_swarm_forms():
    one = Story(duration_s=15.0, until=one_swarm, **CALM, **{"radio.dead_links": 0.2})
    assert one_swarm(one.end)
    whole = Story(duration_s=one.result.emulated_s, **CALM)
    lost = {(fid, m.sender) for fid, m in heard(one, 0.0, 15.0)}
    both = {(fid, m.sender) for fid, m in heard(whole, 0.0, 15.0)}
    assert one.result.counters["datagrams_lost"] > 0
    assert any((b, a) not in lost for a, b in lost & both)


@pytest.mark.parametrize("burst", [0, 20])
def test_losses_in_bursts_delay_but_never_stop(burst):
    one = Story(duration_s=25.0, until=one_swarm, **CALM, **{"radio.loss": 0.2, "radio.burst": burst})
    assert one_swarm(one.end)
    counters = one.result.counters
    share = counters["datagrams_lost"] / (counters["datagrams_lost"] + counters["datagrams_delivered"])
    assert 0.2 < share < 0.55


def test_jamming_stops_all_that_is_sent_meanwhile():
    one = story(Fault(1.0, "loss", tuple(range(1, 31)), 1.0, p=1.0), duration_s=8.0)
    assert not [m for fid, m in heard(one, 1.1, 2.0)]
    assert heard(one, 2.0, 3.0)
    assert one_swarm(one.end)


def test_from_the_calm_on_no_datagram_is_lost():
    noise = {"radio.loss": 0.3, "radio.dead_links": 0.2}
    one = story(Fault(0.0, "loss", (1, 2, 3), p=0.5), calm_s=2.0, duration_s=12.0, **noise)
    counters = [s.counters["datagrams_lost"] for s in one.audience.samples if s.t_s > 2.2]
    assert counters[0] == counters[-1] > 0
    assert one.checks.facts.single_s is not None


# -- FLSs ------------------------------------------------------------------------------------------------------------


def test_all_of_a_swarm_die_and_those_alone():
    plain = story(duration_s=3.0)
    moment = next(
        s.t_s for s in plain.audience.samples if s.swarm[9] and 2 < (s.swarm == s.swarm[9]).sum() < 20
    )
    before = plain.at(moment)
    members = set((np.flatnonzero(before.swarm == before.swarm[9]) + 1).tolist())
    one = story(Fault(moment, "kill", (), 0.5, swarm_of=10), duration_s=12.0)
    dead = {fid for fid, fls in one.flss.items() if fls.machine.incarnation == 1}
    assert dead == members
    assert one.result.counters["failures"] == one.result.counters["replacements"] == len(members)
    assert one_swarm(one.end)


def test_a_region_dies_and_comes_back():
    plan = Story(duration_s=0.1).plan
    points = plan.cloud.points.tolist()
    row = {"at": 4, "what": "kill", "where": {"half": "high", "axis": "H"}, "for": 1}
    one = Story(faults=from_data({"faults": [row]}, 30, points), duration_s=14.0, **CALM)
    high = slabs(points, 2, "H")[1]
    dark = ~one.at(4.5).alive
    assert sorted(np.flatnonzero(dark).tolist()) == high
    assert one.end.lit.all()
    assert one_swarm(one.end)


def test_what_a_predecessor_sent_changes_nothing():
    """Datagrams take up to 0.6 s and flights less, so those of the dead come after their successor's first ones."""
    fids = tuple(range(1, 31, 3))
    slow = {"radio.delay_ms": 300.0, "radio.jitter_ms": 300.0, "lease_ms": 2000.0, "lambda_ms": 200.0}
    fast = {f"flight.{name}": 1000 for name in ("speed_m_s", "acceleration_m_s2", "braking_m_s2")}
    one = story(Fault(1.5, "kill", fids, 0.01), duration_s=4.0, **slow, **fast)
    newest = {}
    for _, fid, event, _ in one.log.events:
        if type(event) is Received:
            key = (fid, event.message.sender)
            assert event.message.incarnation >= newest.get(key, 0), (
                "a predecessor is heard after its successor"
            )
            newest[key] = event.message.incarnation
    assert one.log.fates["replayed"] > 0, "some came, and were dropped"
    assert one.seen["S12"] > 100


@pytest.mark.parametrize("hang_s", [0.0, 1.0])
def test_who_hangs_too_long_is_ended_and_replaced(hang_s):
    fids = (3, 7)
    one = story(Fault(4.0, "hang", fids, 3.0), duration_s=14.0, **{"failure.hang_s": hang_s})
    incarnations = {fid: one.flss[fid].machine.incarnation for fid in fids}
    assert set(incarnations.values()) == ({1} if hang_s else {0})
    assert one.result.counters["failures"] == (2 if hang_s else 0)
    if hang_s:
        gone = [event.t_s for event in one.audience.events if event.kind == "failure"]
        assert gone == [5.0, 5.0]
    assert one_swarm(one.end)


def test_who_hangs_a_short_time_is_left_alone():
    one = story(Fault(4.0, "hang", (3,), 0.9), duration_s=8.0, **{"failure.hang_s": 1.0})
    assert one.result.counters["failures"] == 0


@pytest.mark.parametrize("rate", [0.001, 0.01, 0.1])
def test_failures_by_rate_come_so_often(rate):
    one = Story(duration_s=20.0, **CALM, **{"failure.rate": rate})
    expected = 30 * 20.0 * rate
    assert abs(one.result.counters["failures"] - expected) < 4 * expected**0.5 + 1


# -- sensors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fault",
    [
        Fault(0.0, "bias", (4, 8, 20), by=1.0),
        Fault(0.0, "bias", (4, 8, 20), by=-1.0),
        Fault(0.0, "outliers", (4, 8, 20), p=0.3, by=3.0),
        Fault(0.0, "dead_sensor", (4, 8, 20)),
    ],
    ids=lambda fault: f"{fault.what} {fault.by:g}",
)
def test_a_spoilt_sensor_costs_hd_and_stops_nobody(fault):
    exact = {"epsilon_deg": 0.0, "duration_s": 8.0}  # but for the sensors
    assert story(**exact).hd(story(**exact).end) < 1e-6
    one = story(fault, **exact)
    assert one_swarm(one.end)
    assert np.isfinite(one.end.position).all()
    assert one.hd(one.end) > 0.3
    again = story(fault._replace(for_s=3.0), duration_s=16.0, **{"thaw.policy": "timer"})
    assert again.hd(again.end) < 0.5, "once the sensors are well, thaws put all right"


# -- both ------------------------------------------------------------------------------------------------------------


def test_every_turn_of_a_schedule_is_an_event():
    one = story(
        Fault(1.0, "cut", (3,), 2.0), Fault(2.0, "kill", (4, 5), 0.0), Fault(2.5, "bias", (1,), by=1.0),
        calm_s=4.0, duration_s=6.0,
    )  # fmt: skip
    told = [(e.t_s, e.fid, e.text) for e in one.audience.events if e.kind == "fault"]
    assert told == [
        (1.0, 3, "begins: cut: FLS 3"), (2.0, 0, "begins: kill: 2 FLSs"), (2.0, 0, "over: kill: 2 FLSs"),
        (2.5, 1, "begins: bias: FLS 1"), (3.0, 3, "over: cut: FLS 3"), (4.0, 1, "over: bias: FLS 1"),
        (4.0, 0, "all faults are over"),
    ]  # fmt: skip
    assert all(first.t_s <= second.t_s for first, second in pairwise(one.audience.events))


@pytest.mark.parametrize("seed", range(1, 9))
def test_drawn_schedules_heal(seed):
    """Twelve faults of any kind in 6 s, then the calm: one swarm, and no invariant broken."""
    points = Story(duration_s=0.1).plan.cloud.points.tolist()
    rng = stream(seed, "faults")
    rows = [draw_fault(rng, 6.0, 0.5) for _ in range(12)]
    schedule = from_data({"faults": rows, "calm": 7.0}, 30, points, seed)
    one = Story(seed=seed, faults=schedule, duration_s=40.0)  # it ends at one swarm
    assert one.checks.facts.single_s is not None, rows
