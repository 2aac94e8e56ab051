"""When a swarm of swarms starts again (rule 11). An FLS asks its policy for the delay of its thaw timer."""

from __future__ import annotations

from random import Random
from typing import Protocol


class ThawPolicy(Protocol):
    def delay_s(self, rng: Random) -> float | None:
        """Emulated seconds until this FLS thaws the display; None: this FLS never does by itself."""


class Timer:
    """Uniform in [H, spread * H], drawn anew after every thaw (the paper, section 6: H = log2 F, spread 2)."""

    __slots__ = ("h_s", "spread")

    def __init__(self, h_s: float, spread: float) -> None:
        self.h_s, self.spread = h_s, spread

    def delay_s(self, rng: Random) -> float | None:
        return rng.uniform(self.h_s, self.spread * self.h_s)


class Never:
    """No FLS thaws by itself: nobody does (`off`), or the engine that watches does (`centralized`)."""

    __slots__ = ()

    def delay_s(self, rng: Random) -> float | None:
        return None
