"""Rules of finding a partner: who accepts, and which acceptance pairs (rules 3, 4 and 10)."""

from __future__ import annotations

from swarmer.messages import BUSY, CHALLENGE_ACCEPT, CHALLENGE_ACK, LEASE_CANCEL, NEIGHBOUR, Message
from swarmer.protocol.anchoring import anchors, become_anchor, may_anchor
from swarmer.protocol.localizing import become_localizer
from swarmer.protocol.memory import Memory
from swarmer.protocol.records import A, Accept


def accept(me: Memory, message: Message) -> None:
    """INIT: an Available FLS of another swarm always accepts; an anchoring one if rule 3 allows it."""
    if message.swarm == me.swarm:
        answer_neighbour(me, message)
        return
    flags = me.own_flags()
    if me.state is not A:
        flags |= BUSY
        if not (me.anchoring and may_anchor(me, message, False, me.size, flags)):
            return
    if me.now - me.last_accept_s < me.settings.accept_gap_s:
        return
    me.last_accept_s = me.now
    me.accepts[message.sender] = Accept(message.challenge, me.size, flags, me.now + me.settings.lease_s)
    me.tell(message, CHALLENGE_ACCEPT, flags)


def answer_neighbour(me: Memory, message: Message) -> None:
    """INIT of the own swarm: a planned neighbour may learn that this FLS is in it, too (rule 9)."""
    if message.swarm == me.swarm and me.settings.neighbour_reply and message.sender in me.beliefs.neighbours:
        me.tell(message, NEIGHBOUR)


def take_acceptance(me: Memory, message: Message) -> None:
    """ACCEPT at a challenger that is still Available: the first one pairs."""
    if not me.challenge_open or message.challenge != me.challenge or message.swarm == me.swarm:
        me.tell(message, LEASE_CANCEL)
        return
    me.challenge_open, me.challenge_taken = False, True
    me.tell(message, CHALLENGE_ACK, me.own_flags(), other=message.swarm)
    if anchors(me, message, True, me.size, me.own_flags()):
        become_anchor(me, message)
    else:
        become_localizer(me, message)


def take_more(me: Memory, message: Message) -> None:
    """ACCEPT at a challenger that became anchor: later ones pair too while M allows.

    One from its own localizer is the late answer to a challenge that crossed that FLS's: they are paired already, and
    the CANCEL is of this challenge, not of that pairing.
    """
    same = 0 != me.challenge == message.challenge and message.swarm != me.swarm
    if same and message.sender not in me.leases and may_anchor(me, message, True, me.size, me.own_flags()):
        me.challenge_open, me.challenge_taken = False, True
        me.tell(message, CHALLENGE_ACK, me.own_flags(), other=message.swarm)
        become_anchor(me, message)
    else:
        me.tell(message, LEASE_CANCEL)


def take_ack(me: Memory, message: Message) -> None:
    """ACK: the acceptance still stands if it is remembered and the Swarm-ID it named is still ours."""
    said = me.accepts.pop(message.sender, None)
    if (
        said is None
        or said.challenge != message.challenge
        or said.until_s < me.now
        or not (message.other == me.swarm != message.swarm)
    ):
        me.tell(message, LEASE_CANCEL)
    elif me.state is A:
        if anchors(me, message, False, said.size, said.flags):
            become_anchor(me, message)
        else:
            become_localizer(me, message)
    elif me.anchoring and may_anchor(me, message, False, said.size, said.flags):
        become_anchor(me, message)
    else:
        me.tell(message, LEASE_CANCEL)


def refuse(me: Memory, message: Message) -> None:
    me.tell(message, LEASE_CANCEL)


def forget_accept(me: Memory, message: Message) -> None:
    """CANCEL: the challenger has somebody else. A cancel of another challenge says nothing about this one."""
    said = me.accepts.get(message.sender)
    if said is not None and said.challenge == message.challenge:
        del me.accepts[message.sender]
