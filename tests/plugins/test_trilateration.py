"""Trilateration: what it finds where everybody is in place, and every case in which it finds nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.plugins import NoFix, references_of
from swarmer.plugins.trilateration import Trilateration

coordinates = st.integers(-40, 40).map(float)
flat = st.tuples(coordinates, coordinates, st.just(0.0))


def fix(measured, planned, dim=2):
    return Trilateration().fix(measured, planned, dim)


def shifted(points, offset):
    return [tuple(np.add(point, offset)) for point in points]


def why(measured, planned, dim=2):
    with pytest.raises(NoFix) as none:
        fix(measured, planned, dim)
    return str(none.value)


def in_line(points):
    a, b, c = np.array(points)[:, :2]
    return abs(np.cross(b - a, c - a)) < 1e-9


@pytest.mark.filterwarnings("ignore:Arrays of 2-dimensional vectors")
@given(st.lists(flat, min_size=3, max_size=3, unique=True), flat)
def test_with_everybody_in_place_the_position_is_the_ground_truth(planned, offset):
    if in_line(planned):
        return  # then both points fit
    assert fix(shifted(planned, offset), planned) == pytest.approx(offset, abs=1e-6)


def test_two_circles_and_a_third_by_hand():
    """About (0,0) and (8,0) with radius 5 they meet in (4,3) and (4,-3); the third is 1 from (4,-3), 5 from (4,3)."""
    planned = [(5.0, 0.0, 0.0), (0.0, 5.0, 0.0), (1.0, 0.0, 0.0)]  # lengths 5, 5, 1
    seen = [(0.0, 0.0, 0.0), (8.0, 0.0, 0.0), (4.0, -2.0, 0.0)]
    assert fix(seen, planned) == pytest.approx((4.0, -3.0, 0.0))
    found = Trilateration().fixes(np.array([seen]), np.array([planned]), 2)
    assert found.residual[0] == pytest.approx(0.0, abs=1e-12)


def test_that_three_circles_miss_each_other_is_no_failure_but_a_residual():
    planned = [(5.0, 0.0, 0.0), (0.0, 5.0, 0.0), (3.0, 0.0, 0.0)]
    seen = [(0.0, 0.0, 0.0), (8.0, 0.0, 0.0), (4.0, -2.0, 0.0)]
    found = Trilateration().fixes(np.array([seen]), np.array([planned]), 2)
    assert found.failure[0] == ""
    assert found.residual[0] == pytest.approx(
        2.0
    )  # (4, -3) and (4, 3) are 1 and 5 away from the third, not 3


def test_of_references_in_line_both_points_fit_and_the_nearer_one_is_taken():
    planned = [(-4.0, -3.0, 0.0), (4.0, -3.0, 0.0), (1.0, -3.0, 0.0)]
    seen = shifted(planned, (0.0, 2.0, 0.0))  # meet in (0, 2), and in (0, -4)
    assert fix(seen, planned) == pytest.approx((0.0, 2.0, 0.0))
    above = shifted(planned, (0.0, 5.0, 0.0))  # meet in (0, 5), and in (0, -1)
    assert fix(above, planned) == pytest.approx((0.0, -1.0, 0.0))


def test_the_next_pair_is_taken_where_the_first_one_does_not_meet():
    planned = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (10.0, 0.0, 0.0)]
    seen = [(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.0, 10.0, 0.0)]  # 1 and 2 are 5 apart, with radii of 1
    assert fix(seen, planned) != pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "seen",
    [
        [(0.0, 0.0, 0.0)] * 3,  # d = 0
        [(0.0, 0.0, 0.0), (50.0, 0.0, 0.0), (0.0, 50.0, 0.0)],  # d > D1 + D2
    ],
)
def test_no_pair_meets(seen):
    assert why(seen, [(5.0, 0.0, 0.0), (0.0, 5.0, 0.0), (-5.0, 0.0, 0.0)]) == "no_intersection"


def test_one_circle_within_the_other():
    planned = [(9.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 30.0, 0.0)]
    assert why([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], planned) == "no_intersection"


def test_circles_that_just_touch_meet():
    planned = [(3.0, 0.0, 0.0), (-4.0, 0.0, 0.0), (0.0, 2.0, 0.0)]
    assert fix(shifted(planned, (0.1, 0.2, 0.0)), planned) == pytest.approx((0.1, 0.2, 0.0), abs=1e-6)


def test_in_3d_four_spheres_meet_in_a_point():
    rng = np.random.default_rng(2)
    for _ in range(50):
        planned, offset = rng.uniform(-9, 9, size=(4, 3)), rng.uniform(-9, 9, size=3)
        found = fix(list(planned + offset), list(planned), 3)
        assert found == pytest.approx(tuple(offset), abs=1e-6)
    assert references_of(Trilateration(), 3) == 4
    assert references_of(Trilateration(), 2) == 3


def test_in_3d_four_references_in_a_plane():
    planned = [(1.0, 0.0, 5.0), (0.0, 1.0, 5.0), (-1.0, 0.0, 5.0), (0.0, -1.0, 5.0)]
    assert why(planned, planned, 3) == "coplanar"
