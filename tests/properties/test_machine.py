"""One machine and whatever a right engine may feed it: any message, timer, landing or measurement, in any state.

The messages are any that `decode` can give: from neighbours, strangers, predecessors and liars.
"""

import math

from hypothesis import settings as effort
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from lone import NEIGHBOURS, machine

from swarmer.messages import (
    ALL_FLAGS,
    CHALLENGE_ACCEPT,
    CHALLENGE_ACK,
    LARGEST,
    LEASE_CANCEL,
    SWARM_KINDS,
    Kind,
    Message,
    Stamp,
    Swarm,
    To,
    decode,
    encode,
)
from swarmer.protocol.events import (
    Arm,
    BatteryLow,
    Depart,
    Disarm,
    Due,
    Fly,
    Landed,
    Launch,
    Measure,
    Measured,
    Received,
    Send,
)
from swarmer.state_machine import State

D, A, BA, BL, W = State
RULES = st.sampled_from(
    [
        {},
        {"m": 2},
        {"busy_join": "all"},
        {"busy_join": "off", "neighbour_reply": False},
        {"epochs": False, "thaw_repeat": 0.5},
        {"waiting_ends_at_tick": True, "waiting_bound_s": 1e9},
        {"challenge_on_available": True, "accept_gap_s": 0.02},
    ]
)
OTHERS = [2, 3, 4, 7, 8, 9]
COORDINATE = st.sampled_from([0.0, 1.0, -3.5, 40.0, LARGEST / 10])
VECTOR = st.tuples(COORDINATE, COORDINATE, COORDINATE)


class Life(RuleBasedStateMachine):
    """FLS 5 from its launch on."""

    @initialize(changes=RULES, incarnation=st.sampled_from([0, 0, 1]), seed=st.integers(0, 9))
    def begin(self, changes, incarnation, seed):
        self.m = machine(incarnation=incarnation, seed=seed, **changes)
        self.now = 0.0
        self.armed: dict = {}
        self.flying = self.measuring = self.gone = self.launched = False
        self.number = 0

    def feed(self, event):
        m = self.m
        epoch, swarm = m.epoch, m.swarm
        actions = m.handle(event, self.now)
        assert not (self.gone and actions), "the departed do nothing"
        for action in actions:
            self.perform(action)
        assert m.epoch >= epoch
        if m.state is D:
            assert not any(type(action) is Send for action in actions), "the dark are silent"
            assert m.swarm == swarm
        return actions

    def perform(self, action):
        if isinstance(action, Arm):
            assert action.at_s >= self.now - 1e-9 or action.timer == 2, action
            self.armed[action.timer] = action.at_s
        elif isinstance(action, Disarm):
            assert action.timer in self.armed, "disarms what is not armed"
            del self.armed[action.timer]
        elif isinstance(action, Fly):
            assert not self.flying, "two flights at once"
            assert all(map(math.isfinite, action.vector))
            self.flying = True
        elif isinstance(action, Measure):
            self.measuring = True
        elif isinstance(action, Depart):
            self.gone = True
        elif isinstance(action, Send):
            self.said(action.message)

    def said(self, message):
        m = self.m
        assert (message.sender, message.incarnation, message.epoch) == (m.fid, m.incarnation, m.epoch)
        assert message.to != To.SWARM or message.kind in SWARM_KINDS
        self.number += 1
        stamp = Stamp(1, self.number, (0.0, 0.0, 0.0), self.now)
        assert decode(encode(message, stamp))[0] == message, "whatever it says fits a datagram"

    # -- what may happen -----------------------------------------------------------------------------------------

    @rule(seconds=st.sampled_from([0.0, 0.01, 0.1, 0.3, 1.0]))
    def wait(self, seconds):
        self.now += seconds

    @precondition(lambda self: not self.launched)
    @rule()
    def launch(self):
        self.launched = True
        self.feed(Launch((0.0, 0.0, -3.0)))

    @precondition(lambda self: self.flying)
    @rule()
    def land(self):
        self.flying = False
        self.feed(Landed())

    @precondition(lambda self: self.measuring)
    @rule(vector=VECTOR)
    def measure(self, vector):
        self.measuring = False
        self.feed(Measured(vector))

    def ringing(self):
        """The timers that a run can live to see: no run lasts as long as `waiting_bound_s` where it means never."""
        return sorted(timer for timer, at_s in self.armed.items() if at_s < LARGEST / 10)

    @precondition(lambda self: self.ringing())
    @rule(data=st.data())
    def timer(self, data):
        which = data.draw(st.sampled_from(self.ringing()))
        self.now = max(self.now, self.armed.pop(which))
        self.feed(Due(which))

    @precondition(lambda self: self.launched and not self.gone)
    @rule(chance=st.integers(0, 19))
    def battery(self, chance):
        if not chance:
            self.feed(BatteryLow())

    @precondition(lambda self: self.launched)
    @rule(data=st.data())
    def anything(self, data):
        """Any message at all."""
        kind = data.draw(st.sampled_from([kind for kind in Kind if kind != Kind.CONTROL]))
        self.take(
            data, kind, data.draw(st.sampled_from([*OTHERS, 0, 5] if kind == Kind.THAW else [*OTHERS, 5]))
        )

    @precondition(lambda self: self.launched and self.m.awake)
    @rule(data=st.data())
    def what_fits(self, data):
        """The next step of what is going on."""
        m = self.m
        kinds = [Kind.CHALLENGE_INIT, *SWARM_KINDS]
        if m.challenge:
            kinds += [Kind.CHALLENGE_ACCEPT] * 4
        if m.accepts:
            kinds += [Kind.CHALLENGE_ACK] * 8
        if m.state is BL:  # what crosses: refused
            kinds += [Kind.CHALLENGE_ACCEPT, Kind.LEASE_CANCEL] * 4
        if m.leases:
            kinds += [Kind.CHALLENGE_FIN, Kind.LEASE_RENEW, Kind.LEASE_CANCEL]
        kind = data.draw(st.sampled_from(kinds))
        senders = sorted(m.accepts) if kind == Kind.CHALLENGE_ACK else sorted(m.leases.ends()) or OTHERS
        self.take(data, kind, data.draw(st.sampled_from(senders)), fits=True)

    def take(self, data, kind, sender, fits=False):
        m = self.m
        said = m.accepts.get(sender)
        challenge = said.challenge if said and kind == CHALLENGE_ACK else m.challenge or 1
        own = kind in SWARM_KINDS
        if not fits:
            challenge = data.draw(st.sampled_from([challenge, challenge, 77]))
        swarms = st.sampled_from([Swarm(sender or 1, 0), m.swarm, Swarm(1, 0), Swarm(9, 1)])
        epoch = m.epoch + (0 if fits else data.draw(st.sampled_from([0, 0, 0, 0, 1, -1])))
        message = Message(
            int(kind), sender, data.draw(st.sampled_from([0, 0, 1])), max(0, epoch),
            m.swarm if own and fits else data.draw(swarms), data.draw(st.sampled_from([1, 7, 0, 0xFFFFFFFF])),
            data.draw(VECTOR), int(To.SWARM if own else To.FLS), m.swarm if own else Swarm(5, 0),
            data.draw(st.integers(0, ALL_FLAGS)), challenge, 30.0,
            m.swarm if fits and not own else data.draw(swarms), data.draw(VECTOR),
        )  # fmt: skip
        judged = message.epoch == m.epoch or not m.settings.epochs
        asks = (
            judged and m.awake and not self.gone and kind in (CHALLENGE_ACCEPT, CHALLENGE_ACK) and sender != 5
        )
        noted = not fits and data.draw(st.integers(0, 9)) == 0
        actions = self.feed(Received(message, noted))
        if asks and not noted:
            self.one_outcome(message, actions)

    def one_outcome(self, message, actions):
        """Paired, or cancelled; never both, never silence (S8)."""
        m = self.m
        answers = [a.message.kind for a in actions if type(a) is Send and a.message.to == To.FLS]
        paired = m.anchor is message or (message.sender in m.leases and LEASE_CANCEL not in answers)
        assert answers == ([CHALLENGE_ACK] * (message.kind == CHALLENGE_ACCEPT) if paired else [LEASE_CANCEL])

    # -- what always holds ---------------------------------------------------------------------------------------

    @invariant()
    def busy_anchor_means_a_lease(self):
        if hasattr(self, "m") and not self.gone:
            m = self.m
            assert (m.state is BA) == (len(m.leases) > 0)
            assert len(m.leases) == len(m.leases.ends())

    @invariant()
    def the_machine_knows_what_it_waits_for(self):
        if hasattr(self, "m") and not self.gone:
            m = self.m
            assert m.flying == self.flying
            assert {timer for timer in range(8) if m._armed >> timer & 1} == set(map(int, self.armed))
            if m.awake:
                assert 0 in self.armed, "the challenge timer always runs"
            if m.state is BA:
                assert 2 in self.armed, "a lease runs out"
            if m.state is BL and not m.flying:
                assert self.measuring
            if m.state is W and not m.flying:
                assert 1 in self.armed, "Waiting ends"
            assert not (m.flying and m.state in (A, BA))

    @invariant()
    def tables_hold_only_who_is_there(self):
        if hasattr(self, "m"):
            m = self.m
            assert {*m.leases.ends(), *m.holders, *m.accepts} <= {*OTHERS}
            assert all(m.beliefs.of(fid) is None for fid in OTHERS if fid not in NEIGHBOURS)
            assert m.size >= 0
            assert m.settings.range_start <= m.reach <= m.settings.range_max


TestLife = Life.TestCase
TestLife.settings = effort(max_examples=250, stateful_step_count=50)
