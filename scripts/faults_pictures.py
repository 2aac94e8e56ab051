"""SVG pictures of what faults cost, readable on light and on dark pages: `faults_table.py ... --picture`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

# From good to bad, light to dark, told apart without colours, too.
SCALE = ((255, 247, 196), (254, 196, 79), (236, 112, 20), (165, 40, 60), (62, 16, 74))
LINES = ("#3f8fe0", "#2ca089", "#d9a514", "#e0663f", "#b048b5")
CELL_WIDE, CELL_TALL, LEFT, TOP = 74, 26, 70, 34
STYLE = (
    "<style>text{font:12px sans-serif;fill:#1a1a1a}.axis{stroke:#1a1a1a;stroke-opacity:.25}"
    "@media(prefers-color-scheme:dark){text{fill:#e4e4e4}.axis{stroke:#e4e4e4}}"
    "text.on-light{fill:#1a1a1a}text.on-dark{fill:#fff}</style>"
)
PANEL_WIDE, PANEL_TALL = 330, 230


def heat_map(values: NDArray[np.float64], rows: Sequence[str], columns: Sequence[str], title: str) -> str:
    """A cell for each value, its colour by the value's logarithm; NaN: a dash. Rows from the top."""
    low, high = np.nanmin(values), max(np.nanmax(values), 1.01 * np.nanmin(values))
    parts = [_text(LEFT + len(columns) * CELL_WIDE / 2, 14, title, "middle")]
    parts += [
        _text(LEFT + (at + 0.5) * CELL_WIDE, TOP - 5, name, "middle") for at, name in enumerate(columns)
    ]
    for row, name in enumerate(rows):
        parts.append(_text(LEFT - 8, TOP + row * CELL_TALL + 17, name, "end"))
    for (row, column), value in np.ndenumerate(values):
        x, y = LEFT + column * CELL_WIDE, TOP + row * CELL_TALL
        if math.isnan(value):
            parts.append(_text(x + CELL_WIDE / 2, y + 17, "–", "middle"))
            continue
        share = math.log(value / low) / math.log(high / low)
        parts.append(
            f'<rect x="{x}" y="{y}" width="{CELL_WIDE - 1}" height="{CELL_TALL - 1}" fill="{_colour(share)}"/>'
            + _text(
                x + CELL_WIDE / 2, y + 17, f"{value:.2g}", "middle", "on-dark" if share > 0.55 else "on-light"
            )
        )
    return _svg(LEFT + len(columns) * CELL_WIDE + 6, TOP + len(rows) * CELL_TALL + 6, parts, title)


def _colour(share: float) -> str:
    at = min(share, 1.0) * (len(SCALE) - 1)
    first = min(int(at), len(SCALE) - 2)
    parts = (a + (at - first) * (b - a) for a, b in zip(SCALE[first], SCALE[first + 1], strict=True))
    return f"#{''.join(f'{round(part):02x}' for part in parts)}"


def panels(
    t_s: NDArray[np.float64],
    hd: dict[str, NDArray[np.float64]],
    lit: dict[str, NDArray[np.float64]],
    title: str,
) -> str:
    """HD, logarithmic, and the share of points that are lit over time, a curve for each name."""
    logs = {
        name: np.log10(curve, where=curve > 0, out=np.full(curve.shape, np.nan)) for name, curve in hd.items()
    }
    low = math.floor(min(np.nanmin(curve) for curve in logs.values()))
    high = math.ceil(max(np.nanmax(curve) for curve in logs.values()))
    parts = _panel(
        0, t_s, logs, (low, high), [(at, f"{10.0**at:g}") for at in range(low, high + 1)], "HD, cells"
    )
    ticks = [(at, f"{100 * at:g} %") for at in (0.0, 0.25, 0.5, 0.75, 1.0)]
    parts += _panel(PANEL_WIDE + 60, t_s, lit, (0.0, 1.0), ticks, "lit")
    for number, name in enumerate(hd):
        x = 60 + 130 * number
        parts.append(
            f'<line x1="{x}" x2="{x + 22}" y1="{PANEL_TALL + 66}" y2="{PANEL_TALL + 66}" stroke="{LINES[number]}" '
            f'stroke-width="3"/>' + _text(x + 28, PANEL_TALL + 70, name, "start")
        )
    return _svg(2 * PANEL_WIDE + 130, PANEL_TALL + 84, parts, title)


def _panel(
    left: float,
    t_s: NDArray[np.float64],
    curves: dict[str, NDArray[np.float64]],
    span: tuple[float, float],
    ticks: Iterable[tuple[float, str]],
    name: str,
) -> list[str]:
    x0, low, high = left + 56, *span

    def y(value: float) -> float:
        return round(TOP + (high - value) / (high - low) * PANEL_TALL, 1)

    def x(seconds: float) -> float:
        return round(x0 + seconds / float(t_s[-1]) * PANEL_WIDE, 1)

    parts = [_text(x0, TOP - 12, name, "start")]
    for value, said in ticks:
        parts.append(f'<line class="axis" x1="{x0}" x2="{x0 + PANEL_WIDE}" y1="{y(value)}" y2="{y(value)}"/>')
        parts.append(_text(x0 - 6, y(value) + 4, said, "end"))
    parts += [
        _text(x(seconds), TOP + PANEL_TALL + 16, f"{seconds} s", "middle")
        for seconds in range(0, int(t_s[-1]) + 1, 20)
    ]
    for number, curve in enumerate(curves.values()):
        way = " ".join(
            f"{x(at)},{y(value)}" for at, value in zip(t_s, curve, strict=True) if math.isfinite(value)
        )
        parts.append(f'<polyline points="{way}" fill="none" stroke="{LINES[number]}" stroke-width="1.5"/>')
    return parts


def _text(x: float, y: float, said: str, anchor: str, kind: str = "") -> str:
    of = f' class="{kind}"' if kind else ""
    return f'<text{of} x="{x:g}" y="{y:g}" text-anchor="{anchor}">{escape(said)}</text>'


def _svg(width: float, height: float, parts: Iterable[str], title: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" role="img">'
        f"<title>{escape(title)}</title>{STYLE}{''.join(parts)}</svg>\n"
    )
