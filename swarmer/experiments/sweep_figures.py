"""A sweep's figures: each measure over each setting that was swept, every cell with its interval over the seeds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmer.experiments.comparison import MEASURES, Key, Measure, Row
from swarmer.experiments.results import STATUS
from swarmer.metrics import intervals
from swarmer.metrics.intervals import Interval
from swarmer.observe.report_drawing import DASHES, FAINT, LINES, Figure, legend_above, svg_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

LINES_MAX = 8  # curves in a panel; more cells than these are a cloud of points
PANELS_MAX = 6  # settings that are drawn
ACROSS = 3
STEPS_MAX = 20  # values of a setting between which a line tells anything
BARS_MAX = 150  # cells whose intervals are drawn
WIDE_SHARE = 20.0  # an axis whose last value is so many times its first is logarithmic,
LOW_SHARE = 0.3  # if half of its values lie in this share of it
PANEL_INCHES = (2.9, 2.5)


class CellFigures(NamedTuple):
    """A cell of the sweep: what was set, and what came of it, by a measure's column."""

    key: Key
    runs: int
    values: dict[str, Interval]


class Axis(NamedTuple):
    """A setting that was swept: where each of its values stands."""

    name: str
    at: dict[str, float]
    words: bool  # the values are names, not numbers
    logarithmic: bool


def cells_of(settings: Sequence[str], rows: Sequence[Row], measures: Sequence[Measure]) -> list[CellFigures]:
    """The finished runs by cell: of what is timed the median, else the mean, over the seeds."""
    by_key: dict[Key, list[Row]] = {}
    for row in rows:
        if row.get(STATUS) == "done":
            by_key.setdefault(tuple(row[name] or "null" for name in settings), []).append(row)
    found = []
    for key, runs in by_key.items():
        values = {}
        for measure in measures:
            its = [value for row in runs if (value := measure.of(row)) is not None]
            if its:
                values[measure.column] = intervals.median(its) if measure.timed else intervals.mean(its).cut()
        found.append(CellFigures(key, len(runs), values))
    return found


def measures_of(rows: Sequence[Row]) -> list[Measure]:
    """Those of the usual measures that the runs have, whatever their value."""
    done = [row for row in rows if row.get(STATUS) == "done"]
    return [
        measure for measure in MEASURES
        if any(row.get(measure.column) is not None and measure.of(row) is not None for row in done)
    ]  # fmt: skip


def axis_of(name: str, values: Sequence[str]) -> Axis:
    """Where a setting's values stand: as numbers if all are, else side by side in their order.

    >>> axis_of("lambda_ms", ["50", "1000"]).logarithmic, axis_of("shape", ["hat", "dragon"]).at
    (True, {'hat': 0.0, 'dragon': 1.0})
    """
    numbers = [_number(value) for value in values]
    if all(number is not None for number in numbers):
        places = [number for number in numbers if number is not None]
        first, last, middle = min(places), max(places), sorted(places)[len(places) // 2]
        low = len(places) < 3 or middle - first < LOW_SHARE * (last - first)
        wide = first > 0 and last >= WIDE_SHARE * first and low
        return Axis(name, dict(zip(values, places, strict=True)), False, wide)
    return Axis(name, {value: float(at) for at, value in enumerate(dict.fromkeys(values))}, True, False)


def swept(settings: Sequence[str], cells: Sequence[CellFigures]) -> list[Axis]:
    """The settings that have more than one value, as they are drawn."""
    found = []
    for at, name in enumerate(settings):
        values = list(dict.fromkeys(cell.key[at] for cell in cells))
        if len(values) > 1:
            found.append(axis_of(name, values))
    return found


def figure_of(
    measure: Measure, settings: Sequence[str], cells: Sequence[CellFigures], axes: Sequence[Axis]
) -> Figure:
    """One measure, a panel for each setting."""
    drawn = list(axes[:PANELS_MAX])
    across = min(ACROSS, len(drawn))
    down = math.ceil(len(drawn) / across)
    key = f"over-{measure.column.replace('.', '-').replace('_', '-')}"
    estimate = "median" if measure.timed else "mean"
    alt = f"{measure.title} over {', '.join(axis.name for axis in drawn)}: {_ends(measure, cells)}"

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(down, across, squeeze=False)
        for number, axis in enumerate(drawn):
            _panel(panels[number // across][number % across], axis, measure, settings, cells)
        for number in range(len(drawn), across * down):
            panels[number // across][number % across].set_visible(False)
        canvas.supylabel(measure.title, fontsize=9)

    svg = svg_of(key, alt, draw, 0.7 + PANEL_INCHES[0] * across, 0.3 + PANEL_INCHES[1] * down)
    caption = f"The {estimate} over the seeds of each cell, with its 95 % interval."
    caption += " Above the dotted line: never." if _some_never(measure, cells) else ""
    left = len(axes) - len(drawn)
    caption += (
        " The red mark is the median of all cells at that value." if _clouds(settings, cells, drawn) else ""
    )
    caption += f" {left} more settings are in the table." if left > 0 else ""
    columns = [*settings, "runs", estimate, "low", "high"]
    rows = [[*cell.key, cell.runs, *_bounds(cell.values.get(measure.column))] for cell in cells]
    return Figure(key, measure.title, svg, caption, alt, columns, rows, wide=across > 1)


def _panel(
    axes: Axes, axis: Axis, measure: Measure, settings: Sequence[str], cells: Sequence[CellFigures]
) -> None:
    """The cells over one setting: a line for each combination of the others where these are few, else a cloud."""
    at = settings.index(axis.name)
    lines: dict[Key, list[tuple[float, Interval]]] = {}
    for cell in cells:
        if measure.column in cell.values:
            others = tuple(value for i, value in enumerate(cell.key) if i != at)
            lines.setdefault(others, []).append((axis.at[cell.key[at]], cell.values[measure.column]))
    finite = [one.estimate for line in lines.values() for _, one in line if math.isfinite(one.estimate)]
    top = 1.2 * max(finite, default=1.0) or 1.0
    joined = (
        len(lines) <= LINES_MAX
        and len(axis.at) <= STEPS_MAX
        and any(len(line) > 1 for line in lines.values())
    )
    names = _told_apart([name for i, name in enumerate(settings) if i != at], list(lines))
    for number, (others, line) in enumerate(lines.items()):
        colour = LINES[number % len(LINES)] if joined else LINES[0]
        line.sort(key=lambda point: point[0])
        x, y = [point for point, _ in line], [min(one.estimate, top) for _, one in line]
        dash = DASHES[number // 2 % len(DASHES)] if joined and not axis.words else "none"
        axes.plot(x, y, color=colour, ls=dash, marker="o", ms=3.5 if joined else 2.5, lw=1.3,
                  label=names[others])  # fmt: skip
        if joined or len(cells) <= BARS_MAX:
            _bars(axes, line, top, colour, 1.0 if joined else 0.6)
    if not joined and _shared(axis, cells):
        _middle(axes, lines.values(), top, axis.words)
    _scales(axes, axis, finite, top if _some_never(measure, cells) else None)
    if joined and len(lines) > 1:
        legend_above(axes, 1 if max(map(len, names.values())) > 22 else 2, 7.0)


def _clouds(settings: Sequence[str], cells: Sequence[CellFigures], drawn: Sequence[Axis]) -> bool:
    """Is there a panel with more combinations of the other settings than can be lines, and with few values?"""
    return any(
        _shared(axis, cells)
        and len(
            {
                (*cell.key[: settings.index(axis.name)], *cell.key[settings.index(axis.name) + 1 :])
                for cell in cells
            }
        )
        > LINES_MAX
        for axis in drawn
    )


def _shared(axis: Axis, cells: Sequence[CellFigures]) -> bool:
    """Do several cells stand at each value, mostly? Elsewhere their median is but the cell, and no trend."""
    return len(axis.at) <= STEPS_MAX and 2 * len(axis.at) <= len(cells)


def _bars(axes: Axes, line: Sequence[tuple[float, Interval]], top: float, colour: str, width: float) -> None:
    for x, one in line:
        if not math.isnan(one.low):
            axes.plot(
                [x, x], [min(one.low, top), min(one.high, top)], color=colour, lw=width, solid_capstyle="butt"
            )


def _middle(axes: Axes, lines: Any, top: float, words: bool) -> None:
    """The median of all cells at each value, where no single one can be followed."""
    by_value: dict[float, list[float]] = {}
    for line in lines:
        for x, one in line:
            by_value.setdefault(x, []).append(one.estimate)
    x = sorted(by_value)
    how: dict[str, Any] = {"ls": "none", "marker": "_", "ms": 22, "mew": 1.8} if words else {}
    axes.plot(
        x, [min(intervals.median(by_value[one]).estimate, top) for one in x], color=LINES[1], lw=1.6, **how
    )


def _scales(axes: Axes, axis: Axis, finite: Sequence[float], top: float | None) -> None:
    axes.set_xlabel(axis.name)
    if axis.words:
        axes.set_xticks(list(axis.at.values()), list(axis.at), rotation=20, ha="right", fontsize=8)
        axes.margins(x=0.15)
    elif axis.logarithmic:
        from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=6))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    if min(finite, default=0.0) > 0 and max(finite) > WIDE_SHARE * min(finite):
        from swarmer.observe.report_drawing import logarithmic

        logarithmic(axes)
    elif finite:
        axes.set_ylim(bottom=min(0.0, *finite))
    if top is not None:
        axes.axhline(top * 0.97, color=FAINT, lw=0.8, ls=":")


def _told_apart(names: Sequence[str], keys: Sequence[Key]) -> dict[Key, str]:
    """Of the other settings, what the lines differ in."""
    differ = [i for i in range(len(names)) if len({key[i] for key in keys}) > 1]
    return {key: ", ".join(f"{names[i]} {key[i]}" for i in differ) for key in keys}


def _some_never(measure: Measure, cells: Sequence[CellFigures]) -> bool:
    return any(
        math.isinf(cell.values[measure.column].estimate) for cell in cells if measure.column in cell.values
    )


def _ends(measure: Measure, cells: Sequence[CellFigures]) -> str:
    """From the least to the most, in words."""
    its = sorted(cell.values[measure.column].estimate for cell in cells if measure.column in cell.values)
    if not its:
        return "nothing"
    return " to ".join("never" if math.isinf(one) else f"{one:.3g}" for one in (its[0], its[-1]))


def _bounds(one: Interval | None) -> list[Any]:
    if one is None:
        return [None, None, None]
    return [
        "never" if math.isinf(value) else None if math.isnan(value) else float(f"{value:.6g}")
        for value in one[:3]
    ]


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
