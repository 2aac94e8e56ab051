"""When an FLS challenges, and when it thaws."""

from random import Random

import pytest

from swarmer.config import load_config
from swarmer.plan import make_machine, make_plan
from swarmer.protocol.challenge_policy import Decay, RComplete
from swarmer.protocol.thaw import Never, Timer
from swarmer.state_machine import Identity


def ticks(policy, complete, count=40, rng=None):
    return [policy.challenges(complete, rng or Random(1)) for _ in range(count)]


def test_who_is_not_r_complete_challenges_at_every_tick():
    assert all(ticks(RComplete(8), complete=False))


def test_who_is_r_complete_probes_at_every_8th_tick():
    assert [i + 1 for i, challenges in enumerate(ticks(RComplete(8), complete=True)) if challenges] == [
        8, 16, 24, 32, 40,
    ]  # fmt: skip
    assert not any(ticks(RComplete(0), complete=True))


def test_the_flss_of_a_swarm_do_not_all_probe_at_the_same_tick():
    probes = {fid: ticks(RComplete(8, fid), complete=True).index(True) + 1 for fid in range(1, 17)}
    assert sorted(probes.values()) == sorted([*range(1, 9)] * 2)
    assert all(sum(ticks(RComplete(8, fid), complete=True)) == 5 for fid in probes)


def test_a_machine_has_the_phase_of_its_fid():
    rules = make_plan(load_config(shape="sphere", points=20)).rules
    first = {}
    for fid in range(1, 9):
        machine = make_machine(rules, Identity(fid, 0, (0.0, 0.0, 0.0)), (fid + 1,), 1.0, Random(1))
        first[fid] = ticks(machine.policy, complete=True).index(True)
    assert len(set(first.values())) == 8


def test_idle_ticks_are_counted_anew():
    policy = RComplete(3)
    assert ticks(policy, True, 2) == [False, False]
    assert ticks(policy, False, 1) == [True]
    assert ticks(policy, True, 3) == [False, False, True]
    assert ticks(policy, True, 2) == [False, False]
    policy.thawed()
    assert ticks(policy, True, 3) == [False, False, True]


@pytest.mark.parametrize(("merges", "share"), [(0, 1.0), (1, 0.8), (3, 0.512), (10, 0.107)])
def test_decay_challenges_less_with_each_merge(merges, share):
    policy, rng = Decay(1.25), Random(2)
    for _ in range(merges):
        policy.merged()
    drawn = ticks(policy, True, 4000, rng)
    assert sum(drawn) / 4000 == pytest.approx(share, abs=0.03)
    policy.thawed()
    assert all(ticks(policy, True, 100, rng))


def test_the_thaw_timer_is_uniform_from_h_to_spread_times_h():
    delays = [Timer(10.0, 2.0).delay_s(rng) for rng in [Random(3)] for _ in range(3000)]
    assert all(10.0 <= delay <= 20.0 for delay in delays)
    assert sum(delays) / len(delays) == pytest.approx(15.0, abs=0.2)
    assert min(delays) < 10.1
    assert max(delays) > 19.9


def test_never_is_never():
    assert Never().delay_s(Random(4)) is None
