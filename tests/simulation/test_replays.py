"""Whatever was said comes again, to anybody, at any later time until the calm: no invariant breaks, and all heals."""

from random import Random

import pytest

from swarmer.engines.virtual_faults import StormyFls
from swarmer.experiments.worlds import draw, play
from swarmer.radio import ReplayWindow

SEEDS = range(1, 13)
AGAIN = 0.3  # of all that an FLS hears, so often something of before is said once more


def with_replays(seed, monkeypatch):
    """The world's outcome, and how many datagrams were said again."""
    world, rng, past, said = draw(seed), Random(f"replays {seed}"), [], []
    calm_s = world.schedule.calm_s or 0.0
    hear = StormyFls.hear

    def hear_twice(fls, message, stamp):
        hear(fls, message, stamp)
        past.append((message, stamp))
        if fls.alive and fls.now() < calm_s and rng.random() < AGAIN:
            said.append(rng.choice(past[-2000:]))
            hear(fls, *said[-1])

    with monkeypatch.context() as patch:
        patch.setattr(StormyFls, "hear", hear_twice)
        return play(world), len(said)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_was_said_before_breaks_nothing(seed, monkeypatch):
    outcome, _ = with_replays(seed, monkeypatch)
    assert outcome.failure is None, outcome.failure


def test_the_replays_are_many_and_would_be_noticed(monkeypatch):
    assert with_replays(2, monkeypatch)[1] > 300
    monkeypatch.setattr(ReplayWindow, "fresh", lambda *call: True)
    assert any(with_replays(seed, monkeypatch)[0].invariant == "S12" for seed in SEEDS)
