"""Numbers as people read them: durations, distances, counts; and a curve drawn with braille dots."""

from __future__ import annotations

import io
import math
import os
import textwrap
from collections.abc import Sequence
from typing import Any

DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))  # braille, by column then row


def clock(seconds: float) -> str:
    """Minutes and seconds, with hours where there are any.

    >>> clock(7.4), clock(123), clock(7384)
    ('0:07', '2:03', '2:03:04')
    """
    whole = max(0, int(seconds))
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def unit_after(value: Any, unit: str) -> str:
    """What stands behind the value of a setting: its unit, if it has one and is a number or positions.

    >>> unit_after(12.0, "s"), unit_after("auto", "wall"), unit_after(0.1, "p"), unit_after(None, "s")
    (' s', '', '', '')
    >>> unit_after(0.5, "wall"), unit_after([[0, 0, 0]], "cells"), unit_after([], "cells")
    (' emulated s per wall s', ' cells', '')
    """
    if isinstance(value, bool) or not (
        isinstance(value, (int, float)) or (value and isinstance(value, list))
    ):
        return ""
    said = {"p": "", "wall": "emulated s per wall s"}.get(unit, unit)
    return f" {said}" if said else ""


def cells(value: float | None) -> str:
    """A distance in cells with three significant digits; a dash where there is none.

    >>> cells(12.345), cells(0.01234), cells(1234.5), cells(4e-7), cells(None), cells(float("nan"))
    ('12.3', '0.0123', '1,234', '4.0e-07', '–', '–')
    """
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    if abs(value) >= 1000:
        return f"{value:,.0f}"
    if abs(value) < 1e-4:
        return f"{value:.1e}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"


def count(value: float | None) -> str:
    """A whole number with thousands separated, shortened from a million on.

    >>> count(1234), count(2_345_678), count(None)
    ('1,234', '2.35 M', '–')
    """
    if value is None:
        return "–"
    return f"{value / 1e6:.2f} M" if abs(value) >= 1e6 else f"{value:,.0f}"


def seconds(value: float | None) -> str:
    """Seconds with one digit after the point; "never" where there are none.

    >>> seconds(12.34), seconds(None)
    ('12.3 s', 'never')
    """
    return "never" if value is None else f"{value:.1f} s"


def swarms(number: int) -> str:
    """How many swarms.

    >>> swarms(1), swarms(12)
    ('1 swarm', '12 swarms')
    """
    return f"{number} swarm" + ("" if number == 1 else "s")


def memory(megabytes: float | None) -> str:
    """Megabytes, as gigabytes from 1000 on.

    >>> memory(12.3), memory(1520), memory(None)
    ('12 MB', '1.52 GB', '–')
    """
    if megabytes is None:
        return "–"
    return f"{megabytes / 1000:.2f} GB" if megabytes >= 1000 else f"{megabytes:.0f} MB"


def wrapped(line: str, width: int) -> list[str]:
    """The line in pieces of at most `width` columns, broken between words; what follows the first is indented more.

    >>> wrapped("  faithful: p99 late: timers", 20)
    ['  faithful: p99', '    late: timers']
    """
    lead = line[: len(line) - len(line.lstrip())]
    if len(line) <= width:
        return [line]
    return textwrap.wrap(
        line, max(width, 20), initial_indent="", subsequent_indent=lead + "  ", break_on_hyphens=False
    )


def columns_of(stream: Any, otherwise: int = 80) -> int:
    """How wide the terminal behind `stream` is; `otherwise` where there is none."""
    try:
        return os.get_terminal_size(stream.fileno()).columns or otherwise
    except (OSError, ValueError, AttributeError, io.UnsupportedOperation):
        return otherwise


def braille_curve(
    xs: Sequence[float], ys: Sequence[float], width: int, height: int, span: tuple[float, float, float, float]
) -> list[str]:
    """A curve in `height` lines of `width` characters; span is (x low, x high, y low, y high). NaN leaves a gap.

    >>> braille_curve([0, 1], [0, 1], 2, 1, (0, 1, 0, 1))
    ['⡠⠊']
    """
    columns, rows = 2 * width, 4 * height
    grid = [[0] * width for _ in range(height)]
    x_low, x_high, y_low, y_high = span
    before: tuple[int, int] | None = None
    for x, y in zip(xs, ys, strict=True):
        if not math.isfinite(y) or not x_low <= x <= x_high:
            before = None
            continue
        column = round((x - x_low) / max(x_high - x_low, 1e-12) * (columns - 1))
        share = (y - y_low) / max(y_high - y_low, 1e-12)
        row = round((1 - min(1.0, max(0.0, share))) * (rows - 1))
        for at_column, at_row in _line(before or (column, row), (column, row)):
            grid[at_row // 4][at_column // 2] |= DOTS[at_column % 2][at_row % 4]
        before = (column, row)
    return ["".join(chr(0x2800 + bits) if bits else " " for bits in line) for line in grid]


def _line(start: tuple[int, int], end: tuple[int, int]) -> list[tuple[int, int]]:
    """The dots from one to the other."""
    steps = max(abs(end[0] - start[0]), abs(end[1] - start[1]), 1)
    return [
        (round(start[0] + (end[0] - start[0]) * i / steps), round(start[1] + (end[1] - start[1]) * i / steps))
        for i in range(steps + 1)
    ]
