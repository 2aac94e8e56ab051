"""Every rule broken on purpose is noticed, by the invariant that guards it, within a few worlds."""

import pytest
from mutants import MUTANTS, SEEDS, hunt, play, world_of

TABLE = {}


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.name for mutant in MUTANTS])
def test_a_mutant_is_caught_by_its_invariant(mutant, monkeypatch):
    mutant.apply(monkeypatch)
    caught = hunt(mutant)
    assert caught is not None, f"it survived {SEEDS} worlds"
    TABLE[mutant.name] = caught
    assert caught.invariant in mutant.caught_by, caught.failure


def test_without_a_mutant_nothing_is_broken():
    for settings in (
        {},
        *{tuple(sorted(mutant.settings.items())): mutant.settings for mutant in MUTANTS}.values(),
    ):
        outcome = play(world_of(1, settings))
        assert outcome.failure is None, settings
