"""COUNT: how an FLS reports itself to the owner of its swarm, the FLS whose FID is the Swarm-ID (rule 11)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmer.messages import COUNT, NO_SWARM, TO_FLS, Swarm

if TYPE_CHECKING:
    from swarmer.messages import Message
    from swarmer.protocol.memory import Memory


def owns(me: Memory) -> bool:
    """Is this FLS the owner of its swarm? A replacement that has joined its predecessor's swarm inherits it."""
    return me.swarm.xi == me.fid


def report(me: Memory, owner: int) -> None:
    """Tell an FLS which swarm this one is in, and its longest vector of this epoch."""
    me.say(COUNT, TO_FLS, Swarm(owner, 0), vector=(me.longest, 0.0, 0.0))


class Roll:
    """Who of all F is in one swarm, by what they said themselves; void as soon as the owner's swarm is another."""

    __slots__ = ("_incarnations", "_of", "longest")

    def __init__(self) -> None:
        self._of = NO_SWARM
        self._incarnations: dict[int, int] = {}
        self.longest = 0.0  # vector that one of them flew, cells

    def __len__(self) -> int:
        return len(self._incarnations)

    def __contains__(self, fid: int) -> bool:
        return fid in self._incarnations

    def begin(self, swarm: Swarm) -> None:
        """Nobody, of this swarm."""
        self._of, self.longest = swarm, 0.0
        self._incarnations.clear()

    def note(self, me: Memory) -> None:
        """The owner itself."""
        self._add(me.swarm, me.fid, me.incarnation, me.longest)

    def hear(self, message: Message) -> None:
        """COUNT from one that is in the swarm, or is in it no more."""
        if message.swarm == self._of:
            self._add(message.swarm, message.sender, message.incarnation, message.vector[0])
        elif message.incarnation >= self._incarnations.get(message.sender, 0):
            self._incarnations.pop(message.sender, None)

    def _add(self, swarm: Swarm, fid: int, incarnation: int, longest: float) -> None:
        if incarnation >= self._incarnations.get(fid, 0):
            self._incarnations[fid] = incarnation
            self.longest = max(self.longest, longest)
