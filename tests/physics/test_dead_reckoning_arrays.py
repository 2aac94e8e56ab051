from math import radians, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.physics.dead_reckoning import MODELS as ONE_BY_ONE
from swarmer.physics.dead_reckoning_arrays import MODELS, full, lengths, one_sided

AXES = np.concatenate([np.eye(3), -np.eye(3), [[0.0, 0.0, 1e-9], [1e9, 0.0, 0.0], [3.0, -4.0, 12.0]]])
models = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
dims = pytest.mark.parametrize("dim", [2, 3])


def angles(v, flown):
    cosine = (v * flown).sum(axis=1) / (lengths(v) * lengths(flown))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def test_every_model_has_its_array():
    assert MODELS.keys() == ONE_BY_ONE.keys()


@models
@dims
@given(st.floats(0, 45), st.integers(0, 2**32))
def test_the_length_is_kept_and_the_direction_is_off_by_at_most_epsilon(model, dim, degrees, seed):
    rng = np.random.default_rng(seed)
    v = np.concatenate([AXES, rng.normal(size=(40, 3)) * 30])
    if dim == 2:
        v = v[np.abs(v[:, :2]).sum(axis=1) > 0]
        v[:, 2] = 0.0
    flown = model(v, radians(degrees), dim, rng)
    assert lengths(flown) == pytest.approx(lengths(v), rel=1e-9)
    assert angles(v, flown).max() <= radians(degrees) + 1e-7
    if dim == 2:
        assert (flown[:, 2] == 0).all()


@models
@dims
def test_a_vector_of_length_0_flies_nothing(model, dim):
    assert (model(np.zeros((5, 3)), radians(5), dim, np.random.default_rng(1)) == 0).all()


@models
def test_without_error_the_vector_itself_is_flown(model):
    assert np.array_equal(model(AXES, 0.0, 3, np.random.default_rng(1)), AXES)


def test_the_planes_of_full_are_uniform_about_the_vector():
    v = np.repeat([[1.0, 2.0, -2.0]], 40_000, axis=0)
    off = full(v, radians(20), 3, np.random.default_rng(3)) - v
    across = off - (off @ v[0])[:, None] * v / 9
    assert np.abs(across.mean(axis=0)).max() < 0.02
    spread = np.cov(across.T)
    values = np.sort(np.linalg.eigvalsh(spread))
    assert values[0] == pytest.approx(0, abs=1e-9)
    assert values[1] == pytest.approx(values[2], rel=0.05)


def test_the_angles_of_full_are_uniform():
    v = np.repeat([[0.0, 0.0, 5.0]], 20_000, axis=0)
    off = np.sort(angles(v, full(v, radians(10), 3, np.random.default_rng(3))))
    assert off.mean() == pytest.approx(radians(5), rel=0.02)
    assert off[10_000] == pytest.approx(radians(5), rel=0.03)


def test_one_sided_errs_to_its_one_side_as_the_specification_writes_it():
    v = np.random.default_rng(5).normal(size=(200, 3))
    u = np.random.default_rng(6).random(200)
    i = np.stack([v[:, 1], -v[:, 0], np.zeros(200)], axis=1)
    e = np.cross(v, i)
    e /= lengths(e)[:, None]
    length = lengths(v)[:, None]
    whole = v + e * u[:, None] * length * tan(radians(5))
    expected = whole / lengths(whole)[:, None] * length
    assert np.allclose(one_sided(v, radians(5), 3, np.random.default_rng(6)), expected, atol=1e-12)


def test_one_sided_flies_along_the_depth_without_error():
    v = np.array([[0.0, 0.0, 7.0], [0.0, 0.0, -2.0]])
    assert np.array_equal(one_sided(v, radians(5), 3, np.random.default_rng(1)), v)
