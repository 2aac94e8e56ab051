"""How far another host's clock is from ours: exchanges of its time for ours, as NTP makes them (Mills, RFC 5905).

The host reads its clock somewhere between our question and our hearing of its answer. If both ways took equally long it
was in the middle; however they were, it was between, so half the time of the exchange bounds the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Exchange(NamedTuple):
    """One question and its answer, seconds."""

    asked: float  # our monotonic clock
    monotonic: float  # the host's, when it answered
    wall: float  # the host's time of day then
    heard: float  # our monotonic clock
    wall_here: float  # our time of day when we heard


class Offset(NamedTuple):
    """What the best exchange says: a moment `t` of ours is `t + offset_s` on the host's clock."""

    offset_s: float  # of the monotonic clocks, which begin anywhere
    bound_s: float  # the offset is wrong by no more
    apart_s: float  # how far the host's time of day is ahead of ours


def estimate(exchanges: Sequence[Exchange]) -> Offset:
    """The offset, from the quickest exchange: it had the least time to go wrong in."""
    best = min(exchanges, key=lambda exchange: exchange.heard - exchange.asked)
    took = best.heard - best.asked
    return Offset(
        best.monotonic - (best.asked + best.heard) / 2, took / 2, best.wall + took / 2 - best.wall_here
    )
