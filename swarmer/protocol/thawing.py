"""Rules of beginning anew and of leaving: thaws, epochs, batteries, the next shape (rules 11, 12, 13 and 15)."""

from __future__ import annotations

from swarmer.messages import (
    LEAVE,
    SET_AVAILABLE,
    THAW,
    THAW_ABORT,
    THAW_ANNOUNCE,
    TO_ALL,
    TO_FLS,
    Message,
    Swarm,
)
from swarmer.protocol.beliefs import Beliefs
from swarmer.protocol.events import (
    BOUND_TIMER,
    LEASE_TIMER,
    RENEW_TIMER,
    REPORT_TIMER,
    STALE,
    THAWS_OBEYED,
    THAWS_STARTED,
    Depart,
    ThawBegins,
    Timer,
)
from swarmer.protocol.memory import UINT32_MAX, Memory
from swarmer.protocol.records import BA, BL, A, D, W


def obey_thaw(me: Memory, epoch: int, tell: bool = False) -> None:
    """Start again from here: ξ = FID, nothing owed, nothing believed (rule 11). tell: others, too."""
    me.epoch = epoch
    me.reminded.clear()
    me.beliefs.clear()  # a dark FLS has heard some, too
    if me.state is D:
        return
    me.counts[THAWS_OBEYED] += 1
    me.thawed_s = me.now
    me.swarm, me.size, me.absolute = Swarm(me.fid, me.incarnation), 1, me.oracle
    me.reach, me.challenge_taken = me.settings.range_start, True
    me.close_challenge()
    me.anchor = None
    for table in (me.leases, me.holders, me.accepts, me.pending):
        table.clear()
    me.policy.thawed()
    me.disarm(BOUND_TIMER, LEASE_TIMER, RENEW_TIMER, REPORT_TIMER)
    # A flight that has begun goes on; a Waiting FLS that lands is Available and tells nobody.
    me.state = W if me.flying else A
    if tell:  # with the new Swarm-ID: whoever is in this epoch already must not believe the old one
        me.say(THAW, TO_ALL)
    me.start_timers()
    if me.state is A:
        me.enter_available()


def meet_epoch(me: Memory, message: Message) -> bool:
    """Rule 12: a newer epoch is obeyed first, an older one is told. Handle the message then?"""
    if message.epoch > me.epoch:
        if me.then is not None and message.epoch >= me.then.epoch:
            _become_next(me, message.epoch)
        else:
            obey_thaw(me, message.epoch)
        return message.kind != THAW and not me.departed
    me.counts[STALE] += 1
    if message.kind in (THAW_ANNOUNCE, THAW_ABORT):
        return False  # late copies of what has begun this epoch: all would answer their senders at once
    due = me.reminded.get(message.sender, -1e9) + me.settings.lambda_s
    if me.awake and message.sender and due <= me.now:
        me.reminded[message.sender] = me.now
        me.tell(message, THAW)
    return False


def change_shape(me: Memory, _: object) -> None:
    """Rule 15: from now on this FLS belongs to the next shape. It flies to its point there, or has none and leaves.

    It begins a new epoch, above all those of the old shape: whatever is still said in one of them is out of date, and
    whoever is late with this learns it from the first datagram of the new shape. It stays lit on the way.
    """
    if me.then is not None:  # else it has learned it from a datagram already
        _become_next(me, me.then.epoch)


def _become_next(me: Memory, epoch: int) -> None:
    """`epoch`: a later one than the shape's first if the datagram that tells of the shape is of a later one."""
    then, me.then = me.then, None
    assert then is not None
    me.thaw_policy = then.thaw_policy
    if then.truth is None:
        obey_thaw(me, epoch)
        me.leaving = True
        if not me.flying:
            leave(me, None)
        return
    g, h = me.truth, then.truth
    way = (h[0] - g[0], h[1] - g[1], h[2] - g[2])
    me.truth, me.beliefs = h, Beliefs(then.neighbours)
    me.settings = me.settings._replace(range_start=then.range_start)
    me.reach = then.range_start
    if me.flying:
        me.onward = way
    elif me.state is not D:  # else it has not been launched yet, and will fly there at once
        me.fly(way)
    obey_thaw(me, epoch)


def begin_thaw(me: Memory, known: bool, tell: bool = True) -> None:
    """Begin the next epoch for everybody. known: because the policy says that there is one swarm."""
    me.counts[THAWS_STARTED] += 1
    me.actions.append(ThawBegins(me.swarm, me.epoch, known))
    obey_thaw(me, min(me.epoch + 1, UINT32_MAX) if me.settings.epochs else me.epoch, tell)


def thaw_due(me: Memory, _: object) -> None:
    """This FLS's own timer."""
    begin_thaw(me, known=False)


def report_due(me: Memory, _: object) -> None:
    if me.thaw_policy.report_due(me):
        begin_thaw(me, True, me.thaw_policy.tells)


def hear_count(me: Memory, message: Message) -> None:
    """COUNT: for the policies in which the owner of a swarm keeps a list of who is in it."""
    if me.thaw_policy.counted(me, message):
        begin_thaw(me, True, me.thaw_policy.tells)


def hear_roll_call(me: Memory, message: Message) -> None:
    """ROLL_CALL: the owner misses this FLS on its list."""
    me.thaw_policy.called(me, message)


def hear_announcement(me: Memory, message: Message) -> None:
    """THAW_ANNOUNCE: a corner takes its swarm for the only one."""
    if me.thaw_policy.announced(me, message):
        begin_thaw(me, True, me.thaw_policy.tells)


def hear_abort(me: Memory, message: Message) -> None:
    """THAW_ABORT: somebody knows better."""
    me.thaw_policy.aborted(me, message)


def rearm_thaw(me: Memory, _: object) -> None:
    me.arm_thaw()


def hear_thaw(me: Memory, message: Message) -> None:
    """Without epochs a thaw is obeyed at most once per λ, and repeated by chance (the paper)."""
    if me.settings.epochs or me.now - me.thawed_s < me.settings.lambda_s:
        return
    obey_thaw(me, me.epoch, tell=me.rng.random() < me.settings.thaw_repeat)


def hear_leave(me: Memory, message: Message) -> None:
    me.beliefs.forget(message.sender)


def leave(me: Memory, _: object) -> None:
    """Battery low, and on the ground: say so, free those who wait, go (rule 13)."""
    if me.state is not D:  # nobody has heard of it yet
        for neighbour in sorted(me.beliefs.neighbours):
            me.say(LEAVE, TO_FLS, Swarm(neighbour, 0))
    if me.state in (BA, BL):
        me.tell_swarm(SET_AVAILABLE)
    me.disarm(*Timer)
    me.actions.append(Depart())
    me.departed = True
