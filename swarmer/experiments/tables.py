"""results.csv as people read it: a row for each cell of the grid, every figure with its interval.

Times to an HD are medians, thaws and datagrams means; how the intervals come about says `metrics/intervals.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from swarmer.experiments.results import STATUS, read_results
from swarmer.metrics import intervals
from swarmer.metrics.intervals import NEVER, Interval
from swarmer.observe.words import count

Row = dict[str, str]


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
    values = [float(row[name]) if row[name] else NEVER for row in rows]
    reached = sum(map(math.isfinite, values))
    if not reached:
        return "never"
    there = "" if reached == len(values) else f" ({reached}/{len(values)})"
    return bounded(intervals.median(values), _seconds) + there


def mean_shown(rows: list[Row], name: str) -> str:
    """A mean of what is counted, so never below 0, with its interval.

    >>> mean_shown([{"n": "10"}, {"n": "12"}, {"n": "11"}], "n")
    '11.0 [8.5, 13.5]'
    >>> mean_shown([{"n": "0"}, {"n": "0"}, {"n": "1"}], "n")
    '0.3 [0.0, 1.8]'
    """
    values = [float(row[name]) for row in rows if row.get(name)]
    if not values:
        return "–"
    mean = intervals.mean(values)
    return bounded(mean._replace(low=max(mean.low, 0.0)), _amount)


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


def table_of(path: Path, columns: Iterable[Column] = COLUMNS) -> Table:
    """The table of a results.csv: a row per cell that has a finished run. Raises OSError, ValueError."""
    settings, rows = read_results(path)
    cells: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if row.get(STATUS) == "done":
            cells.setdefault(tuple(row[name] for name in settings), []).append(row)
    shown = [column for column in columns if any(row.get(column.name) is not None for row in rows)]
    body = [
        [*(value or "null" for value in cell), str(len(runs)), *(column.show(runs, column.name) for column in shown)]
        for cell, runs in cells.items()
    ]  # fmt: skip
    return Table([*settings, "runs", *(column.title for column in shown)], body)


def lines_of(path: Path, columns: Iterable[Column] = COLUMNS) -> list[str]:
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


def markdown_of(path: Path, columns: Iterable[Column] = COLUMNS) -> str:
    """The table for a page."""
    table = table_of(path, columns)
    lines = [table.titles, ["---"] * len(table.titles), *table.rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
