"""The drawings in the plane as they are shipped, and made anew."""

import numpy as np
import pytest
from remake import assert_made_anew, remaking
from scipy.spatial import cKDTree

from swarmer.shapes.catalogue import load_shape
from swarmer.shapes.neighbours import neighbour_plan

SHIPPED = {  # count, box that it has to fit in, gap, longest planned link; cells
    "butterfly": (94, (24, 24), 1.1, 4),
    "cat": (114, (24, 24), 1.05, 5),
    "teapot": (100, (24, 24), 1.05, 7),
    "butterfly1008": (1008, (64, 44), 1.05, 6),
}


def flat(name):
    return load_shape(name).points[:, :2]


def without_image(points, middle):
    """Those of the points (N, 2) that have no mirror image beyond the vertical line L = middle."""
    image = np.column_stack([2 * middle - points[:, 0], points[:, 1]])
    return points[cKDTree(points).query(image)[0] > 0.01]


def near(points, at, within):
    return points[np.linalg.norm(points - np.asarray(at), axis=1) < within]


@pytest.mark.parametrize("name", SHIPPED)
def test_a_drawing_keeps_its_count_box_and_gap(name):
    count, box, gap, link = SHIPPED[name]
    cloud = load_shape(name)
    plan = neighbour_plan(cloud.points)
    assert len(cloud) == count
    assert cloud.dim == 2
    np.testing.assert_array_equal(cloud.points[:, 2], 3)
    np.testing.assert_allclose(cloud.points[:, :2].min(axis=0), 3)
    assert all(0.75 * side < extent <= side for side, extent in zip(box, cloud.box_cells[:2], strict=True))
    assert plan.spacing_min_cells >= gap
    assert plan.components == 1
    assert plan.longest_link_cells < link
    assert cloud.licence == "MIT"


@pytest.mark.parametrize("name", SHIPPED)
def test_no_light_of_a_drawing_stands_alone(name):
    points = flat(name)
    apart = np.asarray(cKDTree(points).query(points, k=[2])[0])
    assert apart.max() < 2.5
    assert np.median(apart) < 1.6


@pytest.mark.parametrize("name", ["butterfly", "butterfly1008"])
def test_a_butterfly_is_its_own_mirror_image(name):
    points = flat(name)
    middle = (points[:, 0].min() + points[:, 0].max()) / 2
    assert len(without_image(points, middle)) == 0
    body = np.abs(points[:, 0] - middle) < 0.01
    assert body.sum() >= 8
    # the wings reach farther out than the antennae, and these over the body
    high = points[points[:, 1] > points[body, 1].max() + 2]
    assert np.abs(high[:, 0] - middle).min() > 0.5


def test_the_large_butterfly_has_an_eye_on_each_side_and_filled_wings():
    points = flat("butterfly1008")
    middle = (points[:, 0].min() + points[:, 0].max()) / 2
    # the lone light in the middle of an eye: a dark disc, then a ring
    apart = np.asarray(cKDTree(points).query(points, k=[2])[0]).ravel()
    lone = points[apart > 2.3]
    for side in (-1, 1):
        eye = lone[side * (lone[:, 0] - middle) > 0]
        assert len(eye) == 1
        assert len(near(points, eye[0], 2.4)) == 1 + 12
    wings = near(points, (middle - 13, 32), 6)
    assert len(wings) > 50


def test_the_cat_is_symmetric_but_for_its_tail_and_has_two_pointed_ears():
    points = flat("cat")
    ears = points[points[:, 1] > points[:, 1].max() - 0.1]
    assert len(ears) == 2
    middle = ears[:, 0].mean()
    tail = without_image(points, middle)
    assert len(tail) == 12
    assert (tail[:, 0] > middle + 6).all()
    assert tail[:, 1].max() < 14
    whiskers = points[(np.abs(points[:, 0] - middle) > 7.4) & (points[:, 1] > 15)]
    assert len(whiskers) == 12


def test_the_teapots_belly_is_symmetric_between_handle_spout_and_steam():
    points = flat("teapot")
    knob = points[np.abs(points[:, 0] - 14.25) < 4]
    middle = knob[knob[:, 1].argmax()][0]
    rest = without_image(points, middle)
    left, right = (rest[side * (rest[:, 0] - middle) > 0] for side in (-1, 1))
    assert (len(left), len(right)) == (14, 22)
    assert np.ptp(left[:, 0]) < np.ptp(left[:, 1])  # the handle stands
    steam = right[right[:, 1] > 18]
    assert len(steam) == 6
    spout = right[right[:, 1] <= 18]
    assert spout[spout[:, 1].argmax()][0] > middle + 11  # it rises outwards


@remaking
@pytest.mark.parametrize("name", SHIPPED)
def test_the_script_makes_a_drawing_anew(name, monkeypatch):
    assert_made_anew(name, monkeypatch)
