"""What an FLS believes of its planned neighbours' swarms (rule 9).

Only what a neighbour itself said counts, never hearsay, and only in the epoch in which it was said.
"""

from __future__ import annotations

from swarmer.messages import Message, Swarm


class Beliefs:
    """The last Swarm-ID heard from each planned neighbour."""

    __slots__ = ("_heard", "neighbours")

    def __init__(self, neighbours: tuple[int, ...]) -> None:
        self.neighbours = frozenset(neighbours)
        self._heard: dict[int, Swarm] = {}

    def note(self, message: Message) -> None:
        """Remember the sender's swarm, if the sender is a planned neighbour."""
        if message.sender in self.neighbours:
            self._heard[message.sender] = message.swarm

    def forget(self, fid: int) -> None:
        self._heard.pop(fid, None)

    def clear(self) -> None:
        self._heard.clear()

    def of(self, fid: int) -> Swarm | None:
        return self._heard.get(fid)

    def complete(self, swarm: Swarm) -> bool:
        """R-Complete: every planned neighbour is known to be in `swarm`."""
        return list(self._heard.values()).count(swarm) == len(self.neighbours)
