"""Thirty worlds full of faults, always the same ones; `make soak` runs fresh ones for as long as told."""

from collections import Counter

import pytest
from chaos import Fault, Scenario, Storm, draw, play

from swarmer.radio import ReplayWindow

SEEDS = range(1, 31)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_world_full_of_faults_heals(seed):
    outcome = play(draw(seed))
    assert outcome.failure is None, f"python scripts/soak.py --seed {seed} --once: {outcome.failure}"


def test_the_same_seed_is_the_same_world():
    assert draw(7) == draw(7)
    assert play(draw(7)).digest == play(draw(7)).digest


def test_another_seed_is_another_world():
    assert play(draw(7)).digest != play(draw(8)).digest


def test_the_worlds_have_every_kind_of_fault():
    worlds = [draw(seed) for seed in range(200)]
    kinds = {fault.kind for world in worlds for fault in world.faults}
    assert kinds == {"kill", "replace", "hang", "slow", "cut", "join"}
    assert any(not world.faults for world in worlds)
    assert {"radio.loss", "radio.duplicate", "radio.reorder", "radio.delay_ms"} <= {
        name for world in worlds for name in world.settings
    }


def test_a_world_that_cannot_heal_is_a_failure():
    """The checks would see it: FLSs that are cut apart, and stay so, never become one swarm."""
    world = next(draw(seed) for seed in range(200) if draw(seed).live and draw(seed).settings["points"] > 8)
    apart = Scenario(
        world.seed, world.settings, world.latency_s, (Fault(0.0, "cut", (1,), 1.0), *world.faults), 3.0, True
    )
    heal = Storm.heal
    try:
        Storm.heal = lambda self: (heal(self), self.strike(Fault(0.0, "cut", (1,), 1.0)))
        outcome = play(apart)
    finally:
        Storm.heal = heal
    assert outcome.failure is not None
    assert "no single swarm" in outcome.failure


def test_a_broken_rule_is_seen(monkeypatch):
    """A radio that hands on copies of a datagram is one that the rules must notice."""
    monkeypatch.setattr(ReplayWindow, "fresh", lambda *_: True)
    doubling = (seed for seed in range(200) if "radio.duplicate" in draw(seed).settings)
    assert "handled twice" in (play(draw(next(doubling))).failure or "")


def test_every_rule_had_something_to_say():
    seen = sum((play(draw(seed)).seen for seed in range(1, 13)), Counter())
    assert {"s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "s9", "s11", "s12", "pairs"} <= {
        rule for rule, times in seen.items() if times >= 10
    }
