"""When an engine begins a thaw itself, and when it sees that one has begun."""

import numpy as np
import pytest

from swarmer.config import load_config
from swarmer.engines.thaws import Sight, ThawWatch
from swarmer.plan import make_plan


def rules(**settings):
    return make_plan(load_config(shape="sphere", points=20, **settings)).rules


def sight(t_s, swarms=(1, 1, 1), epochs=(0, 0, 0), lit=(True, True, True), started=0):
    return Sight(t_s, np.array(lit), np.array(swarms, np.int32), np.array(epochs), started)


@pytest.fixture
def central():
    return ThawWatch(rules(**{"thaw.policy": "centralized"}))


def test_one_swarm_is_thawed_once_until_everybody_has_obeyed(central):
    assert central.order(sight(2.0)).epoch == 1
    assert central.order(sight(4.0, epochs=(1, 0, 1))) is None
    assert central.order(sight(4.0, epochs=(1, 1, 1))).epoch == 2
    assert central.seen == 2


def test_several_swarms_wait_until_they_are_overdue(central):
    overdue_s = rules().thaw_h_s
    assert central.order(sight(overdue_s - 0.1, swarms=(1, 2, 1))) is None
    order = central.order(sight(overdue_s, swarms=(1, 2, 1)))
    assert (order.epoch, order.why) == (1, "overdue")


def test_nobody_is_thawed_while_some_are_dark(central):
    assert central.order(sight(2.0, lit=(True, False, True))) is None


def test_a_thaw_of_their_own_is_news_once():
    watch = ThawWatch(rules())
    assert watch.order(sight(2.0)) is None
    assert watch.begun(sight(3.0)) is None
    assert watch.begun(sight(12.0, epochs=(0, 1, 0))) == 1
    assert watch.begun(sight(12.1, epochs=(1, 1, 0))) is None
