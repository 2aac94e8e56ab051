"""The neighbour plan against a slow, obvious computation."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmer.errors import BadInput
from swarmer.shapes.bridges import shortest_bridges
from swarmer.shapes.catalogue import load_shape
from swarmer.shapes.neighbours import NeighbourLists, nearest_table, neighbour_plan

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


coarse = st.tuples(st.integers(0, 5), st.integers(0, 5), st.sampled_from([0, 1, 40]))


@settings(max_examples=120, deadline=None)
@given(rows=st.lists(coarse, min_size=2, max_size=60, unique=True), data=st.data())
def test_the_bridges_are_the_least_tree_that_joins_the_parts(rows, data):
    points = np.array(rows, dtype=float)
    given_parts = st.lists(st.integers(0, 59), min_size=len(points), max_size=len(points))
    label = np.unique(data.draw(given_parts), return_inverse=True)[1]
    within = [(i, j) for i, j in product(range(len(points)), repeat=2) if label[i] == label[j]]
    assert [tuple(link) for link in shortest_bridges(points, label).tolist()] == slow_bridges(points, within)


def test_the_bridges_do_not_depend_on_how_the_points_lie():
    """Larger than one box, and in each layout that a tree of boxes could stumble over."""
    rng = np.random.default_rng(5)
    lattice = np.array(list(product(range(6), repeat=3)), dtype=float)
    layouts = {
        "uniform": rng.random((200, 3)),
        "lattice": lattice,
        "line": np.arange(200.0)[:, None] * [1, 0, 0],
        "circle": np.array([[np.cos(a), np.sin(a), 0] for a in np.arange(150)]),
        "far parts": np.concatenate([rng.random((70, 3)), rng.random((70, 3)) + 1e6]),
        "far pairs": np.repeat(rng.random((80, 3)) * 1e5, 2, axis=0)
        + np.tile([[0, 0, 0], [1, 0, 0]], (80, 1)),
    }
    for name, points in layouts.items():
        order = rng.permutation(len(points))
        for parts in (2, 20, len(points)):
            label = np.unique(rng.integers(0, parts, len(points)), return_inverse=True)[1]
            within = [(i, j) for i, j in product(range(len(points)), repeat=2) if label[i] == label[j]]
            bridges = shortest_bridges(points, label)
            assert [tuple(link) for link in bridges.tolist()] == slow_bridges(points, within), name
            length = np.linalg.norm(np.subtract(*points[bridges.T]), axis=1)
            shuffled = shortest_bridges(points[order], label[order])
            np.testing.assert_allclose(
                np.linalg.norm(np.subtract(*points[order][shuffled.T]), axis=1), length, err_msg=name
            )


def test_one_part_needs_no_bridge():
    assert shortest_bridges(load_shape("cube").points, np.zeros(125, dtype=np.int64)).shape == (0, 2)


def test_the_lists_are_read_like_tuples():
    lists = NeighbourLists(np.array([2, 1, 3, 2], dtype=np.uint32), np.array([0, 1, 3, 4]))
    assert (len(lists), list(lists)) == (3, [(2,), (1, 3), (2,)])
    assert (lists[-1], lists[:2], lists[::-2]) == ((2,), ((2,), (1, 3)), ((2,), (2,)))
    assert all(type(fid) is int for fid in lists[1]), "a message is packed from plain integers"
    for absent in (3, -4):
        with pytest.raises(IndexError):
            lists[absent]


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
def test_many_parts_are_joined_as_a_general_method_joins_them():
    """Against the tree that scipy finds in the whole graph of distances, and in crowds that no matrix could hold."""
    from scipy.sparse.csgraph import minimum_spanning_tree
    from scipy.spatial.distance import cdist

    points = load_shape("random", points=2000).points
    bridges = shortest_bridges(points, np.arange(2000))
    total = np.linalg.norm(np.subtract(*points[bridges.T]), axis=1).sum()
    assert len(bridges) == 1999
    assert total == pytest.approx(minimum_spanning_tree(cdist(points, points)).sum())

    pairs = np.repeat(np.random.default_rng(1).random((50_000, 3)) * 1e5, 2, axis=0)
    pairs[1::2, 0] += 1.5
    assert len(shortest_bridges(pairs, np.repeat(np.arange(50_000), 2))) == 49_999
    plan = neighbour_plan(pairs)
    assert (plan.added_links, len(plan.neighbours)) == (plan.components - 1, 100_000)
    assert plan.components > 500
