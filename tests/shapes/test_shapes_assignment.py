"""Who flies where: against all permutations where they can be counted, else against the optimum that scipy finds."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from swarmer.errors import BadInput
from swarmer.shapes import assignment
from swarmer.shapes.assignment import NOBODY, assign
from swarmer.shapes.catalogue import load_shape

clouds = st.lists(st.tuples(*[st.integers(0, 9)] * 3), min_size=1, max_size=6).map(
    lambda rows: np.array(rows, dtype=float)
)


def whole(result, current, target):
    """One to one, min(F, G) pairs, and the sums are those of the pairs."""
    flying = np.flatnonzero(result.point_of != NOBODY)
    points = result.point_of[flying]
    assert len(result.point_of) == len(current)
    assert len(np.unique(points)) == len(points) == min(len(current), len(target))
    assert result.leaving.tolist() == np.flatnonzero(result.point_of == NOBODY).tolist()
    assert result.joining.tolist() == sorted(set(range(len(target))) - set(points.tolist()))
    ways = np.linalg.norm(current[flying] - target[points], axis=1)
    assert result.squared_cells == pytest.approx((ways**2).sum())
    assert result.longest_cells == pytest.approx(ways.max())
    return result


def least(current, target):
    """By trying all: the fewer choose among the more."""
    squared = cdist(current, target, "sqeuclidean")
    squared = squared if len(current) <= len(target) else squared.T
    rows = range(len(squared))
    return min(
        sum(squared[i, j] for i, j in zip(rows, chosen, strict=True))
        for chosen in permutations(range(squared.shape[1]), len(squared))
    )


@settings(max_examples=150, deadline=None)
@given(current=clouds, target=clouds)
def test_few_are_assigned_as_well_as_can_be(current, target):
    result = whole(assign(current, target), current, target)
    assert result.optimal
    assert result.squared_cells == pytest.approx(least(current, target))


def test_a_moved_and_shuffled_cloud_finds_itself():
    points = load_shape("dragon").points
    order = np.random.default_rng(0).permutation(len(points))
    result = assign(points, points[order] + [5, 0, 0])
    np.testing.assert_array_equal(order[result.point_of], np.arange(len(points)))
    assert result.longest_cells == pytest.approx(5)


def test_those_farthest_out_of_the_way_leave_and_join():
    line = np.arange(10.0)[:, None] * [1, 0, 0]
    assert assign(line, line[:7]).leaving.tolist() == [7, 8, 9]
    assert assign(line[3:], line).joining.tolist() == [0, 1, 2]
    assert assign(line, line[:7]).point_of.tolist() == [*range(7), *[NOBODY] * 3]


def fitted(name, count):
    points = load_shape(name, points=count).points
    return points * (90 / np.ptp(points, axis=0).max())


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("random", 1500), ("cube", 1500)),
        (("sphere", 1500), ("knot", 1500)),
        (("dragon", 760), ("cube", 1300)),
        (("sphere", 2000), ("random", 1200)),
        (("knot", 1100), ("sphere", 1000)),
    ],
)
def test_blocks_come_close_to_the_optimum(one, other, monkeypatch):
    monkeypatch.setattr(assignment, "EXACT_PAIRS", 1000)
    current, target = fitted(*one), fitted(*other)
    result = whole(assign(current, target), current, target)
    squared = cdist(current, target, "sqeuclidean")
    optimum = squared[linear_sum_assignment(squared)].sum()
    assert not result.optimal
    assert optimum * (1 - 1e-9) <= result.squared_cells <= 1.035 * optimum
    np.testing.assert_array_equal(assign(current, target).point_of, result.point_of)


def test_where_the_few_meet_very_many_it_is_still_the_optimum():
    many, few = load_shape("random", points=30_000).points, load_shape("knot", points=150).points
    result = whole(assign(many, few), many, few)
    assert result.optimal
    squared = cdist(few, many, "sqeuclidean")
    assert result.squared_cells == pytest.approx(squared[linear_sum_assignment(squared)].sum())


@pytest.mark.parametrize("layout", ["all on one side", "in one place", "flat"])
def test_odd_layouts_are_assigned_too(layout, monkeypatch):
    monkeypatch.setattr(assignment, "EXACT_PAIRS", 1000)
    rng = np.random.default_rng(4)
    current, target = rng.random((2500, 3)), rng.random((700, 3))
    if layout == "all on one side":
        target[:, 0] += 1000
    elif layout == "in one place":
        current[:] = 0.5
    else:
        current[:, 2] = target[:, 2] = 3.0
    whole(assign(current, target), current, target)
    whole(assign(target, current), target, current)


@pytest.mark.slow
def test_large_shapes_of_different_counts():
    current, target = fitted("random", 22_375), fitted("sphere", 11_894)
    result = whole(assign(current, target), current, target)
    assert len(result.leaving) == 22_375 - 11_894
    halfway = np.linalg.norm(target.mean(axis=0) - current, axis=1)
    assert np.median(halfway[result.leaving]) < np.median(halfway[result.point_of != NOBODY]), (
        "the sphere is hollow: those inside leave"
    )


@pytest.mark.parametrize(("current", "target"), [(0, 3), (3, 0), (0, 0)])
def test_nobody_to_pair_is_refused(current, target):
    with pytest.raises(BadInput, match=r"^points: 0 is not allowed; at least one"):
        assign(np.ones((current, 3)), np.ones((target, 3)))
