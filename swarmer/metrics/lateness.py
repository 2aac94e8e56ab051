"""How late timers and handled messages are: a log-spaced histogram that each FLS counts and whoever looks adds up.

Pure and without numpy: the FLS processes import this file.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

BUCKETS = 128
SMALLEST_MS = 0.05
LARGEST_MS = 60_000.0

_STEP = (LARGEST_MS / SMALLEST_MS) ** (1 / (BUCKETS - 2))

# Bucket i counts EDGES_MS[i - 1] < late <= EDGES_MS[i]; bucket 0 all that is earlier, the last one all that is later.
EDGES_MS = (*(SMALLEST_MS * _STEP**i for i in range(BUCKETS - 2)), LARGEST_MS)


class Percentiles(NamedTuple):
    """Lateness in milliseconds; each value is its bucket's upper edge, so never too small and at most 12 % too large.

    What was later than 60 s reads 60 s.
    """

    p50: float
    p99: float
    max: float


def bucket(ms: float, _edges: tuple[float, ...] = EDGES_MS) -> int:
    """The bucket, 0 to BUCKETS - 1, that counts a lateness of `ms` milliseconds (negative: early, bucket 0).

    >>> bucket(-3), bucket(0.05), bucket(0.051), bucket(60_000), bucket(1e9)
    (0, 0, 1, 126, 127)
    """
    return bisect_left(_edges, ms)


def percentiles(counts: Sequence[int]) -> Percentiles | None:
    """Median, 99th percentile and maximum of a histogram with BUCKETS counts; None if nothing was counted.

    >>> percentiles([0] * 127 + [2])
    Percentiles(p50=60000.0, p99=60000.0, max=60000.0)
    """
    total = int(sum(counts))
    if total == 0:
        return None
    last = max(i for i, count in enumerate(counts) if count)
    return Percentiles(_quantile(counts, total, 0.50), _quantile(counts, total, 0.99), _upper_edge(last))


def quantile(counts: Sequence[int], share: float) -> float | None:
    """Any percentile of such a histogram; None if nothing was counted.

    >>> quantile([3] + [0] * 126 + [1], 0.5), quantile([0] * 128, 0.5)
    (0.05, None)
    """
    total = int(sum(counts))
    return _quantile(counts, total, share) if total else None


def _quantile(counts: Sequence[int], total: int, share: float) -> float:
    """Upper edge of the first bucket at which `share` of `total` is reached."""
    seen = 0
    for i, count in enumerate(counts):
        seen += int(count)
        if seen >= share * total:
            return _upper_edge(i)
    raise AssertionError("the counts add up to their total")


def _upper_edge(i: int) -> float:
    edge: float = EDGES_MS[min(i, BUCKETS - 2)]
    return edge
