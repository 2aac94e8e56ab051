"""Leases: how long an anchor stands still for each FLS that localizes against it (rules 4, 5, 7)."""

from __future__ import annotations


class Leases:
    """The live leases of one anchor, by the FID that holds them. Times are emulated seconds.

    Two FLSs may challenge each other at once and pair twice. A lease therefore knows the challenges that it was granted
    for: when one of the two pairings is cancelled, the other one still stands.
    """

    __slots__ = ("_challenges", "_until", "duration_s")

    def __init__(self, duration_s: float) -> None:
        self.duration_s = duration_s
        self._until: dict[int, float] = {}
        self._challenges: dict[int, set[int]] = {}

    def __len__(self) -> int:
        return len(self._until)

    def __contains__(self, fid: int) -> bool:
        return fid in self._until

    def ends(self) -> dict[int, float]:
        """When the lease of each FID runs out: a copy."""
        return dict(self._until)

    def grant(self, fid: int, challenge: int, now: float) -> None:
        """Give `fid` a lease from `now`, or renew the one it has."""
        self._until[fid] = now + self.duration_s
        self._challenges.setdefault(fid, set()).add(challenge)

    def release(self, fid: int) -> bool:
        """End the lease of `fid`; False if it has none."""
        self._challenges.pop(fid, None)
        return self._until.pop(fid, None) is not None

    def cancel(self, fid: int, challenge: int) -> bool:
        """The pairing of `challenge` does not stand; does that end the lease of `fid`?"""
        challenges = self._challenges.get(fid)
        if challenges is None or challenge not in challenges:
            return False
        challenges.remove(challenge)
        return not challenges and self.release(fid)

    def expire(self, now: float) -> list[int]:
        """End every lease that is over at `now`; whose they were."""
        over = [fid for fid, until in self._until.items() if until <= now]
        for fid in over:
            self.release(fid)
        return over

    def next_expiry(self) -> float | None:
        """When the next lease ends, or None without a lease."""
        return min(self._until.values(), default=None)

    def clear(self) -> None:
        self._until.clear()
        self._challenges.clear()
