"""Points are shared out by space, in proportion, and what a host that is gone had goes to its neighbours."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.config import load_config
from swarmer.engines.cluster.shares import box_of, out_of_box, shares, taken_over
from swarmer.plan import make_plan

POINTS = np.random.default_rng(1).uniform(0, 100, (500, 3))


@pytest.mark.parametrize("hosts", [1, 2, 3, 5, 16])
def test_equal_hosts_have_equal_shares(hosts):
    counts = np.bincount(shares(POINTS, [1.0] * hosts), minlength=hosts)
    assert counts.sum() == 500
    assert counts.max() - counts.min() <= math.ceil(math.log2(hosts + 1)), "each cut may round"


def test_a_host_has_what_it_can_carry():
    counts = np.bincount(shares(POINTS, [2, 2, 16, 4]))
    assert np.abs(counts - np.array([2, 2, 16, 4]) * 500 / 24).max() <= 2


@pytest.mark.parametrize("weights", [[1, 1, 1], [1, 1000, 1], [1000, 1, 1]])
def test_no_host_is_without(weights):
    assert sorted(shares(POINTS[:3], weights).tolist()) == [0, 1, 2]


def test_most_neighbours_stay_at_home():
    plan = make_plan(load_config(shape="dragon"))
    host_of = shares(plan.cloud.points, [1.0] * 4)
    links = [(row, other - 1) for row, others in enumerate(plan.neighbours.neighbours) for other in others]
    crossing = np.mean([host_of[one] != host_of[other] for one, other in links])
    assert crossing < 0.12, "by chance it would be three quarters"


@given(
    st.tuples(*[st.floats(-50, 50)] * 3),
    st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=1, max_size=6),
)
def test_a_box_is_never_farther_than_what_is_in_it(point, inside):
    box = box_of(np.array(inside))
    assert out_of_box(point, box) <= min(math.dist(point, one) for one in inside) * (1 + 1e-9)


def test_a_box_is_as_far_as_its_side():
    box = box_of(np.array([[0, 0, 0], [10, 10, 0]]))
    assert out_of_box((5, 5, 0), box) == 0
    assert out_of_box((13, 14, 0), box) == 5
    assert out_of_box((5, 5, -2), box) == 2


def test_what_a_host_had_goes_to_the_nearest_in_equal_parts():
    line = np.column_stack([np.arange(90.0), np.zeros(90), np.zeros(90)])
    host_of = shares(line, [1, 1, 1])
    middle = host_of[45]
    lost = np.flatnonzero(host_of == middle)
    left = {int(host_of[0]): 1.0, int(host_of[-1]): 1.0}
    to = taken_over(line, host_of, lost, left)
    assert set(to[:15]) == {host_of[0]}
    assert set(to[15:]) == {host_of[-1]}


def test_of_one_that_is_lost_only_one_host_takes_it():
    host_of = np.array([0, 1, 2, 2])
    to = taken_over(POINTS[:4], host_of, np.array([0]), {1: 1.0, 2: 1.0})
    assert len(to) == 1
    assert to[0] in (1, 2)
