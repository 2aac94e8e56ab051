from itertools import pairwise
from math import dist, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.physics import flight
from swarmer.physics.flight import Velocity, duration, peak_speed, plan_flight, position_at

rates = st.floats(0.1, 1000.0)
velocities = st.builds(Velocity, rates, rates, rates)
lengths = st.one_of(st.just(0.0), st.floats(1e-6, 1e4))
SLOW = Velocity(2.0, 1.0, 4.0)


def travelled(t_s, length, velocity):
    return flight.travelled(t_s, length, duration(length, velocity), velocity)


@given(lengths, velocities)
def test_it_begins_at_nothing_ends_exactly_and_never_goes_back(length, velocity):
    whole = duration(length, velocity)
    ways = [travelled(whole * k / 200, length, velocity) for k in range(201)]
    assert ways[0] == 0.0
    assert ways[-1] == length
    assert travelled(whole + 1.0, length, velocity) == length
    assert travelled(-1.0, length, velocity) == 0.0
    assert all(a <= b * (1 + 1e-9) + 1e-12 for a, b in pairwise(ways))
    assert all(0.0 <= way <= length * (1 + 1e-9) for way in ways)


@given(lengths, velocities)
def test_it_is_continuous_and_keeps_its_limits(length, velocity):
    whole = duration(length, velocity)
    if whole == 0.0:
        return
    step = whole / 400
    ways = [travelled(step * k, length, velocity) for k in range(401)]
    speeds = [(b - a) / step for a, b in pairwise(ways)]
    peak = peak_speed(length, velocity)
    noise = 1e-6 * max(speeds)
    assert peak <= velocity.speed
    assert max(speeds) <= peak + noise
    changes = [(b - a) / step for a, b in pairwise(speeds)]
    noise = 1e-3 * max(velocity.acceleration, velocity.braking)
    assert max(changes, default=0.0) <= velocity.acceleration + noise
    assert -min(changes, default=0.0) <= velocity.braking + noise
    assert speeds[0] <= velocity.acceleration * step * (1 + 1e-6)
    assert speeds[-1] <= velocity.braking * step * (1 + 1e-6)


def test_a_long_flight_cruises():
    # 2 s to 2 cells/s over 2 cells, 0.5 s of braking over 0.5 cells, the other 7.5 cells at full speed
    assert duration(10.0, SLOW) == pytest.approx(2.0 + 0.5 + 7.5 / 2.0)
    assert peak_speed(10.0, SLOW) == 2.0
    assert travelled(2.0, 10.0, SLOW) == pytest.approx(2.0)
    assert travelled(3.0, 10.0, SLOW) == pytest.approx(4.0)
    assert travelled(duration(10.0, SLOW) - 0.5, 10.0, SLOW) == pytest.approx(9.5)


def test_a_short_flight_never_reaches_the_top_speed():
    peak = peak_speed(1.0, SLOW)
    assert peak == pytest.approx(sqrt(2 * 1.0 * 1.0 * 4.0 / 5.0))
    assert peak < SLOW.speed
    assert duration(1.0, SLOW) == pytest.approx(peak / 1.0 + peak / 4.0)
    assert travelled(peak / 1.0, 1.0, SLOW) == pytest.approx(peak**2 / 2)


def test_a_flight_tells_where_it_is():
    flight = plan_flight((1.0, 2.0, 3.0), (0.0, 6.0, 8.0), 100.0, SLOW)
    assert flight.length == 10.0
    assert position_at(flight, 99.0, SLOW) == (1.0, 2.0, 3.0)
    assert position_at(flight, 103.0, SLOW) == pytest.approx((1.0, 2.0 + 2.4, 3.0 + 3.2))
    assert position_at(flight, 100.0 + flight.duration_s, SLOW) == (1.0, 8.0, 11.0)
    assert position_at(flight, float("inf"), SLOW) == (1.0, 8.0, 11.0)


def test_no_flight_is_where_it_is():
    flight = plan_flight((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 5.0, SLOW)
    assert flight.duration_s == 0.0
    for now in (0.0, 5.0, 6.0):
        assert position_at(flight, now, SLOW) == (1.0, 2.0, 3.0)


coordinates = st.floats(-1e3, 1e3).map(lambda x: round(x, 6))
places = st.tuples(coordinates, coordinates, coordinates)


@given(places, places, velocities, st.floats(0.0, 1.0))
def test_it_stays_on_its_line(start, displacement, velocity, share):
    flight = plan_flight(start, displacement, 0.0, velocity)
    here = position_at(flight, share * flight.duration_s, velocity)
    end = tuple(a + b for a, b in zip(start, displacement, strict=True))
    assert dist(start, here) + dist(here, end) == pytest.approx(flight.length, abs=1e-6)
