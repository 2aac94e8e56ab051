"""Names, counts and what a cloud is checked for."""

import numpy as np
import pytest

from swarmer.errors import BadInput
from swarmer.shapes import generators
from swarmer.shapes.catalogue import CATALOGUE, data_dir, load_shape
from swarmer.shapes.cloud import make_cloud
from swarmer.shapes.errors import BadShape
from swarmer.shapes.neighbours import nearest_table

FLAT = ("butterfly", "butterfly1008", "cat", "teapot")


def cloud(rows, **options):
    return make_cloud("x", np.array(rows, dtype=float), licence="", source="", **options)


def least_gap(points):
    return nearest_table(points, 1)[1].min()


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_name_of_the_catalogue_loads(name):
    shape = load_shape(name)
    dim = 2 if name in FLAT else 3
    assert (shape.name, len(shape), shape.dim, shape.dropped) == (name, CATALOGUE[name].points, dim, 0)
    np.testing.assert_allclose(shape.points.min(axis=0), 3)
    assert least_gap(shape.points) >= 1
    assert shape.licence
    assert shape.source


@pytest.mark.parametrize("name", ["sphere", "cube", "knot", "random"])
@pytest.mark.parametrize("count", [2, 3, 7, 64, 65, 101, 1000])
def test_a_made_shape_has_exactly_the_points_asked_for(name, count):
    points = load_shape(name, points=count).points
    assert points.shape == (count, 3)
    assert len(np.unique(points, axis=0)) == count
    assert least_gap(points) >= 1 - 1e-9


@pytest.mark.parametrize("name", ["sphere", "cube", "knot"])
def test_the_nearest_two_of_a_made_shape_are_two_cells_apart(name):
    assert least_gap(load_shape(name, points=200).points) == pytest.approx(generators.SPACING)


def test_the_points_of_the_knot_follow_each_other_evenly_round_it():
    points = load_shape("knot", points=200).points
    steps = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    assert steps.max() < 1.1 * steps.min()


def test_a_full_cube_is_a_lattice_and_a_trimmed_one_keeps_its_symmetry():
    np.testing.assert_array_equal(np.ptp(load_shape("cube", points=27).points, axis=0), [4, 4, 4])
    points = load_shape("cube", points=27 - 8).points
    centred = points - (points.max(axis=0) + points.min(axis=0)) / 2
    assert {tuple(point) for point in centred} == {tuple(-point) for point in centred}


def test_random_follows_its_seed_alone():
    np.testing.assert_array_equal(load_shape("random", seed=7).points, load_shape("random", seed=7).points)
    assert not np.array_equal(load_shape("random", seed=7).points, load_shape("random", seed=8).points)
    assert least_gap(generators.random(3000, seed=1)) >= generators.RANDOM_GAP


def test_fewer_points_of_a_shipped_shape_are_a_spread_part_of_it():
    whole, part = load_shape("dragon").points, load_shape("dragon", points=100).points
    assert len(part) == 100
    assert {tuple(point) for point in part} < {tuple(point) for point in whole}
    assert least_gap(part) > 2 * least_gap(whole)


def test_more_points_than_a_shipped_shape_has_are_refused():
    with pytest.raises(BadInput, match="points: 761 is not allowed; 2 to 760, as many as dragon has"):
        load_shape("dragon", points=761)


@pytest.mark.parametrize("points", [-1, 0, 1, 10_000_001])
def test_a_senseless_count_is_refused(points):
    with pytest.raises(BadInput, match=r"^points: "):
        load_shape("sphere", points=points)


def test_an_unknown_policy_for_duplicates_is_refused():
    with pytest.raises(BadInput, match=r"^duplicates: 'keep' is not allowed; refuse"):
        load_shape("sphere", duplicates="keep")


def test_an_unknown_name_gets_the_nearest_one():
    with pytest.raises(BadShape) as refusal:
        load_shape("dragn")
    assert str(refusal.value) == "shape: no 'dragn'; did you mean 'dragon'? `swarmer shapes` lists all"
    assert refusal.value.exit_status == 2


@pytest.mark.parametrize("name", ["zzz", "", " ", "a\nb", "x" * 5000, "a\0b", "../dragon", "/", "."])
def test_any_other_name_ends_in_one_short_line(name):
    with pytest.raises(BadShape) as refusal:
        load_shape(name)
    line = str(refusal.value)
    assert line.startswith("shape: ")
    assert "\n" not in line
    assert len(line) < 250


def test_points_belong_to_the_cloud_and_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        load_shape("cube").points[0] = 0


def test_two_columns_get_depth_0_and_constant_depth_is_2d():
    assert (cloud([[1, 2], [3, 4]]).dim, cloud([[1, 2], [3, 4]]).points.tolist()) == (
        2,
        [[1, 2, 0], [3, 4, 0]],
    )
    assert cloud([[1, 2, 9], [3, 4, 9]]).dim == 2
    assert cloud([[1, 2, 9], [3, 4, 8]]).dim == 3


def test_negative_coordinates_are_fine():
    assert cloud([[-1, -2, -3], [0, 0, 0]]).points[0].tolist() == [-1, -2, -3]


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (np.empty((0, 3)), "0 points; at least 2"),
        ([[1, 2, 3]], "1 point; at least 2"),
        ([[1, 2, 3]] * 4, "all 4 points are equal, (1, 2, 3)"),
        ([[1, 2, 3], [1, np.nan, 3]], "point 2 is (1, nan, 3); coordinates must be finite"),
        ([[np.inf, 2, 3], [1, 1, 3]], "point 1 is (inf, 2, 3)"),
        ([[1e8, 2, 3], [1, 1, 3]], "within 10,000,000 cells"),
        ([1, 2, 3], "array of shape (3,)"),
        ([[1], [2]], "array of shape (2, 1)"),
        ([[1, 2, 3, 4], [2, 2, 3, 4]], "array of shape (2, 4)"),
    ],
)
@pytest.mark.parametrize("duplicates", ["refuse", "drop"])
def test_what_is_no_cloud_is_refused(rows, line, duplicates):
    with pytest.raises(BadShape) as refusal:
        cloud(rows, duplicates=duplicates)
    assert line in str(refusal.value)


def test_duplicates_are_named_or_dropped():
    rows = [[i // 2, 0, i // 8] for i in range(14)] + [[0.0, -0.0, 0.0]]
    with pytest.raises(BadShape) as refusal:
        cloud(rows)
    line = str(refusal.value)
    assert "8 of 15 points are duplicates: (0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 1), ..." in line
    assert "--dedupe" in line
    kept = cloud(rows, duplicates="drop")
    assert (len(kept), kept.dropped) == (7, 8)
    assert kept.points[:, 0].tolist() == list(range(7))  # the first of each, in the order of the file


def test_installed_data_is_preferred_to_the_checkout(tmp_path, monkeypatch):
    package = tmp_path / "swarmer" / "shapes"
    package.mkdir(parents=True)
    monkeypatch.setattr("swarmer.shapes.catalogue.__file__", str(package / "catalogue.py"))
    assert data_dir() == tmp_path / "pointclouds"
    (tmp_path / "swarmer" / "pointclouds").mkdir()
    assert data_dir() == tmp_path / "swarmer" / "pointclouds"
    with pytest.raises(BadShape, match=r"^shape: dragon: its shipped file .* cannot be read"):
        load_shape("dragon")
