"""Who localized since the last sample, as a snapshot has it: from a list, or from what FLS processes show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swarmer.engines.result import Localized

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swarmer.physics.flight import Flight


def take_localized(noted: list[tuple[int, int, Flight]]) -> Localized | None:
    """Empty a list of (FID, its anchor's, the flight)."""
    if not noted:
        return None
    fids, anchors, flights = zip(*noted, strict=True)
    noted.clear()
    return Localized(
        np.array(fids, np.int32),
        np.array(anchors, np.int32),
        np.array([flight.start for flight in flights], np.float32),
        np.array([flight.displacement for flight in flights], np.float32),
    )


class LocalizedWatch:
    """Each slot shows its FLS's last localization; new is what was not there at the last look.

    Of two by one FLS between two looks only the later one is seen.
    """

    def __init__(self, count: int) -> None:
        self._seen_s: NDArray[np.float64] = np.zeros(count)  # when the last one seen of each FLS began

    def look(self, shown: NDArray[np.void]) -> Localized | None:
        """shown: (F,), with the names of `telemetry.Localization`."""
        new = np.flatnonzero((shown["anchor"] > 0) & (shown["begins_s"] != self._seen_s))
        self._seen_s = shown["begins_s"].copy()
        if not len(new):
            return None
        rows = shown[new]
        return Localized(
            (new + 1).astype(np.int32),
            rows["anchor"].astype(np.int32),
            rows["start"].copy(),
            rows["vector"].copy(),
        )
