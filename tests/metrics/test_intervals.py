"""Intervals hold the truth as often as they say, and runs that never got there are not forgotten."""

import math

import numpy as np
import pytest
from scipy import stats

from swarmer.metrics.intervals import NEVER, difference_of_means, mean, median

DRAWS = 4000


def held(samples, interval, truth):
    """In which share of the samples the interval holds the truth."""
    found = [interval(sample.tolist()) for sample in samples]
    return np.mean([one.low <= truth <= one.high for one in found])


@pytest.mark.parametrize("n", [2, 5, 10])
def test_the_mean_of_normal_values_is_held_95_times_in_100(n):
    samples = np.random.default_rng(1).normal(3, 2, (DRAWS, n))
    assert held(samples, mean, 3) == pytest.approx(0.95, abs=0.012)


def test_the_mean_is_that_of_scipy():
    values = [3.0, 4.5, 4.0, 7.25]
    found = mean(values)
    low, high = stats.t.interval(0.95, 3, np.mean(values), stats.sem(values))
    assert found[:5] == (pytest.approx(4.6875), pytest.approx(low), pytest.approx(high), "t", 4)


def test_the_difference_of_means_is_that_of_scipy():
    one, other = [3.0, 4.5, 4.0, 7.25], [9.0, 9.5, 12.0]
    found = difference_of_means(one, other)
    bounds = stats.ttest_ind(other, one, equal_var=False).confidence_interval(0.95)
    assert found[:3] == (pytest.approx(np.mean(other) - np.mean(one)), *map(pytest.approx, bounds))
    assert difference_of_means([1, 1], [3, 3])[:3] == (2, 2, 2)
    assert math.isnan(difference_of_means([1], [2, 3]).low)


@pytest.mark.parametrize("n", [5, 6, 9, 10, 20, 31])
@pytest.mark.parametrize("shape", ["exponential", "normal"])
def test_the_median_is_held_as_often_as_the_interval_says(n, shape):
    rng = np.random.default_rng(n)
    samples = getattr(rng, shape)(size=(DRAWS, n))
    truth = math.log(2) if shape == "exponential" else 0.0
    says = median(samples[0].tolist()).level
    assert says >= (0.95 if n > 5 else 0.9)
    assert held(samples, median, truth) == pytest.approx(says, abs=0.015)


def test_the_ranks_are_those_of_the_tables():
    """Conover, Practical Nonparametric Statistics: for n = 10 the 2nd and the 9th, for n = 20 the 6th and the 15th."""
    assert median(list(range(1, 11)))[:3] == (5.5, 2, 9)
    assert median(list(range(1, 21)))[:3] == (10.5, 6, 15)


@pytest.mark.parametrize("n", [1_000, 5_000])
def test_of_many_values_the_ranks_are_those_of_the_binomial(n):
    found = median([float(value) for value in range(1, n + 1)])
    rank = int(found.low)
    assert found.high == n + 1 - rank
    assert found.level == pytest.approx(1 - 2 * stats.binom.cdf(rank - 1, n, 0.5))
    assert found.level >= 0.95 > 1 - 2 * stats.binom.cdf(rank, n, 0.5)


def test_a_run_that_never_got_there_is_the_latest_of_all():
    assert median([1, 2, 3, 4, 5, 6, NEVER])[:3] == (4, 1, NEVER)
    assert median([1, 2, NEVER, NEVER, NEVER, NEVER]).estimate == NEVER
    assert median([1, NEVER]).estimate == NEVER
    assert median([NEVER, NEVER]).estimate == NEVER  # not NaN, as inf - inf would be


def test_too_few_values_have_no_bounds():
    assert math.isnan(mean([3.0]).low)
    assert mean([3.0]).estimate == 3
    for n in range(1, 5):
        found = median(list(range(n)))
        assert math.isnan(found.low)
        assert found.estimate == (n - 1) / 2
    assert math.isnan(mean([]).estimate)
    assert math.isnan(median([]).estimate)
