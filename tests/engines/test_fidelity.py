"""The governor on machines made up for it: a load that rises with the time scale, and lateness with the load."""

import numpy as np
import pytest

from swarmer.engines.fidelity import CALM, SLOWEST, Governor, Tally
from swarmer.metrics.lateness import BUCKETS, bucket

LEASE_MS = 250.0
BOUND_MS = LEASE_MS / 2


class Machine:
    """Handles `messages_per_s` (emulated) and makes them late by `late_ms(scale)`; thaws every 10 emulated seconds."""

    def __init__(self, governor, late_ms, messages_per_s=4000, epoch_s=10.0):
        self.governor, self.late_ms, self.rate, self.epoch_s = governor, late_ms, messages_per_s, epoch_s
        self.timer, self.handled = np.zeros(BUCKETS, np.int64), np.zeros(BUCKETS, np.int64)
        self.wall = self.t_s = 0.0
        self.scales = []

    def run(self, emulated_s, look_s=0.05):
        while self.t_s < emulated_s:
            scale = self.governor.scale
            self.wall += look_s
            self.t_s += look_s * scale
            self.handled[bucket(self.late_ms(scale, self.t_s))] += round(self.rate * look_s * scale)
            thaws = int(self.t_s // self.epoch_s)
            self.governor.judge(self.timer.copy(), self.handled.copy(), thaws, self.t_s, self.wall)
            self.scales.append(self.governor.scale)
        return self

    def p99(self):
        total = np.cumsum(self.handled)
        return int(np.searchsorted(total, 0.99 * total[-1]))


def governor(wake_ms=10.0, wanted="auto"):
    made = Governor(wanted, LEASE_MS)
    if made.auto:
        made.rehearsed(wake_ms)
    return made


def test_a_machine_with_room_runs_in_real_time():
    machine = Machine(governor(), lambda scale, t: 2.0).run(30)
    assert machine.scales[-1] == 1.0
    assert machine.t_s / machine.wall > 0.9


@pytest.mark.parametrize("slowness", [100, 400, 1500])
def test_a_slow_machine_runs_slower_and_stays_faithful(slowness):
    """Lateness in emulated time grows with the scale: at 1 it would be `slowness` ms."""
    machine = Machine(governor(wake_ms=slowness / 3.5), lambda scale, t: slowness * scale).run(40)
    assert machine.p99() <= bucket(1.7 * BOUND_MS)
    steady = np.mean(machine.scales[len(machine.scales) // 2 :])
    assert 0.25 * BOUND_MS / slowness < steady <= min(1.0, 2 * BOUND_MS / slowness)


def test_it_brakes_for_a_thaw_before_it_is_late():
    """Only the 1.3 s after a thaw are hard: there the machine is late in proportion to the scale, else never."""

    def late_ms(scale, t):
        return 300 * scale if t % 10 < 1.3 else 1.0

    machine = Machine(governor(wake_ms=300 / 3.5), late_ms).run(60)
    after_thaw = [
        s for s, t in zip(machine.scales, np.linspace(0, 60, len(machine.scales)), strict=True) if t > 40
    ]
    assert max(after_thaw) == 1.0
    assert min(after_thaw) < 0.8
    assert machine.p99() <= bucket(BOUND_MS * 1.15)
    assert machine.t_s / machine.wall > 0.6


def test_a_fixed_scale_is_never_touched():
    machine = Machine(governor(wanted=0.8), lambda scale, t: 5000.0).run(5)
    assert set(machine.scales) == {0.8}


def test_the_scale_stays_within_its_limits():
    machine = Machine(governor(wake_ms=1e6), lambda scale, t: 50_000.0).run(2)
    assert min(machine.scales) >= SLOWEST
    machine = Machine(governor(wake_ms=1e-9), lambda scale, t: 0.01).run(20)
    assert max(machine.scales) <= 1.0


def test_a_longer_rehearsal_begins_slower():
    scales = [governor(wake_ms=wake).scale for wake in (1, 50, 100, 10_000)]
    assert scales[0] == 1.0
    assert scales == sorted(scales, reverse=True)
    assert scales[1] > scales[2] > scales[3] > 0
    assert 0 < CALM < 1


class Sample:
    def __init__(self, timer, handled):
        self.timer_late, self.handled_late = np.array(timer), np.array(handled)


def histogram(**late):
    counts = [0] * BUCKETS
    for name, number in late.items():
        counts[bucket(float(name.removeprefix("ms")))] += number
    return counts


def test_the_tally_judges_the_whole_run_without_the_rehearsal():
    tally = Tally()
    tally.add(Sample(histogram(), histogram(ms900=500)))
    tally.start()
    tally.add(Sample(histogram(ms1=1000), histogram(ms900=500, ms3=1000)))
    assert tally.handled().p99 < 4
    assert tally.faithful(LEASE_MS)
    assert tally.suggestion(1.0, LEASE_MS) is None
    tally.add(Sample(histogram(ms1=1000), histogram(ms900=500, ms3=1000, ms400=100)))
    assert not tally.faithful(LEASE_MS)
    # 400 ms late at scale 1 would be 125 at 0.3; buckets are a little coarse.
    assert 0.2 <= tally.suggestion(1.0, LEASE_MS) <= 0.3


def test_a_tally_of_nothing_says_nothing():
    tally = Tally()
    assert tally.faithful(LEASE_MS) is None
    assert tally.timer() is None
    tally.add(Sample(histogram(), histogram()))
    assert tally.faithful(LEASE_MS) is None
    assert tally.suggestion(1.0, LEASE_MS) is None
