"""Rules of how a life begins, and of the challenge tick (rules 1 and 2)."""

from __future__ import annotations

from swarmer.messages import Swarm
from swarmer.protocol.events import CHALLENGE_TIMER, Landed, Launch
from swarmer.protocol.memory import Memory
from swarmer.protocol.records import W


def launch(me: Memory, event: Launch) -> None:
    """Off to the point, in the dark."""
    g, o = me.truth, event.origin
    me.arm_thaw()
    me.fly((g[0] - o[0], g[1] - o[1], g[2] - o[2]))


def light_up(me: Memory, event: Landed) -> None:
    """Landed: lit, a swarm of its own."""
    if me.flies_on(event.offset):
        return
    me.swarm, me.size = Swarm(me.fid, me.incarnation), 1
    me.become_available()
    me.start_timers()


def challenge_due(me: Memory, _: object) -> None:
    _rearm_tick(me)
    if me.policy.challenges(me.complete, me.rng):
        me.send_challenge()


def skip_tick(me: Memory, _: object) -> None:
    """A busy FLS does not challenge; in the authors' program the tick is what ends Waiting."""
    _rearm_tick(me)
    if me.state is W and not me.flying and me.settings.waiting_ends_at_tick:
        me.become_available()


def _rearm_tick(me: Memory) -> None:
    # From the tick's own time, not from now: a late process must not challenge less often.
    # uniform in [0.5, 1.5) λ
    me.tick_s = max(me.now, me.tick_s + me.settings.lambda_s * (0.5 + me.rng.random()))
    me.arm(CHALLENGE_TIMER, me.tick_s)
