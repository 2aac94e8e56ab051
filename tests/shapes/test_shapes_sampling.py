"""Exactly so many points, well spread: counts, gaps, thin parts, what is kept, what is refused."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from swarmer.errors import BadInput
from swarmer.shapes import sampling
from swarmer.shapes.errors import BadShape
from swarmer.shapes.sampling import blue_noise, drawn_on_surface, gap_share, spread_choice, surface_sample


def box(length, height, depth):
    """Vertices, faces and area of a box."""
    corners = np.array([(x, y, z) for x in (0, length) for y in (0, height) for z in (0, depth)], dtype=float)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([three for a, b, c, d in sides for three in ((a, b, c), (a, c, d))])
    return corners, faces, 2.0 * (length * height + height * depth + depth * length)


def plane():
    vertices = np.array([(0, 0, 0), (30, 0, 0), (30, 10, 0), (0, 10, 0)], dtype=float)
    return vertices, np.array([(0, 1, 2), (0, 2, 3)]), 300.0


def sphere():
    turn, up = np.meshgrid(np.linspace(0, 2 * np.pi, 65), np.linspace(0, np.pi, 33), indexing="ij")
    vertices = np.stack([np.sin(up) * np.cos(turn), np.cos(up), np.sin(up) * np.sin(turn)], axis=-1)
    at = np.arange(65 * 33).reshape(65, 33)
    one, right, above, other = at[:-1, :-1], at[1:, :-1], at[:-1, 1:], at[1:, 1:]
    threes = [(one, right, other), (one, other, above)]
    faces = np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in threes])
    return vertices.reshape(-1, 3), faces, 4 * np.pi


SURFACES = {"plane": plane(), "sphere": sphere(), "thin box": box(40.0, 25.0, 3.0)}


def gap_of(points):
    return cKDTree(points).query(points, k=[2])[0].min()


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("count", [500, 2500, 6000])
def test_a_surface_gets_its_count_at_six_tenths_of_the_best_gap_there_is(surface, count):
    vertices, faces, area = SURFACES[surface]
    points = surface_sample(vertices, faces, count, seed=2)
    assert points.shape == (count, 3)
    assert 0.6 < gap_share(points, area) < 1
    assert len(np.unique(points, axis=0)) == count


@pytest.mark.slow
def test_a_hundred_thousand_points_keep_that_gap():
    vertices, faces, area = SURFACES["plane"]
    assert 0.65 < gap_share(surface_sample(vertices, faces, 100_000, seed=1), area) < 1


def test_the_hexagonal_lattice_has_a_gap_share_of_one():
    row, column = np.meshgrid(np.arange(200), np.arange(200), indexing="ij")
    points = np.column_stack(
        [(column + row % 2 / 2).ravel(), (row * np.sqrt(0.75)).ravel(), np.zeros(40_000)]
    )
    assert gap_share(points, 40_000 * np.sqrt(0.75)) == pytest.approx(1)


def test_no_place_of_the_surface_is_left_bare():
    vertices, faces, area = SURFACES["plane"]
    points = surface_sample(vertices, faces, 3000, seed=5)
    ideal = np.sqrt(2 * area / (np.sqrt(3) * 3000))
    bare = cKDTree(points).query(drawn_on_surface(vertices, faces, 50_000, seed=6))[0].max()
    assert bare < ideal


def test_the_seed_decides():
    candidates = np.random.default_rng(1).random((20_000, 3))
    one = blue_noise(candidates, 700, seed=4)
    np.testing.assert_array_equal(one, blue_noise(candidates, 700, seed=4))
    assert not np.array_equal(one, blue_noise(candidates, 700, seed=5))


def test_blue_noise_is_as_wide_as_farthest_first():
    candidates = np.random.default_rng(2).random((20_000, 2))
    rows = blue_noise(candidates, 1000)
    assert np.all(np.diff(rows) > 0)
    assert gap_of(candidates[rows]) > 0.97 * gap_of(spread_choice(candidates, 1000))


def test_what_is_kept_stays_and_nothing_comes_near_it():
    rng = np.random.default_rng(3)
    line = np.column_stack([np.linspace(0, 1, 200), np.full(200, 0.5)])
    candidates = np.vstack([line, rng.random((30_000, 2))])
    rows = blue_noise(candidates, 1200, kept=200)
    np.testing.assert_array_equal(rows[:200], np.arange(200))
    assert len(rows) == 1200
    away = cKDTree(line).query(candidates[rows[200:]])[0].min()
    assert away >= gap_of(candidates[rows[200:]]) > 0.015 > gap_of(line)


def test_what_is_kept_may_be_all():
    candidates = np.random.default_rng(4).random((50, 3))
    np.testing.assert_array_equal(blue_noise(candidates, 50, kept=50), np.arange(50))
    np.testing.assert_array_equal(blue_noise(candidates, 7, kept=7), np.arange(7))


def test_twice_the_weight_stands_twice_as_near():
    candidates = np.random.default_rng(5).random((60_000, 2))
    left = candidates[:, 0] < 0.5
    rows = blue_noise(candidates, 1500, weight=np.where(left, 2.0, 1.0))
    inside, outside = candidates[rows][left[rows]], candidates[rows][~left[rows]]
    assert 3.2 < len(inside) / len(outside) < 4.8
    assert gap_of(outside) / gap_of(inside) == pytest.approx(2, rel=0.1)


@pytest.mark.parametrize("count", [1500, 3000])
def test_a_thin_antenna_on_a_large_body_gets_its_points(count):
    vertices, faces, area = box(100.0, 60.0, 80.0)
    antenna, sides, thin = box(0.2, 50.0, 0.2)
    both = np.vstack([vertices, antenna + (50, 60, 40)])
    points = surface_sample(both, np.vstack([faces, sides + 8]), count, seed=1)
    on_it = np.sort(points[points[:, 1] > 60.5, 1])
    ideal = np.sqrt(2 * area / (np.sqrt(3) * count))
    assert len(on_it) > 4 * count * thin / area  # that many times what its area alone would get
    assert len(on_it) > 50 / (2 * ideal)
    assert np.diff(on_it).max() < 2 * ideal


def test_large_clouds_are_chosen_from_as_a_whole(monkeypatch):
    points = np.random.default_rng(6).random((30_000, 3))
    slow = spread_choice(points, 300)
    monkeypatch.setattr(sampling, "WORK_MAX", 1)
    quick = spread_choice(points, 300)
    assert quick.shape == slow.shape
    assert gap_of(quick) > 0.9 * gap_of(slow)
    rows = cKDTree(points).query(quick)[1]
    assert np.all(np.diff(rows) > 0)


def test_a_choice_of_all_is_all():
    points = np.random.default_rng(7).random((9, 3))
    np.testing.assert_array_equal(spread_choice(points, 9), points)


@pytest.mark.parametrize("count", [2, 300, 500, 999, 1000])
def test_a_lattice_gives_any_count(count):
    axes = np.meshgrid(*[np.arange(10.0)] * 3, indexing="ij")
    rows = blue_noise(np.stack(axes, axis=-1).reshape(-1, 3), count)
    assert len(np.unique(rows)) == len(rows) == count


def test_a_cloud_with_a_clump_gives_any_count():
    rng = np.random.default_rng(8)
    points = np.vstack([rng.normal(0, 1e-6, (20_000, 3)), rng.uniform(-50, 50, (500, 3))])
    assert len(np.unique(blue_noise(points, 400))) == 400
    assert len(np.unique(blue_noise(points, 15_000))) == 15_000


def test_duplicates_are_chosen_once_and_refused_when_there_is_nothing_else():
    points = np.repeat(np.random.default_rng(9).random((40, 3)), 5, axis=0)
    assert len(np.unique(points[blue_noise(points, 40)], axis=0)) == 40
    with pytest.raises(BadShape, match="41 points of 40 different ones"):
        blue_noise(points, 41)
    with pytest.raises(BadShape, match="2 points of 1 different ones"):
        blue_noise(np.zeros((10, 3)), 2)


@pytest.mark.parametrize(("count", "kept"), [(0, 0), (11, 0), (3, 4), (-1, 0)])
def test_a_count_that_cannot_be_is_refused(count, kept):
    with pytest.raises(BadInput, match=f"count: {count} is not allowed; {max(kept, 1)} to 10"):
        blue_noise(np.random.default_rng(1).random((10, 3)), count, kept=kept)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_a_weight_that_cannot_be_is_refused(bad):
    weight = np.ones(10)
    weight[3] = bad
    with pytest.raises(BadInput, match=r"weight: .* is not allowed; finite numbers above 0"):
        blue_noise(np.random.default_rng(1).random((10, 3)), 5, weight=weight)
