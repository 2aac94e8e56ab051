"""results.csv as people read it: a row for each cell of the grid, every figure with its interval.

When an HD was reached is a median, all else a mean; how the intervals come about says `metrics/intervals.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from swarmer.experiments.comparison import Measure
from swarmer.experiments.results import STATUS, read_results
from swarmer.metrics import intervals
from swarmer.metrics.intervals import NEVER, Interval
from swarmer.observe.words import count

Row = dict[str, str]
NOTHING = "–"  # of what no run of a cell has


class Column(NamedTuple):
    """A figure of a cell."""

    title: str
    name: str  # in results.csv
    show: Callable[[list[Row], str], str]


class Table(NamedTuple):
    """Titles and cells: the settings that vary, the number of runs, the figures."""

    titles: list[str]
    rows: list[list[str]]


def time_shown(rows: list[Row], name: str) -> str:
    """A median of times, with its interval; how many got there, if not all.

    >>> time_shown([{"t": "5.5"}, {"t": "7"}, {"t": ""}], "t")
    '7.0 (2/3)'
    """
    return _median_shown(rows, name, _seconds)


def rounds_shown(rows: list[Row], name: str) -> str:
    """A median of rounds, as of times.

    >>> rounds_shown([{"rounds": "9", "rounds_to_hd.1": "5"}, {"rounds": "", "rounds_to_hd.1": ""}], "rounds_to_hd.1")
    '5'
    """
    return _median_shown(rows, name, figure)


def _median_shown(rows: list[Row], name: str, show: Callable[[float], str]) -> str:
    """A run that does not count time in this unit has no such figure, which is not never."""
    clock = Measure(name, name).clock
    values = [float(row[name]) if row[name] else NEVER for row in rows if row[name] or row.get(clock) != ""]
    reached = sum(map(math.isfinite, values))
    if not reached:
        return "never" if values else NOTHING
    there = "" if reached == len(values) else f" ({reached}/{len(values)})"
    return bounded(intervals.median(values), show) + there


def mean_shown(rows: list[Row], name: str) -> str:
    """A mean of what is counted, so never below 0, with its interval.

    >>> mean_shown([{"n": "10"}, {"n": "12"}, {"n": "11"}], "n")
    '11.0 [8.5, 13.5]'
    >>> mean_shown([{"n": "0"}, {"n": "0"}, {"n": "1"}], "n")
    '0.3 [0.0, 1.8]'
    """
    return _mean_shown(rows, name, _amount)


def measured_shown(rows: list[Row], name: str) -> str:
    """A mean of what is measured and never below 0, however small.

    >>> measured_shown([{"hd": "0.04"}, {"hd": "0.02"}, {"hd": "0.03"}], "hd")
    '0.03 [0.00516, 0.0548]'
    """
    return _mean_shown(rows, name, figure)


def _mean_shown(rows: list[Row], name: str, show: Callable[[float], str]) -> str:
    values = [float(row[name]) for row in rows if row.get(name)]
    if not values:
        return NOTHING
    return bounded(intervals.mean(values).cut(), show)


def figure(value: float) -> str:
    """A number with three digits that say something.

    >>> figure(0.012345), figure(12.345), figure(161_234.5), figure(math.inf), figure(-math.inf)
    ('0.0123', '12.3', '161,234', 'never', '-∞')
    """
    if math.isinf(value):
        return "never" if value > 0 else "-∞"
    if abs(value) >= 1000:
        return count(value)
    return f"{value:.3g}"


def bounded(interval: Interval, show: Callable[[float], str]) -> str:
    """`7.1 [6.9, 7.4]`; the estimate alone where there are no bounds, or nothing between them."""
    if math.isnan(interval.low) or interval.low == interval.high:
        return show(interval.estimate)
    return f"{show(interval.estimate)} [{show(interval.low)}, {show(interval.high)}]"


def _seconds(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:.1f}"


def _amount(value: float) -> str:
    """A count, with one digit after the point where it is small.

    >>> _amount(6.25), _amount(161_234.5)
    ('6.2', '161,234')
    """
    return f"{value:.1f}" if abs(value) < 100 else count(value)


COLUMNS = (
    Column("HD < 1, s", "time_to_hd_s.1", time_shown),
    Column("< 0.1, s", "time_to_hd_s.0.1", time_shown),
    Column("< 0.01, s", "time_to_hd_s.0.01", time_shown),
    Column("< 0.001, s", "time_to_hd_s.0.001", time_shown),
    Column("thaws", "thaws", mean_shown),
    Column("wrong thaws", "wrong_thaws", mean_shown),
    Column("datagrams sent", "datagrams_sent", mean_shown),
)


IN_ROUNDS = (
    Column("rounds to HD < 0.09", "rounds_to_hd.0.09", rounds_shown),
    Column("HD at the end, cells", "hd_cells", measured_shown),
    Column("cells flown by an FLS", "distance_cells_mean", measured_shown),
)
"""Beside the others, of runs that count rounds: they have no seconds, and end where their HD is low."""


def table_of(path: Path, columns: Iterable[Column] | None = None) -> Table:
    """The table of a results.csv: a row per cell that has a finished run. Raises OSError, ValueError.

    columns: None is the usual ones. One of which no cell has anything is left out.
    """
    settings, rows = read_results(path)
    cells: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if row.get(STATUS) == "done":
            cells.setdefault(tuple(row[name] for name in settings), []).append(row)
    asked = _usual(rows) if columns is None else columns
    there = [column for column in asked if any(row.get(column.name) is not None for row in rows)]
    figures = [
        (column.title, [column.show(runs, column.name) for runs in cells.values()]) for column in there
    ]
    shown = [(title, its) for title, its in figures if set(its) != {NOTHING}]
    body = [
        [*(value or "null" for value in cell), str(len(runs)), *(its[at] for _, its in shown)]
        for at, (cell, runs) in enumerate(cells.items())
    ]
    return Table([*settings, "runs", *(title for title, _ in shown)], body)


def _usual(rows: Iterable[Row]) -> Iterable[Column]:
    """With rounds, if there are any; what is not counted in them stands behind."""
    if not any(row.get("rounds") for row in rows):
        return COLUMNS
    times = [column for column in COLUMNS if column.show is time_shown]
    return [*times, *IN_ROUNDS, *(column for column in COLUMNS if column not in times)]


def lines_of(path: Path, columns: Iterable[Column] | None = None) -> list[str]:
    """The table in aligned lines; none if no run is finished."""
    table = table_of(path, columns)
    if not table.rows:
        return []
    return aligned([table.titles, *table.rows])


def aligned(rows: list[list[str]]) -> list[str]:
    """Rows of one length as lines, each column as wide as its widest cell."""
    widths = [max(len(row[at]) for row in rows) for at in range(len(rows[0]))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def unfaithful(path: Path) -> int:
    """In how many finished runs the machine, or each FLS, was too slow to be believed. Raises OSError, ValueError."""
    _, rows = read_results(path)
    return sum(row.get(STATUS) == "done" and row.get("faithful") == "false" for row in rows)


def markdown_of(path: Path, columns: Iterable[Column] | None = None) -> str:
    """The table for a page."""
    table = table_of(path, columns)
    lines = [table.titles, ["---"] * len(table.titles), *table.rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
