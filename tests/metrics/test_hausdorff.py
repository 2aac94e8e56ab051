import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmer.errors import BadInput
from swarmer.metrics.hausdorff import (
    EmptyCloud,
    HausdorffMeter,
    hausdorff,
    sampled_translation,
    smallest_spacing,
)

NUMBERS = st.floats(-100, 100, allow_nan=False, width=32)


def clouds(rows=st.integers(1, 12)):
    return rows.flatmap(lambda n: arrays(np.float64, (n, 3), elements=NUMBERS))


def brute_force(a, b):
    distances = np.linalg.norm(a[:, None, :] - b[None, :, :], axis=2)
    return max(distances.min(axis=1).max(), distances.min(axis=0).max())


@settings(deadline=None)  # the first call imports scipy
@given(clouds(), clouds())
def test_hausdorff_is_what_its_definition_says(a, b):
    assert hausdorff(a, b, translate=False) == pytest.approx(brute_force(a, b), abs=1e-9)
    moved = a - a.mean(axis=0) + b.mean(axis=0)
    assert hausdorff(a, b) == pytest.approx(brute_force(moved, b), abs=1e-9)


@settings(deadline=None)
@given(st.integers(1, 12).flatmap(lambda n: st.tuples(*[arrays(np.float64, (n, 3), elements=NUMBERS)] * 2)),
       st.data(), st.sampled_from([1.0, 1e-3, 1e-9]))  # fmt: skip
def test_meter_reads_the_lit_ones_only(pair, data, scale):
    """Also where errors are small, so that the shortcut answers."""
    truth, error = pair
    position = truth + scale * error
    lit = np.array(data.draw(st.lists(st.booleans(), min_size=len(truth), max_size=len(truth))))
    meter = HausdorffMeter(truth)
    if not lit.any():
        with pytest.raises(EmptyCloud):
            meter.hd(position, lit)
        return
    own = truth[lit]
    moved = position[lit] + (own - position[lit]).mean(axis=0)
    assert meter.hd(position, lit) == pytest.approx(brute_force(moved, own), abs=1e-9)
    assert meter.absolute(position, lit) == pytest.approx(brute_force(position[lit], own), abs=1e-9)


def test_shortcut_asks_no_tree(monkeypatch):
    truth = np.arange(30.0).reshape(10, 3)
    meter = HausdorffMeter(truth)
    monkeypatch.setattr("swarmer.metrics.hausdorff._tree", None)
    monkeypatch.setattr(meter, "_whole_tree", None)
    position = truth.copy()
    position[3] += 0.01
    assert 0 < meter.hd(position) < 0.02


def test_shifted_swarm_has_hd_0_but_not_absolutely():
    truth = np.random.default_rng(0).random((50, 3)) * 40
    meter = HausdorffMeter(truth)
    assert meter.hd(truth + [7, -3, 2]) == pytest.approx(0, abs=1e-12)
    assert meter.absolute(truth + [100, 0, 0]) > 60


@pytest.mark.parametrize("which", ["estimated", "truth"])
def test_empty_cloud_is_named(which):
    given_clouds = {"estimated": np.ones((1, 3)), "truth": np.ones((1, 3))} | {which: np.empty((0, 3))}
    with pytest.raises(BadInput, match=f"{which}: '0 points'"):
        hausdorff(**given_clouds)


def test_spacing_of_one_point_is_infinite():
    assert smallest_spacing(np.zeros((1, 3))) == np.inf
    assert HausdorffMeter(np.zeros((1, 3))).absolute(np.full((1, 3), 2.0)) == pytest.approx(12**0.5)


def test_the_sampled_translation_is_the_error_that_fits_the_sample_best():
    """SwarMer, section 4.2, by its letter."""
    rng = np.random.default_rng(8)
    truth, position = rng.random((2, 30, 3)) * 9
    errors = truth - position
    fits = [np.linalg.norm(position + error - truth, axis=1).sum() for error in errors]
    assert sampled_translation(errors) == pytest.approx(errors[int(np.argmin(fits))])
    same = np.array([[1.0, 0, 0], [0.0, 0, 0]])
    assert sampled_translation(same).tolist() == [1.0, 0.0, 0.0], "the first of equal ones"
