"""Is one better than the other? Runs that share a seed are compared with each other, pair by pair.

Two runs of one seed have the same first flight errors, so what they differ by says more than what each is. Everything
here takes the differences of pairs, other minus one, for one measure:

- how much: the mean with a bootstrap interval (BCa), or the median between two ranks where some never got there;
- how surely: a permutation test that flips signs. If neither were better, each difference could as well be of the
  other sign; p is the share of all ways to flip them whose sum is as far from 0. Where some are infinite their ranks
  are summed;
- how consistently: the matched-pairs rank-biserial correlation (Kerby 2014), 1 where all differences are positive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.metrics.intervals import LEVEL, Interval, mean, median

EXACT_PAIRS = 16  # more are not flipped in every way, but in FLIPS drawn ones
FLIPS = 99_999
RESAMPLES = 9_999
ENOUGH_FOR_BOOTSTRAP = 6  # values; with fewer their t interval is given: a bootstrap of so few is too narrow
SEED = 20231204  # of resamples and flips: the same data give the same figures
ALPHA = 0.05


class SignTest(NamedTuple):
    """What the pairs say about their difference."""

    p: float
    least_p: float  # the smallest that so many pairs can give of which none is 0
    method: str
    direction: int  # to which side of 0 that what is flipped adds up: -1, 0, 1


def bootstrap_mean(values: Sequence[float], level: float = LEVEL) -> Interval:
    """The mean with a BCa bootstrap interval (Efron 1987); Student's t for fewer than 6 values, and the method says so.

    >>> bootstrap_mean([1.0, 2.0, 3.0, 4.0, 5.0, 30.0])._replace(low=0, high=0)
    Interval(estimate=7.5, low=0, high=0, method='bootstrap BCa', n=6, level=0.95)
    """
    n = len(values)
    if n < ENOUGH_FOR_BOOTSTRAP:
        return mean(values, level)
    data = np.asarray(values, np.float64)
    middle = float(data.mean())
    if np.ptp(data) <= 1e-12 * max(1.0, float(np.abs(data).max())):
        return Interval(middle, middle, middle, "bootstrap BCa", n, level)
    from scipy.special import ndtr, ndtri

    rng = np.random.default_rng(SEED)
    means = np.sort(data[rng.integers(0, n, size=(RESAMPLES, n))].mean(axis=1))
    below = (means < middle).mean() + (means == middle).mean() / 2
    bias = float(ndtri(np.clip(below, 1 / RESAMPLES, 1 - 1 / RESAMPLES)))
    off = middle - (data.sum() - data) / (n - 1)  # the jackknife's
    skew = float((off**3).sum() / (6 * (off**2).sum() ** 1.5))
    bounds = []
    for tail in ((1 - level) / 2, (1 + level) / 2):
        z = bias + float(ndtri(tail))
        bounds.append(float(np.quantile(means, ndtr(bias + z / (1 - skew * z)))))
    return Interval(middle, bounds[0], bounds[1], "bootstrap BCa", n, level)


def differences(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """other - one, pair by pair; 0 where both never got there.

    >>> differences([1.0, math.inf, math.inf], [3.0, math.inf, 2.0])
    [2.0, 0.0, -inf]
    """
    return [0.0 if a == b else b - a for a, b in zip(one, other, strict=True)]


def difference(values: Sequence[float], level: float = LEVEL) -> Interval:
    """How large differences are: their mean, or where one is infinite their median."""
    return bootstrap_mean(values, level) if all(map(math.isfinite, values)) else median(values, level)


def effect(values: Sequence[float]) -> float:
    """The matched-pairs rank-biserial correlation of differences, -1 to 1; 0 if all of them are 0.

    >>> effect([1.0, 2.0, 3.0]), effect([-3.0, 1.0, 2.0])
    (1.0, 0.0)
    """
    ranks = _signed_ranks(values)
    total = float(np.abs(ranks).sum())
    return float(ranks.sum()) / total if total else 0.0


def sign_flips(values: Sequence[float]) -> SignTest:
    """Is it by chance that the differences lie on one side of 0? Two-sided; see the top of this file."""
    infinite = not all(map(math.isfinite, values))
    scores = _signed_ranks(values) if infinite else np.array([value for value in values if value], np.float64)
    what = "signed ranks" if infinite else "mean"
    n = len(scores)
    if n == 0:
        return SignTest(1.0, 1.0, f"sign flips of the {what}, exact", 0)
    whole = float(scores.sum())
    direction = int(np.sign(whole))
    far = abs(whole) - 1e-12 * float(np.abs(scores).sum())  # sums that differ by rounding alone are equal
    if n <= EXACT_PAIRS:
        signs = 1 - 2 * (
            (np.arange(2 ** (n - 1))[:, None] >> np.arange(n - 1)) & 1
        )  # the last one stays: by symmetry
        sums = np.abs(signs @ scores[:-1] + scores[-1])
        return SignTest(
            float((sums >= far).mean()), least_p(n), f"sign flips of the {what}, exact", direction
        )
    rng = np.random.default_rng(SEED)
    hits = 0
    for start in range(0, FLIPS, 10_000):
        rows = min(10_000, FLIPS - start)
        signs = 1 - 2 * rng.integers(0, 2, size=(rows, n), dtype=np.int8)
        hits += int((np.abs(signs @ scores) >= far).sum())
    drawn = f"sign flips of the {what}, {FLIPS + 1:,} drawn"
    return SignTest((hits + 1) / (FLIPS + 1), least_p(n), drawn, direction)


def least_p(n: int) -> float:
    """The smallest p that so many pairs can give: that of differences which all lie on one side of 0.

    >>> least_p(0), least_p(6), least_p(17)
    (1.0, 0.03125, 1e-05)
    """
    return min(1.0, 2.0 ** (1 - n)) if n <= EXACT_PAIRS else 1 / (FLIPS + 1)


def holm(ps: Sequence[float]) -> list[float]:
    """p-values of several tests, corrected so that all of them together err once in 20 times at most (Holm 1979).

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    order = sorted(range(len(ps)), key=lambda at: ps[at])
    corrected, highest = [0.0] * len(ps), 0.0
    for place, at in enumerate(order):
        highest = max(highest, min(1.0, (len(ps) - place) * ps[at]))
        corrected[at] = highest
    return corrected


def pairs_needed(tests: int) -> int:
    """How many pairs it takes before the surest of so many tests together can show a difference.

    >>> pairs_needed(1), pairs_needed(18)
    (6, 10)
    """
    return 1 + math.ceil(math.log2(tests / ALPHA))


def _signed_ranks(values: Sequence[float]) -> NDArray[np.float64]:
    """Of the differences that are not 0 the ranks of their sizes, equal ones with the mean rank, with their signs."""
    data = np.array([value for value in values if value], np.float64)
    sizes = np.abs(data)
    ordered = np.sort(sizes)
    ranks = (np.searchsorted(ordered, sizes, "left") + np.searchsorted(ordered, sizes, "right") + 1) / 2
    return np.sign(data) * ranks
