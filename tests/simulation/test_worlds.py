"""Small displays in virtual time, from fixed seeds, with every invariant checked at every event."""

from math import inf

import pytest
from invariants import Watch
from world import World

from swarmer.config import load_config
from swarmer.messages import NO_SWARM, Kind, Message, Stamp, To
from swarmer.protocol.events import Count, Fly, Received
from swarmer.state_machine import State

LATENCY_S = (0.0005, 0.0015)


def world(preset=None, latency_s=LATENCY_S, **settings):
    settings = {"shape": "dragon", "points": 30, "seed": 1, "thaw.h_s": 3.0} | settings
    return World(load_config(preset, [], **settings), latency_s)


def lit(world):
    return all(body.lit for body in world.bodies.values() if body.alive)


def run_to_one_swarm(world, within_s):
    """The moment, to a tenth of a second, when all are lit and in one swarm."""
    until = world.now + within_s
    while world.now < until:
        world.run(world.now + 0.1)
        if lit(world) and world.swarms() == 1:
            return world.now
    raise AssertionError(f"{world.swarms()} swarms after {within_s} s")


# -- converging ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_small_shape_becomes_one_swarm_and_itself(seed):
    w = world(seed=seed)
    watch = Watch(w)
    run_to_one_swarm(w, 6.0)
    w.run(14.0)
    assert w.hd() < 0.1
    for rule in ("s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "s9", "s11", "s12", "pairs"):
        assert watch.seen[rule] > 10, f"{rule} never had anything to look at"


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
        ("random", {"points": 25, "sensing.model": "uniform", "sensing.error_percent": 10.0, "sensing.samples": 4,
                    "sensing.sample_ms": 5.0}),
    ],
    ids=str,
)  # fmt: skip
def test_one_swarm_forms_whatever_the_settings(shape, settings):
    w = world(shape=shape, **{"thaw.policy": "off"}, **settings)
    Watch(w)
    run_to_one_swarm(w, 15.0)


def test_on_a_slow_radio_challenges_cross_and_pairs_still_last():
    w = world(latency_s=(0.02, 0.06), **{"thaw.policy": "off"})
    Watch(w)
    run_to_one_swarm(w, 10.0)
    granted, expired = w.count(Count.LEASES_GRANTED), w.count(Count.LEASES_EXPIRED)
    assert granted >= w.plan.size - 1
    assert expired <= granted / 10


def test_a_formed_swarm_is_quiet():
    """Everyone R-Complete: nothing but a probe at every 8th tick (rule 9)."""
    w = world(**{"thaw.policy": "off"})
    run_to_one_swarm(w, 10.0)
    w.run(w.now + 3.0)
    before = dict(w.sent)
    seconds = 8.0
    w.run(w.now + seconds)
    new = {kind: w.sent[kind] - before.get(kind, 0) for kind in w.sent}
    probes = w.plan.size * seconds / w.rules.lambda_s / 8
    assert 0.6 * probes < new.pop(Kind.CHALLENGE_INIT) < 1.4 * probes
    new.pop(Kind.NEIGHBOUR)
    assert not any(new.values()), new


# -- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("end", ["radio.loss", "radio.loss_sender", "radio.loss_receiver"])
def test_lost_datagrams_delay_but_never_stop(loss, end):
    w = world(**{end: loss, "thaw.policy": "off"})
    Watch(w)
    run_to_one_swarm(w, 25.0)


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
    w = world(**{f"radio.{name}": value for name, value in radio.items()}, **{"thaw.policy": "off"})
    Watch(w)
    run_to_one_swarm(w, 20.0)


def test_what_comes_twice_acts_once():
    """Copies change who answers first, but each message is handled once; S12 sees the rest."""
    w = world(**{"radio.duplicate": 1.0})
    watch = Watch(w)
    w.run(6.0)
    handled = sum(body.machine.counts[Count.HANDLED] for body in w.bodies.values())
    assert watch.seen["s12"] >= handled > 1000


@pytest.mark.parametrize("victim", [1, 30], ids=["the lowest FID", "the highest FID"])
@pytest.mark.parametrize("moment", [1.5, 7.0], ids=["while swarms form", "in a formed swarm"])
def test_a_replacement_joins_and_drags_nobody(victim, moment):
    w = world(**{"thaw.policy": "off"})
    watch = Watch(w)
    w.run(moment)
    if moment > 5:
        assert w.swarms() == 1
    w.kill(victim)
    w.run(moment + 0.4)
    assert w.bodies[victim].lit  # nobody has replaced it; the dead have no say in what follows
    w.replace(victim)
    first = []
    tap = w.tap

    def notice(fid, event, actions):
        tap(fid, event, actions)
        state = w.bodies[fid].machine.state
        if fid == victim and state in (State.BUSY_ANCHOR, State.BUSY_LOCALIZING):
            first.append(state)

    w.tap = notice
    others = {fid: body.machine.swarm for fid, body in w.bodies.items() if fid != victim}
    run_to_one_swarm(w, 8.0)
    assert first[0] == State.BUSY_LOCALIZING
    assert watch.seen["s10"] > 0
    assert w.count(Count.JOINS) >= 1
    if moment > 5:
        assert {fid: body.machine.swarm for fid, body in w.bodies.items() if fid != victim} == others


def test_a_third_of_all_dies_at_once_and_comes_back():
    w = world(**{"thaw.policy": "off"})
    Watch(w)
    w.run(5.0)
    for fid in range(1, 31, 3):
        w.kill(fid)
    w.run(5.5)
    for fid in range(1, 31, 3):
        w.replace(fid)
    run_to_one_swarm(w, 15.0)
    assert w.hd() < 5.0


def test_the_bereaved_anchor_is_free_after_a_lease():
    w = world(points=2, **{"thaw.policy": "off"})
    Watch(w)
    anchor, localizer = w.bodies[1], w.bodies[2]
    while (
        localizer.machine.state is not State.BUSY_LOCALIZING or anchor.machine.state is not State.BUSY_ANCHOR
    ):
        assert w.now < 5.0
        w.run(w.now + 0.0005)
    w.kill(2)
    died = w.now
    while anchor.machine.state is State.BUSY_ANCHOR:
        w.run(w.now + 0.001)
    assert w.now - died <= w.rules.lease_s + 0.002
    assert anchor.machine.counts[Count.LEASES_EXPIRED] == 1


def test_two_halves_that_cannot_hear_each_other_merge_when_they_can():
    w = world(**{"thaw.policy": "off"})
    Watch(w)
    w.dark_until_heal = {frozenset((a, b)) for a in range(1, 16) for b in range(16, 31)}
    w.run(6.0)
    assert w.swarms() >= 2
    w.dark_until_heal.clear()
    run_to_one_swarm(w, 10.0)


# -- thaws -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "radio", [{}, {"radio.loss": 0.2}, {"radio.delay_ms": 50.0, "radio.jitter_ms": 50.0}], ids=str
)
def test_each_thaw_is_obeyed_exactly_once_by_everybody(radio):
    w = world(**radio, **{"thaw.h_s": 2.0})
    Watch(w)
    w.run(12.0)
    epochs = {body.machine.epoch for body in w.bodies.values()}
    assert min(epochs) >= 3, "who missed a THAW was told"
    assert max(epochs) - min(epochs) <= 1
    for body in w.bodies.values():  # nobody was dark when the first thaw came
        assert body.machine.counts[Count.THAWS_OBEYED] == body.machine.epoch


def test_who_missed_a_thaw_is_told():
    w = world(**{"thaw.h_s": 4.0})
    Watch(w)
    w.run(3.9)
    w.dark_until_heal = {frozenset((7, other)) for other in range(1, 31) if other != 7}
    while w.bodies[1].machine.epoch == 0:
        w.run(w.now + 0.1)
    w.run(w.now + 0.1)
    assert {body.machine.epoch for fid, body in w.bodies.items() if fid != 7} == {1}
    assert w.bodies[7].machine.epoch == 0
    w.dark_until_heal.clear()
    w.run(w.now + 1.5)
    assert w.bodies[7].machine.epoch == 1


def test_thawing_makes_the_shape_better():
    shares = []
    for seed in range(1, 4):
        w = world(seed=seed, **{"thaw.h_s": 3.0})
        run_to_one_swarm(w, 3.5)
        first = w.hd()
        w.run(16.0)
        shares.append(w.hd() / first)
    assert max(shares) < 0.2


# -- the presets -----------------------------------------------------------------------------------------------------


def thaw_from_the_engine(w, number):
    message = Message(Kind.THAW, 0, 0, 0, NO_SWARM, 0, (0.0, 0.0, 0.0), To.ALL)
    for fid, body in w.bodies.items():
        w.push(w.now, (fid, body, "datagram", (message, Stamp(1, number, (0.0, 0.0, 0.0), w.now))))


def test_the_papers_rules():
    w = world("paper", **{"thaw.h_s": 4.0})
    Watch(w)
    run_to_one_swarm(w, 6.0)
    w.run(12.0)
    assert w.hd() < 1.0
    assert w.count(Count.THAWS_OBEYED) >= w.plan.size
    assert {body.machine.epoch for body in w.bodies.values()} == {0}
    assert all(not body.machine.joins for body in w.bodies.values())


def test_the_authors_rules():
    w = world("authors_code", points=20)
    Watch(w)
    w.run(4.0)
    first = w.hd()
    for number in range(1, 9):
        thaw_from_the_engine(w, number)
        w.run(w.now + 2.5)
    assert w.hd() < first / 2
    assert w.count(Count.THAWS_OBEYED) == 8 * 20
    assert w.sent[Kind.NEIGHBOUR] == 0
    assert max(len(body.machine.leases) for body in w.bodies.values()) <= 1
    assert w.bodies[1].machine.settings.waiting_bound_s > 1e6
    assert w.bodies[1].machine.settings.m != inf


# -- chance ----------------------------------------------------------------------------------------------------------


def story(until_s=6.0, **settings):
    w = world(**settings)
    events = []
    w.tap = lambda fid, event, actions: events.append((w.now, fid, event, actions))
    w.run(until_s)
    return events


def test_the_same_seed_is_the_same_run():
    assert story(seed=5) == story(seed=5)
    faults = {"radio.loss": 0.2, "radio.duplicate": 0.2, "radio.jitter_ms": 20.0, "radio.delay_ms": 20.0}
    assert story(seed=5, **faults) == story(seed=5, **faults)


def test_another_seed_is_another_run():
    assert story(seed=5, until_s=2.0) != story(seed=6, until_s=2.0)


def flight_draws(**settings):
    """For each FLS the state of its flight generator before each of its flights."""
    w = world(**settings)
    draws = {fid: [] for fid in w.bodies}

    def tap(fid, event, actions):
        for action in actions:
            if isinstance(action, Fly):
                draws[fid].append(w.flight_rng[fid].getstate())

    for fid in w.bodies:
        draws[fid].append(w.flight_rng[fid].getstate())
    w.tap = tap
    w.run(6.0)
    return draws


def test_loss_does_not_change_how_much_flights_are_off():
    clean, lossy = flight_draws(), flight_draws(**{"radio.loss": 0.2})
    compared = 0
    for fid, draws in clean.items():
        both = min(len(draws), len(lossy[fid]))
        assert draws[:both] == lossy[fid][:both]
        compared += both
    assert compared > 60
    assert clean != lossy


def test_a_stale_capture_changes_nothing():
    """Every datagram that FLS 3 ever got, once more: each is dropped by the window."""
    w = world()
    captured = []
    receive = w.receive

    def capture(fid, body, message, stamp):
        if fid == 3:
            captured.append((message, stamp))
        receive(fid, body, message, stamp)

    w.receive = capture
    w.run(5.0)
    w.receive = receive
    body = w.bodies[3]
    before = (body.machine.view(), list(body.machine.counts))
    events = []
    w.tap = lambda fid, event, actions: events.append(event)
    for message, stamp in captured:
        w.receive(3, body, message, stamp)
    assert len(captured) > 50
    assert not [event for event in events if isinstance(event, Received)]
    assert (body.machine.view(), list(body.machine.counts)) == before
