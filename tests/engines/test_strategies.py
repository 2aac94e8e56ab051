"""Every anchor selection, challenge policy and placement, and Physical Movement: in virtual time, all checks on."""

from collections import Counter
from math import hypot
from statistics import median

import numpy as np
import pytest
from virtual_runs import Watcher

from swarmer.config import load_config
from swarmer.engines.result import Witness
from swarmer.engines.specs import fls_rows, fls_spec
from swarmer.engines.virtual import VirtualEngine
from swarmer.messages import CHALLENGE_ACCEPT, CHALLENGE_INIT, JOIN
from swarmer.observe.invariants import Checks
from swarmer.plan import make_plan
from swarmer.protocol.anchor_selection import STRATEGIES
from swarmer.protocol.events import Fly, Landed, Received
from swarmer.state_machine import State

BASE = {"engine": "virtual", "shape": "sphere", "points": 30, "duration_s": 8}


class Pairs(Witness):
    """Who of two ends anchored: for each ACCEPT that paired, the two sizes that were said, and the roles."""

    def __init__(self):
        self.machines = {}
        self.pairs = []
        self.kinds = Counter()
        self.flights = []  # (fid, cells)
        self.legs = Counter()  # per flight that a machine asked for
        self._before = {}

    def made(self, fls, now_s):
        self.machines[fls.fid] = fls.machine

    def handled(self, fls, event, actions, cause, now_s):
        m = fls.machine
        was = self._before.get(m.fid, (State.DEPLOYING, 1, m.swarm))
        for action in actions:
            if type(action) is Fly and m.state is State.BUSY_LOCALIZING:
                self.legs[len(action.legs)] += 1
        if type(event) is Received and event.message.kind == CHALLENGE_ACCEPT and was[0] is State.AVAILABLE:
            role = {State.BUSY_ANCHOR: True, State.BUSY_LOCALIZING: False}.get(m.state)
            if role is not None and not event.message.flags & JOIN:
                self.pairs.append((role, was[1], event.message.size, was[2], event.message.swarm))
        self._before[m.fid] = (m.state, m.size, m.swarm)

    def sent(self, fls, message, stamp, copies, now_s):
        self.kinds[message.kind] += 1

    def flew(self, fls, asked, flight, now_s):
        self.flights.append((fls.fid, hypot(*asked)))


def played(on_sample=lambda snapshot: False, **settings):
    plan = make_plan(load_config(None, (), **{**BASE, **settings}))
    pairs, checks, watcher = Pairs(), Checks(plan), Watcher(on_sample)
    with VirtualEngine(plan, [checks, pairs]) as engine:
        result = engine.run(watcher)
    assert result.status == "done", result.message
    return pairs, watcher, result


# -- who anchors -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("m", ["inf", 2])
@pytest.mark.parametrize("anchor", STRATEGIES)
def test_every_selection_makes_one_swarm_and_localizes(anchor, m):
    pairs, watcher, result = played(anchor=anchor, m=m)
    assert result.counters["thaws_at_one_swarm"] >= 2
    assert watcher.progress.hd < 0.1
    assert len(pairs.pairs) > 10


SAYS = {
    "lowest": lambda mine, theirs, me, other: me < other,
    "largest": lambda mine, theirs, me, other: (mine, other) > (theirs, me),
    "smallest": lambda mine, theirs, me, other: (mine, me) < (theirs, other),
    "challenger": lambda *_: True,
}


@pytest.mark.parametrize("anchor", SAYS)
def test_the_one_that_it_names_anchors(anchor):
    """By the sizes that the two said to each other, whoever is told: `true` here is the challenger's role."""
    pairs, _, _ = played(anchor=anchor)
    for role, mine, theirs, me, other in pairs.pairs:
        assert role is SAYS[anchor](mine, theirs, me, other)


def test_the_coin_falls_both_ways():
    roles = Counter(role for role, *_ in played(anchor="random")[0].pairs)
    assert min(roles.values()) > 0.25 * sum(roles.values())


@pytest.mark.parametrize("anchor", ["lowest", "largest", "smallest"])
def test_an_fls_knows_about_how_large_its_swarm_is(anchor):
    """From what the messages say alone: never exactly, for merges race, and good enough to choose by."""
    shares = []

    def look(snapshot):
        machines = [m for m in pairs_of[0].values() if m.awake]
        true = Counter(m.swarm for m in machines)
        shares.extend(m.size / true[m.swarm] for m in machines if true[m.swarm] > 1)
        return False

    pairs_of = [{}]
    plan = make_plan(load_config(None, (), **{**BASE, "points": 60, "anchor": anchor, "thaw.policy": "off"}))
    pairs = Pairs()
    pairs_of[0] = pairs.machines
    with VirtualEngine(plan, [pairs]) as engine:
        engine.run(Watcher(look))
    assert len(shares) > 1000
    assert 0.5 < median(shares) < 2
    assert sum(1 / 3 < share < 3 for share in shares) > 0.9 * len(shares)


def test_a_thaw_makes_the_size_1_again():
    pairs, _, _ = played(**{"thaw.policy": "centralized", "duration_s": 6, "anchor": "largest"})
    alone = [m for m in pairs.machines.values() if m.swarm.xi == m.fid and not m.merged]
    assert all(m.size < 30 for m in alone)
    first = [mine for _, mine, theirs, *_ in pairs.pairs if (mine, theirs) == (1, 1)]
    assert len(first) > 10, "pairs of two single FLSs come again after every thaw"


# -- when to challenge -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("policy", ["r_complete", "decay", "always"])
def test_every_challenge_policy_makes_one_swarm(policy):
    _, watcher, _ = played(challenge_policy=policy)
    assert watcher.progress.hd < 0.1


def test_a_formed_swarm_goes_on_challenging_only_where_the_policy_is_always():
    sent = {
        policy: played(**{"challenge_policy": policy, "thaw.policy": "off", "duration_s": 12})[0].kinds
        for policy in ("r_complete", "always")
    }
    ticks = 30 * 12 / 0.5
    assert sent["always"][CHALLENGE_INIT] > 0.6 * ticks
    assert sent["r_complete"][CHALLENGE_INIT] < 0.4 * ticks


# -- Physical Movement -------------------------------------------------------------------------------------------------


def test_physical_movement_flies_to_the_anchor_and_from_there_to_its_place():
    pairs, watcher, result = played(technique="physical_movement")
    _, straight, shorter = played()
    assert set(pairs.legs) == {2}
    assert result.counters["distance_cells"] > 2 * shorter.counters["distance_cells"]
    assert watcher.progress.hd > 10 * straight.progress.hd, "its error grows with what it flies"


def test_without_flight_error_both_ways_end_at_the_same_place():
    _, watcher, result = played(technique="physical_movement", epsilon_deg=0)
    assert watcher.progress.hd < 1e-9
    assert result.counters["localizations"] > 20


def test_two_legs_are_one_flight_to_the_machine():
    """FIN, and a machine that is Available, only after the second."""
    landed = Counter()

    class Landings(Witness):
        def handled(self, fls, event, actions, cause, now_s):
            landed[type(event) is Landed] += 1
            assert not (fls.machine.flying and fls.machine.available)

    plan = make_plan(load_config(None, (), **{**BASE, "technique": "physical_movement"}))
    pairs = Pairs()
    with VirtualEngine(plan, [pairs, Landings()]) as engine:
        engine.run(Watcher())
    assert len(pairs.flights) >= landed[True] + pairs.legs[2] - 30


# -- where and when they begin -----------------------------------------------------------------------------------------


def specs_of(**settings):
    plan = make_plan(load_config(None, (), **{**BASE, **settings}))
    return plan, [fls_spec(row) for row in fls_rows(plan)]


def test_random_placement_has_nothing_to_do_with_the_points():
    """A random cloud is drawn by the same seed: from one stream, everybody would begin where it belongs."""
    plan, specs = specs_of(shape="random", points=200, **{"deploy.start": "random"})
    points, starts = plan.cloud.points, np.array([spec.start for spec in specs])
    for axis in range(3):
        assert abs(np.corrcoef(points[:, axis], starts[:, axis])[0, 1]) < 0.2
    assert (starts >= points.min(axis=0)).all()
    assert (starts <= points.max(axis=0)).all()
    assert {spec.origin for spec in specs} == {(0.0, 0.0, 0.0)}


def test_who_is_placed_at_random_is_lit_at_once_and_its_replacement_flies_in():
    lit = []
    _, watcher, result = played(
        lambda snapshot: bool(lit.append(snapshot.lit.mean())),
        **{"deploy.start": "random", "failure.rate": 0.02, "duration_s": 12},
    )
    assert lit[0] == 1.0
    assert result.counters["replacements"] > 2
    assert min(lit) < 1.0, "a replacement is dark on its way"
    assert watcher.progress.hd < 1.0


@pytest.mark.parametrize("rate", [0.0, 10.0])
def test_dispatchers_launch_at_their_rate(rate):
    stations = ((0.0, 0.0, 0.0), (20.0, 0.0, 0.0))
    lit = {}
    played(
        lambda snapshot: bool(lit.update({snapshot.t_s: int(snapshot.lit.sum())})),
        **{"deploy.dispatchers": stations, "deploy.rate_per_s": rate, "thaw.policy": "off"},
    )
    assert lit[8.0] == 30
    early = lit[1.0]
    assert (early < 25) if rate else (early == 30)
