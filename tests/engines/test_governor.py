"""The governor on machines made up for it: a queue that is emptied at a steady rate, and filled at one of the run."""

import numpy as np
import pytest

from swarmer.engines.governor import AWAKE_S, CALM, PATIENCE_S, SLOWEST, Governor
from swarmer.metrics.lateness import BUCKETS, bucket

LEASE_MS = 250.0
BOUND_MS = LEASE_MS / 2
COUNT = 1000  # FLSs


class Machine:
    """A queue: `demand(t)` things to do in an emulated second, `capacity` done in a wall second, late while they wait.

    It thaws every 10 emulated seconds. Everything it does is a datagram that is handled, or with `timers` a timer. For
    0.2 s after time has become faster, what it does is `woken_late_ms` late: all are being woken.
    """

    def __init__(self, governor, demand, capacity=10_000.0, timers=False, woken_late_ms=0.0):
        self.governor, self.demand, self.capacity = governor, demand, capacity
        self.timers, self.woken_late_ms, self.faster_at = timers, woken_late_ms, -1.0
        self.timer, self.handled = np.zeros(BUCKETS, np.int64), np.zeros(BUCKETS, np.int64)
        self.wall = self.t_s = self.waiting = 0.0
        self.scales, self.times = [], []

    def run(self, emulated_s, look_s=0.05):
        while self.t_s < emulated_s:
            scale = self.governor.scale
            self.wall += look_s
            self.t_s += look_s * scale
            self.waiting += self.demand(self.t_s) * look_s * scale
            done = min(self.waiting, self.capacity * look_s)
            self.waiting -= done
            late_ms = 1e3 * scale * (0.002 + self.waiting / self.capacity)
            if self.wall - self.faster_at < 0.2:
                late_ms = max(late_ms, self.woken_late_ms)
            (self.timer if self.timers else self.handled)[bucket(late_ms)] += round(done)
            delivered = int(self.handled.sum())
            self.governor.judge(
                self.timer.copy(), self.handled.copy(), delivered, int(self.t_s // 10), self.t_s, self.wall
            )
            if self.governor.scale > scale:
                self.faster_at = self.wall
            self.scales.append(self.governor.scale)
            self.times.append(self.t_s)
        return self

    def between(self, begin, end):
        """The time scales between two moments of every epoch but the first."""
        return [s for s, t in zip(self.scales, self.times, strict=True) if t > 10 and begin <= t % 10 < end]

    def over(self):
        """The share of everything that was later than the bound."""
        counts = self.handled + self.timer
        return counts[bucket(BOUND_MS) + 1 :].sum() / counts.sum()


def governor(wake_ms=100.0, wanted="auto", count=COUNT):
    made = Governor(wanted, LEASE_MS, count)
    if made.auto:
        made.rehearsed(wake_ms)
    return made


def bursts(quiet, busy, busy_s=2.0):
    return lambda t: busy if t % 10 < busy_s else quiet


def test_a_machine_with_room_runs_in_real_time():
    machine = Machine(governor(wake_ms=20), lambda t: 2000.0).run(30)
    assert machine.scales[-1] == 1.0
    assert machine.t_s / machine.wall > 0.9


@pytest.mark.parametrize("overload", [1.5, 4.0, 20.0])
@pytest.mark.parametrize("wake_ms", [20.0, 200.0])
def test_an_overloaded_machine_runs_slower_and_is_seldom_late(overload, wake_ms):
    """What takes a wall second comes `overload` times in an emulated one, whatever the rehearsal promised."""
    machine = Machine(governor(wake_ms), lambda t: overload * 10_000).run(60)
    ungoverned = Machine(governor(wanted=1.0), lambda t: overload * 10_000).run(60)
    assert machine.over() < 0.04 < 0.9 < ungoverned.over()
    steady = np.mean(machine.scales[len(machine.scales) // 2 :])
    assert 0.5 / overload < steady < 1.05 / overload


def test_it_braces_for_a_thaw_and_is_quick_again_when_that_is_over():
    machine = Machine(governor(), bursts(quiet=1500.0, busy=60_000.0)).run(60)
    assert machine.over() < 0.03
    assert max(machine.between(0.1, 1.5)) < 0.3
    assert min(machine.between(5.0, 10.0)) == 1.0
    assert machine.t_s / machine.wall > 0.25


def test_a_wave_without_a_thaw_is_slowed_down_for_before_it_is_late():
    """The demand rises over a second; the scale follows it, not the lateness."""
    machine = Machine(governor(), lambda t: 2000 + 38_000 * max(0.0, 1 - abs(t % 10 - 7))).run(60)
    assert machine.over() < 0.06
    assert min(machine.between(6.8, 7.2)) < 0.5


def test_timers_are_work_too():
    machine = Machine(governor(), lambda t: 30_000.0, timers=True).run(30)
    assert machine.over() < 0.04
    assert machine.scales[-1] < 0.5


def test_to_go_faster_is_rare_because_everybody_is_woken_for_it():
    machine = Machine(governor(), bursts(quiet=1500.0, busy=60_000.0)).run(60)
    change = np.diff(machine.scales)
    changes = np.flatnonzero(change)
    faster = changes[change[changes] > 0][1:]
    before = np.array([changes[changes < at].max() for at in faster])
    assert len(faster) > 5
    assert ((faster - before) * 0.05 >= PATIENCE_S - 0.051).all()


def test_who_is_late_only_because_all_were_woken_is_no_reason_to_slow_down():
    machine = Machine(governor(wake_ms=1000), lambda t: 4000.0, woken_late_ms=300.0).run(9.5)
    assert machine.scales[-1] == 1.0
    assert (np.diff(machine.scales) < 0).sum() == 0


def test_what_happens_while_all_are_woken_is_no_lesson_at_all():
    """To have been late then proves nothing, and nor does not to have been seen to be."""
    judge = governor(wake_ms=400.0)
    handled, capacity, wall = np.zeros(BUCKETS, np.int64), [], 100.0
    for look in range(60):  # quiet at first: it goes up to real time; then busy at once
        wall += 0.05
        handled[bucket(1.0 if look < 20 else 300.0)] += 5 if look < 20 else 240
        before = judge.scale
        judge.judge(handled * 0, handled.copy(), int(handled.sum()), 0, 5 + 0.05 * look, wall)
        capacity.append(judge._capacity)
        if judge.scale > before:
            awake = look + int(AWAKE_S / 0.05)
            handled[bucket(1.0)] += 1000  # much done, as all wake
            break
    for later in range(look + 1, awake):
        wall += 0.05
        handled[bucket(300.0)] += 240
        judge.judge(handled * 0, handled.copy(), int(handled.sum()), 0, 5 + 0.05 * later, wall)
        assert judge._capacity == capacity[-1]


def test_without_a_rehearsal_it_still_learns():
    """Nobody was woken in time, so nothing is known of the machine: lateness teaches it all the same."""
    made = Governor("auto", LEASE_MS, COUNT)
    machine = Machine(made, lambda t: 30_000.0).run(30)
    assert machine.scales[-1] < 0.5
    assert machine.over() < 0.06


@pytest.mark.parametrize(("so_far_ms", "learns"), [(1.0, False), (110.0, True)])
def test_a_run_that_was_punctual_may_be_late_for_a_moment(so_far_ms, learns):
    """The last moments are 110 of 125 ms late: too much only for a run that is as late as a whole."""
    judge = governor()
    before = judge._capacity
    handled = np.zeros(BUCKETS, np.int64)
    handled[bucket(so_far_ms)] = 1_000_000
    for look in range(12):
        judge.judge(handled * 0, handled.copy(), int(handled.sum()), 0, 5 + 0.05 * look, 100 + 0.05 * look)
        handled[bucket(110.0)] += 100
    assert (judge._capacity < before) == learns


def test_a_fixed_scale_is_never_touched():
    machine = Machine(governor(wanted=0.8), lambda t: 50_000.0).run(5)
    assert set(machine.scales) == {0.8}


def test_the_scale_stays_within_its_limits():
    machine = Machine(governor(wake_ms=1e6), lambda t: 1e7).run(2)
    assert min(machine.scales) >= SLOWEST
    machine = Machine(governor(wake_ms=1e-9), lambda t: 1.0).run(20)
    assert max(machine.scales) <= 1.0


def test_a_longer_rehearsal_begins_slower():
    scales = [governor(wake_ms=wake).scale for wake in (1, 100, 300, 1_000)]
    assert scales[0] == 1.0
    assert scales == sorted(scales, reverse=True)
    assert scales[1] > scales[2] > scales[3] > 0
    assert 0 < CALM < 1
