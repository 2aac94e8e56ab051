"""The thaw policy `corner` (rule 11): who is farthest from the centre announces a thaw, and any other swarm objects."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmer.messages import THAW_ABORT, THAW_ANNOUNCE, TO_ALL, Swarm
from swarmer.protocol.events import REPORT_TIMER
from swarmer.protocol.thaw import FALLBACK, Timer

if TYPE_CHECKING:
    from swarmer.messages import Message
    from swarmer.protocol.memory import Memory

CORNERS, CORNERS_2D = 8, 4
COPIES = 3  # of announcements that an FLS needs, its own among them; all of F, if F is less
WITHIN_S = 2.0
SPEAKERS = 10  # expected number of FLSs that repeat an announcement, and of a swarm that object
PAUSE_S = (1.0, 2.0)  # from R-Complete to an announcement, and to the next
LOOKS_EVERY = 0.5  # λ, a corner that is not R-Complete


class Corner(Timer):
    """The paper's second idea (section 3). Nobody says THAW: the copies of the announcement are the thaw."""

    __slots__ = ("_copies", "_corner", "_needed", "_share", "_waits")
    tells = False

    def __init__(self, count: int, h_s: float, spread: float, corner: bool) -> None:
        """count: F. corner: this FLS is one."""
        super().__init__(FALLBACK * h_s, spread)
        self._corner, self._needed, self._share = corner, min(COPIES, count), SPEAKERS / count
        self._copies: list[float] = []  # when an announcement of the own swarm came, or went out
        self._waits = False  # R-Complete, and about to announce

    def begins(self, me: Memory) -> None:
        self._copies.clear()
        self._waits = False
        if self._corner:
            me.arm(REPORT_TIMER, me.now + LOOKS_EVERY * me.settings.lambda_s)

    def joined(self, me: Memory, left: Swarm) -> None:
        self._copies.clear()

    def report_due(self, me: Memory) -> bool:
        announces = me.complete and self._waits
        self._waits = me.complete
        if self._waits:
            self._pause(me)
        else:
            me.arm(REPORT_TIMER, me.now + LOOKS_EVERY * me.settings.lambda_s)
        return announces and self._speak(me, Swarm(me.fid, me.incarnation))

    def announced(self, me: Memory, message: Message) -> bool:
        if message.swarm != me.swarm:
            if me.rng.random() * me.size < SPEAKERS:
                me.say(THAW_ABORT, TO_ALL, other=message.swarm)
            return False
        if self._copy(me):
            return True
        first_hand = message.sender == message.other.xi  # a copy of a copy would never end
        return first_hand and me.rng.random() < self._share and self._speak(me, message.other)

    def aborted(self, me: Memory, message: Message) -> None:
        if message.other == me.swarm:
            self._copies.clear()
            if self._waits:
                self._pause(me)

    def _pause(self, me: Memory) -> None:
        me.arm(REPORT_TIMER, me.now + me.rng.uniform(*PAUSE_S))

    def _speak(self, me: Memory, corner: Swarm) -> bool:
        me.say(THAW_ANNOUNCE, TO_ALL, other=corner)
        return self._copy(me)

    def _copy(self, me: Memory) -> bool:
        """One copy more: are there enough?"""
        self._copies = [at for at in self._copies if me.now - at <= WITHIN_S] + [me.now]
        return len(self._copies) >= self._needed
