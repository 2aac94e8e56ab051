"""One state machine alone: put into any state by events, and its actions in words. FLS 5 is the one that is tested."""

from __future__ import annotations

import math
from random import Random

from swarmer.messages import ANCHORING, BUSY, JOIN, Kind, Message, Swarm, To
from swarmer.observe.protocol_words import KIND_NAMES
from swarmer.plugins.signal_strength import SignalStrength
from swarmer.protocol.anchor_selection import STRATEGIES
from swarmer.protocol.challenge_policy import RComplete
from swarmer.protocol.events import (
    Arm,
    Count,
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
from swarmer.protocol.events import Timer as Purpose
from swarmer.protocol.thaw import Timer
from swarmer.state_machine import Identity, MachineSettings, State, StateMachine

LAMBDA_S, LEASE_S, BOUND_S = 0.5, 0.25, 0.6
SHORT = {
    State.DEPLOYING: "D", State.AVAILABLE: "A", State.BUSY_ANCHOR: "BA", State.BUSY_LOCALIZING: "BL",
    State.WAITING: "W",
}  # fmt: skip
NAMES = {kind: KIND_NAMES[kind] for kind in Kind}
KINDS = {name: kind for kind, name in NAMES.items()}
MEMBERS = (8, 9)  # FLSs that are in the swarm of FLS 5; all others are swarms of their own
NEIGHBOURS = (3, 7, 8)


def settings(**changes) -> MachineSettings:
    base = MachineSettings(
        lambda_s=LAMBDA_S, lease_s=LEASE_S, lease_margin_s=0.0, m=math.inf, waiting_bound_s=BOUND_S,
        waiting_ends_at_tick=False, flight_threshold=0.001, range_start=10.0, range_step=5.0, range_max=100.0,
        challenge_on_available=False, accept_gap_s=0.0, neighbour_reply=True, busy_join="newcomer", epochs=True,
        thaw_repeat=0.0, anchors=STRATEGIES["lowest"], localizer=SignalStrength(),
    )  # fmt: skip
    return base._replace(**changes)


def machine(
    fid=5, incarnation=0, seed=1, kind=StateMachine, probe_every=8, thaws=None, **changes
) -> StateMachine:
    return kind(
        Identity(fid, incarnation, (0.0, 0.0, 0.0)), NEIGHBOURS, settings(**changes), RComplete(probe_every),
        Timer(10.0, 2.0) if thaws is None else thaws, Random(seed),
    )  # fmt: skip


class Lone:
    """FLS 5 and a clock. Everything is fed by the words of the tests."""

    def __init__(self, incarnation=0, **changes) -> None:
        self.m = machine(incarnation=incarnation, **changes)
        self.now = 0.0
        self.armed: dict[Purpose, float] = {}
        self.asked = 12345  # id of the last challenge it sent

    def lit(self) -> Lone:
        """Launched and landed."""
        self.feed(Launch((0.0, 0.0, -3.0)))
        self.feed(Landed())
        return self

    def feed(self, event) -> list:
        actions = self.m.handle(event, self.now)
        for action in actions:
            if isinstance(action, Arm):
                self.armed[action.timer] = action.at_s
            elif isinstance(action, Disarm):
                del self.armed[action.timer]
            elif isinstance(action, Send) and action.message.kind == Kind.CHALLENGE_INIT:
                self.asked = action.message.challenge
        return actions

    def hear(self, words: str) -> list:
        return self.feed(Received(self.message(words)))

    def message(self, words: str) -> Message:
        """'INIT 7', 'ACCEPT 3 joins', 'SET_WAITING 8 (a)', 'FOLLOW_MERGE 8 to 4', 'ACK 7 old', 'THAW 7 epoch 2',
        'COUNT 8 flew 4', 'THAW_ANNOUNCE 8 of 3', ...
        """
        name, sender, *more = words.split()
        kind, fid, m = KINDS[name], int(sender), self.m
        joins = "joins" in more
        own = fid in MEMBERS
        incarnation = int(joins or "newer" in more)
        swarm = m.swarm if own else Swarm(fid, incarnation)
        if "same" in more:  # it has taken the Swarm-ID of FLS 5 meanwhile
            swarm = m.swarm
        flags = (JOIN if joins else 0) | (ANCHORING if "(a)" in more else 0) | (BUSY if "busy" in more else 0)
        challenge = 10 * fid  # its own challenge
        if kind == Kind.CHALLENGE_ACCEPT:
            challenge = self.asked
        if "old" in more:
            challenge += 1
        to_swarm = name in ("SET_WAITING", "SET_AVAILABLE", "FOLLOW", "MERGE", "FOLLOW_MERGE")
        return Message(
            kind, fid, incarnation, _after(more, "epoch", m.epoch), swarm, _after(more, "size", 1),
            (10.0 * fid, 0.0, 0.0), To.SWARM if to_swarm else To.FLS,
            Swarm(77, 0) if "others" in more else m.swarm if to_swarm else Swarm(m.fid, 0), flags, challenge,
            other=Swarm(_after(more, "to", 0), 0) if to_swarm
            else Swarm(_after(more, "of", 0), 0) if "of" in more else m.swarm,
            vector=(float(_after(more, "flew", 0)), 0.0, 0.0) if kind == Kind.COUNT else (1.0, 2.0, 2.0),
        )  # fmt: skip

    def later(self, seconds: float) -> Lone:
        self.now += seconds
        return self

    def due(self, purpose: Purpose) -> list:
        """That timer is over, now or when it was armed for."""
        self.now = max(self.now, self.armed.pop(purpose))
        return self.feed(Due(purpose))

    @property
    def state(self) -> str:
        return SHORT[self.m.state] + (" flying" if self.m.flying else "")

    def count(self, which: Count) -> int:
        return self.m.counts[which]


def _after(words: list[str], word: str, default: int) -> int:
    return int(words[words.index(word) + 1]) if word in words else default


def given(words: str, **changes) -> Lone:
    """FLS 5 as the words say: a state, then what happened in it, with commas between."""
    state, *happened = (part.strip() for part in words.split(","))
    incarnation = 1 if "newcomer" in state else 0
    if "M 2" in happened:
        happened.remove("M 2")
        changes["m"] = 2
    lone = Lone(incarnation, **changes)
    state = state.removeprefix("newcomer ")
    if state != "D":
        lone.feed(Launch((0.0, 0.0, -3.0)))
    if state not in ("D", "D flying"):
        lone.feed(Landed())
    for step in BEGINNINGS[state] + tuple(happened):
        happen(lone, step)
    assert lone.state == state.replace("Wa", "W").replace("Wl", "W") or happened, (lone.state, state)
    return lone


BEGINNINGS = {
    "D": (), "D flying": (), "A": (),
    "BA": ("INIT 6", "ACK 6"),
    "BL": ("INIT 2", "ACK 2"),
    "BL flying": ("INIT 2", "ACK 2", "measured 1"),
    "Wa": ("SET_WAITING 8 (a)",),
    "Wl": ("SET_WAITING 8 (l)",),
    "W flying": ("FOLLOW 8",),
}  # fmt: skip


def happen(lone: Lone, step: str) -> list:
    """One step in words; what the machine answers."""
    word, *more = step.split()
    if word in KINDS:
        return lone.hear(step)
    if word == "later":
        lone.later(float(more[0]))
        return []
    if word == "measured":  # so that V is as long as the words say, along the first axis
        anchor = lone.m.anchor
        assert anchor is not None
        return lone.feed(Measured((anchor.truth[0] + float(more[0]), 0.0, 0.0)))
    if word == "landed":
        return lone.feed(Landed())
    purposes = {
        "tick": "CHALLENGE", "bound": "BOUND", "lease": "LEASE", "renew": "RENEW", "thaw": "THAW", "report": "REPORT",
    }  # fmt: skip
    return lone.due(Purpose[purposes[word]])


def in_words(actions) -> list[str]:
    """What others can notice of the actions: timers are left out."""
    return [words for action in actions if (words := _in_words(action))]


def _in_words(action) -> str:
    if isinstance(action, Send):
        m = action.message
        name = NAMES[Kind(m.kind)]
        if m.kind == Kind.SET_WAITING:
            name += "(a)" if m.flags & ANCHORING else "(l)"
        if m.kind in (Kind.MERGE, Kind.FOLLOW_MERGE):
            name += f"({m.other.xi})"
        to = {To.FLS: f"{m.addressee.xi}", To.SWARM: f"swarm {m.addressee.xi}", To.ALL: "all"}[To(m.to)]
        return f"{name} {to}"
    return {Fly: "fly", Measure: "measure", Depart: "depart"}.get(type(action), "")
