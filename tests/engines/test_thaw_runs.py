"""The thaw policies in whole displays in virtual time: right without loss and with it, whoever fails, however few."""

from __future__ import annotations

from itertools import pairwise

import pytest
from virtual_runs import Watcher, fly

from swarmer.config import load_config
from swarmer.engines.result import Witness
from swarmer.engines.virtual import VirtualEngine
from swarmer.fls import FAILURE
from swarmer.messages import Kind, Swarm
from swarmer.next_shape import corners
from swarmer.plan import make_plan
from swarmer.protocol.events import ThawBegins
from swarmer.shapes.catalogue import load_shape

POLICIES = ("roster", "census", "corner")
LOSSES = (0.0, 0.1)
NO_REST = {"thaw.rest_below_cells": 0}


class Notary(Witness):
    """Notes when thaws begin, by which FLS and why, and how many there are of each kind of message."""

    def __init__(self):
        self.begins: list[tuple[float, int, ThawBegins]] = []
        self.sent_kinds: dict[Kind, int] = dict.fromkeys(Kind, 0)
        self.reports: list[tuple[float, int, int]] = []  # second, FID, epoch

    def handled(self, fls, event, actions, cause, now_s):
        self.begins += [(now_s, fls.fid, action) for action in actions if isinstance(action, ThawBegins)]

    def sent(self, fls, message, stamp, copies, now_s):
        self.sent_kinds[Kind(message.kind)] += 1
        if message.kind == Kind.COUNT:
            self.reports.append((now_s, fls.fid, message.epoch))


def watched(**settings) -> tuple[dict, Notary, Watcher]:
    """Counters of a run, what a witness has noted, what an observer has seen."""
    plan = make_plan(load_config(None, (), **{"shape": "sphere", "points": 40, "duration_s": 12, **settings}))
    notary, watcher = Notary(), Watcher()
    with VirtualEngine(plan, [notary]) as engine:
        result = engine.run(watcher)
    assert result.status == "done", result.message
    return result.counters, notary, watcher


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("policy", POLICIES)
def test_without_failures_every_thaw_of_a_policy_comes_at_one_swarm(policy, loss):
    counters, notary, watcher = watched(
        **{"thaw.policy": policy, "radio.loss": loss, "duration_s": 20, **NO_REST}
    )
    assert counters["thaws"] >= 3
    assert counters["wrong_thaws"] <= (0 if policy != "corner" or not loss else counters["thaws"] / 2)
    assert counters["thaws_by_clock"] == 0
    assert counters["thaws_at_one_swarm"] == counters["thaws"] - counters["wrong_thaws"]
    assert all(begins.known for _, _, begins in notary.begins)
    assert watcher.progress.hd < 0.5


@pytest.mark.parametrize("policy", POLICIES)
def test_a_policy_that_knows_is_faster_than_the_clock(policy):
    clock = fly(**{"duration_s": 15, "thaw.policy": "timer"})[1].progress.time_to_hd_s["0.01"]
    assert fly(**{"duration_s": 15, "thaw.policy": policy})[1].progress.time_to_hd_s["0.01"] < clock / 1.5


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("points", [2, 3, 5])
def test_few_flss_thaw_too(policy, loss, points):
    counters, notary, watcher = watched(
        **{"thaw.policy": policy, "radio.loss": loss, "points": points, "duration_s": 20}
    )
    assert any(begins.known for _, _, begins in notary.begins)
    assert counters["thaws"] >= 4
    assert counters["wrong_thaws"] == 0
    assert watcher.progress.hd < 0.01


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("rate", [0.001, 0.01])
def test_failures_and_replacements_do_not_stop_the_thaws(policy, loss, rate):
    counters, _, watcher = watched(
        **{"thaw.policy": policy, "radio.loss": loss, "failure.rate": rate, "duration_s": 30, "seed": 2}
    )
    assert counters["failures"] > 0
    assert counters["thaws"] >= 4
    assert counters["thaws_by_clock"] <= counters["thaws"] / 2
    assert counters["wrong_thaws"] <= max(1, counters["thaws"] / 5)
    assert watcher.progress.hd_min < 0.05


@pytest.mark.parametrize("policy", POLICIES)
def test_whoever_is_gone_for_good_leaves_the_thaws_to_the_clock(policy):
    """The latest clock is 8 H; the owner that the roster has, if it is alive, has one of 2 H."""
    counters, notary, watcher = watched(
        **{
            "thaw.policy": policy, "failure.rate": 0.02, "failure.replace": False, "duration_s": 60, "points": 20,
            "thaw.h_s": 2, "seed": 3,
        }
    )  # fmt: skip
    first = next(event.t_s for event in watcher.events if event.kind == "failure")
    moments = [first, *(t_s for t_s, _, begins in notary.begins if t_s > first), 60.0]
    assert counters["failures"] >= 3
    pauses = sorted(later - t_s for t_s, later in pairwise(moments))
    assert len(pauses) > 3
    assert pauses[-1] <= 8 * 2
    if policy == "roster":
        assert pauses[len(pauses) // 2] <= 2 * 2 + 1


def test_the_owner_may_fail():
    """FLS 1 owns what all become. Its successor inherits that swarm, and the list with it."""

    class Killer(Witness):
        """Ends FLS 1 when it has the reports of three quarters of the display."""

        def __init__(self):
            self.at_s = None

        def handled(self, fls, event, actions, cause, now_s):
            if self.at_s is None and fls.fid == 1 and len(fls.machine.thaw_policy._roll) >= 30:
                self.at_s = now_s
                fls.wait(FAILURE, now_s)

    killer = Killer()
    plan = make_plan(
        load_config(None, (), shape="sphere", points=40, duration_s=8, **{"thaw.policy": "roster"}, **NO_REST)
    )
    notary, watcher = Notary(), Watcher()
    with VirtualEngine(plan, [killer, notary]) as engine:
        counters = engine.run(watcher).counters
    assert counters["failures"] == counters["replacements"] == 1
    t_s, fid, begins = notary.begins[0]
    assert (fid, begins.swarm, begins.known) == (1, Swarm(1, 0), True)
    assert killer.at_s < t_s < killer.at_s + 4.0, "long before the clock, 4 H"
    assert counters["wrong_thaws"] == 0


@pytest.mark.parametrize("anchor", ["largest", "challenger", "random"])
@pytest.mark.parametrize("policy", POLICIES)
def test_where_swarm_ids_rise_wrong_thaws_are_few(policy, anchor):
    counters, _, _ = watched(**{"thaw.policy": policy, "anchor": anchor, "radio.loss": 0.1, "duration_s": 25})
    assert counters["thaws"] >= 3
    assert counters["wrong_thaws"] <= counters["thaws"] / 3


def test_the_roster_knows_a_latency_after_the_last_merge():
    """Without loss: after the last FLS took the last Swarm-ID comes one datagram, then the thaw (L3)."""
    latency = {"virtual.latency_min_ms": 1, "virtual.latency_max_ms": 2, "virtual.handling_ms": 0}
    settings = {"thaw.policy": "roster", **latency, **NO_REST}
    _, notary, _ = watched(**settings)
    assert len(notary.begins) > 3
    for t_s, _, begins in notary.begins:
        last = max(at for at, _, epoch in notary.reports if epoch == begins.epoch and at < t_s)
        assert t_s - last <= 0.002 + 1e-9


def test_the_census_fires_within_two_lambda_of_the_last_report():
    _, notary, _ = watched(**{"thaw.policy": "census", "duration_s": 20})
    ends = [0.0] + [t_s for t_s, _, _ in notary.begins]
    assert len(ends) > 4
    for before, t_s in pairwise(ends):
        first = {}
        for at, fid, _ in notary.reports:
            if before < at < t_s:
                first.setdefault(fid, at)
        assert len(first) == 39, "all but the owner, which needs no datagram"
        assert t_s - max(first.values()) <= 2 * 0.5 + 0.002


def test_the_roster_asks_only_when_reports_may_be_lost_or_are_due():
    _, calm, _ = watched(**{"thaw.policy": "roster", **NO_REST})
    _, rough, _ = watched(**{"thaw.policy": "roster", "radio.loss": 0.1, **NO_REST})
    assert rough.sent_kinds[Kind.ROLL_CALL] > 0
    thaws = len(calm.begins)
    assert calm.sent_kinds[Kind.ROLL_CALL] < 20 * thaws < calm.sent_kinds[Kind.COUNT]


def test_a_display_that_is_as_good_as_it_gets_goes_quiet():
    tired, _, still = watched(**{"thaw.policy": "roster", "duration_s": 30})
    awake, _, busy = watched(**{"thaw.policy": "roster", "duration_s": 30, **NO_REST})
    assert tired["thaws"] < awake["thaws"] / 3
    assert tired["datagrams_sent"] < awake["datagrams_sent"] / 2
    assert tired["thaws_by_clock"] > 0 == awake["thaws_by_clock"]
    assert max(still.progress.hd, busy.progress.hd) < 0.01


def test_a_replacement_ends_the_rest():
    """A newcomer lands cells away from its point; the thaw that follows its joining corrects it."""
    counters, notary, watcher = watched(
        **{"thaw.policy": "roster", "failure.rate": 0.001, "duration_s": 40, "seed": 4, "thaw.h_s": 100}
    )
    failures = [event.t_s for event in watcher.events if event.kind == "failure" and 6 < event.t_s < 34]
    assert failures
    assert counters["thaws_by_clock"] == 0, "the clock is far away in this run"
    for failed_s in failures:
        assert any(failed_s < t_s < failed_s + 5 for t_s, _, _ in notary.begins)


@pytest.mark.parametrize("policy", POLICIES)
def test_a_busy_handler_delays_and_does_not_mislead(policy):
    counters, _, _ = watched(**{"thaw.policy": policy, "virtual.handling_ms": 3, "duration_s": 15})
    assert counters["thaws"] >= 3
    assert counters["wrong_thaws"] == 0


def test_centralized_does_not_wait_for_a_sample():
    counters, _, watcher = watched(**{"thaw.policy": "centralized", "recording.rate_hz": 1})
    moments = [event.t_s for event in watcher.events if event.kind == "thaw"]
    assert counters["thaws_at_one_swarm"] == counters["thaws"] == len(moments) > 6
    assert all(t_s != round(t_s) for t_s in moments)
    assert counters["wrong_thaws"] == 0


def test_by_the_clock_nobody_is_wrong_but_how_it_stood_is_known():
    counters, _, _ = watched(**{"thaw.policy": "timer", "duration_s": 20})
    assert "wrong_thaws" not in counters
    assert counters["thaws_by_clock"] == counters["thaws"] >= counters["thaws_at_one_swarm"] > 0
    early = watched(**{"thaw.policy": "timer", "thaw.h_s": 0.5, "thaw.spread": 1})[0]
    assert early["thaws_at_one_swarm"] < early["thaws"] == early["thaws_by_clock"]


@pytest.mark.parametrize(
    ("shape", "points", "expected"), [("sphere", 40, 8), ("sphere", 5, 5), ("cat", None, 4)]
)
def test_corners_are_farthest_from_the_centroid(shape, points, expected):
    cloud = load_shape(shape, points, "refuse", 1)
    far = ((cloud.points - cloud.points.mean(axis=0)) ** 2).sum(axis=1)
    found = corners(cloud)
    assert len(found) == len(set(found)) == expected
    others = [row for row in range(len(cloud)) if row + 1 not in found]
    assert all(far[fid - 1] >= far[row] for fid in found for row in others)


def test_copies_of_a_thaw_that_wait_to_be_handled_begin_no_other():
    """Without epochs all repeat it here: handling 59 copies takes longer than λ, for which an FLS obeys no other.

    Where copies wait their turn the last ones are obeyed, repeated, and the storm never ends.
    """
    counters, notary, _ = watched(
        **{"points": 60, "duration_s": 9, "lambda_ms": 50, "virtual.handling_ms": 2, "epochs": False,
           "thaw.policy": "timer", "thaw.repeat": 1, "busy_join": "off"}
    )  # fmt: skip
    begun = len(notary.begins)
    assert begun == 1
    assert counters["thawed_flss"] == 60
    assert notary.sent_kinds[Kind.THAW] == 60
