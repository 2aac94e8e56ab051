"""Who sees whom, by hand and against the plain definition."""

import numpy as np
import pytest
from rounds_runs import in_rows, plan_of

from swarmer.engines import rounds_links
from swarmer.engines.rounds_links import Nearest, Planned, Swarms, challengers, live_links


def on_a_line(places):
    return np.array([[x, 0.0, 0.0] for x in places])


def seen(links, swarm):
    return links.ends[links.starts[swarm] : links.starts[swarm + 1]].tolist()


def test_swarms_are_in_the_order_of_their_ids_and_members_in_that_of_fids():
    swarms = Swarms.of_ids(in_rows([0, 1, 0, 1, 4, 0]))
    assert swarms.ids.tolist() == [0, 1, 4]
    assert swarms.of.tolist() == [0, 1, 0, 1, 2, 0]
    assert swarms.members.tolist() == [0, 2, 5, 1, 3, 4]
    assert swarms.starts.tolist() == [0, 3, 5, 6]
    assert swarms.sizes.tolist() == [3, 2, 1]


def test_the_lowest_fid_that_sees_an_outsider_challenges():
    """0-1-2 is a swarm from left to right; of two nearest only 2 sees beyond it."""
    swarms = Swarms.of_ids(in_rows([0, 0, 0, 3, 4]))
    links = challengers(Nearest(on_a_line([0, 1, 2, 3.5, 6]), 2, 3), swarms)
    assert links.challenger.tolist() == [2, 3, 4]
    assert seen(links, 0) == [3]
    assert seen(links, 1) == [2, 1]
    assert seen(links, 2) == [3, 2]


def test_of_equal_distances_the_lower_fid_is_nearer():
    links = challengers(Nearest(on_a_line([0, 1, -1, 2]), 1, 3), Swarms.of_ids(np.arange(4)))
    assert [seen(links, swarm) for swarm in range(4)] == [[1], [0], [0], [1]]


def test_a_swarm_that_sees_no_outsider_doubles_its_range():
    """Two threes far apart: of the nearest 1 and 2 nobody sees the other three, of the nearest 4 all do."""
    position = on_a_line([0, 1, 2, 100, 101.5, 103])
    swarms = Swarms.of_ids(in_rows([0, 0, 0, 3, 3, 3]))
    links = challengers(Nearest(position, 1, 3), swarms)
    assert links.challenger.tolist() == [0, 3]  # all need the third nearest: the lower FID
    assert seen(links, 0) == [3, 4]
    assert seen(links, 1) == [2, 1]


def test_the_member_that_needs_the_smallest_rank_is_kept():
    """Of the swarm 0, 1, 2 it is 1 whose second nearest is an outsider."""
    position = np.array([[0, 0, 0], [0, 3, 0], [0.1, 0, 0], [0, 6.001, 0], [50, 0, 0]], dtype=float)
    links = challengers(Nearest(position, 1, 3), Swarms.of_ids(in_rows([0, 0, 0, 3, 4])))
    assert links.challenger[0] == 1
    assert seen(links, 0) == [3]


def test_where_widening_looks_at_too_many_the_nearest_outsider_is_asked(monkeypatch):
    monkeypatch.setattr(rounds_links, "WIDEN_MAX", 4)
    position = on_a_line([0, 1, 2, 100, 101.5, 103])
    links = challengers(Nearest(position, 1, 3), Swarms.of_ids(in_rows([0, 0, 0, 3, 3, 3])))
    assert links.challenger.tolist() == [2, 3]
    assert [seen(links, 0), seen(links, 1)] == [[3], [2]]


def test_links_are_what_the_definition_says():
    rng = np.random.default_rng(4)
    for _ in range(20):
        count, k = int(rng.integers(5, 60)), int(rng.integers(1, 5))
        position, group = rng.random((count, 3)), rng.integers(0, 6, count)
        xi = in_rows([np.flatnonzero(group == one)[0] for one in group])
        swarms = Swarms.of_ids(xi)
        if len(swarms) == 1:
            continue
        apart = np.linalg.norm(position[:, None] - position[None], axis=2)
        np.fill_diagonal(apart, np.inf)
        near = np.argsort(apart, axis=1, kind="stable")[:, :k]
        live = [[int(v) for v in near[u] if xi[v] != xi[u]] for u in range(count)]
        u, v = live_links(Nearest(position, k, 3), swarms)
        assert list(zip(u.tolist(), v.tolist(), strict=True)) == [
            (a, b) for a in range(count) for b in live[a]
        ]
        links = challengers(Nearest(position, k, 3), swarms)
        for swarm, name in enumerate(swarms.ids):
            seers = [row for row in np.flatnonzero(xi == name) if live[row]]
            if seers:
                assert links.challenger[swarm] == seers[0]
                assert seen(links, swarm) == live[seers[0]]
            else:
                assert len(seen(links, swarm)) > 0


def test_planned_links_are_those_of_the_plan_whoever_has_which_point():
    plan = plan_of(points=30)
    point = np.random.default_rng(3).permutation(30)
    row_of = {int(at): row for row, at in enumerate(point)}
    counts, ends = Planned(plan.neighbours.neighbours, point).of(in_rows([4, 0, 29]))
    expected = [
        [row_of[fid - 1] for fid in plan.neighbours.neighbours[int(point[row])]] for row in (4, 0, 29)
    ]
    assert counts.tolist() == [len(one) for one in expected]
    assert ends.tolist() == [end for one in expected for end in one]


@pytest.mark.parametrize("counts", [[], [0, 0], [3, 0, 1]])
def test_ranges(counts):
    starts = 10 * np.arange(len(counts))
    expected = [int(s) + i for s, c in zip(starts, counts, strict=True) for i in range(c)]
    assert rounds_links.ranges(starts, in_rows(counts)).tolist() == expected
