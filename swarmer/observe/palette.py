"""The colours that recording, panel and report share.

Swarms are told apart by hue, on a circle on which all hues look equally light (OKLCH: Ottosson, "A perceptual color
space for image processing", 2020), so none stands out and all are seen on dark and on white. With hundreds of swarms no
palette can give each a colour of its own; what is to be seen then is what has grown together. So an FLS that is a swarm
by itself is pale, and one with company is vivid. When all are one swarm there is nothing to tell apart: one calm
colour.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GOLDEN = 0.6180339887498949
LIGHTS = (0.74, 0.66, 0.82)  # neighbours on the circle differ by these, too
VIVID, PALE = 0.145, 0.045  # chroma
FROM_CONES = np.array(
    [
        (4.0767416621, -3.3077115913, 0.2309699292),
        (-1.2684380046, 2.6097574011, -0.3413193965),
        (-0.0041960863, -0.7034186147, 1.7076147010),
    ]
)  # of the eye to linear sRGB
DARK = (70, 76, 88)  # an FLS that is not lit
CALM = (92, 160, 214)  # all are one swarm
TRUTH = (62, 69, 84)  # faint on the recording's background

# In the order of swarmer.state_machine.State.
STATES = ("Deploying", "Available", "Busy Anchor", "Busy Localizing", "Waiting")
STATE_COLOURS = ("#8a93a6", "#4c9be8", "#f2b134", "#e4572e", "#8d6bd1")


def swarm_colours(swarms: NDArray[np.int64], chroma: float = VIVID) -> NDArray[np.uint8]:
    """(n, 3) RGB of (n,) Swarm-IDs: the hue goes round by the golden ratio, so any few ids lie far apart."""
    hues = 2 * np.pi * ((0.08 + swarms * GOLDEN) % 1.0)
    return oklch(np.array(LIGHTS)[swarms % len(LIGHTS)], chroma, hues)


def oklch(light: NDArray[np.floating], chroma: float, hue: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(n, 3) sRGB of colours by lightness (0 to 1), chroma and hue (radians); cut off where a screen ends.

    >>> oklch(np.array([1.0, 0.0]), 0.0, np.zeros(2)).tolist()
    [[255, 255, 255], [0, 0, 0]]
    """
    a, b = chroma * np.cos(hue), chroma * np.sin(hue)
    cones = np.stack([
        light + 0.3963377774 * a + 0.2158037573 * b,
        light - 0.1055613458 * a - 0.0638541728 * b,
        light - 0.0894841775 * a - 1.2914855480 * b,
    ])  # fmt: skip
    linear = np.clip(FROM_CONES @ cones**3, 0.0, 1.0).T
    curved = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    screen: NDArray[np.uint8] = np.rint(255 * curved).astype(np.uint8)
    return screen


def rgb(colour: str) -> tuple[int, int, int]:
    """The three parts of '#rrggbb'.

    >>> rgb("#f2b134")
    (242, 177, 52)
    """
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


class Palette:
    """Colours of Swarm-IDs from 0 to the largest, made once."""

    def __init__(self, largest: int) -> None:
        ids = np.arange(largest + 1)
        self._vivid, self._pale = swarm_colours(ids), swarm_colours(ids, PALE)
        self._vivid[0] = self._pale[0] = DARK

    def colours(self, swarm: NDArray[np.int32], lit: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """(F, 3) RGB of (F,) Swarm-IDs: pale where alone, calm if all lit are one swarm, grey where dark."""
        known = np.where(lit & (swarm < len(self._vivid)), swarm, 0)
        sizes = np.bincount(known[lit], minlength=len(self._vivid))
        if np.count_nonzero(sizes) == 1 and sizes.max() > 1:
            return np.where(lit[:, None], np.array(CALM, np.uint8), np.array(DARK, np.uint8))
        alone = (sizes[known] == 1)[:, None]
        coloured: NDArray[np.uint8] = np.where(alone, self._pale[known], self._vivid[known])
        return coloured
