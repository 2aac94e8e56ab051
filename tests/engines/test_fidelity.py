"""Whether a run is faithful, from histograms of how late its timers and messages were."""

import numpy as np

from swarmer.engines.fidelity import Tally
from swarmer.metrics.lateness import BUCKETS, bucket

LEASE_MS = 250.0


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


def test_timers_alone_do_not_make_a_run_faithful():
    tally = Tally()
    tally.add(Sample(histogram(ms1=1000), histogram()))
    assert tally.timer().p99 < 2
    assert tally.faithful(LEASE_MS) is None


def test_a_tally_of_nothing_says_nothing():
    tally = Tally()
    assert tally.faithful(LEASE_MS) is None
    assert tally.timer() is None
    tally.add(Sample(histogram(), histogram()))
    assert tally.faithful(LEASE_MS) is None
    assert tally.suggestion(1.0, LEASE_MS) is None
