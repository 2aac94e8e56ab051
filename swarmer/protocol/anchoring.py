"""Rules of an anchor: who becomes one, and that it stands still while it owes anybody a lease (rules 4, 5, 7, 10)."""

from __future__ import annotations

from swarmer.messages import (
    ABSOLUTE,
    ANCHORING,
    BUSY,
    JOIN,
    LEASE_CANCEL,
    SET_AVAILABLE,
    SET_WAITING,
    Message,
)
from swarmer.protocol.anchor_selection import Party
from swarmer.protocol.events import (
    ANCHORINGS,
    BOUND_TIMER,
    JOINS,
    LEASE_TIMER,
    LEASES_EXPIRED,
    LEASES_GRANTED,
)
from swarmer.protocol.memory import Memory, sum_of_sizes
from swarmer.protocol.records import BA


def anchors(me: Memory, message: Message, challenged: bool, size: int, flags: int) -> bool:
    """Does this FLS anchor the sender? The two ends ask this of the same two datagrams, so exactly one says yes.

    challenged, size, flags: this FLS's own part. An acceptor judges itself by what its ACCEPT said, for that is what
    the challenger has decided by.
    """
    theirs = message.flags
    if (theirs ^ flags) & ABSOLUTE:  # rule 14, whatever the Swarm-IDs
        return bool(flags & ABSOLUTE)
    if (theirs ^ flags) & JOIN:
        return bool(theirs & JOIN)
    if theirs & JOIN:
        return me.swarm < message.swarm
    if (theirs | flags) & BUSY and me.settings.busy_join == "all":
        return bool(flags & BUSY)
    mine = Party(me.swarm, size, challenged)
    other = Party(message.swarm, message.size, not challenged)
    return me.settings.anchors(mine, other, message.challenge)


def may_anchor(me: Memory, message: Message, challenged: bool, size: int, flags: int) -> bool:
    """OK of the table: this FLS would be the anchor of the sender, and M allows one more; a newcomer joins M aside."""
    if message.flags & ~flags & JOIN:
        return True
    if len(me.leases) >= me.settings.m - 1 and message.sender not in me.leases:
        return False
    return anchors(me, message, challenged, size, flags)


def become_anchor(me: Memory, message: Message) -> None:
    """PAIR, the anchor's end; for an anchor, one more localizer."""
    if me.state is not BA:
        me.counts[ANCHORINGS] += 1
        me.disarm(BOUND_TIMER)
        me.holders.clear()
        me.state = BA
        me.tell_swarm(SET_WAITING, flags=ANCHORING)
    if message.flags & JOIN:
        me.counts[JOINS] += 1
    grant(me, message)


def grant(me: Memory, message: Message) -> None:
    """A lease for the sender from now on."""
    if message.sender not in me.leases:
        me.counts[LEASES_GRANTED] += 1
    me.leases.grant(message.sender, message.challenge, me.now)
    _arm_lease(me)


def free(me: Memory, message: Message) -> None:
    """FIN: that lease is over; after the last one the anchor and its swarm are free (rule 7)."""
    if me.leases.release(message.sender):
        _has_merged(me, message)
        _after_lease(me)
    else:
        finished_first(me, message)


def finished_first(me: Memory, message: Message) -> None:
    """FIN before the ACK of its pairing: the localizer needed no flight, and its FIN is the more urgent (rule 7).

    The pairing is over before its lease would begin. The accept is forgotten, so that the ACK grants none to somebody
    who will neither renew nor end it.
    """
    said = me.accepts.get(message.sender)
    if said is not None and said.challenge == message.challenge:
        del me.accepts[message.sender]
        if message.swarm == me.swarm:
            _has_merged(me, message)


def _has_merged(me: Memory, message: Message) -> None:
    me.size = sum_of_sizes(me.size, message.size)
    me.merged = True
    me.policy.merged()


def cancel_lease(me: Memory, message: Message) -> None:
    """CANCEL: as FIN, but nobody has merged."""
    if me.leases.cancel(message.sender, message.challenge):
        _after_lease(me)


def lease_over(me: Memory, _: object) -> None:
    me.counts[LEASES_EXPIRED] += len(me.leases.expire(me.now))
    _after_lease(me)


def renewed(me: Memory, message: Message) -> None:
    """LEASE_RENEW: granted anew if it ran out, unless this FLS could not anchor the sender now."""
    if message.sender in me.leases or may_anchor(me, message, False, me.size, me.own_flags() | BUSY):
        grant(me, message)
    else:
        me.tell(message, LEASE_CANCEL)


def _after_lease(me: Memory) -> None:
    if me.leases:
        _arm_lease(me)
    else:
        me.become_available()
        me.tell_swarm(SET_AVAILABLE)


def _arm_lease(me: Memory) -> None:
    expiry = me.leases.next_expiry()
    if expiry is not None:
        me.arm(LEASE_TIMER, expiry)
