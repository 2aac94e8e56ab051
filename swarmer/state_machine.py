"""The SwarMer state machine: event + now -> actions (SwarMer, section 4; the house's rules are in docs/protocol.md).

Two rules hold here. The machine performs nothing: it returns actions, and the engine reports back with events. And it
knows no other time or chance than the `now` and the `rng` it is handed, so the same code runs as a real process and in
virtual time.

TABLE is the protocol: for each state, which event it has a rule for and which states that rule may lead to. What is not
listed is ignored and counted, for a late datagram is normal; an event that only our own engine can send raises instead.
Three things come before the table, in `receive`: epochs (rule 12), beliefs (rule 9), and flights, during which swarm
messages wait for the landing and pairings are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from swarmer.messages import (
    CHALLENGE_ACCEPT,
    CHALLENGE_ACK,
    LEASE_CANCEL,
    NEIGHBOUR,
    SWARM_KINDS,
    Kind,
    Message,
)
from swarmer.protocol.anchoring import cancel_lease, finished_first, free, lease_over, renewed
from swarmer.protocol.challenging import challenge_due, launch, light_up, skip_tick
from swarmer.protocol.events import (
    HANDLED,
    IGNORED,
    KEYS,
    Action,
    BatteryLow,
    Due,
    Event,
    Landed,
    Launch,
    Local,
    Measured,
    NewShape,
    Received,
)
from swarmer.protocol.following import (
    bound_over,
    follow,
    follow_merge,
    follower_landed,
    merge,
    note_size,
    resume,
    wait,
)
from swarmer.protocol.localizing import cancelled, finish, localize, renew_lease
from swarmer.protocol.memory import Memory
from swarmer.protocol.pairing import (
    accept,
    answer_neighbour,
    forget_accept,
    refuse,
    take_acceptance,
    take_ack,
    take_more,
)
from swarmer.protocol.records import BA, BL, A, D, Identity, MachineSettings, ProtocolBug, State, W
from swarmer.protocol.thawing import (
    change_shape,
    hear_abort,
    hear_announcement,
    hear_count,
    hear_leave,
    hear_roll_call,
    hear_thaw,
    leave,
    meet_epoch,
    rearm_thaw,
    report_due,
    thaw_due,
)

__all__ = ["TABLE", "Identity", "MachineSettings", "ProtocolBug", "Rule", "State", "StateMachine"]

PENDING_MAX = 64  # swarm messages that may wait for a landing; more are dropped and counted as ignored


class Rule(NamedTuple):
    """What a state does with an event, and every state that may follow."""

    act: Callable[[Memory, Any], None]
    leads_to: tuple[State, ...]


def _rule(act: Callable[..., None], *leads_to: State) -> Rule:
    return Rule(act, leads_to)


TABLE: Mapping[State, Mapping[Kind | Local, Rule]] = {
    D: {
        Local.LAUNCH: _rule(launch, D),
        Local.LANDED: _rule(light_up, D, A),
        Local.THAW_DUE: _rule(rearm_thaw, D),
        Local.BATTERY_LOW: _rule(leave, D),
        Local.NEW_SHAPE: _rule(change_shape, D),
    },
    A: {
        Kind.CHALLENGE_INIT: _rule(accept, A),
        Kind.CHALLENGE_ACCEPT: _rule(take_acceptance, A, BA, BL),
        Kind.CHALLENGE_ACK: _rule(take_ack, A, BA, BL),
        Kind.CHALLENGE_FIN: _rule(finished_first, A),
        Kind.SET_WAITING: _rule(wait, W),
        Kind.SET_AVAILABLE: _rule(note_size, A),
        Kind.FOLLOW: _rule(follow, W, A),
        Kind.MERGE: _rule(merge, A),
        Kind.FOLLOW_MERGE: _rule(follow_merge, W, A),
        Kind.LEASE_RENEW: _rule(refuse, A),
        Kind.LEASE_CANCEL: _rule(forget_accept, A),
        Kind.THAW: _rule(hear_thaw, A),
        Kind.LEAVE: _rule(hear_leave, A),
        Kind.COUNT: _rule(hear_count, A),
        Kind.ROLL_CALL: _rule(hear_roll_call, A),
        Kind.THAW_ANNOUNCE: _rule(hear_announcement, A),
        Kind.THAW_ABORT: _rule(hear_abort, A),
        Local.CHALLENGE_DUE: _rule(challenge_due, A),
        Local.THAW_DUE: _rule(thaw_due, A),
        Local.REPORT_DUE: _rule(report_due, A),
        Local.BATTERY_LOW: _rule(leave, A),
        Local.NEW_SHAPE: _rule(change_shape, A, W),
    },
    BA: {
        Kind.CHALLENGE_INIT: _rule(accept, BA),
        Kind.CHALLENGE_ACCEPT: _rule(take_more, BA),
        Kind.CHALLENGE_ACK: _rule(take_ack, BA),
        Kind.CHALLENGE_FIN: _rule(free, BA, A),
        Kind.MERGE: _rule(merge, BA),
        Kind.LEASE_RENEW: _rule(renewed, BA),
        Kind.LEASE_CANCEL: _rule(cancel_lease, BA, A),
        Kind.THAW: _rule(hear_thaw, BA, A),
        Kind.LEAVE: _rule(hear_leave, BA),
        Kind.COUNT: _rule(hear_count, BA, A),
        Kind.ROLL_CALL: _rule(hear_roll_call, BA),
        Kind.THAW_ANNOUNCE: _rule(hear_announcement, BA, A),
        Kind.THAW_ABORT: _rule(hear_abort, BA),
        Local.CHALLENGE_DUE: _rule(skip_tick, BA),
        Local.LEASE_OVER: _rule(lease_over, BA, A),
        Local.THAW_DUE: _rule(thaw_due, A),
        Local.REPORT_DUE: _rule(report_due, BA, A),
        Local.BATTERY_LOW: _rule(leave, BA),
        Local.NEW_SHAPE: _rule(change_shape, BA, A, W),
    },
    BL: {
        Kind.CHALLENGE_INIT: _rule(answer_neighbour, BL),
        Kind.CHALLENGE_ACCEPT: _rule(refuse, BL),
        Kind.CHALLENGE_ACK: _rule(refuse, BL),
        Kind.LEASE_RENEW: _rule(refuse, BL),
        Kind.LEASE_CANCEL: _rule(cancelled, BL, A),
        Kind.THAW: _rule(hear_thaw, BL, A, W),
        Kind.LEAVE: _rule(hear_leave, BL),
        Kind.COUNT: _rule(hear_count, BL, A, W),
        Kind.ROLL_CALL: _rule(hear_roll_call, BL),
        Kind.THAW_ANNOUNCE: _rule(hear_announcement, BL, A, W),
        Kind.THAW_ABORT: _rule(hear_abort, BL),
        Local.MEASURED: _rule(localize, BL, A),
        Local.LANDED: _rule(finish, A),
        Local.RENEW_DUE: _rule(renew_lease, BL),
        Local.CHALLENGE_DUE: _rule(skip_tick, BL),
        Local.THAW_DUE: _rule(thaw_due, A, W),
        Local.REPORT_DUE: _rule(report_due, BL, A, W),
        Local.BATTERY_LOW: _rule(leave, BL),
        Local.NEW_SHAPE: _rule(change_shape, BL, A, W),
    },
    W: {
        Kind.CHALLENGE_INIT: _rule(accept, W),
        Kind.CHALLENGE_ACCEPT: _rule(refuse, W),
        Kind.CHALLENGE_ACK: _rule(take_ack, W, BA),
        Kind.CHALLENGE_FIN: _rule(finished_first, W),
        Kind.SET_WAITING: _rule(wait, W),
        Kind.SET_AVAILABLE: _rule(resume, W, A),
        Kind.FOLLOW: _rule(follow, W, A),
        Kind.MERGE: _rule(merge, A),
        Kind.FOLLOW_MERGE: _rule(follow_merge, W, A),
        Kind.LEASE_RENEW: _rule(refuse, W),
        Kind.THAW: _rule(hear_thaw, W, A),
        Kind.LEAVE: _rule(hear_leave, W),
        Kind.COUNT: _rule(hear_count, W, A),
        Kind.ROLL_CALL: _rule(hear_roll_call, W),
        Kind.THAW_ANNOUNCE: _rule(hear_announcement, W, A),
        Kind.THAW_ABORT: _rule(hear_abort, W),
        Local.CHALLENGE_DUE: _rule(skip_tick, W, A),
        Local.BOUND_OVER: _rule(bound_over, A),
        Local.LANDED: _rule(follower_landed, W, A),
        Local.THAW_DUE: _rule(thaw_due, W, A),
        Local.REPORT_DUE: _rule(report_due, W, A),
        Local.BATTERY_LOW: _rule(leave, W),
        Local.NEW_SHAPE: _rule(change_shape, A, W),
    },
}


# The table as the machine looks it up: by plain numbers, because hashing an enum is a call.
_BY_NUMBER = [{int(event): rule for event, rule in TABLE[state].items()} for state in State]
_RULES = [[rules.get(number) for number in range(KEYS)] for rules in _BY_NUMBER]
_TIMERS = int(Local.CHALLENGE_DUE)
_NOT_IN_FLIGHT = SWARM_KINDS | {Kind.CHALLENGE_INIT, Kind.CHALLENGE_ACCEPT, Kind.CHALLENGE_ACK}
_LAUNCH, _LANDED, _MEASURED, _BATTERY_LOW, _NEW_SHAPE = map(
    int, (Local.LAUNCH, Local.LANDED, Local.MEASURED, Local.BATTERY_LOW, Local.NEW_SHAPE)
)


class StateMachine(Memory):
    """One FLS. `handle` is the only way in, and `receive` for datagrams; everything else is for reading."""

    def handle(self, event: Event, now: float) -> list[Action]:
        """Take one event at emulated second `now`; what the engine must do, in this order.

        Raises ProtocolBug for an event that the present state cannot get from a right engine.
        """
        if type(event) is Received:
            return self.receive(event.message, now, event.noted)
        self.now = now
        actions: list[Action] = []
        self.actions = actions
        if self.departed:
            return actions
        if type(event) is Due:
            timer = event.timer
            self._armed &= ~(1 << timer)
            self._apply(_TIMERS + timer, None)
        elif type(event) is Landed:
            self._land(event)
        elif type(event) is Measured:
            if self.state is BL and not self.flying:
                self._apply(_MEASURED, event)
        elif type(event) is Launch:
            self._apply(_LAUNCH, event)
        elif type(event) is BatteryLow:
            self.leaving = True
            if not self.flying:
                self._apply(_BATTERY_LOW, None)
        elif type(event) is NewShape:
            self._apply(_NEW_SHAPE, None)
        return actions

    def receive(self, message: Message, now: float, noted: bool = False) -> list[Action]:
        """`handle` the event Received, which nobody need make for it: most events are datagrams."""
        self.now = now
        actions: list[Action] = []
        self.actions = actions
        if self.departed or message.sender == self.fid:
            return actions
        if message.epoch != self.epoch and self.settings.epochs and not meet_epoch(self, message):
            return actions
        self.beliefs.note(message)
        kind = message.kind
        if noted or kind == NEIGHBOUR:
            self.counts[HANDLED] += 1
        elif self.flying and kind in _NOT_IN_FLIGHT:
            self._receive_in_flight(message)
        elif kind in SWARM_KINDS and message.addressee != self.swarm:
            self.counts[IGNORED] += 1
        else:
            self._apply(kind, message)
        return actions

    def _receive_in_flight(self, message: Message) -> None:
        if message.kind in SWARM_KINDS and self.awake and len(self.pending) < PENDING_MAX:
            self.pending.append(message)
            return
        self.counts[IGNORED] += 1
        if message.kind in (CHALLENGE_ACCEPT, CHALLENGE_ACK) and self.awake:
            self.tell(message, LEASE_CANCEL)

    def _land(self, event: Landed) -> None:
        self.flying = False
        self._apply(_LANDED, event)
        pending, self.pending = self.pending, []
        for message in pending:
            if self.flying:  # one of them asked for a flight: the rest waits for its landing
                self.pending.append(message)
            elif message.addressee == self.swarm:
                self._apply(message.kind, message)
            else:
                self.counts[IGNORED] += 1
        if self.leaving and not self.flying:
            self._apply(_BATTERY_LOW, None)

    def _apply(self, key: int, body: object) -> None:
        state = self.state
        rule = _RULES[state][key]
        if rule is None:
            if key >= _TIMERS:
                raise ProtocolBug(f"FLS {self.fid}: {Local(key).name} in {state.name}")
            self.counts[IGNORED] += 1
            return
        if key < _TIMERS:
            self.counts[HANDLED] += 1
        act, leads_to = rule
        act(self, body)
        if self.state not in leads_to:
            raise ProtocolBug(f"FLS {self.fid}: {key} in {state.name} led to {self.state.name}")
