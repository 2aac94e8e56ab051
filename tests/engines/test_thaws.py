"""When an engine begins a thaw itself, and when it sees that one has begun."""

import numpy as np
import pytest

from swarmer.config import load_config
from swarmer.engines.thaws import Order, Sight, ThawTally, ThawWatch
from swarmer.messages import Swarm
from swarmer.plan import make_plan
from swarmer.protocol.events import ThawBegins


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


def test_without_epochs_one_swarm_is_thawed_at_most_once_per_lambda():
    watch = ThawWatch(rules(**{"thaw.policy": "centralized", "epochs": False}))
    assert watch.order(sight(2.0)).single
    assert watch.order(sight(2.5)) is None
    assert watch.order(sight(2.6)).single


def test_with_epochs_the_next_swarm_is_thawed_however_soon_it_forms(central):
    assert central.order(sight(2.0)).epoch == 1
    assert central.order(sight(2.1, epochs=(1, 1, 1))).epoch == 2


def begins(epoch, known=True):
    return ThawBegins(Swarm(1, 0), epoch, known)


def test_a_thaw_counts_once_and_by_how_it_stood_when_it_began():
    tally = ThawTally(rules(**{"thaw.policy": "corner"}))
    tally.note(2.5, begins(0), single=True)
    tally.note(2.5, begins(0), single=False)  # the others, a moment later
    tally.note(2.5, begins(1), single=False)
    tally.note(2.5, begins(2, known=False), single=False)
    tally.note(2.5, begins(3, known=False), single=True)
    assert tally.counters() == {"thaws_at_one_swarm": 2, "thaws_by_clock": 2, "wrong_thaws": 1}
    assert tally.first_s == 2.5


def test_without_epochs_every_thaw_counts():
    tally = ThawTally(rules(epochs=False))
    for _ in range(3):
        tally.note(2.5, begins(0, known=False), single=False)
    assert tally.counters() == {"thaws_at_one_swarm": 0, "thaws_by_clock": 3}
    assert tally.first_s is None


def test_the_engines_own_thaws_are_by_what_it_sees_or_overdue():
    tally = ThawTally(rules(**{"thaw.policy": "centralized"}))
    tally.ordered(1.5, Order(1, single=True))
    tally.ordered(1.5, Order(2, single=False))
    assert tally.counters() == {"thaws_at_one_swarm": 1, "thaws_by_clock": 1, "wrong_thaws": 0}
    assert tally.first_s == 1.5
