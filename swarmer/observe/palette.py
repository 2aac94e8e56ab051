"""The colours that recording, panel and report share."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray

GOLDEN = 0.6180339887498949
DARK = (86, 92, 105)  # an FLS that is not lit
TRUTH = (128, 138, 156)

# In the order of swarmer.state_machine.State.
STATES = ("Deploying", "Available", "Busy Anchor", "Busy Localizing", "Waiting")
STATE_COLOURS = ("#8a93a6", "#4c9be8", "#f2b134", "#e4572e", "#8d6bd1")


def swarm_colour(swarm: int) -> tuple[int, int, int]:
    """A colour for a Swarm-ID: the hue goes round by the golden ratio, so any few ids lie far apart."""
    hue = (0.08 + swarm * GOLDEN) % 1.0
    light = 0.62 + 0.08 * ((swarm * 7) % 3 - 1)
    red, green, blue = colorsys.hls_to_rgb(hue, light, 0.78)
    return round(255 * red), round(255 * green), round(255 * blue)


class Palette:
    """Colours of Swarm-IDs from 0 to the largest, made once."""

    def __init__(self, largest: int) -> None:
        self._table = np.array([DARK] + [swarm_colour(i) for i in range(1, largest + 1)], dtype=np.uint8)

    def colours(self, swarm: NDArray[np.int32], lit: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """(F, 3) RGB of (F,) Swarm-IDs; dark FLSs grey."""
        known = np.where(lit & (swarm < len(self._table)), swarm, 0)
        return self._table[known]
