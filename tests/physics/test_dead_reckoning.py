from math import acos, atan, dist, hypot, pi, radians, sin, tan
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.physics.dead_reckoning import MODELS, full, one_sided, one_sided_random

numbers = st.floats(-1e4, 1e4).map(lambda x: round(x, 6))
vectors = st.tuples(numbers, numbers, numbers)
AXES = [
    (1.0, 0.0, 0.0),
    (0.0, 2.0, 0.0),
    (0.0, 0.0, 3.0),
    (-1.0, 0.0, 0.0),
    (0.0, 0.0, -1e-9),
    (1e9, 0.0, 0.0),
]
models = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def length(v):
    return hypot(*v)


def angle(a, b):
    scale = length(a) * length(b)
    return acos(max(-1.0, min(1.0, sum(x * y for x, y in zip(a, b, strict=True)) / scale)))


def keeps_its_promise(v, flown, epsilon):
    assert length(flown) == pytest.approx(length(v), rel=1e-9, abs=1e-300)
    assert dist(flown, v) <= 2.0 * length(v) * sin(epsilon / 2.0) * (1.0 + 1e-6) + 1e-9 * length(v)


@models
@given(vectors, st.floats(0.0, radians(45)), st.integers(0, 2**32))
def test_the_length_is_kept_and_the_direction_is_off_by_at_most_epsilon(model, v, epsilon, seed):
    keeps_its_promise(v, model(v, epsilon, 3, Random(seed)), epsilon)


@models
@given(st.tuples(numbers, numbers, st.just(0.0)), st.floats(0.0, radians(45)), st.integers(0, 2**32))
def test_in_2d_the_error_stays_in_the_plane(model, v, epsilon, seed):
    flown = model(v, epsilon, 2, Random(seed))
    keeps_its_promise(v, flown, epsilon)
    assert flown[2] == 0.0


@models
@pytest.mark.parametrize("v", AXES)
@pytest.mark.parametrize("dim", [2, 3])
def test_along_an_axis(model, v, dim):
    rng = Random(1)
    for _ in range(200):
        keeps_its_promise(v, model(v, radians(5), dim, rng), radians(5))


@models
@pytest.mark.parametrize("dim", [2, 3])
def test_nothing_is_flown_where_there_is_nothing_to_fly_and_exactly_where_there_is_no_error(model, dim):
    assert model((0.0, 0.0, 0.0), radians(5), dim, Random(1)) == (0.0, 0.0, 0.0)
    assert model((1.0, 2.0, 3.0), 0.0, dim, Random(1)) == (1.0, 2.0, 3.0)


def test_the_angle_is_uniform_and_its_plane_turns_all_around():
    v, epsilon, rng = (0.0, 0.0, 1.0), radians(5), Random(2)
    flown = [full(v, epsilon, 3, rng) for _ in range(20_000)]
    angles = [angle(v, one) for one in flown]
    assert sum(angles) / len(angles) == pytest.approx(epsilon / 2, rel=0.02)
    assert max(angles) > 0.999 * epsilon
    for axis in (0, 1):
        mean = sum(one[axis] for one in flown) / len(flown)
        assert abs(mean) < 0.001, "no side is preferred"
        spread = (sum(one[axis] ** 2 for one in flown) / len(flown)) ** 0.5
        assert spread == pytest.approx(sin(epsilon) / 6**0.5, rel=0.03)


def test_in_2d_both_sides_are_as_likely():
    rng = Random(3)
    left = sum(full((1.0, 0.0, 0.0), radians(5), 2, rng)[1] > 0 for _ in range(4000))
    assert 1850 < left < 2150


def test_the_matlab_model_errs_to_one_side_which_v_decides():
    v, epsilon, rng = (3.0, 4.0, 5.0), radians(5), Random(4)
    side = (v[0] * v[2], v[1] * v[2], -(v[0] ** 2) - v[1] ** 2)
    for _ in range(200):
        flown = one_sided(v, epsilon, 3, rng)
        off = tuple(a - b for a, b in zip(flown, v, strict=True))
        assert angle(off, side) < radians(5)
    assert one_sided((0.0, 0.0, 7.0), epsilon, 3, Random(5)) == (0.0, 0.0, 7.0), (
        "along the depth axis it has none"
    )


@pytest.mark.parametrize("model", [one_sided, one_sided_random])
def test_the_authors_angle_is_atan_of_a_share_of_tan_epsilon(model):
    v, epsilon = (1.0, 2.0, 2.0), radians(20)
    for seed in range(50):
        share = Random(seed).random()
        assert angle(v, model(v, epsilon, 3, Random(seed))) == pytest.approx(
            atan(share * tan(epsilon)), abs=1e-7
        )


def test_the_authors_emulator_turns_the_plane():
    rng = Random(6)
    flown = [one_sided_random((1.0, 0.0, 0.0), pi / 36, 3, rng) for _ in range(4000)]
    for axis in (1, 2):
        assert abs(sum(one[axis] for one in flown) / 4000) < 0.002
    left = sum(one_sided_random((1.0, 0.0, 0.0), pi / 36, 2, rng)[1] > 0 for _ in range(4000))
    assert 1850 < left < 2150


@models
@pytest.mark.parametrize("dim", [2, 3])
def test_every_flight_draws_equally_often(model, dim):
    """So where an FLS flies does not change by how much its next flights are off."""
    states = []
    for v in [*AXES, (0.0, 0.0, 0.0), (1.0, 2.0, 0.0)]:
        rng = Random(7)
        model(v, radians(5), dim, rng)
        states.append(rng.getstate())
    assert all(state == states[0] for state in states)
