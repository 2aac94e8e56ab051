"""Which of two paired FLSs anchors (rule 4). Both ends ask the same question and must get the same answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from swarmer.messages import Swarm


class Party(NamedTuple):
    """One end of a pairing, as both ends know it."""

    swarm: Swarm
    size: int  # its own estimate of its swarm's size
    challenged: bool  # it sent the CHALLENGE_INIT


AnchorSelection = Callable[[Party, Party, int], bool]
"""(me, other, challenge id) -> do I anchor? Antisymmetric: exactly one of the two ends gets True."""


def lowest(me: Party, other: Party, challenge: int) -> bool:
    """The lower Swarm-ID anchors (the paper's text); of equal ids the older incarnation."""
    return me.swarm < other.swarm


def largest(me: Party, other: Party, challenge: int) -> bool:
    """The larger swarm anchors; ties: the lower Swarm-ID."""
    return lowest(me, other, challenge) if me.size == other.size else me.size > other.size


def smallest(me: Party, other: Party, challenge: int) -> bool:
    """The smaller swarm anchors; ties: the lower Swarm-ID."""
    return lowest(me, other, challenge) if me.size == other.size else me.size < other.size


def challenger(me: Party, other: Party, challenge: int) -> bool:
    """Whoever challenged anchors."""
    return me.challenged


def random(me: Party, other: Party, challenge: int) -> bool:
    """A coin that both ends can toss: the parity of a hash of the challenge id."""
    return me.challenged if _hash(challenge) & 1 else other.challenged


def _hash(number: int) -> int:
    # Multiplying by a large odd constant and keeping high bits spreads consecutive ids (Knuth's multiplicative hash).
    return (number * 2654435761 & 0xFFFFFFFF) >> 16


STRATEGIES: dict[str, AnchorSelection] = {
    rule.__name__: rule for rule in (lowest, largest, smallest, challenger, random)
}
