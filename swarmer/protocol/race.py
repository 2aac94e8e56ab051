"""What the network thread answers at once, without waiting for the handler (rules 8 and 9).

One pure function of a message and the state that the handler last published, used by every engine. It decides what
is certain; what it lets through the handler judges again by the state of its own moment.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from swarmer.messages import (
    CHALLENGE_ACK,
    CHALLENGE_INIT,
    LARGEST,
    LEASE_CANCEL,
    NEIGHBOUR,
    NO_SWARM,
    TO_FLS,
    ZERO,
    Kind,
    Message,
    Swarm,
    Vec3,
)

_new = tuple.__new__  # a named tuple's own costs twice the time, and these are made all the time


class Published(Protocol):
    """The part of an FLS's state that its network thread may read."""

    @property
    def awake(self) -> bool:
        """Lit and on the air; False while Deploying."""

    @property
    def epoch(self) -> int: ...

    @property
    def flying(self) -> bool: ...

    @property
    def available(self) -> bool: ...

    @property
    def anchoring(self) -> bool:
        """It anchors (BA), or waits because its swarm does (Wa)."""

    @property
    def swarm(self) -> Swarm: ...

    @property
    def size(self) -> int: ...


class Verdict(NamedTuple):
    """What the network thread does with a datagram."""

    reply: int | None  # answered at once
    queue: bool  # goes on to the handler
    note: bool  # the handler only notes the sender's Swarm-ID
    word: str  # for it


QUEUE = Verdict(None, True, False, "queued")
DROP = Verdict(None, False, False, "dropped")
NOTE = Verdict(None, False, True, "noted")
NOTE_AND_ANSWER = Verdict(NEIGHBOUR, False, True, "answered")
CANCEL = Verdict(LEASE_CANCEL, False, False, "answered")

JUDGED = frozenset(
    (CHALLENGE_INIT, CHALLENGE_ACK)
)  # the only kinds of which `judge` may say anything but QUEUE


# In which order the handler takes up what is queued. Lower goes first: control and thaw, then what a whole swarm waits
# for, then the rest.
_FIRST = {Kind.THAW, Kind.THAW_ANNOUNCE, Kind.THAW_ABORT}
_SECOND = {
    Kind.SET_WAITING, Kind.SET_AVAILABLE, Kind.FOLLOW, Kind.MERGE, Kind.FOLLOW_MERGE, Kind.CHALLENGE_FIN, Kind.COUNT,
    Kind.ROLL_CALL,
}  # fmt: skip
PRIORITY = tuple(0 if n in _FIRST else 1 if n in _SECOND else 2 for n in range(max(Kind) + 1))


def judge(message: Message, state: Published, neighbours: frozenset[int], neighbour_reply: bool) -> Verdict:
    """Answer, drop or queue `message`, which the radio found to be addressed to this FLS."""
    kind = message.kind
    if message.epoch != state.epoch:
        return QUEUE  # one of the two has missed a thaw, and only the handler may obey it
    if kind == CHALLENGE_INIT:
        if not state.awake or state.flying:
            return DROP
        if message.swarm != state.swarm:
            return QUEUE if state.available or state.anchoring else NOTE
        answers = neighbour_reply and message.sender in neighbours
        return NOTE_AND_ANSWER if answers else NOTE
    if kind == CHALLENGE_ACK and state.awake and not can_pair(message, state):
        return CANCEL
    return QUEUE


def can_pair(message: Message, state: Published) -> bool:
    """Rule 3 asked again with the present state. Whose Swarm-ID wins and M are left to the handler's judgement."""
    if state.flying or message.other != state.swarm:
        return False
    return state.available or state.anchoring


def answer(message: Message, kind: int, state: Published, fid: int, incarnation: int, truth: Vec3) -> Message:
    """The reply that `judge` asked for, from this FLS to the sender of `message`."""
    return _new(
        Message,
        (kind, fid, incarnation, state.epoch, state.swarm, state.size, truth, TO_FLS, _new(Swarm, (message.sender, 0)),
         0, message.challenge, LARGEST, NO_SWARM, ZERO),
    )  # fmt: skip
