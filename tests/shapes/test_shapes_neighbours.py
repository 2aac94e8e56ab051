"""The neighbour plan against a slow, obvious computation."""

import time
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmer.errors import BadInput
from swarmer.shapes.bridges import shortest_bridges
from swarmer.shapes.catalogue import load_shape
from swarmer.shapes.neighbours import nearest_table, neighbour_plan

coordinates = st.tuples(*[st.integers(0, 6)] * 3)
whole_numbers = st.lists(coordinates, min_size=2, max_size=40, unique=True)


def squared_distances(points):
    return ((points[:, None] - points[None]) ** 2).sum(axis=2)


def slow_nearest(points, k):
    squared = squared_distances(points)
    np.fill_diagonal(squared, np.inf)
    return [sorted(range(len(points)), key=lambda j, i=i: (squared[i, j], j))[:k] for i in range(len(points))]


def slow_bridges(points, links):
    """Kruskal: all pairs by (length, lower row, higher row), each that joins two parts is taken."""
    part = list(range(len(points)))

    def find(i):
        return i if part[i] == i else find(part[i])

    for i, j in links:
        part[find(i)] = find(j)
    squared = squared_distances(points)
    pairs = sorted((squared[i, j], i, j) for i in range(len(points)) for j in range(i + 1, len(points)))
    bridges = []
    for _, i, j in pairs:
        if find(i) != find(j):
            part[find(i)] = find(j)
            bridges.append((i, j))
    return bridges


@settings(max_examples=60, deadline=None)
@given(rows=whole_numbers, eta=st.sampled_from([1, 1, 2, 3, 5]))
def test_the_plan_is_what_the_definition_says(rows, eta):
    points = np.array(rows, dtype=float)
    if len(points) <= eta:
        return
    nearest = slow_nearest(points, eta)
    links = {(i, j) for i, row in enumerate(nearest) for j in row}
    bridges = slow_bridges(points, links)
    both = links | {(j, i) for i, j in links} | set(bridges) | {(j, i) for i, j in bridges}

    plan = neighbour_plan(points, eta)
    assert {(i, j - 1) for i, row in enumerate(plan.neighbours) for j in row} == both
    assert (plan.components, plan.added_links) == (len(bridges) + 1, len(bridges))
    assert plan.one_way_share == pytest.approx(sum((j, i) not in links for i, j in links) / len(links))
    directed = neighbour_plan(points, eta, "nearest")
    assert [[j - 1 for j in row] for row in directed.neighbours] == nearest
    assert (directed.components, directed.added_links) == (plan.components, 0)


def test_equal_distances_go_to_the_lower_fid_however_many_there_are():
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    corners = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    axes = [[2, 0, 0], [-2, 0, 0], [0, 2, 0], [0, -2, 0], [0, 0, 2], [0, 0, -2]]
    lattice = load_shape("cube", points=1000).points
    centre = np.array([*axes, *corners, [0.0, 0.0, 0.0]])
    assert nearest_table(centre, 3)[0][-1].tolist() == [7, 8, 9]
    assert [row.tolist() for row in nearest_table(lattice, 5)[0]] == [
        [j + 1 for j in row] for row in slow_nearest(lattice, 5)
    ]
    ring = np.column_stack([np.round(np.cos(angle), 9), np.round(np.sin(angle), 9), 0 * angle])
    assert len(neighbour_plan(ring, 59).neighbours[0]) == 59


def test_ties_beyond_what_the_tree_was_asked_for_are_seen():
    five = {point for point in product(range(-5, 6), repeat=3) if sum(x * x for x in point) == 25}
    for seed in range(5):
        around = np.random.default_rng(seed).permutation(np.array(sorted(five), dtype=float))
        assert len(around) == 30
        assert nearest_table(np.vstack([around, np.zeros((1, 3))]), 2)[0][-1].tolist() == [1, 2]


def test_the_shortest_links_join_far_parts_and_large_ones():
    rng = np.random.default_rng(3)
    parts = [rng.random((size, 3)) * 4 + offset for size, offset in ((3, 0), (40, 20), (60, 50), (5, 90))]
    points = np.concatenate(parts)
    label = np.repeat(np.arange(4), [len(part) for part in parts])
    links = [(i, j) for i in range(len(points)) for j in range(len(points)) if label[i] == label[j]]
    assert sorted(map(tuple, shortest_bridges(points, label).tolist())) == sorted(slow_bridges(points, links))
    plan = neighbour_plan(points, 2)
    assert plan.components >= 4
    assert plan.longest_link_cells == pytest.approx(plan.reach_cells.max())
    assert neighbour_plan(points, 2, "nearest").longest_link_cells < plan.longest_link_cells


@pytest.mark.parametrize("mode", ["connected", "nearest"])
def test_neighbours_are_sorted_and_within_reach(mode):
    points = load_shape("random", points=200).points
    plan = neighbour_plan(points, None, mode)
    assert (plan.eta, plan.mode) == (5, mode)
    for fid, (row, reach) in enumerate(zip(plan.neighbours, plan.reach_cells, strict=True), start=1):
        lengths = np.linalg.norm(points[np.array(row) - 1] - points[fid - 1], axis=1)
        assert fid not in row
        assert (np.diff(lengths) >= -1e-12).all()
        assert lengths.max() == pytest.approx(reach)
    assert plan.mean_degree == pytest.approx(np.mean([len(row) for row in plan.neighbours]))
    assert plan.spacing_min_cells == pytest.approx(nearest_table(points, 1)[1].min())


@pytest.mark.parametrize("count", [2, 3, 5, 6])
def test_small_shapes_plan_with_fewer_neighbours(count):
    line = np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(float)
    assert neighbour_plan(line).eta == min(5, count - 1)


@pytest.mark.parametrize("eta", [-1, 0, 100, 101])
def test_an_eta_that_cannot_be_is_refused(eta):
    with pytest.raises(BadInput, match=rf"^eta: {eta} is not allowed; 1 to 99 for 100 FLSs \(default 5\)$"):
        neighbour_plan(load_shape("sphere").points, eta)


def test_an_unknown_mode_is_refused():
    with pytest.raises(BadInput, match=r"^neighbours: 'far' is not allowed"):
        neighbour_plan(load_shape("sphere").points, 5, "far")


def test_the_table_of_nearest_points():
    points = load_shape("sphere", points=50).points
    fids, distances = nearest_table(points, 49)
    assert (fids.shape, fids.dtype, distances.shape) == ((50, 49), np.uint32, (50, 49))
    assert (np.diff(distances, axis=1) >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(points[fids[0] - 1] - points[0], axis=1), distances[0])
    assert nearest_table(points, 0)[0].shape == (50, 0)
    with pytest.raises(BadInput, match=r"^k: 50 "):
        nearest_table(points, 50)


@pytest.mark.slow
def test_22_000_points_are_planned_in_seconds():
    points = load_shape("random", points=22_000).points
    began = time.perf_counter()
    assert neighbour_plan(points).components >= 1
    assert neighbour_plan(points, 1).added_links > 1000
    assert time.perf_counter() - began < 60
