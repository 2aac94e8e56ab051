"""SVG by hand for the pages: curves over time and clouds of points, in the page's own colour, light or dark."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.observe.palette import Palette
from swarmer.shapes.views import seen_from, usual_view

CURVE, TRUTH, MARK = "#3f8fe0", "#8a93a6", "#d97a2b"
WIDE, TALL, SIDE = 270, 200, 300  # a curve's width and height, a cloud's width, in the drawing's own units
LEFT, RIGHT, TOP, BOTTOM = 50, 10, 12, 30
MOST_POINTS = 900  # of a curve
SETS = "font-family='sans-serif' font-size='12' fill='currentColor'"


class Mark(NamedTuple):
    """A moment on a curve, drawn as a line from top to bottom."""

    t_s: float
    colour: str


def hd_curve(
    t_s: NDArray[np.float64],
    hd: NDArray[np.float64],
    marks: Iterable[Mark],
    said: str,
    end_s: float | None = None,
    width: int = WIDE,
) -> str:
    """HD over emulated time, logarithmic. said: what somebody hears who does not see it."""
    shown = np.isfinite(hd) & (hd > 0)
    times, values = t_s[shown], np.log10(hd[shown])
    end = end_s or float(times[-1])
    low, high = math.floor(values.min()), math.ceil(values.max())

    def x(seconds: float) -> float:
        return round(LEFT + seconds / end * (width - LEFT - RIGHT), 1)

    def y(value: float) -> float:
        return round(TOP + (high - value) / (high - low) * (TALL - TOP - BOTTOM), 1)

    parts = [_level(value, y(value), width) for value in range(low, high + 1)]
    parts += [_time(end * i / 4, x(end * i / 4), "end" if i == 4 else "middle") for i in range(5)]
    parts += [
        f"<line x1='{x(mark.t_s)}' x2='{x(mark.t_s)}' y1='{TOP}' y2='{TALL - BOTTOM}' stroke='{mark.colour}' "
        "stroke-dasharray='3 3'/>"
        for mark in marks
        if mark.t_s <= end
    ]
    step = max(1, len(times) // MOST_POINTS)
    way = " ".join(f"{x(t)},{y(v)}" for t, v in zip(times[::step], values[::step], strict=True))
    parts.append(f"<polyline points='{way}' fill='none' stroke='{CURVE}' stroke-width='2'/>")
    return svg(width, TALL, parts, said)


def _level(value: int, y: float, width: int) -> str:
    return (
        f"<line x1='{LEFT}' x2='{width - RIGHT}' y1='{y}' y2='{y}' stroke='currentColor' stroke-opacity='.2'/>"
        f"<text x='{LEFT - 6}' y='{y + 4}' text-anchor='end'>{10.0**value:g}</text>"
    )


def _time(t_s: float, x: float, anchor: str) -> str:
    return f"<text x='{x}' y='{TALL - 10}' text-anchor='{anchor}'>{t_s:.3g} s</text>"


class Frame:
    """How points of a shape become places in a drawing, the same for all clouds of it."""

    def __init__(self, truth: NDArray[np.float64], width: float = SIDE) -> None:
        """truth: (F, 3), cells. width: of the drawing."""
        self.view = usual_view(2 if np.ptp(truth[:, 2]) == 0 else 3)
        seen = seen_from(truth, self.view)[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        room = 0.06 * float(max(*(high - low), 1.0))
        self.low, self.high = low - room, high + room
        self.scale = width / float(self.high[0] - self.low[0])
        self.width, self.height = width, float(self.high[1] - self.low[1]) * self.scale

    def places(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(F, 2), x to the right and y down."""
        seen = seen_from(points, self.view)
        x, y = (seen[:, 0] - self.low[0]) * self.scale, (self.high[1] - seen[:, 1]) * self.scale
        return np.column_stack([x, y])


def cloud(
    truth: NDArray[np.float64],
    position: NDArray[np.float64],
    swarm: NDArray[np.int32],
    lit: NDArray[np.bool_],
    said: str,
) -> str:
    """The display at one moment: a colour a swarm, ground truth as rings. Arrays (F, 3), (F, 3), (F,), (F,)."""
    frame = Frame(truth)
    size = float(np.clip(34 / math.sqrt(len(truth)), 1.1, 3.6))
    parts = [
        f"<circle cx='{x:.1f}' cy='{y:.1f}' r='{size:.1f}' fill='none' stroke='{TRUTH}' stroke-width='.6'/>"
        for x, y in frame.places(truth)
    ]
    parts += [
        f"<circle cx='{x:.1f}' cy='{y:.1f}' r='{size:.1f}' fill='{colour}' stroke='currentColor' stroke-width='.4'/>"
        for (x, y), colour in zip(frame.places(position)[lit], colours(swarm, lit, len(truth)), strict=True)
    ]
    return svg(frame.width, frame.height, parts, said)


def colours(swarm: NDArray[np.int32], lit: NDArray[np.bool_], largest: int) -> list[str]:
    """Of each lit FLS, its swarm's."""
    return ["#" + "".join(f"{part:02x}" for part in rgb) for rgb in Palette(largest).colours(swarm, lit)[lit]]


def svg(width: float, height: float, parts: Sequence[str], said: str) -> str:
    """One picture, as wide as its place."""
    return (
        f"<svg viewBox='0 0 {width:.0f} {height:.0f}' role='img' aria-label='{escape(said, quote=True)}' "
        f"style='width:100%;height:auto' {SETS}>{''.join(parts)}</svg>"
    )
