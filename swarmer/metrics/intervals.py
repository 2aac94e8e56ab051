"""Estimates with 95 % confidence intervals, for few runs, some of which may never have got where they should.

Questions, a method for each, named in what it gives:

- a mean (datagrams, thaws): Student's t, and Welch's for how much two differ;
- a median of times, where a run that never got there counts as later than all that did: order statistics, the ranks
  of the binomial distribution, which assume nothing about how the times are distributed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

LEVEL = 0.95
ENOUGH = 0.9  # an interval that holds the truth less often is none
NEVER = math.inf


class Interval(NamedTuple):
    """An estimate between two bounds; without enough values to tell, the bounds are NaN."""

    estimate: float
    low: float
    high: float
    method: str  # "t", "welch" or "ranks"
    n: int
    level: float = LEVEL  # the share of experiments whose interval holds the truth

    def cut(self) -> Interval:
        """Of what is never below 0 the interval, which Student's t may let begin there.

        >>> mean([1.0, 2.0, 3.0]).cut()[:3]
        (2.0, 0.0, 4.484...)
        """
        return self._replace(low=0.0) if self.low < 0 else self


def mean(values: Sequence[float], level: float = LEVEL) -> Interval:
    """The mean, with Student's t interval: exact for normal values, good for others that are not too skew.

    >>> mean([1.0, 2.0, 3.0])
    Interval(estimate=2.0, low=-0.484..., high=4.484..., method='t', n=3, level=0.95)
    """
    n = len(values)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, "t", 0, level)
    middle = math.fsum(values) / n
    if n == 1:
        return Interval(middle, math.nan, math.nan, "t", 1, level)
    from scipy.special import stdtrit

    half = float(stdtrit(n - 1, (1 + level) / 2)) * math.sqrt(_variance(values, middle) / n)
    return Interval(middle, middle - half, middle + half, "t", n, level)


def difference_of_means(values: Sequence[float], others: Sequence[float], level: float = LEVEL) -> Interval:
    """How much larger the mean of `others` is, with Welch's interval: their variances need not be alike.

    >>> difference_of_means([1.0, 2.0, 3.0], [2.0, 4.0, 6.0])
    Interval(estimate=2.0, low=-2.15..., high=6.15..., method='welch', n=6, level=0.95)
    """
    one, other = mean(values, level), mean(others, level)
    n, estimate = one.n + other.n, other.estimate - one.estimate
    if min(one.n, other.n) < 2:
        return Interval(estimate, math.nan, math.nan, "welch", n, level)
    from scipy.special import stdtrit

    shares = [_variance(its, of.estimate) / of.n for its, of in ((values, one), (others, other))]
    both = math.fsum(shares)
    if both == 0:
        return Interval(estimate, estimate, estimate, "welch", n, level)
    freedom = both**2 / (shares[0] ** 2 / (one.n - 1) + shares[1] ** 2 / (other.n - 1))
    half = float(stdtrit(freedom, (1 + level) / 2)) * math.sqrt(both)
    return Interval(estimate, estimate - half, estimate + half, "welch", n, level)


def _variance(values: Sequence[float], middle: float) -> float:
    return math.fsum((value - middle) ** 2 for value in values) / (len(values) - 1)


def median(values: Sequence[float], level: float = LEVEL) -> Interval:
    """The median, between the two values whose ranks hold it with at least `level`.

    NEVER (infinity) is a value like any other, the largest. Of 5 values the smallest and the largest hold the median
    with 0.9375, and `level` of the result says so; of fewer than 5 no two hold it with 0.9, and there are no bounds.

    >>> median([7.0, 5.0, 6.0, NEVER, 5.5])
    Interval(estimate=6.0, low=5.0, high=inf, method='ranks', n=5, level=0.9375)
    """
    n = len(values)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, "ranks", 0, level)
    ordered = sorted(values)
    lower, upper = ordered[(n - 1) // 2], ordered[n // 2]
    middle = upper if lower == upper else (lower + upper) / 2
    rank, held = _rank(n, level)
    if held < ENOUGH:
        return Interval(middle, math.nan, math.nan, "ranks", n, level)
    return Interval(middle, ordered[rank - 1], ordered[n - rank], "ranks", n, held)


def _rank(n: int, level: float) -> tuple[int, float]:
    """The largest rank r, from 1, such that the r-th value from below and from above hold the median with at least
    `level`, and with what they do hold it; r is 1 if none does.
    """
    rank, below = 1, 0.5**n  # below: P(Binomial(n, 1/2) < rank)
    while rank + 1 <= n / 2:
        next_below = below + math.comb(n, rank) / 2**n  # whole numbers: of many values no float holds them
        if 1 - 2 * next_below < level:
            break
        rank, below = rank + 1, next_below
    return rank, 1 - 2 * below
