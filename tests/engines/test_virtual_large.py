"""What lets the virtual-time engine be fast with many FLSs changes nothing: short ways end where the long ones do."""

from random import Random

import numpy as np
import pytest
from test_virtual_radio import POINTS, display, message
from virtual_runs import fly, trace

from swarmer import radio
from swarmer.engines import virtual, virtual_radio
from swarmer.engines.virtual import _Run
from swarmer.engines.virtual_fls import HALF_WINDOW, VirtualFls
from swarmer.engines.virtual_radio import next_draws
from swarmer.engines.virtual_time import GROUP, SLOTS_PER_S, Agenda, Entry
from swarmer.fls import BaseFls
from swarmer.messages import Kind, Stamp, Swarm, To
from swarmer.protocol import race
from swarmer.radio import WINDOW
from swarmer.telemetry import Wire

FAULTS = {"radio.loss": 0.05, "radio.reorder": 0.2, "failure.rate": 0.02, "virtual.handling_ms": 1}


@pytest.mark.parametrize("faults", [{}, FAULTS], ids=["calm", "rough"])
def test_the_short_way_of_a_datagram_is_the_long_one(monkeypatch, faults):
    short = trace(**faults)
    monkeypatch.setattr(VirtualFls, "hear", BaseFls.hear)
    monkeypatch.setattr(VirtualFls, "take", BaseFls.hear)
    monkeypatch.setattr(VirtualFls, "fresh", BaseFls.fresh)
    assert trace(**faults) == short


@pytest.mark.parametrize(
    "settings", [{}, {"virtual.latency_min_ms": 1, "virtual.latency_max_ms": 1}], ids=str
)
def test_latencies_in_arrays_are_those_drawn_one_by_one(monkeypatch, settings):
    before = trace(**settings)
    monkeypatch.setattr(virtual_radio, "MANY", 10**9)
    assert trace(**settings) == before


@pytest.mark.parametrize("latency_ms", [(0, 0), (1, 1), (0.1, 0.3)])
def test_a_datagram_to_many_is_the_same_as_an_entry_for_each(monkeypatch, latency_ms):
    """Also where all latencies are the same, and much falls on one moment: what was put down first comes first."""
    settings = {"virtual.latency_min_ms": latency_ms[0], "virtual.latency_max_ms": latency_ms[1]}
    together, put = trace(**settings), Agenda.put

    def put_apart(agenda, at_s, what, fls, one=None, two=None):
        if what != GROUP:
            put(agenda, at_s, what, fls, one, two)
            return
        for arrival in reversed(one):
            put(agenda, arrival[0], GROUP, None, [arrival], two)

    monkeypatch.setattr(Agenda, "put", put_apart)
    assert trace(**settings) == together


@pytest.mark.parametrize("swarms", [1, 2, 40])
def test_whoever_is_asked_the_same_hear_a_challenge(monkeypatch, swarms):
    """FLS 1 to 100 are one swarm; the others are so many."""
    _, shared, flss = display()
    for fid, fls in flss.items():
        fls.machine.swarm = Swarm(1 if fid <= 100 or swarms == 1 else 100 + fid % (swarms - 1) + 1, 0)
        fls._retune()
    for fid in (1, 60, 110):
        sender = flss[fid]
        for reach in (15.0, 1e9):
            challenge = message(Kind.CHALLENGE_INIT, fid, reach=reach, swarm=sender.machine.swarm)
            challenge = challenge._replace(truth=sender.spec.truth)
            stamp = Stamp(1, 1, sender.position(), 0.0)
            ways = []
            for few in (-1, POINTS):
                monkeypatch.setattr(virtual_radio, "FEW", few)
                ways.append([fls.fid for fls in shared.air._in_range(challenge, stamp, sender)])
            heard = [
                other.fid
                for other in flss.values()
                if radio.heard(challenge, stamp, other.ears, POINTS) is None
            ]
            assert sorted(ways[0]) == sorted(ways[1]) == heard
            assert heard


def test_the_draws_of_an_array_are_those_of_one_call_after_the_other():
    one, other = Random(5), Random(5)
    for count in (1, 2, 7, 500):
        assert next_draws(one, count).tolist() == [other.random() for _ in range(count)]
    assert one.getstate() == other.getstate()


def test_only_kinds_that_the_judge_may_stop_are_asked_about():
    class Flying:
        """A state in which everything is answered, dropped or noted that can be."""

        awake, flying, available, anchoring, epoch, size, swarm = True, True, False, False, 0, 1, Swarm(1, 0)

    for kind in Kind:
        verdict = race.judge(message(kind), Flying(), frozenset(), True)
        assert (verdict is race.QUEUE) == (kind not in race.JUDGED), kind


def test_who_sends_too_fast_is_remembered_by_its_receivers():
    _, shared, flss = display()
    sender, receiver, air = flss[1], flss[2], shared.air

    def send_half_a_window(now):
        shared.agenda.now = now
        for _ in range(HALF_WINDOW):
            sender.stamp(message(Kind.NEIGHBOUR), now)

    def arrive(number):
        before = shared.counts[Wire.DELIVERED]
        stamp = Stamp(1, number, (0.0, 0.0, 0.0), 0.0)
        receiver.hear(message(Kind.NEIGHBOUR, 1, To.FLS, Swarm(2, 0)), stamp)
        return shared.counts[Wire.DELIVERED] - before

    send_half_a_window(1.0)
    send_half_a_window(1.0 + 1.01 * air._longest_s)
    assert not air.doubtful[1]
    send_half_a_window(1.0 + 1.5 * air._longest_s)
    assert air.doubtful[1]
    assert [arrive(WINDOW + 5), arrive(4), arrive(5), arrive(5)] == [1, 0, 1, 0]
    assert shared.counts[Wire.REPLAYED] == 2
    assert not any(air.doubtful[2:])


def test_a_successor_is_remembered_so_that_its_predecessor_is_not_heard_after_it():
    _, shared, flss = display()
    flss[1].end("failed")
    VirtualFls(shared, flss[1].spec._replace(incarnation=1))
    said = message(Kind.NEIGHBOUR, 1, To.FLS, Swarm(2, 0))
    for what, number in ((said._replace(incarnation=1), 1), (said, 7)):
        flss[2].hear(what, Stamp(1, number, (0.0, 0.0, 0.0), 0.0))
    assert (shared.counts[Wire.DELIVERED], shared.counts[Wire.REPLAYED]) == (1, 1)


def test_where_copies_are_made_everybody_remembers():
    _, shared, _ = display(**{"radio.duplicate_receiver": 0.1})
    assert all(shared.air.doubtful)


def test_the_agenda_gives_back_in_order_whatever_is_put_down():
    agenda, rng = Agenda(), Random(3)
    put: list[tuple[float, int]] = []
    taken: list[tuple[float, int]] = []

    def add(at):
        agenda.put(at, 0, None)
        put.append((at, agenda.order))

    for _ in range(300):
        add(rng.choice([0.0, rng.uniform(0, 0.02), rng.uniform(0, 3), rng.randrange(9) / SLOTS_PER_S]))
    while len(taken) < 600:
        agenda.heap.sort()
        entry: Entry = agenda.heap.pop(0)
        agenda.now = entry[0]
        if entry[1] == -1:
            agenda.next_slot()
            continue
        taken.append(entry[:2])
        if len(put) < 600:
            add(agenda.now + rng.choice([0.0, 1e-4, 0.5, 1 / SLOTS_PER_S]))
    assert taken == sorted(put)


def test_a_snapshot_shows_the_flss_themselves(monkeypatch):
    taken = []

    def checked(run, now, snapshot=_Run._snapshot):
        seen = snapshot(run, now)
        assert seen.position.tolist() == [list(fls.position()) for fls in run.flss]
        assert seen.swarm.tolist() == [fls.machine.swarm.xi if fls.lit else 0 for fls in run.flss]
        assert seen.lit.tolist() == [fls.lit for fls in run.flss]
        assert seen.alive.tolist() == [fls.alive for fls in run.flss]
        assert seen.state.tolist() == [int(fls.machine.state) for fls in run.flss]
        assert not any(np.shares_memory(seen.position, other.position) for other in taken)
        taken.append(seen)
        return seen

    monkeypatch.setattr(_Run, "_snapshot", checked)
    fly(**{"failure.rate": 0.02, "failure.replace": False, "failure.battery_s": 9, "recording.rate_hz": 20})
    assert len(taken) == 241
    assert not taken[-1].alive.all()


def test_an_observer_hears_that_a_run_lives_while_emulated_time_stands_still(monkeypatch):
    monkeypatch.setattr(virtual, "BEAT_S", -1.0)
    _, watcher = fly(duration_s=12, **{"recording.rate_hz": 0.1})
    assert watcher.calls.count("sample") == 3
    assert "beat" in watcher.calls
