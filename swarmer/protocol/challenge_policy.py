"""When an Available FLS challenges (rules 2 and 9)."""

from __future__ import annotations

from random import Random
from typing import Protocol


class ChallengePolicy(Protocol):
    """Decides at every tick of the challenge timer that finds the FLS Available."""

    def challenges(self, complete: bool, rng: Random) -> bool:
        """Challenge now? `complete`: every planned neighbour is known to be in the FLS's own swarm."""

    def merged(self) -> None:
        """The FLS's swarm merged with another."""

    def thawed(self) -> None:
        """The FLS is a swarm of its own again."""


class RComplete:
    """Challenge until R-Complete (the paper); then only probe, at every `probe_every`-th tick (ours; 0: never).

    `fid` sets which of them: the FLSs of a swarm become complete together and must not all probe together.
    """

    __slots__ = ("_first", "_idle_ticks", "probe_every")

    def __init__(self, probe_every: int, fid: int = 0) -> None:
        self.probe_every = probe_every
        self._first = fid % probe_every if probe_every else 0
        self._idle_ticks = self._first

    def challenges(self, complete: bool, rng: Random) -> bool:
        if not complete:
            self._idle_ticks = self._first
            return True
        self._idle_ticks += 1
        return self.probe_every > 0 and self._idle_ticks % self.probe_every == 0

    def merged(self) -> None:
        pass

    def thawed(self) -> None:
        self._idle_ticks = self._first


class Always:
    """Challenge at every tick, though all neighbours be there: what R-Complete saves is the difference."""

    __slots__ = ()

    def challenges(self, complete: bool, rng: Random) -> bool:
        return True

    def merged(self) -> None:
        pass

    def thawed(self) -> None:
        pass


class Decay:
    """Challenge with a probability that each merge divides by `divisor` (the authors' code)."""

    __slots__ = ("_probability", "divisor")

    def __init__(self, divisor: float) -> None:
        self.divisor = divisor
        self._probability = 1.0

    def challenges(self, complete: bool, rng: Random) -> bool:
        return rng.random() < self._probability

    def merged(self) -> None:
        self._probability /= self.divisor

    def thawed(self) -> None:
        self._probability = 1.0
