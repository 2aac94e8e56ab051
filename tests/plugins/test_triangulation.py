"""Triangulation: what it finds where everybody is in place, and every case in which it finds nothing."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from swarmer.plugins import NoFix, references_of
from swarmer.plugins.triangulation import Triangulation

coordinates = st.floats(-50, 50).map(lambda x: round(x, 3))
points = st.tuples(coordinates, coordinates, st.just(0.0))


def fix(measured, planned):
    return Triangulation().fix(measured, planned, 2)


def around(angles_deg, radius=10.0):
    return [(radius * np.cos(a), radius * np.sin(a), 0.0) for a in np.radians(angles_deg)]


def why(measured, planned):
    with pytest.raises(NoFix) as none:
        fix(measured, planned)
    return str(none.value)


@given(st.lists(points, min_size=3, max_size=3), points)
def test_with_everybody_in_place_the_position_is_the_ground_truth(three, offset):
    """Seen from x_f = g_f + offset, the references' places and the planned ones differ by the offset alone."""
    measured = [tuple(np.subtract(point, offset)) for point in three]
    try:
        found = fix(measured, three)
    except NoFix as none:
        assume(str(none) not in ("no_order", "circles_too_close", "degenerate", "tangent"))
        raise
    assert found == pytest.approx(tuple(-x for x in offset), abs=1e-5)


def test_the_test_vector_of_the_specification():
    rng = np.random.default_rng(7)
    planned = rng.uniform(-8, 8, size=(2000, 3, 3))
    planned[:, :, 2] = 0
    found = Triangulation().fixes(planned, planned, 2)
    fixed = found.failure == ""
    assert fixed.sum() > 1000
    assert np.median(np.abs(found.vector[fixed])) < 1e-9
    clear = np.abs(found.vector[fixed]).max(axis=1) < 1e-9
    assert clear.mean() > 0.99, "but for triples that are almost degenerate"


def test_a_square_of_references_by_hand():
    """Seen under two right angles: Thales' circles about the middles of the two sides meet in the centre."""
    planned = [(4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (-4.0, 0.0, 0.0)]
    shifted = [(x + 1.0, y + 2.0, 0.0) for x, y, _ in planned]
    assert fix(shifted, planned) == pytest.approx((1.0, 2.0, 0.0), abs=1e-12)


def test_references_within_a_half_turn_have_an_order_and_those_of_which_two_are_opposite_may_not():
    spread = around([10, 60, 150])
    assert fix(spread, spread) == pytest.approx((0, 0, 0), abs=1e-9)
    opposite = around([0, 180, 180], 5.0)
    assert why(opposite, opposite) == "no_order"


def test_all_four_on_one_circle():
    planned = [tuple(np.subtract(point, (10.0, 0.0, 0.0))) for point in around([60, 120, 250])]
    assert why(planned, planned) == "circles_too_close"


def test_circles_whose_centres_are_less_than_a_cell_apart():
    planned = around([10, 100, 200])
    assert why([tuple(np.multiply(point, 0.05)) for point in planned], planned) == "circles_too_close"


def test_two_references_in_one_place():
    planned = around([10, 100, 200])
    assert why([planned[0], planned[0], planned[2]], planned) == "degenerate"


def test_circles_that_touch_in_the_second_reference():
    """Seen under 90 degrees each: Thales' circles over two chords in line touch in their common end."""
    planned = [(4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (-4.0, 0.0, 0.0)]
    in_line = [(0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (12.0, 0.0, 0.0)]
    assert why(in_line, planned) == "tangent"


def test_a_fix_does_not_depend_on_the_order_of_its_references():
    planned, seen = around([10, 100, 200]), around([15, 90, 210], 9.0)
    first = fix(seen, planned)
    for order in ((1, 2, 0), (2, 1, 0), (0, 2, 1)):
        assert fix([seen[i] for i in order], [planned[i] for i in order]) == pytest.approx(first, abs=1e-9)


def test_in_3d_the_depth_is_kept():
    planned = [(4.0, 0.0, 2.0), (0.0, 4.0, -7.0), (-4.0, 0.0, 1.0)]
    shifted = [(x + 1.0, y + 2.0, z + 3.0) for x, y, z in planned]
    assert Triangulation().fix(shifted, planned, 3) == pytest.approx((1.0, 2.0, 0.0), abs=1e-12)
    assert references_of(Triangulation(), 3) == 3
