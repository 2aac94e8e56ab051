"""The thaw policy `roster` (rule 11): whoever joins a swarm reports to its owner, and the owner asks for the last ones.

Under the rule `lowest` Swarm-IDs only fall in an epoch, and none is below the lowest: who has joined the swarm of the
lowest owner stays in it. So nobody needs to know whether its neighbours are there, and the last report comes one
datagram after the last merge. Reports get lost; the owner of at least half the display knows whom it misses, and asks.
Where half of the reports are lost no owner ever hears of half the display: so one that has heard of an eighth of it,
and of nobody for a while, asks, too.

Where Swarm-IDs can rise, a member may leave: then it tells the owner that it leaves, too. That can be lost, and who
fails tells nobody. Then a thaw comes too early; what the formation had still to correct is left to the next one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from swarmer.messages import ROLL_CALL, TO_FLS, Swarm
from swarmer.protocol.events import REPORT_TIMER, THAW_TIMER
from swarmer.protocol.reports import Roll, owns, report
from swarmer.protocol.thaw import FALLBACK, Timer

if TYPE_CHECKING:
    from swarmer.messages import Message
    from swarmer.protocol.memory import Memory

ASKS_EVERY = 0.25  # λ, between two rounds of questions
ASKS_LEAST, ASKS_SHARE = 32, 8  # FLSs asked in a round: so many, or one in so many of all, if more
ASKS_FROM, QUIET = 8, 1.0  # who has one in so many of all asks after so many λ without a report, and so often


class Roster(Timer):
    """Reports on joining; thaws when all F have reported, unless the formation corrected nothing worth another one."""

    __slots__ = (
        "_before",
        "_began_s",
        "_count",
        "_early",
        "_falls",
        "_gone",
        "_heard_s",
        "_inherits",
        "_patient",
        "_rest",
        "_roll",
        "_soon",
    )

    def __init__(
        self,
        count: int,
        h_s: float,
        spread: float,
        rest_below: float,
        falls: bool,
        gone: tuple[int, ...] = (),
    ) -> None:
        """count: F. rest_below: cells. falls: Swarm-IDs only fall, but for newcomers'. gone: FIDs that are
        none of these F.
        """
        super().__init__(FALLBACK * h_s, spread)
        self._count, self._rest, self._falls = count, rest_below, falls
        self._gone = gone
        self._soon = Timer(h_s, spread)
        self._roll = Roll()
        self._began_s = self._heard_s = 0.0
        self._before = math.inf  # the longest vector of the last formation that this FLS saw whole
        self._early = self._inherits = False
        self._patient = False  # it waits for a quiet time, not for the next round

    def begins(self, me: Memory) -> None:
        self._began_s, self._early, self._inherits, self._patient = me.now, False, False, False
        self._roll.begin(me.swarm)
        self._roll.note(me)

    def joined(self, me: Memory, left: Swarm) -> None:
        self._roll.begin(me.swarm)
        self._inherits = owns(me)
        if self._early:
            self._early = False
            me.arm_thaw()
        if self._inherits:
            self._roll.note(me)
            me.arm(REPORT_TIMER, me.now + ASKS_EVERY * me.settings.lambda_s)
            return
        me.disarm(REPORT_TIMER)
        report(me, me.swarm.xi)
        if left.xi not in (me.fid, me.swarm.xi) and (left < me.swarm or not self._falls):
            report(me, left.xi)

    def counted(self, me: Memory, message: Message) -> bool:
        if not owns(me):
            return False
        roll = self._roll
        roll.hear(message)
        self._heard_s = me.now
        if not self._most():
            if self._some() and not me.is_armed(REPORT_TIMER):
                self._patient = True
                me.arm(REPORT_TIMER, me.now + QUIET * me.settings.lambda_s)
            return False
        self._hurry(me)
        if len(roll) < self._count:
            if self._patient or not me.is_armed(REPORT_TIMER):
                self._patient = False
                me.arm(REPORT_TIMER, me.now + ASKS_EVERY * me.settings.lambda_s)
            return False
        return not self._rests(max(roll.longest, me.longest))

    def report_due(self, me: Memory) -> bool:
        """Ask some of those who are missing."""
        if not owns(me) or len(self._roll) >= self._count:
            return False
        every, sure = ASKS_EVERY, self._most() or self._inherits
        if not sure:
            every, quiet_s = QUIET, self._heard_s + QUIET * me.settings.lambda_s
            if not self._some():
                return False
            if me.now < quiet_s:
                me.arm(REPORT_TIMER, quiet_s)
                return False
        last, gone = self._count + len(self._gone), frozenset(self._gone)
        missing = [fid for fid in range(1, last + 1) if fid not in self._roll and fid not in gone]
        most = max(ASKS_LEAST, self._count // ASKS_SHARE)
        for fid in missing if len(missing) <= most else me.rng.sample(missing, most):
            me.say(ROLL_CALL, TO_FLS, Swarm(fid, 0))
        me.arm(REPORT_TIMER, me.now + every * me.settings.lambda_s)
        return False

    def called(self, me: Memory, message: Message) -> None:
        if message.swarm == me.swarm and message.sender == me.swarm.xi:
            report(me, message.sender)

    def _most(self) -> bool:
        return 2 * len(self._roll) >= self._count

    def _some(self) -> bool:
        return ASKS_FROM * len(self._roll) >= self._count

    def _rests(self, longest: float) -> bool:
        """Is another formation not worth it? longest: vector that anybody flew in this one."""
        before, self._before = self._before, longest
        return longest < self._rest and not 0.0 < longest < before / 2

    def _hurry(self, me: Memory) -> None:
        """The owner of half the display has the clock of `timer`: for a rest, and for who is gone for good."""
        if not self._early:
            self._early = True
            delay_s = self._soon.delay_s(me.rng) or 0.0
            me.arm(THAW_TIMER, max(me.now, self._began_s + delay_s))
