from math import hypot
from random import Random

import pytest

from swarmer.physics.sensing import MODELS, Sensor

TRUE = (3.0, 4.0, 12.0)


def sensor(model, share=0.1, accurate=0.5, samples=1, average="mean"):
    return Sensor(MODELS[model](share, accurate), samples, average, 0.01)


def factors(sensor, count=8000):
    rng = Random(1)
    sensed = [sensor.measure(TRUE, rng) for _ in range(count)]
    for vector in sensed:  # the angles are right, the length is off
        assert vector[0] / 3.0 == pytest.approx(vector[1] / 4.0)
        assert vector[0] / 3.0 == pytest.approx(vector[2] / 12.0)
    return [hypot(*vector) / 13.0 for vector in sensed]


def test_none_is_exact():
    assert sensor("none").measure(TRUE, Random(1)) == TRUE


def test_uniform_is_off_by_at_most_its_share():
    off = factors(sensor("uniform"))
    assert 0.9 <= min(off) < 0.901
    assert 1.099 < max(off) <= 1.1 + 1e-12
    assert sum(off) / len(off) == pytest.approx(1.0, abs=0.002)


def test_mixed_is_exact_so_often():
    off = factors(sensor("mixed", accurate=0.7))
    assert sum(abs(factor - 1.0) < 1e-12 for factor in off) / len(off) == pytest.approx(0.7, abs=0.02)
    assert min(off) < 0.91


@pytest.mark.parametrize("average", ["mean", "median"])
def test_more_samples_are_nearer_and_take_longer(average):
    one, many = sensor("uniform"), sensor("uniform", samples=9, average=average)
    assert (one.delay_s, many.delay_s) == pytest.approx((0.01, 0.09))

    def spread(sensor):
        off = factors(sensor, 2000)
        return (sum((factor - 1.0) ** 2 for factor in off) / len(off)) ** 0.5

    assert spread(many) < 0.65 * spread(one)


def test_mean_and_median_are_what_they_are_called():
    def given(values):
        drawn = iter(values)
        return lambda rng: next(drawn)

    assert Sensor(given([1.0, 2.0, 6.0]), 3, "mean", 0.0).measure((1.0, 0.0, 0.0), Random(1))[0] == 3.0
    assert Sensor(given([6.0, 1.0, 2.0]), 3, "median", 0.0).measure((1.0, 0.0, 0.0), Random(1))[0] == 2.0
    assert Sensor(given([6.0, 1.0, 2.0, 4.0]), 4, "median", 0.0).measure((1.0, 0.0, 0.0), Random(1))[0] == 3.0


@pytest.mark.parametrize("accurate", [0.0, 0.3, 1.0])
def test_mixed_draws_equally_often_whatever_it_draws(accurate):
    rng, plain = Random(2), Random(2)
    sensor("mixed", accurate=accurate).measure(TRUE, rng)
    sensor("mixed", accurate=0.5).measure(TRUE, plain)
    assert rng.getstate() == plain.getstate()
