"""A cloud in the terminal: eight dots to a character, the nearer the brighter where there is colour."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.cloud import UP_AXIS
from swarmer.shapes.views import View, seen_from, shade

_DOT = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # Unicode's braille: row, column
_NEAR, _FAR = np.array([255, 204, 92]), np.array([86, 66, 160])
_END = "\x1b[0m"


def terminal_picture(
    points: NDArray[Any],
    view: View,
    columns: int = 76,
    rows: int = 30,
    *,
    colour: bool = False,
    ascii_only: bool = False,
    up_axis: int = UP_AXIS,
) -> str:
    """The cloud (F, 3) in at most `columns` x `rows` characters, lines joined by newlines, none trailing.

    colour: 24-bit escape codes, by nearness. ascii_only: `.` and `o` and `#` for 1, 2 and more lights
    of a character, for terminals without Unicode.
    """
    seen = seen_from(points, view, up_axis)
    wide, high = 2 * columns - 1, 4 * rows - 1
    extent = np.maximum(np.ptp(seen[:, :2], axis=0), 1e-9)
    dots_per_cell = min(wide / extent[0], high / extent[1])
    at = np.rint((seen[:, :2] - seen[:, :2].min(axis=0)) * dots_per_cell).astype(np.int64)
    column, row = at[:, 0], at[:, 1].max() - at[:, 1]
    grid = np.zeros((row.max() // 4 + 1, column.max() // 2 + 1), dtype=np.int64)
    np.bitwise_or.at(grid, (row // 4, column // 2), _DOT[row % 4, column % 2])
    light: NDArray[np.float64] = np.zeros(grid.shape)
    np.maximum.at(light, (row // 4, column // 2), shade(seen[:, 2]))
    return "\n".join(_line(bits, near, colour, ascii_only) for bits, near in zip(grid, light, strict=True))


def _line(bits: NDArray[np.int64], near: NDArray[np.float64], colour: bool, ascii_only: bool) -> str:
    text, last = [], ""
    for dots, nearness in zip(bits.tolist(), near.tolist(), strict=True):
        glyph = " .o#"[min(3, dots.bit_count())] if ascii_only else chr(0x2800 + dots) if dots else " "
        code = _code(nearness) if colour and dots else last
        text.append(glyph if code == last else code + glyph)
        last = code
    line = "".join(text).rstrip()
    return line + _END if last else line


def _code(nearness: float) -> str:
    step = round(nearness * 15) / 15  # few colours, so that few codes are needed
    red, green, blue = np.rint(_FAR + (_NEAR - _FAR) * step).astype(int)
    return f"\x1b[38;2;{red};{green};{blue}m"
