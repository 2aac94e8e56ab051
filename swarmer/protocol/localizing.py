"""Rules of a localizer: measure, tell the old swarm, fly, and let the anchor go (rule 5)."""

from __future__ import annotations

from swarmer.messages import (
    ABSOLUTE,
    CHALLENGE_FIN,
    FOLLOW_MERGE,
    LEASE_RENEW,
    MERGE,
    SET_AVAILABLE,
    SET_WAITING,
    TO_FLS,
    TO_SWARM,
    Message,
    Swarm,
)
from swarmer.protocol.events import LOCALIZATIONS, RENEW_TIMER, Measure, Measured
from swarmer.protocol.memory import Memory, sum_of_sizes
from swarmer.protocol.records import BL


def become_localizer(me: Memory, message: Message) -> None:
    """PAIR, the localizer's end."""
    me.close_challenge()
    me.anchor = message
    me.state = BL
    me.tell_swarm(SET_WAITING)
    me.arm(RENEW_TIMER, me.now + me.settings.lease_s / 2)
    me.actions.append(Measure(message))


def localize(me: Memory, event: Measured) -> None:
    """The sensor has answered: take the anchor's swarm and tell the old one (rule 5)."""
    anchor = me.anchor
    assert anchor is not None
    g, a = me.truth, anchor.truth
    localizer, wanted = me.settings.localizer, (a[0] - g[0], a[1] - g[1], a[2] - g[2])
    vector = localizer.displacement(event.vector, wanted)
    me.counts[LOCALIZATIONS] += 1
    old, me.brought = me.swarm, me.size
    stays = me.absolute  # both swarms stand where they should (rule 14)
    me.take_swarm(anchor.swarm, sum_of_sizes(me.size, anchor.size), anchor.flags)
    flags = anchor.flags & ABSOLUTE
    length2 = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
    if length2 >= me.settings.flight_threshold**2 and not stays:
        me.say(FOLLOW_MERGE, TO_SWARM, old, flags, other=me.swarm, vector=vector)
        by_legs = getattr(localizer, "legs", None)  # only the localizer itself goes that way
        me.fly(vector, () if by_legs is None else by_legs(event.vector, wanted))
    else:
        me.say(MERGE, TO_SWARM, old, flags, other=me.swarm)
        finish(me, None)
    me.thaw_policy.joined(me, old)


def finish(me: Memory, _: object) -> None:
    """Landed where the localization led: the anchor may go."""
    anchor = me.anchor
    assert anchor is not None
    me.say(CHALLENGE_FIN, TO_FLS, Swarm(anchor.sender, 0), challenge=anchor.challenge, size=me.brought)
    me.become_available()


def renew_lease(me: Memory, _: object) -> None:
    assert me.anchor is not None
    me.tell(me.anchor, LEASE_RENEW)
    me.arm(RENEW_TIMER, me.now + me.settings.lease_s / 2)


def cancelled(me: Memory, message: Message) -> None:
    """CANCEL at a localizer: of this very pairing and on the ground it gives up; flying it finishes."""
    anchor = me.anchor
    assert anchor is not None
    if (message.sender, message.challenge) == (anchor.sender, anchor.challenge) and not me.flying:
        me.become_available()
        me.tell_swarm(SET_AVAILABLE)
