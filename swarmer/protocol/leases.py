"""Leases: how long an anchor stands still for each FLS that localizes against it (rules 4, 5, 7)."""

from __future__ import annotations


class Leases:
    """The live leases of one anchor, by the FID that holds them. Times are emulated seconds."""

    __slots__ = ("_until", "duration_s")

    def __init__(self, duration_s: float) -> None:
        self.duration_s = duration_s
        self._until: dict[int, float] = {}

    def __len__(self) -> int:
        return len(self._until)

    def __contains__(self, fid: int) -> bool:
        return fid in self._until

    def grant(self, fid: int, now: float) -> None:
        """Give `fid` a lease from `now`, or renew the one it has."""
        self._until[fid] = now + self.duration_s

    def release(self, fid: int) -> bool:
        """End the lease of `fid`; False if it has none."""
        return self._until.pop(fid, None) is not None

    def expire(self, now: float) -> list[int]:
        """End every lease that is over at `now`; whose they were."""
        over = [fid for fid, until in self._until.items() if until <= now]
        for fid in over:
            del self._until[fid]
        return over

    def next_expiry(self) -> float | None:
        """When the next lease ends, or None without a lease."""
        return min(self._until.values(), default=None)

    def clear(self) -> None:
        self._until.clear()
