"""The racing car and the statue as they are shipped, and made anew; how their points are drawn."""

from importlib import import_module

import numpy as np
import pytest
from remake import SCRIPTS, assert_made_anew, assert_shipped, remaking
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from swarmer.shapes.catalogue import load_shape

SHIPPED = {"racecar": (11_894, (49, 98, 25)), "statue": (22_375, (66, 82, 98))}


@pytest.fixture
def distances(monkeypatch):
    monkeypatch.syspath_prepend(SCRIPTS)
    return import_module("solids.distances")


def parts(points, reach):
    """Clumps of points (N, 3) that are linked by steps of at most `reach`, those of ten points or more."""
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    label = connected_components(graph, directed=False)[1]
    return [points[label == one] for one in np.flatnonzero(np.bincount(label) >= 10)]


@pytest.mark.parametrize("name", SHIPPED)
def test_a_large_shape_keeps_its_count_box_and_gap(name):
    assert_shipped(name, *SHIPPED[name], gap=1.02, link=4)


@pytest.mark.parametrize("name", SHIPPED)
def test_no_light_of_it_stands_alone(name):
    points = load_shape(name).points
    assert cKDTree(points).query(points, k=[2])[0].max() < 2


def test_the_car_is_the_same_on_both_sides():
    points = load_shape("racecar").points
    image = points * (-1, 1, 1) + (2 * 26, 0, 0)
    assert np.percentile(cKDTree(points).query(image)[0], 99) < 1.3


def test_the_car_has_four_wheels_beside_its_body_the_rear_ones_larger():
    points = load_shape("racecar").points
    outermost = points[
        (np.abs(points[:, 0] - 26) > 20.5) & (points[:, 1] < 84)
    ]  # cells; the front wing is beyond
    wheels = parts(outermost, 2.5)
    assert len(wheels) == 4
    wheels.sort(key=lambda wheel: wheel[:, 1].mean())
    for wheel, size in zip(wheels, (15.4, 15.4, 14, 14), strict=True):
        np.testing.assert_allclose(np.ptp(wheel[:, 1:], axis=0), size, atol=1)
        assert wheel[:, 2].min() < 3.6  # on the ground


def test_the_car_has_its_rear_wing_on_high_and_its_front_wing_near_the_ground():
    points = load_shape("racecar").points
    tail, nose = points[points[:, 1] < 10], points[points[:, 1] > 91]
    assert np.ptp(tail[tail[:, 2] > 22][:, 0]) > 28
    assert np.ptp(nose[:, 0]) > 44
    assert nose[:, 2].max() < 12
    between = points[(points[:, 1] > 86) & (points[:, 1] < 89)]
    assert between[:, 2].max() < 13


def test_one_can_look_through_the_rims_of_the_car():
    """Beside the hub, between two spokes."""
    points = load_shape("racecar").points
    middle = np.array([3 + 14.0, 3 + 7.7])  # H, D of the rear axle
    wheel = points[np.abs(points[:, 0] - 26) > 14]
    away = np.linalg.norm(wheel[:, 1:] - middle, axis=1)
    rim = wheel[(away > 1.6) & (away < 4.6)]
    turn = np.sort(np.arctan2(*(rim[:, 1:] - middle).T))
    assert np.diff(turn).max() > np.radians(25)


def test_the_statue_stands_on_a_plinth_that_is_its_lowest_part():
    points = load_shape("statue").points
    low = points[points[:, 1] < 11]
    assert np.ptp(low[:, 0]) == pytest.approx(36, abs=1)
    assert np.ptp(low[:, 2]) == pytest.approx(66, abs=2)
    ground = cKDTree(low[low[:, 1] < 4][:, [0, 2]])
    row, column = np.meshgrid(np.arange(18, 51), np.arange(14, 75), indexing="ij")
    assert ground.query(np.column_stack([row.ravel(), column.ravel()]))[0].max() < 2


def test_the_statues_horse_rears_its_wings_spread():
    points = load_shape("statue").points
    legs = points[(points[:, 1] > 14) & (points[:, 1] < 20) & (points[:, 2] > 20)]
    assert len(parts(legs, 2.0)) == 2  # of the hind legs alone: the forelegs are in the air
    head = points[points[:, 2] > 82]
    assert np.ptp(head[:, 0]) < 20
    assert head[:, 1].min() > 35
    wide = points[np.abs(points[:, 0] - 34.5) > 20]
    assert {np.sign(wing[0, 0] - 34.5) for wing in parts(wide, 2.5)} == {-1, 1}
    assert wide[:, 1].min() > 45
    assert wide[:, 1].max() > 78


def test_points_drawn_on_a_level_lie_on_it_evenly(distances):
    ball = distances.ellipsoid((1, 2, 3), (6, 6, 6))
    cubes = distances.cubes_of(ball, ((-8, -8, -8), (9, 10, 11)), -1.5)
    for level in (0.0, -1.5):
        points = distances.drawn_on_level(ball, level, cubes, 10.0, np.random.default_rng(1)) - (1, 2, 3)
        radius = 6 + level
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius, atol=0.05)
        assert len(points) == pytest.approx(10 * 4 * np.pi * radius**2, rel=0.1)
        octant = np.bincount((points > 0) @ (1, 2, 4), minlength=8)
        assert octant.min() > 0.8 * octant.max()


def test_solids_join_part_and_mirror(distances):
    at = np.array([[3.0, 0, 0], [-3, 0, 0], [0, 0, 0], [9, 0, 0]])
    right = distances.slab((3, 0, 0), (1, 1, 1))
    np.testing.assert_array_equal(right(at) < 0, [True, False, False, False])
    np.testing.assert_array_equal(distances.both_sides(right)(at) < 0, [True, True, False, False])
    drum = distances.drum((0, 0, 0), 0, 2.0, 4.0)
    np.testing.assert_array_equal(distances.union(right, drum)(at) < 0, [True, True, True, False])
    np.testing.assert_array_equal(distances.without(drum, right)(at) < 0, [False, True, True, False])


def test_melted_capsules_bulge_where_they_meet_and_flat_ones_are_thin(distances):
    cross = np.array([[-5, 0, 0, 1, 5, 0, 0, 1], [0, -5, 0, 1, 0, 5, 0, 1]], dtype=float)
    corner = np.array([[1.2, 1.2, 0]])
    assert distances.melted(cross, 0.5)(corner)[0] < 0 < distances.melted(cross, 0.05)(corner)[0]
    thin = distances.melted(cross[:1], 0.05, (0, 0, 1.0))
    np.testing.assert_allclose(thin(np.array([[0, 1.0, 0], [0, 0, 0.5]])), 0, atol=1e-9)
    assert thin(np.array([[0, 0, 30.0]]))[0] == distances.FAR


def test_a_hull_follows_its_sections(distances):
    hull = distances.loft([(0, 0, 2, 0, 4), (10, 1, 4, 2, 4)], 2.0)
    on_it = np.array([[2, 1e-9, 2], [5, 10 - 1e-9, 3], [0.5 + 3, 5, 2.5]])
    np.testing.assert_allclose(hull(on_it), 0, atol=1e-6)
    assert hull(np.array([[0, 11.0, 3]]))[0] == pytest.approx(1)


@remaking
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", SHIPPED)
def test_the_script_makes_a_large_shape_anew(name, monkeypatch):
    assert_made_anew(name, monkeypatch)
