"""The rounds engine calls whatever a plugin offers, and names the one that breaks."""

import numpy as np
import pytest
from rounds_runs import plan_of, play

from swarmer.engines.array_technique import ArrayTechnique
from swarmer.errors import RunFailed
from swarmer.plugins import NoFix
from swarmer.plugins.physical_movement import PhysicalMovement
from swarmer.plugins.signal_strength import SignalStrength
from swarmer.plugins.trilateration import Trilateration


class Plain:
    """Signal Strength, one by one."""

    displacement = SignalStrength.displacement


class PlainLegs(Plain):
    legs = PhysicalMovement.legs


class PlainFix:
    references = 3

    def fix(self, measured, ground_truth, dim):
        return Trilateration().fix(measured, ground_truth, dim)


def technique(plugin, monkeypatch):
    made = ArrayTechnique(plan_of())
    monkeypatch.setattr(made, "_plugin", plugin)
    return made


def some(*shape):
    return np.random.default_rng(1).normal(size=shape), np.random.default_rng(2).normal(size=shape)


def test_one_by_one_is_the_same_as_all_at_once(monkeypatch):
    d, g = some(20, 3)
    assert np.array_equal(
        technique(Plain(), monkeypatch).displacements(d, g),
        technique(SignalStrength(), monkeypatch).displacements(d, g),
    )
    for one, other in zip(
        technique(PlainLegs(), monkeypatch).legs(d, g),
        technique(PhysicalMovement(), monkeypatch).legs(d, g),
        strict=True,
    ):
        assert np.array_equal(one, other)
    d, g = (np.concatenate([part[..., :2], 0 * part[..., :1]], axis=2) for part in some(20, 3, 3))
    plain, arrays = (
        technique(plugin, monkeypatch).fixes(d, g, 2) for plugin in (PlainFix(), Trilateration())
    )
    assert plain.failure.tolist() == arrays.failure.tolist()
    assert np.allclose(plain.vector, arrays.vector, equal_nan=True)


def answering(**methods):
    return type("Mine", (), methods)()


@pytest.mark.parametrize(
    ("plugin", "said"),
    [
        (answering(displacement=lambda self, d, g: (1.0, 2.0)), "not three numbers"),
        (answering(displacement=lambda self, d, g: (np.nan, 2.0, 0.0)), "finite"),
        (answering(displacement=lambda self, d, g: 1 / 0), "raised ZeroDivisionError"),
        (answering(displacements=lambda self, d, g: d[:1]), "gave an array"),
        (answering(displacements=lambda self, d, g: d * np.nan), "not finite"),
        (answering(displacements=lambda self, d, g: None), "gave an array"),
        (answering(displacements=lambda self, d, g: 1 / 0), "raised ZeroDivisionError"),
    ],
)
def test_a_broken_technique_is_named_with_its_package(plugin, said, monkeypatch):
    d, g = some(5, 3)
    with pytest.raises(RunFailed, match="technique: 'signal_strength' of the package swarmer ") as failed:
        technique(plugin, monkeypatch).displacements(d, g)
    assert said in str(failed.value)


def raising(error):
    def fix(self, measured, ground_truth, dim):
        raise error

    return fix


def test_a_fix_that_is_none_is_a_reason_and_one_that_raises_is_broken(monkeypatch):
    d, g = some(4, 3, 3)
    none = technique(answering(references=3, fix=raising(NoFix("too_shy"))), monkeypatch).fixes(d, g, 2)
    assert none.failure.tolist() == ["too_shy"] * 4
    for fix in (
        raising(KeyError("x")),
        lambda self, d, g, dim: (1.0,),
        lambda self, d, g, dim: (np.inf, 0, 0),
    ):
        with pytest.raises(RunFailed, match="technique: 'signal_strength' of the package swarmer "):
            technique(answering(references=3, fix=fix), monkeypatch).fixes(d, g, 2)


def test_a_run_says_which_technique_broke_and_keeps_what_it_had(monkeypatch):
    monkeypatch.setattr(SignalStrength, "displacements", lambda self, d, g: d[:, :1])
    result, watcher = play()
    assert result.status == "failed"
    assert "technique: 'signal_strength' of the package swarmer " in result.message
    assert "gave an array" in result.message
    assert len(watcher.samples) == 1
