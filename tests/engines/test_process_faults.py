"""A fault schedule on processes, signal by signal; the processes are numbers here (real ones: tests/processes)."""

import math
import signal
from array import array

import pytest

from swarmer.engines import process_faults
from swarmer.engines.process_faults import Hand, Watch
from swarmer.faults import Fault, Schedule

STOP, GO, KILL = signal.SIGSTOP, signal.SIGCONT, signal.SIGKILL


@pytest.fixture
def sent(monkeypatch):
    """(process id, signal) of all that is sent."""
    signals = []
    monkeypatch.setattr(process_faults.os, "kill", lambda pid, number: signals.append((pid, number)))
    return signals


def hand(*faults, calm_s=None, listens=(1, 1, 3, 3)):
    pids = {fid: 100 + fid for fid in range(1, 5)}
    told = []
    made = Hand(Schedule(faults, calm_s), 1, pids, array("I", listens), told.append)
    made.pids, made.told = pids, told
    return made


def test_kill_and_replace(sent):
    one = hand(Fault(1.0, "kill", (2, 3), 0.5))
    assert one.due_s() == 1.0
    assert one.act(0.9, 1.0) == []
    assert sent == []
    assert one.act(1.01, 1.0) == []
    assert sent == [(102, KILL), (103, KILL)]
    assert (one.dark, one.struck) == ({2, 3}, {102, 103})
    del one.pids[2], one.pids[3]  # the dispatcher has seen them end
    assert one.act(1.5, 1.0) == [2, 3]
    assert one.dark == set()
    assert one.due_s() == math.inf
    assert [(turn.begins, turn.at_s) for turn in one.told] == [(True, 1.0), (False, 1.5)]


def test_who_is_not_seen_dead_yet_is_replaced_when_it_is(sent):
    one = hand(Fault(1.0, "kill", (2,), 0.0))
    assert one.act(1.0, 1.0) == [], "its process still is a child"
    assert one.dark == set(), "so the dispatcher replaces it, once it has seen it end"


def test_a_swarm_is_who_listens_to_it_at_that_moment(sent):
    one = hand(Fault(1.0, "kill", (), 1.0, swarm_of=4))
    one.act(1.0, 1.0)
    assert sent == [(103, KILL), (104, KILL)]
    dark = hand(Fault(1.0, "kill", (), 1.0, swarm_of=4), listens=(1, 1, 3, 0))
    dark.act(1.0, 1.0)
    assert dark.dark == set(), "in the dark it is in no swarm"


def test_hang_until_the_last_fault_lets_go(sent):
    one = hand(Fault(1.0, "hang", (2,), 2.0), Fault(2.0, "hang", (2, 3), 2.0))
    one.act(1.0, 1.0)
    one.act(2.0, 1.0)
    assert sent == [(102, STOP), (102, STOP), (103, STOP)]
    sent.clear()
    one.act(3.0, 1.0)
    assert sent == []
    one.act(4.0, 1.0)
    assert sent == [(102, GO), (103, GO)]


def test_a_successor_does_not_hang(sent):
    one = hand(Fault(1.0, "hang", (2,), 2.0))
    one.act(1.0, 1.0)
    one.pids[2] = 999
    sent.clear()
    one.act(3.0, 1.0)
    assert sent == [], "the one that was stopped is gone"


def test_slow_is_a_duty_cycle(sent):
    one = hand(Fault(1.0, "slow", (2,), 2.0, late_s=0.1))
    now, stood, since = 0.0, 0.0, None
    while now < 5.0:
        one.act(now, 1.0)
        for _, number in sent:
            assert (since is None) == (number == STOP)
            stood += 0.0 if since is None else now - since
            since = now if number == STOP else None
        sent.clear()
        now = max(now + 1e-6, min(one.due_s(), 5.0))
    assert since is None, "it goes on when the fault is over"
    assert stood == pytest.approx(1.5, abs=0.15)


def test_slow_costs_no_more_than_it_must(sent):
    """At a time scale of 1/1000 the cycle would be of some microseconds."""
    one = hand(Fault(0.0, "slow", (2,), 1.0, late_s=1e-5))
    now = 0.0
    while now < 1.0:
        one.act(now, 0.001)
        now = one.due_s()
    assert len(sent) <= 1.0 / 0.001 / process_faults.SHORTEST_S


def test_at_the_end_and_in_the_calm_everybody_goes_on(sent):
    faults = (Fault(1.0, "hang", (2,)), Fault(1.0, "slow", (3,), late_s=0.5), Fault(1.0, "kill", (4,)))
    one = hand(*faults)
    one.act(1.6, 1.0)
    assert {(102, STOP), (104, KILL)} <= set(sent)
    sent.clear()
    one.let_go()
    assert (102, GO) in sent
    calm = hand(*faults, calm_s=3.0)
    calm.act(1.6, 1.0)
    del calm.pids[4]
    sent.clear()
    assert calm.act(3.0, 1.0) == [4]
    assert (102, GO) in sent
    assert calm.calm
    assert calm.due_s() == math.inf


def test_who_shows_no_life_is_given_up_once(monkeypatch):
    wall = [0.0]
    monkeypatch.setattr(process_faults.time, "monotonic", lambda: wall[0])
    beats, pids = {1: 0, 2: 0}, {1: 101, 2: 102}
    watch, given_up = Watch(1.0, pids), []
    for step in range(60):
        wall[0] = step * 0.1
        beats[1] = step % 256
        given_up += [(round(wall[0], 1), pid) for pid in watch.given_up(wall[0], 1.0, beats.__getitem__)]
        if given_up and pids[2] == 102 and wall[0] > 4.0:
            pids[2] = 202  # replaced; it hangs, too
    assert [pid for _, pid in given_up] == [102]
    assert (
        process_faults.PATIENCE_S
        <= given_up[0][0]
        <= process_faults.PATIENCE_S + 2 * process_faults.BEATS_EVERY_S
    )
    assert Watch(0.0, pids).given_up(99.0, 1.0, beats.__getitem__) == []
