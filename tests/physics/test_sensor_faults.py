"""Broken sensors: off by a constant, wild now and then, dead; never anything but finite."""

import math
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.physics.sensor_faults import SensorFault, sensed

TRUE = (3.0, 4.0, 12.0)


def fault(what, by=0.0, p=0.0, begins_s=0.0, ends_s=9.0):
    return SensorFault(what, begins_s, ends_s, by, p)


@pytest.mark.parametrize(("by", "length"), [(2.0, 15.0), (-3.0, 10.0), (-20.0, 0.0), (0.0, 13.0)])
def test_bias_is_off_by_so_many_cells(by, length):
    found = sensed(TRUE, [fault("bias", by)], 1.0, Random(1))
    assert math.hypot(*found) == pytest.approx(length)
    assert found[0] * 4.0 == pytest.approx(found[1] * 3.0), "the angles are right"


def test_bias_has_no_direction_at_no_distance():
    assert sensed((0.0, 0.0, 0.0), [fault("bias", 2.0)], 1.0, Random(1)) == (0.0, 0.0, 0.0)


def test_outliers_come_so_often():
    rng = Random(1)
    found = [math.hypot(*sensed(TRUE, [fault("outliers", 5.0, 0.1)], 1.0, rng)) for _ in range(5000)]
    wild = [length for length in found if length > 14.0]
    assert len(wild) / len(found) == pytest.approx(0.1, abs=0.015)
    assert wild == pytest.approx([65.0] * len(wild))


def test_a_dead_sensor_tells_nothing():
    assert sensed(TRUE, [fault("dead_sensor")], 1.0, Random(1)) == (0.0, 0.0, 0.0)


def test_a_fault_ends():
    faults = [fault("dead_sensor", begins_s=1.0, ends_s=2.0)]
    dead = [sensed(TRUE, faults, now, Random(1)) != TRUE for now in (0.9, 1.0, 1.9, 2.0)]
    assert dead == [False, True, True, False]


def test_several_at_once():
    both = [fault("bias", 1.0), fault("outliers", 2.0, 1.0)]
    assert math.hypot(*sensed(TRUE, both, 1.0, Random(1))) == pytest.approx(28.0)


def test_a_length_of_next_to_nothing_is_left_as_it_is():
    assert sensed((5e-324, 0.0, 0.0), [fault("bias", 1.0)], 1.0, Random(1)) == (5e-324, 0.0, 0.0)


cells = st.floats(-1e6, 1e6)


@given(
    st.tuples(cells, cells, cells),
    st.lists(st.builds(fault, st.sampled_from(["bias", "outliers", "dead_sensor"]), cells, st.floats(0, 1))),
)
def test_whatever_it_tells_is_finite(vector, faults):
    assert all(map(math.isfinite, sensed(vector, faults[:3], 1.0, Random(1))))
