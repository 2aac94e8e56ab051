"""The battery of an FLS: flying and shining both draw on it (rule 13; the model is ours).

A full one would fly for `flight_s` with its light off, or shine for `light_s` in its place; 0: that costs nothing. What
is used adds up: who has flown for a tenth of the one can shine for nine tenths of the other.
"""

from __future__ import annotations


class Battery:
    """How much of one is used; times are emulated seconds."""

    __slots__ = ("_flight_s", "_least", "_light_s", "_lit_since_s", "used")

    def __init__(self, flight_s: float, light_s: float, reserve: float, used: float = 0.0) -> None:
        """reserve: the share that must be left for the way home. used: the share that is gone when the life begins."""
        self._flight_s, self._light_s, self._least = flight_s, light_s, 1.0 - reserve
        self.used = used  # but by the light, which is on
        self._lit_since_s: float | None = None

    def flies(self, seconds: float) -> None:
        """A flight of so many seconds begins; it counts from now on."""
        if self._flight_s > 0:
            self.used += seconds / self._flight_s

    def lights_up(self, now_s: float) -> None:
        self._lit_since_s = now_s

    def low_at(self, now_s: float) -> float:
        """When only the reserve is left, if nothing but the light draws on it until then; infinity: never."""
        left = self._least - self.used
        if self._lit_since_s is None or self._light_s == 0:
            return now_s if left <= 0 and self._lit_since_s is not None else float("inf")
        return max(now_s, self._lit_since_s + left * self._light_s)
