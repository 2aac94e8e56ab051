"""Random walks: any event in any state, from seeds. What one machine alone must keep, and no dead line in the table."""

import math
from random import Random

import pytest
from lone import KINDS, NEIGHBOURS, settings

from swarmer.messages import ABSOLUTE, ALL_FLAGS, JOIN, SWARM_KINDS, Kind, Message, Swarm, To
from swarmer.protocol.anchor_selection import STRATEGIES
from swarmer.protocol.census import Census
from swarmer.protocol.challenge_policy import Decay, RComplete
from swarmer.protocol.corner import Corner
from swarmer.protocol.events import (
    Arm,
    BatteryLow,
    Count,
    Depart,
    Disarm,
    Due,
    Fly,
    Landed,
    Launch,
    Local,
    Measure,
    Measured,
    NewShape,
    Received,
    Send,
    Timer,
)  # fmt: skip
from swarmer.protocol.records import SHAPE_EPOCHS, NextPoint
from swarmer.protocol.roster import Roster
from swarmer.protocol.thaw import Timer as ThawTimer
from swarmer.state_machine import TABLE, Identity, State, StateMachine

D, A, BA, BL, W = State
WALKS, STEPS = 600, 150
RULES = {
    "default": {},
    "two": {"m": 2, "flight_threshold": 1.0},
    "all join": {"busy_join": "all", "anchors": STRATEGIES["largest"]},
    "challenger": {"anchors": STRATEGIES["challenger"], "busy_join": "off", "neighbour_reply": False},
    "random": {"anchors": STRATEGIES["random"], "lease_margin_s": 0.1},
    "authors": {
        "m": 2, "waiting_ends_at_tick": True, "waiting_bound_s": 1e9, "challenge_on_available": True,
        "accept_gap_s": 0.02, "busy_join": "off", "epochs": False, "thaw_repeat": 0.5, "neighbour_reply": False,
    },
}  # fmt: skip


class Watched(StateMachine):
    """Notes every step through the table."""

    steps: set

    def _apply(self, key, body):
        before = self.state
        super()._apply(key, body)
        if key in KNOWN and KNOWN[key] in TABLE[before]:
            self.steps.add((before, KNOWN[key], self.state))


KNOWN = {int(event): event for event in (*Kind, *Local)}


OFTEN = [kind for kind in Kind if kind not in (Kind.CONTROL, Kind.THAW, Kind.LEAVE)] * 4 + [
    Kind.THAW,
    Kind.LEAVE,
]


def thaws(seed: int, rules: dict):
    """A thaw policy; those with reports in a display so small that a walk may come across its thaws."""
    if not rules.get("epochs", True):
        return ThawTimer(0.5, 8.0)
    few = 1 + seed // 4 % 3
    return (
        ThawTimer(0.5, 8.0),
        Roster(1 + few, 0.5, 8.0, 0.5 * few, falls=few > 1),
        Census(few, 0.5, 8.0),
        Corner(few, 0.5, 8.0, corner=True),
    )[seed % 4]


class Walk:
    """One life: draws events that a right engine may feed, and checks after each."""

    def __init__(self, seed: int, rules: dict, steps: set) -> None:
        self.rng = Random(f"walk {seed}")
        incarnation = self.rng.choice([0, 0, 1])
        self.agreeing = 0.8 if seed % 4 > 1 else 0.1
        self.landings = self.rng.choice([0.05, 0.4])  # long flights, short flights
        policy = Decay(1.25) if seed % 3 == 0 else RComplete(8)
        self.m = Watched(
            Identity(5, incarnation, (1.0, 1.0, 1.0)), NEIGHBOURS, settings(**rules), policy,
            thaws(seed, rules), Random(seed), then=self.next_point(seed, rules),
            oracle=seed % 8 == 4,
        )  # fmt: skip
        self.flags = ABSOLUTE if seed % 4 else ALL_FLAGS + 1  # to some, absolute swarms speak
        self.m.steps, self.changes = steps, self.m.then is not None
        self.now = 0.0
        self.timers: dict[Timer, float] = {}
        self.launched = self.measuring = self.done = False
        self.ids: list[int] = []
        self.reach: dict[int, float] = {}
        self.trace: list = []

    def next_point(self, seed: int, rules: dict) -> NextPoint | None:
        """Of a third of the walks with epochs; one in two has no point in the next shape, and leaves."""
        if seed % 3 or not rules.get("epochs", True):
            return None
        truth = None if self.rng.random() < 0.5 else (5.0, 1.0, 1.0)
        return NextPoint(SHAPE_EPOCHS, truth, (2, 7), 12.0, thaws(seed, rules))

    def step(self) -> None:
        event = self.draw()
        m = self.m
        before = (m.state, m.epoch, m.flying, m.swarm, len(m.leases), m.counts[Count.THAWS_OBEYED])
        ready = m.complete
        actions = m.handle(event, self.now)
        self.trace.append((event, actions))
        self.take(event, actions)
        if not self.done:
            self.check(event, actions, before, ready)

    def draw(self):
        rng, m = self.rng, self.m
        self.now += rng.choice([0.0, 0.001, 0.01, 0.05, 0.2])
        overdue = [timer for timer, at in sorted(self.timers.items()) if at <= self.now]
        if overdue and rng.random() < 0.7:
            return Due(rng.choice(overdue))
        if not self.launched and m.state is D and rng.random() < 0.4:
            self.launched = True
            return Launch((0.0, 0.0, 0.0))
        if m.flying and rng.random() < self.landings:
            return Landed((0.5, 0.0, 0.0)) if m.oracle and rng.random() < 0.3 else Landed()
        if self.measuring and rng.random() < 0.15:
            self.measuring = False
            far = rng.choice([0.0, 0.5, 3.0])
            anchor = m.anchor
            origin = (0.0, 0.0, 0.0) if anchor is None else anchor.truth
            return Measured((origin[0] - 1.0 + far, origin[1] - 1.0, origin[2] - 1.0))
        if rng.random() < (0.02 if m.state is D else 0.004):
            return BatteryLow()
        often = 0.0 if not self.changes else 0.06 if m.then and m.state in (W, BL) else 0.01
        if often and rng.random() < often:  # also once it has learned it from a datagram
            return NewShape()
        return Received(self.message(), noted=rng.random() < 0.05)

    def message(self) -> Message:
        """Mostly what fits: the challenge that is open, the accept that is remembered, the swarm that is addressed."""
        rng, m = self.rng, self.m
        kind = rng.choice(OFTEN)
        if m.state is A and rng.random() < 0.6:
            kind = (
                Kind.CHALLENGE_ACK
                if m.accepts
                else Kind.CHALLENGE_ACCEPT
                if m.challenge_open
                else Kind.CHALLENGE_INIT
            )
        sender = rng.choice([1, 2, 3, 4, 6, 7, 8, 9, 5])
        if kind == Kind.CHALLENGE_ACK and m.accepts and rng.random() < 0.8:
            sender = rng.choice(sorted(m.accepts))
        if kind in (Kind.CHALLENGE_FIN, Kind.LEASE_RENEW, Kind.LEASE_CANCEL) and rng.random() < 0.7:
            sender = rng.choice([fid for fid in range(1, 10) if fid in m.leases] or [sender])
        if kind == Kind.LEASE_CANCEL and m.anchor and rng.random() < 0.7:
            sender = m.anchor.sender
        said = m.accepts.get(sender)
        challenge = rng.randrange(1, 50)
        if kind == Kind.CHALLENGE_ACCEPT:
            challenge = m.challenge
        elif kind == Kind.CHALLENGE_ACK and said:
            challenge = said.challenge
        elif kind == Kind.LEASE_CANCEL and m.anchor and rng.random() < 0.8:
            challenge = m.anchor.challenge
        elif kind == Kind.LEASE_CANCEL and sender in m.leases:
            challenge = min(m.leases._challenges[sender])
        swarm = rng.choice([Swarm(sender, rng.choice([0, 0, 0, 1])), Swarm(sender, 0), m.swarm])
        if sender in NEIGHBOURS and rng.random() < self.agreeing:
            swarm = m.swarm  # so that the FLS is R-Complete now and then
        elif m.incarnation and rng.random() < 0.1:
            swarm = Swarm(5, 0)  # its predecessor's, which it may inherit
        epoch = m.epoch + (
            rng.choice([-1, 1]) if m.settings.epochs and m.epoch and rng.random() < 0.02 else 0
        )
        if m.then is not None and rng.random() < 0.01:
            epoch = m.then.epoch + rng.choice([0, 1])
        addressee = Swarm(5, 0) if kind not in SWARM_KINDS else rng.choice([m.swarm, m.swarm, m.swarm, swarm])
        return Message(
            kind, sender, swarm.incarnation, epoch, swarm, rng.randrange(1, 9), (float(sender), 0.0, 0.0),
            To.SWARM if kind in SWARM_KINDS else To.FLS, addressee, rng.randrange(self.flags), challenge,
            rng.uniform(0, 50), rng.choice([m.swarm, Swarm(rng.randrange(1, 10), 0)]), (1.0, 0.0, 0.0),
        )  # fmt: skip

    def take(self, event, actions) -> None:
        """What an engine does with the actions, and that it can."""
        if isinstance(event, Due):
            del self.timers[event.timer]
        flights = 0
        for action in actions:
            if isinstance(action, Arm):
                # A lease may be over already, if its timer is late.
                assert action.at_s >= self.now or action.timer is Timer.LEASE, "armed in the past"
                self.timers[action.timer] = action.at_s
            elif isinstance(action, Disarm):
                del self.timers[action.timer]  # KeyError: disarmed what was not armed
            elif isinstance(action, Fly):
                flights += 1
            elif isinstance(action, Measure):
                self.measuring = True
            elif isinstance(action, Depart):
                self.done = True
                assert action is actions[-1]
        assert flights <= 1

    def check(self, event, actions, before, was_complete) -> None:
        m = self.m
        was, epoch, flew, swarm, leases, thaws = before
        sent = [action.message for action in actions if isinstance(action, Send)]
        # S1: Deploying is dark.
        assert not (m.state is D and sent)
        assert (m.state is D) <= (swarm == Swarm(5, m.incarnation) == m.swarm)
        if was is D and m.state is not D:
            assert isinstance(event, Landed)
            assert (m.state, m.swarm) == (A, Swarm(5, m.incarnation))
        # S2: challenges.
        for init in [message for message in sent if message.kind == Kind.CHALLENGE_INIT]:
            assert m.state is A or isinstance(event, Landed)  # what waited for the landing came after it
            assert init.challenge not in self.ids, "an id comes again"
            self.ids.append(init.challenge)
            thaw = m.counts[Count.THAWS_OBEYED]
            assert m.settings.range_start <= init.range <= m.settings.range_max
            assert init.range >= self.reach.get(thaw, 0.0), "the range shrinks within an epoch"
            self.reach[thaw] = init.range
            if (
                isinstance(m.policy, RComplete)
                and was_complete
                and was is A
                and not m.settings.challenge_on_available
            ):
                assert m.policy._idle_ticks % 8 == 0, "R-Complete, and no probe"
        # S3, S7: leases and who holds them; one timer per purpose, armed exactly when it is of use.
        assert (m.state is BA) == (len(m.leases) > 0)
        assert (Timer.LEASE in self.timers) == (m.state is BA)
        assert (Timer.RENEW in self.timers) == (m.state is BL)
        assert (Timer.BOUND in self.timers) == (m.state is W and not m.flying)
        assert (m.state is W and not m.flying) == bool(m.holders)
        assert (m.anchor is not None) == (m.state is BL)
        assert m.state is not BA or not m.flying
        assert m.state is not A or not m.flying
        assert Timer.CHALLENGE in self.timers or m.state is D
        if len(m.leases) > leases and leases >= m.settings.m - 1:
            assert event.message.flags & JOIN, "M is exceeded, and nobody joined"
        if was is BA and m.state is not BA and m.counts[Count.THAWS_OBEYED] == thaws:
            assert any(message.kind == Kind.SET_AVAILABLE for message in sent)
        # S4, S8: every ACK and every ACCEPT has one outcome.
        if isinstance(event, Received) and not event.noted and m.counts[Count.THAWS_OBEYED] == thaws:
            self.check_outcome(event.message, sent, before)
        # S5, S6: a flight begins on the ground, and lasts until it lands.
        assert not (flew and not m.flying and not isinstance(event, Landed))
        assert not (
            any(isinstance(action, Fly) for action in actions) and flew and not isinstance(event, Landed)
        )
        if m.settings.epochs:
            assert m.epoch >= epoch
        # S11: after a thaw nothing is left.
        more = isinstance(event, Received) and event.message.kind != Kind.THAW  # a message of the new epoch
        if m.counts[Count.THAWS_OBEYED] > thaws and not more:
            assert m.swarm == Swarm(5, m.incarnation)
            assert not any((m.leases, m.holders, m.accepts, m.pending))
            assert m.reach == m.settings.range_start
        # S16: what is said is finite, and about oneself.
        for message in sent:
            last_words = message.kind == Kind.THAW_ANNOUNCE  # its own copy may be the one that makes it thaw
            assert message.epoch == m.epoch or (last_words and message.epoch == epoch)
            assert (message.sender, message.incarnation) == (5, m.incarnation)
            assert all(map(math.isfinite, (*message.vector, message.range)))
            assert 1 <= message.size < 2**32
            assert message.to != To.FLS or message.addressee.xi not in (0, 5)

    def check_outcome(self, message, sent, before) -> None:
        m = self.m
        was, epoch, _, _, leases, _ = before
        if was is D or message.epoch != epoch or message.sender == 5:
            return
        to_sender = [
            sent_.kind for sent_ in sent if sent_.to == To.FLS and sent_.addressee.xi == message.sender
        ]
        if message.kind == Kind.CHALLENGE_ACK:
            paired = message.sender in m.leases if m.state is BA else (m.state is BL and m.anchor is message)
            cancelled = to_sender == [Kind.LEASE_CANCEL]
            assert cancelled or (paired and not to_sender)
            assert len(m.leases) <= leases + 1
        elif message.kind == Kind.CHALLENGE_ACCEPT:
            assert to_sender in ([Kind.CHALLENGE_ACK], [Kind.LEASE_CANCEL])
            if to_sender == [Kind.CHALLENGE_ACK]:
                assert message.sender in m.leases or m.anchor is message
        elif message.kind == Kind.CHALLENGE_INIT and message.swarm == before[3]:
            assert Kind.CHALLENGE_ACCEPT not in to_sender, "accepts its own swarm"
        elif message.kind == Kind.CHALLENGE_INIT:
            assert to_sender in ([], [Kind.CHALLENGE_ACCEPT])
            assert not to_sender or was in (A, BA, W)


def walk(seed, rules, steps):
    life = Walk(seed, rules, steps)
    for _ in range(STEPS):
        if life.done:
            break
        life.step()
    return life


@pytest.mark.parametrize("rules", RULES.values(), ids=RULES)
@pytest.mark.parametrize("seed", range(1000, 1010))
def test_walk(rules, seed):
    walk(seed, rules, set())


def test_every_step_of_the_table_is_taken_and_no_other():
    rows = [(state, event, rule) for state in State for event, rule in TABLE[state].items()]
    listed = {(state, event, after) for state, event, rule in rows for after in rule.leads_to}
    observed: set = set()
    for seed in range(WALKS):
        for rules in RULES.values():
            walk(seed, rules, observed)
        if observed >= listed:
            break
    words = [
        f"{before.name}: {event.name} -> {after.name}" for before, event, after in sorted(observed ^ listed)
    ]
    assert observed == listed, words


def test_the_same_seed_is_the_same_life():
    assert walk(7, RULES["default"], set()).trace == walk(7, RULES["default"], set()).trace
    assert walk(7, RULES["default"], set()).trace != walk(8, RULES["default"], set()).trace


def test_all_messages_take_part():
    assert set(KINDS.values()) == set(Kind)
