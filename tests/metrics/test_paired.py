"""Which of two is better, pair by pair: by hand, against scipy, and by what must hold of any test."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.metrics import paired

finite = st.floats(-100, 100).map(lambda value: round(value, 3))
few = st.lists(finite, min_size=1, max_size=10)


def by_hand(values):
    """Every way to flip the signs of what is not 0, one after the other."""
    values = [value for value in values if value]
    if not values:
        return 1.0
    far = abs(math.fsum(values))
    sums = [
        abs(math.fsum(s * v for s, v in zip(signs, values, strict=True)))
        for signs in itertools.product((-1, 1), repeat=len(values))
    ]
    return sum(total >= far - 1e-9 for total in sums) / len(sums)


@given(few)
def test_p_is_the_share_of_all_ways_to_flip_the_signs(values):
    assert paired.sign_flips(values).p == pytest.approx(by_hand(values), abs=1e-12)


@given(few)
def test_whom_one_asks_first_makes_no_difference(values):
    other = [-value for value in values]
    assert paired.sign_flips(values).p == paired.sign_flips(other).p
    assert paired.effect(values) == -paired.effect(other)


@given(st.lists(finite, min_size=6, max_size=12))
def test_against_scipy(values):
    from scipy.stats import wilcoxon

    if len({abs(value) for value in values}) == len(values) and all(
        values
    ):  # scipy's is exact without ties alone
        ranks = [
            math.copysign(math.inf, value) if abs(value) == max(map(abs, values)) else value
            for value in values
        ]
        assert paired.sign_flips(ranks).p == pytest.approx(wilcoxon(values, method="exact").pvalue, abs=1e-12)


def test_more_pairs_than_can_be_flipped_in_every_way():
    rng = np.random.default_rng(3)
    values = rng.normal(0.5, 1.0, 14).tolist()
    exact = paired.sign_flips(values)
    assert "exact" in exact.method
    many = [*values, *(1e-9 * value for value in rng.normal(0, 1, 6))]  # six more that hardly count
    drawn = paired.sign_flips(many)
    assert "drawn" in drawn.method
    assert drawn.p == pytest.approx(exact.p, abs=0.01)
    assert drawn == paired.sign_flips(many), "the same data, the same p"


def test_the_least_p_that_so_many_pairs_can_give():
    assert paired.sign_flips([1.0, 2.0, 3.0]).p == paired.sign_flips([1.0, 2.0, 3.0]).least_p == 0.25
    assert paired.sign_flips([1.0] * 6).p < paired.ALPHA < paired.sign_flips([1.0] * 5).p
    for tests in (1, 2, 6, 18, 100):
        needed = paired.pairs_needed(tests)
        assert tests * 2.0 ** (1 - needed) <= paired.ALPHA < tests * 2.0 ** (2 - needed)


def test_who_never_got_there_is_later_than_all_and_both_are_alike():
    never = math.inf
    values = paired.differences([1.0, 2.0, never, 4.0], [never, 2.0, never, 5.0])
    assert values == [never, 0.0, 0.0, 1.0]
    assert paired.effect(values) == 1.0
    assert paired.difference([never] * 6).estimate == never
    assert "signed ranks" in paired.sign_flips(values).method


def test_holm_by_hand():
    assert paired.holm([]) == []
    assert paired.holm([0.04]) == [0.04]
    assert paired.holm([0.01, 0.011, 0.5, 0.02]) == pytest.approx([0.04, 0.04, 0.5, 0.04])


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_never_makes_surer(ps):
    corrected = paired.holm(ps)
    assert all(p <= more <= 1 for p, more in zip(ps, corrected, strict=True))
    assert sorted(range(len(ps)), key=lambda at: (ps[at], at)) == sorted(
        range(len(ps)), key=lambda at: (corrected[at], ps[at], at)
    )


@pytest.mark.parametrize(("draw", "n"), [("normal", 10), ("exponential", 20)])
def test_the_bootstrap_holds_the_mean_about_as_often_as_it_says(draw, n):
    rng = np.random.default_rng(11)
    true = 0.0 if draw == "normal" else 1.0
    held = 0
    for _ in range(200):
        interval = paired.bootstrap_mean(getattr(rng, draw)(size=n).tolist())
        assert interval.low <= interval.estimate <= interval.high
        held += interval.low <= true <= interval.high
    assert 0.86 < held / 200 < 0.99


def test_the_bootstrap_by_scipy_s():
    from scipy.stats import bootstrap

    values = np.random.default_rng(4).exponential(size=15)
    theirs = bootstrap((values,), np.mean, n_resamples=9999, method="BCa", rng=1).confidence_interval
    ours = paired.bootstrap_mean(values.tolist())
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), rel=0.05)


def test_few_or_equal_values_have_an_interval_that_says_how():
    assert paired.bootstrap_mean([1.0, 2.0, 4.0]).method == "t"
    assert paired.bootstrap_mean([2.5] * 8)[:4] == (2.5, 2.5, 2.5, "bootstrap BCa")
    assert math.isnan(paired.bootstrap_mean([]).estimate)
