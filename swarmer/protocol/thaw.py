"""When a swarm of swarms starts again (rule 11): what a thaw policy is asked, and the policies that only have a clock.

A policy that knows more is a file of its own: `roster`, `census`, `corner`. Its methods change the memory of their FLS
as rules do, through `me`; those that may find that there is one swarm answer True, and the rule begins the thaw.
"""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from swarmer.messages import Message, Swarm
    from swarmer.protocol.memory import Memory

FALLBACK = 4  # a policy that waits for messages thaws by the clock after so many times H


class ThawPolicy(Protocol):
    """One for each FLS, with what it remembers of the present epoch."""

    tells: bool
    """An FLS that finds one swarm says THAW to all; False: all find it together, by the same messages."""

    def delay_s(self, rng: Random) -> float | None:
        """Emulated seconds until this FLS thaws the display by the clock; None: it never does."""

    def begins(self, me: Memory) -> None:
        """Landed or thawed: an epoch begins for this FLS, and what was remembered of another is void."""

    def joined(self, me: Memory, left: Swarm) -> None:
        """It was in the swarm `left` and has taken another Swarm-ID. If it flies for that, it has begun to."""

    def report_due(self, me: Memory) -> bool:
        """The timer REPORT is over. Thaw?"""

    def counted(self, me: Memory, message: Message) -> bool:
        """COUNT. Thaw?"""

    def called(self, me: Memory, message: Message) -> None:
        """ROLL_CALL."""

    def announced(self, me: Memory, message: Message) -> bool:
        """THAW_ANNOUNCE. Thaw?"""

    def aborted(self, me: Memory, message: Message) -> None:
        """THAW_ABORT."""


class Silent:
    """What a policy is that neither reports nor listens."""

    __slots__ = ()
    tells = True

    def begins(self, me: Memory) -> None:
        pass

    def joined(self, me: Memory, left: Swarm) -> None:
        pass

    def report_due(self, me: Memory) -> bool:
        return False

    def counted(self, me: Memory, message: Message) -> bool:
        return False

    def called(self, me: Memory, message: Message) -> None:
        pass

    def announced(self, me: Memory, message: Message) -> bool:
        return False

    def aborted(self, me: Memory, message: Message) -> None:
        pass


class Timer(Silent):
    """Uniform in [H, spread * H], drawn anew after every thaw (the paper, section 6: H = log2 F, spread 2)."""

    __slots__ = ("h_s", "spread")

    def __init__(self, h_s: float, spread: float) -> None:
        self.h_s, self.spread = h_s, spread

    def delay_s(self, rng: Random) -> float | None:
        return rng.uniform(self.h_s, self.spread * self.h_s)


class Never(Silent):
    """No FLS thaws by itself: nobody does (`off`), or the engine that watches does (`centralized`)."""

    __slots__ = ()

    def delay_s(self, rng: Random) -> float | None:
        return None
