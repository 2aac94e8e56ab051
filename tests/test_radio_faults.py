"""What a schedule does to the datagrams of one FLS, at both of its ends."""

from collections import Counter

import pytest

from swarmer.config import load_config
from swarmer.faults import NO_FAULTS, Fault, Schedule
from swarmer.messages import ENGINE_FID, NO_SWARM, Kind, Message, Swarm, To
from swarmer.radio import LOST
from swarmer.radio_faults import NOW, Ends
from swarmer.rules import make_rules
from swarmer.streams import stream

FIN, INIT = Kind.CHALLENGE_FIN, Kind.CHALLENGE_INIT


def ends(*faults, fid=1, calm_s=None, **settings):
    rules = make_rules(load_config(None, **settings), 9, 3, 100.0, "x:y")
    own = lambda purpose: stream(5, purpose, fid)  # noqa: E731
    return Ends(rules, Schedule(faults, calm_s), 5, fid, own)


def said(sender, kind=FIN):
    return Message(int(kind), sender, 0, 0, Swarm(sender, 0), 1, (0.0, 0.0, 0.0), To.ALL, NO_SWARM)


def test_in_good_weather_nothing_is_asked():
    calm = ends()
    assert calm.plain_in
    assert calm.plain_out
    assert not ends(**{"radio.loss_sender": 0.1}).plain_out
    assert ends(**{"radio.loss_sender": 0.1}).plain_in
    assert not ends(**{"radio.dead_links": 0.1}).plain_in


@pytest.mark.parametrize(
    ("way", "into", "out"),
    [("both", False, False), ("in", False, True), ("out", True, False)],
)
def test_a_cut_lets_through_only_what_its_way_allows(way, into, out):
    """FLSs 1 to 3 are cut off; FLS 1 hears from 5, or FLS 5 from 1."""
    cut = Fault(1.0, "cut", (1, 2, 3), 2.0, way=way)
    inside, outside = ends(cut, fid=1), ends(cut, fid=5)
    assert (inside.heard(said(5), 1.5) == NOW) == into
    assert (outside.heard(said(1), 1.5) == NOW) == out
    assert inside.heard(said(2), 1.5) == outside.heard(said(6), 1.5) == NOW, "no border between them"
    assert inside.heard(said(ENGINE_FID, Kind.THAW), 1.5) == NOW, "the engine is no FLS"
    for moment in (0.99, 3.0):
        assert inside.heard(said(5), moment) == outside.heard(said(1), moment) == NOW


def test_it_strikes_whom_it_names_at_the_end_that_it_names():
    for way in ("both", "in", "out"):
        one = ends(Fault(0.0, "loss", (1,), way=way, p=1.0))
        assert (one.heard(said(5), 1.0) == LOST) == (way != "out")
        assert (one.sent(said(1), 1.0) == LOST) == (way != "in")
        other = ends(Fault(0.0, "loss", (1,), way=way, p=1.0), fid=2)
        assert other.plain_in
        assert other.plain_out


def test_only_some_kinds():
    one = ends(Fault(0.0, "loss", (1,), p=1.0, kinds=(int(FIN),)), Fault(0.0, "cut", (1,), kinds=(int(FIN),)))
    assert one.heard(said(5, FIN), 1.0) == LOST
    assert one.heard(said(5, INIT), 1.0) == NOW
    assert one.sent(said(1, FIN), 1.0) == LOST
    assert one.sent(said(1, INIT), 1.0) == NOW


def test_a_one_way_link():
    """Nothing of FLS 4 gets to FLS 1; the other way all does, and all others are heard."""
    fault = Fault(0.0, "loss", (1,), way="in", p=1.0, source=(4,))
    assert ends(fault).heard(said(4), 1.0) == LOST
    assert ends(fault).heard(said(5), 1.0) == NOW
    assert ends(fault, fid=4).heard(said(1), 1.0) == NOW


@pytest.mark.parametrize(
    ("fault", "fates"),
    [
        (Fault(0.0, "delay", (1,), delay_s=0.2), {(0.2,)}),
        (Fault(0.0, "duplicate", (1,), p=1.0), {(0.0, 0.0)}),
        (Fault(0.0, "reorder", (1,), p=1.0, delay_s=0.3), {(0.3,)}),
        (Fault(0.0, "reorder", (1,), p=0.5, delay_s=0.3), {(0.0,), (0.3,)}),
    ],
    ids=lambda value: value.what if isinstance(value, Fault) else "",
)
def test_each_does_what_the_settings_of_the_radio_do(fault, fates):
    one = ends(fault)
    assert {one.heard(said(5), 1.0) for _ in range(200)} == fates
    assert {one.sent(said(1), 1.0) for _ in range(200)} == fates


def test_faults_add_up_with_each_other_and_with_the_settings():
    one = ends(
        Fault(0.0, "delay", (1,), delay_s=0.2), Fault(0.0, "duplicate", (1,), p=1.0), **{"radio.delay_ms": 100}
    )  # fmt: skip
    assert one.heard(said(5), 1.0) == (pytest.approx(0.3), pytest.approx(0.3))
    lossy = ends(Fault(0.0, "loss", (1,), p=0.5), **{"radio.loss": 0.5})
    lost = Counter(lossy.heard(said(5), 1.0) for _ in range(4000))
    assert lost[LOST] / 4000 == pytest.approx(0.75, abs=0.03)


def test_a_fault_takes_no_draws_of_the_settings_nor_of_another_fault():
    noise = Fault(0.0, "duplicate", (1,), p=0.5)
    alone = ends(**{"radio.loss": 0.3})
    beside = ends(noise, **{"radio.loss": 0.3})
    both = [(alone.heard(said(5), 1.0), beside.heard(said(5), 1.0)) for _ in range(500)]
    assert all((one == LOST) == (two == LOST) for one, two in both)
    with_loss = ends(Fault(0.0, "loss", (1,), p=0.3), noise)
    only = ends(noise)
    pairs = [(only.heard(said(5), 1.0), with_loss.heard(said(5), 1.0)) for _ in range(500)]
    assert {len(two) for _, two in pairs} == {0, 1, 2}


def test_each_flss_draws_are_its_own_and_each_ends():
    noise = Fault(0.0, "loss", (1, 2), p=0.5)

    def drawn(fid):
        one = ends(noise, fid=fid)
        return [[ask(said(5), 1.0) == LOST for _ in range(64)] for ask in (one.heard, one.sent)]

    assert drawn(1) == drawn(1)
    assert drawn(1)[0] != drawn(1)[1]
    assert drawn(1) != drawn(2)


def test_two_alike_draw_apart():
    twice = ends(Fault(0.0, "loss", (1,), p=0.5), Fault(0.0, "loss", (1,), p=0.5))
    lost = sum(twice.heard(said(5), 1.0) == LOST for _ in range(4000))
    assert lost / 4000 == pytest.approx(0.75, abs=0.03)


def test_from_the_calm_on_the_radio_is_perfect():
    one = ends(
        Fault(0.0, "loss", (1,), p=1.0), Fault(0.0, "cut", (1,)), calm_s=2.0,
        **{"radio.loss": 1, "radio.dead_links": 1},
    )  # fmt: skip
    assert one.heard(said(5), 1.99) == one.sent(said(1), 1.99) == LOST
    assert one.heard(said(5), 2.0) == one.sent(said(1), 2.0) == NOW


def test_a_dead_link_carries_nothing():
    share = {"radio.dead_links": 0.5}
    heard = {
        (sender, fid): ends(fid=fid, **share).heard(said(sender), 1.0) == NOW
        for fid in range(1, 9) for sender in range(1, 9)
    }  # fmt: skip
    assert 16 < sum(heard.values()) < 48
    assert any(heard[a, b] != heard[b, a] for a in range(1, 9) for b in range(1, a))


def test_no_schedule_is_the_empty_one():
    assert NO_FAULTS.of_the_air() == ()
