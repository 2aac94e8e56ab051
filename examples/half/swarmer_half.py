"""A thaw policy: the owner of a swarm, the FLS whose FID is the Swarm-ID, thaws once half of all FLSs are in it."""

from swarmer.protocol.reports import Roll, owns, report
from swarmer.protocol.thaw import FALLBACK, Timer


class Half(Timer):
    """Reports on joining. `Timer` is the clock that it falls back on, and answers what a policy need not care for."""

    __slots__ = ("_count", "_roll")

    def __init__(self, count: int, h_s: float, spread: float) -> None:
        """count: F, the number of FLSs."""
        super().__init__(FALLBACK * h_s, spread)
        self._count, self._roll = count, Roll()

    def begins(self, me):
        """Landed or thawed: all that was reported is void."""
        self._roll.begin(me.swarm)
        self._roll.note(me)

    def joined(self, me, left):
        """This FLS has taken another Swarm-ID: it tells the FLS whose FID that is."""
        self._roll.begin(me.swarm)
        if not owns(me):
            report(me, me.swarm.xi)

    def counted(self, me, message):
        """A report. Thaw?"""
        if not owns(me):
            return False
        self._roll.hear(message)
        return 2 * len(self._roll) >= self._count
