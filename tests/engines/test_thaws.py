"""When an engine begins a thaw itself, and when it sees that one has begun."""

import numpy as np
import pytest

from swarmer.config import load_config
from swarmer.engines.thaws import Order, Sight, ThawsInHindsight, ThawTally, ThawWatch
from swarmer.messages import Swarm
from swarmer.plan import make_plan
from swarmer.protocol.events import ThawBegins
from swarmer.telemetry import NOTHING_LEFT, Began, Thawed


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
    tally = ThawTally(rules(**{"thaw.policy": "timer", "epochs": False}))
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


HEARD, CLOCK, KNOWING = Began


def left(xi, epoch=0, began=HEARD, at_s=2.0, incarnation=0):
    return Thawed(epoch, xi, incarnation, began, at_s)


def hindsight(*looks, **settings):
    """The tally after looks at (epoch, what was left) of each FLS; None: it is dark."""
    plays = rules(**settings)
    tally = ThawTally(plays)
    seen = ThawsInHindsight(plays, tally)
    fields = list(zip(Thawed._fields, ("<u4", "<u4", "<u2", "u1", "<f8"), strict=True))
    for flss in looks:
        lit = np.array([fls is not None for fls in flss])
        epoch = np.array([fls[0] if fls else 0 for fls in flss])
        thawed = np.array([tuple(fls[1]) if fls else tuple(NOTHING_LEFT) for fls in flss], fields)
        seen.look(lit, epoch, thawed)
    return tally, seen.counters()


def test_a_thaw_is_understood_once_all_have_obeyed_it():
    owner, member, before = left(1, began=KNOWING, at_s=2.5), left(1, at_s=2.6), NOTHING_LEFT
    tally, counters = hindsight([(0, before), (0, before)], [(1, owner), (0, before)])
    assert counters == {"thaws_at_one_swarm": 0, "thaws_by_clock": 0, "wrong_thaws": 0}
    whole = [(1, member), (1, owner)]
    tally, counters = hindsight([(1, owner), (0, before)], whole, whole)
    assert counters == {"thaws_at_one_swarm": 1, "thaws_by_clock": 0, "wrong_thaws": 0}
    assert tally.first_s == 2.5


@pytest.mark.parametrize(
    "other",
    [
        left(2),
        left(1, incarnation=1),
        left(1, epoch=-1 % 2**32),  # it has missed the thaw before
    ],
)
def test_it_was_not_at_one_swarm_if_anybody_was_in_another(other):
    tally, counters = hindsight([(1, left(1, began=KNOWING)), (1, other)])
    assert counters == {"thaws_at_one_swarm": 0, "thaws_by_clock": 0, "wrong_thaws": 1}
    assert tally.first_s is None


def test_who_was_dark_takes_no_part():
    _, counters = hindsight([(1, left(1, began=KNOWING)), (1, left(1)), (1, NOTHING_LEFT), None])
    assert counters["thaws_at_one_swarm"] == 1
    _, counters = hindsight([(1, NOTHING_LEFT), None], [None, None])
    assert counters == {"thaws_at_one_swarm": 0, "thaws_by_clock": 0, "wrong_thaws": 0}


def test_the_first_to_begin_says_why():
    knew, clock = left(1, began=KNOWING, at_s=2.0), left(1, began=CLOCK, at_s=2.1)
    assert hindsight([(1, clock), (1, knew)])[1]["thaws_by_clock"] == 0
    assert hindsight([(1, clock._replace(at_s=1.9)), (1, knew)])[1]["thaws_by_clock"] == 1
    assert hindsight([(1, left(1)), (1, left(1))])[1]["thaws_by_clock"] == 1, "whoever began it is gone"


def test_what_the_engine_begins_is_not_counted_again():
    whole = [(1, left(1)), (1, left(1))]
    assert hindsight(whole, **{"thaw.policy": "centralized"})[1]["thaws_at_one_swarm"] == 0
    assert hindsight(whole, **{"thaw.policy": "timer", "epochs": False})[1] == {}
