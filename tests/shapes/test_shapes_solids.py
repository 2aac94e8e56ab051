"""The hat, the skateboard and the chess king as they are shipped, and made anew."""

import numpy as np
import pytest
from remake import assert_made_anew, assert_shipped, remaking
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from swarmer.shapes.catalogue import load_shape

SHIPPED = {  # count, corner farthest from the dispatcher, longest planned link in cells
    "hat": (1562, (89, 98, 45), 8.0),
    "skateboard": (1727, (35, 98, 22), 4.0),
    "chess": (454, (53, 53, 98), 8.0),
}


@pytest.mark.parametrize("name", SHIPPED)
def test_a_solid_keeps_its_count_box_and_gap(name):
    count, corner, link = SHIPPED[name]
    assert_shipped(name, count, corner, gap=1.2, link=link)


@pytest.mark.parametrize("name", SHIPPED)
def test_its_lights_leave_neither_clumps_nor_holes(name):
    points = load_shape(name).points
    apart = cKDTree(points).query(points, k=[2])[0]
    assert np.percentile(apart, 95) < 4.2
    assert apart.max() < 4 * apart.min()


def test_the_hat_has_its_brim_below_and_its_tip_hangs_over_to_one_side():
    points = load_shape("hat").points
    low, high = points[points[:, 1] < 25], points[points[:, 1] > 45]
    np.testing.assert_allclose(np.ptp(low, axis=0)[[0, 2]], (86, 42))
    assert np.ptp(high[:, 2]) < 20
    bend = points[points[:, 1] > 60]
    tip = bend[bend[:, 0].argmax()]
    assert tip[0] > 70
    assert bend[bend[:, 1].argmax()][0] < 65
    assert 60 < tip[1] < 85
    assert np.sum(np.linalg.norm(points - tip, axis=1) < 4) < 12  # it is pointed


def test_the_hats_band_is_dark_between_its_lines_but_for_the_buckle_in_front():
    length, height, depth = load_shape("hat").points.T
    cone = np.hypot((length - 46) / 24, (depth - 24) / 16) < 1
    between = cone & (height > 14) & (height < 16)
    assert between.sum() >= 10
    assert depth[between].min() > 24 + 8
    assert np.abs(length[between] - 46).max() < 9


def test_the_skateboard_has_four_wheels_on_one_side_of_its_deck():
    points = load_shape("skateboard").points
    treads = points[points[:, 2] > 22 - 1.9]  # cells: the hangers do not reach so far
    pairs = cKDTree(treads).query_pairs(5.0, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(treads), len(treads)))
    count, wheel = connected_components(graph, directed=False)
    assert count == 4
    middles = np.array([treads[wheel == one].mean(axis=0) for one in range(4)])
    left_low, right_low, left_high, right_high = middles[np.lexsort((middles[:, 0], middles[:, 1] > 50))]
    for left, right in ((left_low, right_low), (left_high, right_high)):
        assert 20 < np.linalg.norm(right - left) < 26
    np.testing.assert_allclose(right_high - right_low, left_high - left_low, atol=1.0)
    assert 40 < np.linalg.norm(left_high - left_low) < 50


def test_the_skateboard_stands_on_its_tail_and_both_ends_bend_away_from_the_wheels():
    points = load_shape("skateboard").points
    left_low, left_high = (points[np.abs(points[:, 1] - at) < 3][:, 0].min() for at in (35, 65))
    assert 1.5 < left_high - left_low < 3  # it leans, by some 4 degrees
    ends = points[(points[:, 1] < 6) | (points[:, 1] > 95)]
    waist = points[np.abs(points[:, 1] - 50.5) < 5]
    assert ends[:, 2].max() < 6
    assert waist[:, 2].min() > 6
    assert np.ptp(waist[:, 2]) < 4  # nothing but the deck there
    assert np.ptp(waist[:, 0]) > 26


def test_the_king_tilts_with_his_foot_the_widest_and_a_flat_cross_on_top():
    points = load_shape("chess").points - load_shape("chess").points.mean(axis=0)
    axis = np.linalg.svd(points, full_matrices=False)[2][0]
    axis *= -np.sign(axis[2])  # to the head, which is away from the viewer
    assert axis[:2].min() > 0.2
    along = points @ axis
    along -= along.min()
    out = np.linalg.norm(points - np.outer(points @ axis, axis), axis=1)
    foot, stem, collar, crown, cross = (
        out[(along > low) & (along < high)].max()
        for low, high in ((0, 12), (32, 42), (47, 53), (68, 76), (85, 97))
    )
    assert foot > 1.3 * crown > 1.3 * collar > 1.8 * stem
    assert cross > stem
    flat = points[along > 85] - points[along > 85].mean(axis=0)
    assert np.linalg.svd(flat)[1][2] < 0.05 * np.linalg.svd(flat)[1][0]


@remaking
@pytest.mark.parametrize("name", SHIPPED)
def test_the_script_makes_a_solid_anew(name, monkeypatch):
    assert_made_anew(name, monkeypatch)
