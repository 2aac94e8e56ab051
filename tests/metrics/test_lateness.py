import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.metrics.lateness import BUCKETS, EDGES_MS, LARGEST_MS, SMALLEST_MS, bucket, percentiles


@given(st.lists(st.floats(-10, 1e6), min_size=1, max_size=300))
def test_percentiles_are_never_too_small_and_a_quarter_too_large_at_most(lates):
    counts = [0] * BUCKETS
    for late in lates:
        counts[bucket(late)] += 1
    read = percentiles(counts)
    ordered = sorted(lates)
    for share, value in ((0.5, read.p50), (0.99, read.p99), (1.0, read.max)):
        exact = ordered[max(0, -int(-share * len(lates) // 1) - 1)]
        assert min(exact, LARGEST_MS) <= value * (1 + 1e-9)
        assert value <= max(1.2533 * exact, SMALLEST_MS)


def test_edges_rise_and_fill_the_buckets():
    assert len(EDGES_MS) == BUCKETS - 1
    assert list(EDGES_MS) == sorted(set(EDGES_MS))
    assert (EDGES_MS[0], EDGES_MS[-1]) == (SMALLEST_MS, LARGEST_MS)
    assert {bucket(edge) for edge in EDGES_MS} == set(range(BUCKETS - 1))


def test_nothing_counted_is_none():
    assert percentiles([0] * BUCKETS) is None


@pytest.mark.parametrize("late", [float("nan"), float("inf"), -float("inf")])
def test_any_float_has_a_bucket(late):
    assert 0 <= bucket(late) < BUCKETS


def test_importing_it_costs_no_numpy():
    code = "import sys, swarmer.metrics.lateness; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
