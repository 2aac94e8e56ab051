"""Small displays in virtual time, from fixed seeds, with every invariant checked at every event."""

from math import inf

import pytest
from stories import Story, one_swarm, swarms

from swarmer.faults import Fault, Schedule
from swarmer.messages import Kind
from swarmer.protocol.events import Fly, Landed, Received
from swarmer.state_machine import State

CALM = {"thaw.policy": "off"}
LOW = range(1, 16)
HIGH = range(16, 31)


def run_to_one_swarm(within_s, **settings):
    story = Story(until=one_swarm, duration_s=within_s, **settings)
    assert one_swarm(story.end), f"{swarms(story.end)} swarms after {within_s} s"
    return story


# -- converging ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_small_shape_becomes_one_swarm_and_itself(seed):
    story = Story(seed=seed, duration_s=14.0)
    assert any(one_swarm(snapshot) for snapshot in story.audience.samples if snapshot.t_s <= 6.0)
    assert story.hd(story.end) < 0.1
    for invariant in ("S1", "S2", "S3", "S4", "S5", "S6", "S7", "S8", "S9", "S11", "S12", "S13", "S16"):
        assert story.seen[invariant] > 10, f"{invariant} never had anything to look at"


@pytest.mark.parametrize(
    ("shape", "settings"),
    [
        ("dragon", {"points": 2}),
        ("dragon", {"points": 3, "m": 2}),
        ("random", {"points": 12, "eta": 1}),
        ("random", {"points": 25, "m": 2}),
        ("random", {"points": 25, "epsilon_deg": 30}),
        ("random", {"points": 25, "epsilon_deg": 0}),
        ("random", {"points": 25, "lambda_ms": 50}),
        ("random", {"points": 25, "lease_ms": 20}),
        ("random", {"points": 25, "busy_join": "all"}),
        ("random", {"points": 25, "anchor": "largest"}),
        ("random", {"points": 25, "anchor": "smallest"}),
        ("random", {"points": 25, "anchor": "challenger"}),
        ("random", {"points": 25, "anchor": "random"}),
        ("random", {"points": 25, "virtual.handling_ms": 2.0}),
        ("random", {"points": 25, "sensing.model": "uniform", "sensing.error_percent": 10.0, "sensing.samples": 4,
                    "sensing.sample_ms": 5.0}),
    ],
    ids=str,
)  # fmt: skip
def test_one_swarm_forms_whatever_the_settings(shape, settings):
    run_to_one_swarm(15.0, shape=shape, **CALM, **settings)


def test_on_a_slow_radio_challenges_cross_and_pairs_still_last():
    slow = {"virtual.latency_min_ms": 20.0, "virtual.latency_max_ms": 60.0}
    story = run_to_one_swarm(10.0, **slow, **CALM)
    granted, expired = (story.result.counters[name] for name in ("leases_granted", "leases_expired"))
    assert granted >= story.plan.size - 1
    assert expired <= granted / 10


def test_a_formed_swarm_is_quiet():
    """Everyone R-Complete: nothing but a probe at every 8th tick (rule 9)."""
    story = Story(duration_s=15.0, **CALM)
    assert one_swarm(story.at(4.0))
    new = story.log.kinds_sent(from_s=7.0)
    probes = story.plan.size * 8.0 / story.plan.rules.lambda_s / 8
    assert 0.6 * probes < new.pop(int(Kind.CHALLENGE_INIT)) < 1.4 * probes
    new.pop(int(Kind.NEIGHBOUR))
    assert not new


# -- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("end", ["radio.loss", "radio.loss_sender", "radio.loss_receiver"])
def test_lost_datagrams_delay_but_never_stop(loss, end):
    run_to_one_swarm(25.0, **{end: loss}, **CALM)


@pytest.mark.parametrize(
    "radio",
    [
        {"duplicate": 0.5},
        {"reorder": 0.4, "reorder_ms": 100.0},
        {"delay_ms": 60.0},
        {
            "delay_ms": 40.0,
            "jitter_ms": 40.0,
            "duplicate": 0.3,
            "reorder": 0.3,
            "reorder_ms": 300.0,
            "loss": 0.1,
        },
    ],
    ids=str,
)
def test_late_doubled_and_disordered_datagrams(radio):
    run_to_one_swarm(20.0, **{f"radio.{name}": value for name, value in radio.items()}, **CALM)


def test_what_comes_twice_acts_once():
    """Copies change who answers first, but each message is handled once; S12 sees the rest."""
    story = Story(duration_s=6.0, **{"radio.duplicate": 1.0})
    assert story.seen["S12"] >= story.result.counters["handled"] > 1000


@pytest.mark.parametrize("victim", [1, 30], ids=["the lowest FID", "the highest FID"])
@pytest.mark.parametrize("moment", [1.5, 7.0], ids=["while swarms form", "in a formed swarm"])
def test_a_replacement_joins_and_drags_nobody(victim, moment):
    back = moment + 0.4
    story = Story(
        faults=Schedule((Fault(moment, "kill", (victim,), 0.4),), back), duration_s=back + 8.0, **CALM
    )  # fmt: skip
    assert story.checks.facts.single_s is not None
    assert not story.at(moment + 0.2).alive[victim - 1]
    assert story.flss[victim].machine.incarnation == 1
    assert story.seen["S10"] > 0
    assert story.result.counters["replacements"] == 1
    if moment > 5:
        assert one_swarm(story.at(moment - 0.1))
        before, after = story.at(back), story.end
        others = [row for row in range(story.plan.size) if row != victim - 1]
        assert (before.swarm[others] == after.swarm[others]).all()


def test_a_third_of_all_dies_at_once_and_comes_back():
    third = tuple(range(1, 31, 3))
    story = Story(
        faults=Schedule((Fault(5.0, "kill", third, 0.5),), 5.5), duration_s=20.0, **CALM
    )  # fmt: skip
    assert story.checks.facts.single_s is not None
    assert story.at(5.2).alive.sum() == 20
    assert story.hd(story.end) < 5.0


def test_the_bereaved_anchor_is_free_after_a_lease():
    """Its localizer dies in flight: no FIN, no renewal, and the lease runs out."""
    free = Story(points=2, duration_s=5.0, **CALM)
    grants = [
        t_s for t_s, fid, _, actions in free.log.events if fid == 2 and any(type(a) is Fly for a in actions)
    ]
    assert len(grants) == 2, "its launch, and the way to its anchor"
    moment = grants[1] + 0.001
    story = Story(points=2, faults=Schedule((Fault(moment, "kill", (2,)),)), duration_s=moment + 1.0, **CALM)
    freed = story.result.counters
    assert freed["leases_expired"] == 1
    states = [
        (t_s, fid)
        for t_s, fid, event, _ in story.log.events
        if type(event).__name__ == "Due" and event.timer == 2
    ]
    assert len(states) == 1
    assert states[0][0] - moment <= story.plan.rules.lease_s + 0.002
    assert story.flss[1].machine.state is State.AVAILABLE


@pytest.mark.parametrize("way", ["both", "in", "out"])
def test_two_halves_that_cannot_hear_each_other_merge_when_they_can(way):
    cut = Fault(0.0, "cut", tuple(LOW), 6.0, way=way)
    story = Story(
        faults=Schedule((cut,)), duration_s=16.0, **CALM,
        until=lambda snapshot: snapshot.t_s > 6.0 and one_swarm(snapshot),
    )  # fmt: skip
    assert swarms(story.at(5.9)) >= 2
    assert one_swarm(story.end)
    before = [event for event in story.log.events if event[0] < 6.0 and type(event[2]) is Received]
    crossed = {(event[1] in LOW, event[2].message.sender in LOW) for event in before}
    assert ((True, False) in crossed) == (way == "out"), "who listens in the low half"
    assert ((False, True) in crossed) == (way == "in"), "who listens in the high half"


def test_who_hangs_hears_all_of_it_later():
    fids = (3, 7)
    story = Story(faults=Schedule((Fault(1.5, "hang", fids, 2.0),)), duration_s=12.0, **CALM)
    hung = [t_s for t_s, fid, *_ in story.log.events if fid in fids and 1.5 < t_s < 3.5]
    assert not hung
    woken = [t_s for t_s, fid, *_ in story.log.events if fid in fids and 3.5 <= t_s < 3.52]
    assert len(woken) > 5
    assert one_swarm(story.end)


def test_who_is_slow_is_late_and_joins():
    slow = Fault(0.0, "slow", (3, 7, 11), 20.0, 0.3)
    story = Story(faults=Schedule((slow,)), duration_s=20.0, until=one_swarm, **CALM)
    assert one_swarm(story.end)
    swift = Story(duration_s=20.0, until=one_swarm, **CALM)
    lit = [min(e[0] for e in s.log.events if e[1] == 3 and type(e[2]) is Landed) for s in (story, swift)]
    assert 0.0 < lit[0] - lit[1] <= 0.3


# -- thaws -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "radio", [{}, {"radio.loss": 0.2}, {"radio.delay_ms": 50.0, "radio.jitter_ms": 50.0}], ids=str
)
def test_each_thaw_is_obeyed_exactly_once_by_everybody(radio):
    story = Story(duration_s=12.0, **radio, **{"thaw.h_s": 2.0})
    epochs = {fls.machine.epoch for fls in story.flss.values()}
    assert min(epochs) >= 3, "who missed a THAW was told"
    assert max(epochs) - min(epochs) <= 1
    # Nobody was dark when the first thaw came, and nobody obeyed one twice.
    assert story.result.counters["thawed_flss"] == sum(fls.machine.epoch for fls in story.flss.values())


def test_who_missed_a_thaw_is_told():
    before = Story(duration_s=8.0, **{"thaw.h_s": 4.0})
    thawed = next(t_s for t_s, fid, _, actions in before.log.events if any(_says_thaw(a) for a in actions))
    alone = Fault(thawed - 0.1, "cut", (7,), 0.3)
    story = Story(faults=Schedule((alone,)), duration_s=thawed + 1.7, **{"thaw.h_s": 4.0})
    epochs = {fid: [e[0] for e in story.log.events if e[1] == fid and _obeys(e)] for fid in (1, 7)}
    assert epochs[1][0] < thawed + 0.05
    assert thawed + 0.2 <= epochs[7][0] < thawed + 1.7
    assert story.flss[7].machine.epoch == 1


def _says_thaw(action):
    return getattr(getattr(action, "message", None), "kind", None) == Kind.THAW


def _obeys(event):
    return type(event[2]) is Received and event[2].message.epoch == 1


def test_thawing_makes_the_shape_better():
    shares = []
    for seed in range(1, 4):
        story = Story(seed=seed, duration_s=16.0)
        first = next(snapshot for snapshot in story.audience.samples if one_swarm(snapshot))
        assert first.t_s <= 4.0
        shares.append(story.hd(story.end) / story.hd(first))
    assert max(shares) < 0.2


# -- the presets -----------------------------------------------------------------------------------------------------


def test_the_papers_rules():
    story = Story("paper", duration_s=12.0, **{"thaw.h_s": 4.0})
    assert any(one_swarm(snapshot) for snapshot in story.audience.samples if snapshot.t_s <= 6.0)
    assert story.hd(story.end) < 1.0
    assert story.result.counters["thawed_flss"] >= story.plan.size
    assert {fls.machine.epoch for fls in story.flss.values()} == {0}
    assert all(not fls.machine.joins for fls in story.flss.values())


def test_the_authors_rules():
    story = Story("authors_code", points=20, duration_s=24.0, **{"thaw.h_s": 2.5})
    assert story.hd(story.end) < story.hd(story.at(4.0)) / 2
    thaws = story.result.counters["thaws"]
    assert thaws >= 5
    assert 20 * (thaws - 1) <= story.result.counters["thawed_flss"] <= 20 * thaws
    assert not story.log.kinds_sent()[int(Kind.NEIGHBOUR)]
    assert max(len(fls.machine.leases) for fls in story.flss.values()) <= 1
    assert story.flss[1].machine.settings.waiting_bound_s > 1e6
    assert story.flss[1].machine.settings.m != inf


# -- chance ----------------------------------------------------------------------------------------------------------


def test_the_same_seed_is_the_same_run():
    faults = {"radio.loss": 0.2, "radio.duplicate": 0.2, "radio.jitter_ms": 20.0, "radio.delay_ms": 20.0}
    storm = Schedule((Fault(1.0, "kill", (2, 3), 0.5), Fault(2.0, "slow", (5, 6), 2.0, 0.1)), 5.0)
    one, two = (Story(seed=5, duration_s=6.0, faults=storm, **faults) for _ in range(2))
    assert one.log.events == two.log.events
    assert one.result.extra["trace_sha256"] == two.result.extra["trace_sha256"]


def test_until_its_first_fault_a_run_is_the_same():
    """A schedule takes no draw of anybody's."""
    plain = Story(duration_s=4.0)
    late = Story(
        duration_s=4.0, faults=Schedule((Fault(2.0, "kill", (4,), 0.5), Fault(3.0, "slow", (5,), 1.0, 0.1)))
    )
    before = [event for event in plain.log.events if event[0] < 2.0]
    assert len(before) > 300
    assert before == [event for event in late.log.events if event[0] < 2.0]
    assert plain.log.events != late.log.events


def test_loss_does_not_change_how_much_flights_are_off():
    clean, lossy = Story(duration_s=6.0), Story(duration_s=6.0, **{"radio.loss": 0.2})
    compared = 0
    for fid in clean.flss:
        flights = [
            [e[3] for e in story.log.events if e[1] == fid and e[0] == 0.0] for story in (clean, lossy)
        ]
        assert flights[0] == flights[1]
        compared += len(flights[0])
    assert compared == 30
    # Two generators that have drawn equally often are in the same state, whatever the radio did meanwhile.
    same = [
        clean.flss[fid]._flight_rng.getstate() == lossy.flss[fid]._flight_rng.getstate()
        for fid in clean.flss
        if _flights(clean, fid) == _flights(lossy, fid)
    ]
    assert same
    assert all(same)


def _flights(story, fid):
    return sum(
        type(action) is Fly for _, who, _, actions in story.log.events if who == fid for action in actions
    )


def test_a_stale_capture_changes_nothing():
    """Every datagram that FLS 3 ever took, once more: each is dropped by the window."""
    story = Story(duration_s=5.0, faults=Schedule((Fault(4.0, "hang", (30,), 0.1),)))
    fls, captured = story.flss[3], story.log.taken[3]
    assert len(captured) > 50
    before, handled = fls.machine.view(), len(story.log.events)
    story.log.fates.clear()
    for message, stamp in captured:
        fls.arrive(message, stamp)
    assert story.log.fates == {"replayed": len(captured)}
    assert len(story.log.events) == handled
    assert fls.machine.view() == before
