"""scripts/scaling_page.py: what is counted on the air is what the engine sends, and the page follows from it."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from scaling.measure import by_fid, measure  # noqa: E402
from scaling.model import HOST, Growth, need, power  # noqa: E402
from scaling.page import FREE, of_policy, page  # noqa: E402
from scaling.wire import Wire, formation  # noqa: E402
from scaling_page import MEASURED, PAGE  # noqa: E402

from swarmer.config import load_config  # noqa: E402
from swarmer.messages import CHALLENGE_ACK, FOLLOW_MERGE  # noqa: E402
from swarmer.plan import make_plan  # noqa: E402

KEPT = json.loads(MEASURED.read_text("utf-8"))


def test_the_page_is_made_from_what_was_counted():
    assert PAGE.read_text("utf-8") == page(KEPT)


def test_a_copy_goes_once_to_each_other_host():
    hosts = by_fid(np.array([0, 0, 1, 1, 2]))  # of FIDs 1 to 5
    wire = Wire(5, [hosts])
    wire.begin()
    wire.note(FOLLOW_MERGE, 1, [2, 3, 4, 5], 0.05)
    wire.note(CHALLENGE_ACK, 3, [4], 0.05)
    merge, ack = wire.counts[FOLLOW_MERGE], wire.counts[CHALLENGE_ACK]
    assert (merge.sent, merge.delivered, merge.largest, merge.crossings) == (1, 4, 4, [2])
    assert (ack.sent, ack.delivered, ack.crossings) == (1, 1, [0])
    assert wire.received.tolist() == [0, 0, 1, 1, 2, 1]
    assert dict(wire.bins) == {0: 5}
    assert dict(wire.crossed[0]) == {0: 2}


def test_a_broadcast_is_made_on_every_host_that_it_reaches():
    hosts = by_fid(np.arange(60) // 20)
    wire = Wire(60, [hosts])
    wire.begin()
    wire.note(FOLLOW_MERGE, 1, list(range(2, 41)), 0.0)
    assert (wire.counts[FOLLOW_MERGE].broadcasts, wire.counts[FOLLOW_MERGE].airings) == (1, [2])


class Everything(Wire):
    """Counts from the first datagram on, and does not begin anew."""

    def __init__(self, size):
        super().__init__(size, [])
        self.on = True

    def begin(self):
        if not hasattr(self, "counts"):
            super().begin()


@pytest.mark.parametrize("whole", [True, False])
def test_what_is_counted_is_what_the_engine_sends(whole):
    """From the very beginning it adds up to the run's own counters, and a formation is less."""
    plan = make_plan(load_config(engine="virtual", shape="sphere", points=60, duration_s=20))
    wire = Everything(60) if whole else Wire(60, [])
    observer, result = formation(plan, wire)
    assert len(observer.thaws_s) == 2
    counted = sum(count.sent for count in wire.counts.values())
    assert (
        counted == result.counters["datagrams_sent"]
        if whole
        else 0 < counted < result.counters["datagrams_sent"]
    )


def test_one_formation_is_told_whole():
    one = measure(600, **{"thaw.policy": "centralized"})
    assert one["per_host"] == [250]
    assert one["thaws_s"][0] < one["thaws_s"][1]
    acks = one["kinds"]["CHALLENGE_ACK"]
    assert 0 < acks["crossings"][0] < acks["delivered"] == acks["sent"]
    assert one["kinds"]["THAW"]["delivered"] >= 599 or "THAW" not in one["kinds"]


def test_laws_are_those_of_what_they_are_made_from():
    assert power([10, 20, 40], [5.0, 20.0, 80.0]) == pytest.approx((0.05, 2.0))
    free = of_policy(KEPT, FREE)
    growth = Growth(free)
    for one in free:
        assert growth.of("delivered", one["points"]) == pytest.approx(
            sum(kind["delivered"] for kind in one["kinds"].values()) / one["points"], rel=0.2
        )
    assert growth.copies("crossings", 1e5, 16000) < growth.copies("crossings", 1e5, 1000)


def test_hosts_are_bound_by_what_they_have():
    growth = Growth(of_policy(KEPT, FREE))
    slow, fast = need(growth, 1_000_000, 0.1), need(growth, 1_000_000, 1.0)
    assert slow.bound == "memory"
    assert slow.each * 3.85e-3 <= HOST.memory_gb
    assert fast.bound == "processors"
    assert fast.hosts > slow.hosts
    assert need(growth, 100, 1.0)[2:4] == (1, 100)
    assert need(growth, 100, 1.0).relayed == 0
