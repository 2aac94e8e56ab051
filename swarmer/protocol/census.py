"""The thaw policy `census` (rule 11): whoever is R-Complete reports to the owner of its swarm, by the clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmer.protocol.events import REPORT_TIMER
from swarmer.protocol.reports import Roll, owns, report
from swarmer.protocol.thaw import FALLBACK, Timer

if TYPE_CHECKING:
    from swarmer.messages import Message, Swarm
    from swarmer.protocol.memory import Memory

EVERY = 2.0  # λ


class Census(Timer):
    """The paper's first idea (section 3), with the number F known: the owner thaws when all F are on its list."""

    __slots__ = ("_count", "_roll")

    def __init__(self, count: int, h_s: float, spread: float) -> None:
        """count: F."""
        super().__init__(FALLBACK * h_s, spread)
        self._count, self._roll = count, Roll()

    def begins(self, me: Memory) -> None:
        self._roll.begin(me.swarm)
        me.arm(REPORT_TIMER, me.now + me.rng.uniform(0.0, EVERY * me.settings.lambda_s))

    def joined(self, me: Memory, left: Swarm) -> None:
        self._roll.begin(me.swarm)

    def report_due(self, me: Memory) -> bool:
        me.arm(REPORT_TIMER, me.now + EVERY * me.settings.lambda_s)
        if not me.complete:
            return False
        if not owns(me):
            report(me, me.swarm.xi)
            return False
        self._roll.note(me)
        return len(self._roll) == self._count

    def counted(self, me: Memory, message: Message) -> bool:
        if not owns(me):
            return False
        self._roll.hear(message)
        return len(self._roll) == self._count
