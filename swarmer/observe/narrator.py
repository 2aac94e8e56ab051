"""What happened between two samples, in lines for the recording's log: lights, merges, localizations, leases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from swarmer.engines.result import Localized, Snapshot

FEW = 4  # localizations that are told one by one


class Narrator:
    """Told of every sample in turn."""

    def __init__(self) -> None:
        self._lit = self._swarms = 0
        self._expired = 0.0

    def lines(self, snapshot: Snapshot, swarms: int) -> list[str]:
        """swarms: of the lit FLSs."""
        lit, expired = int(snapshot.lit.sum()), snapshot.counters.get("leases_expired", self._expired)
        told = []
        if lit != self._lit:
            told.append(f"{lit} of {len(snapshot.lit)} FLSs lit")
        if snapshot.localized is not None:
            told += localization_lines(snapshot.localized)
        if swarms != self._swarms and (swarms < self._swarms or lit == self._lit):
            told.append(f"{_count(swarms, 'swarm')}, {_difference(swarms - self._swarms)}")
        if expired > self._expired:
            told.append(
                f"{_count(expired - self._expired, 'lease')} expired: a localizer was not heard of in time"
            )
        self._lit, self._swarms, self._expired = lit, swarms, expired
        return told


def localization_lines(localized: Localized) -> list[str]:
    """One by one if they are few."""
    length = np.linalg.norm(localized.vector, axis=1)
    if len(length) > FEW:
        by = len(np.unique(localized.anchor[localized.anchor > 0]))
        anchors = f" by {_count(by, 'anchor')}" if by else ""
        return [f"{len(length)} FLSs localized{anchors}, the longest flight {length.max():.3g} cells"]
    return [
        f"FLS {fid} localized{f' by FLS {anchor}' if anchor else ''}: flies {cells:.3g} cells"
        for fid, anchor, cells in zip(localized.fid, localized.anchor, length, strict=True)
    ]


def _difference(more: int) -> str:
    return f"{more} more" if more > 0 else f"{-more} fewer"


def _count(number: float, what: str) -> str:
    return f"{number:.0f} {what}{'' if number == 1 else 's'}"
