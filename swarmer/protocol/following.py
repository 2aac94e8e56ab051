"""Rules of a member: it waits, follows and resumes as its swarm tells it (rules 6 and 7)."""

from __future__ import annotations

from swarmer.messages import ANCHORING, Message
from swarmer.protocol.events import BOUND_TIMER, Landed
from swarmer.protocol.memory import Memory
from swarmer.protocol.records import W


def wait(me: Memory, message: Message) -> None:
    """SET_WAITING: stand still until the sender, or the bound, says otherwise."""
    me.state = W
    me.close_challenge()
    me.holders[message.sender] = bool(message.flags & ANCHORING)
    me.arm(BOUND_TIMER, me.now + me.settings.waiting_bound_s)


def resume(me: Memory, message: Message) -> None:
    """SET_AVAILABLE: the sender no longer holds this FLS."""
    me.size = message.size
    me.holders.pop(message.sender, None)
    if not me.holders:
        me.become_available()


def note_size(me: Memory, message: Message) -> None:
    """SET_AVAILABLE at one who waits no more: it tells the swarm's new size (rule 4)."""
    me.size = message.size


def follow(me: Memory, message: Message) -> None:
    """Fly V; an oracle knows better (rule 14)."""
    me.close_challenge()
    if me.oracle:
        if me.state is W:
            me.become_available()
        return
    me.state = W
    me.fly(message.vector)


def merge(me: Memory, message: Message) -> None:
    """MERGE: another swarm from now on, without a flight; an anchor keeps its leases."""
    old = me.swarm
    me.take_swarm(message.other, message.size, message.flags)
    if me.state is W:
        me.become_available()
    me.thaw_policy.joined(me, old)


def follow_merge(me: Memory, message: Message) -> None:
    old = me.swarm
    me.take_swarm(message.other, message.size, message.flags)
    follow(me, message)
    me.thaw_policy.joined(me, old)


def follower_landed(me: Memory, event: Landed) -> None:
    if not me.flies_on(event.offset):
        me.become_available()


def bound_over(me: Memory, _: object) -> None:
    """The swarm has gone silent: a lost datagram delays, but never stops anyone (rule 7)."""
    me.become_available()
