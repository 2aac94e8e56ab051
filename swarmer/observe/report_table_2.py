"""A table in the shape of the paper's Table 2 (SwarMer, section 6): a column for each group of runs, what it took.

Means over the seeds with Student's 95 % interval. The paper's columns are values of λ, each of one run of 2 minutes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from swarmer.metrics import intervals
from swarmer.observe.report_page import esc, scrolling
from swarmer.observe.saved_run import SavedRun
from swarmer.observe.words import cells, count

Summary = dict[str, Any]


class Row(NamedTuple):
    """A figure of a run, and how it is written."""

    title: str
    of: Callable[[Summary], float | None]
    show: Callable[[float], str]


def _value(name: str, factor: float = 1.0) -> Callable[[Summary], float | None]:
    def read(summary: Summary) -> float | None:
        value = summary.get(name)
        return value * factor if isinstance(value, (int, float)) else None

    return read


def _each(name: str, total: str) -> Callable[[Summary], float | None]:
    """A mean of one FLS, or the rounds engine's total divided by their number."""

    def read(summary: Summary) -> float | None:
        value, cells_of_all, points = (summary.get(one) for one in (name, total, "points"))
        if value is None and isinstance(cells_of_all, (int, float)) and points:
            return cells_of_all / points
        return value if isinstance(value, (int, float)) else None

    return read


def expired_share(summary: Summary) -> float | None:
    """Leases expired, % of those granted; None where none was granted."""
    expired, granted = summary.get("leases_expired"), summary.get("leases_granted")
    return 100 * expired / granted if granted and expired is not None else None


ROWS = (
    Row("Emulated time, s", _value("emulated_s"), lambda value: f"{value:,.1f}"),
    Row("Rounds", _value("rounds"), lambda value: f"{value:,.1f}"),
    Row("Bytes sent, MB", _value("bytes_sent", 1e-6), lambda value: f"{value:,.1f}"),
    Row("Localizations", _value("localizations"), count),
    Row("Anchors", _value("anchorings"), count),
    Row("Thawed swarms", _value("thawed_flss"), count),
    Row("Leases expired", _value("leases_expired"), count),
    Row("Leases expired, % of granted", expired_share, lambda value: f"{value:.2f}"),
    Row("Average distance, cells", _value("distance_cells_mean"), cells),
    Row("of it localizing", _each("localizing_cells_mean", "distance_localizing_cells"), cells),
    Row("of it following", _each("following_cells_mean", "distance_swarm_cells"), cells),
    Row("HD at the end, cells", _value("hd_cells"), cells),
)


def table_2(groups: Sequence[tuple[str, Sequence[SavedRun]]]) -> str:
    """The table as HTML; rows for which no run has a value are left out."""
    head = "".join(f"<th scope=col>{esc(name)}</th>" for name, _ in groups)
    lines = []
    for row in ROWS:
        shown = [cell(row, [run.summary for run in runs]) for _, runs in groups]
        if set(shown) != {"–"}:
            cells_of_row = "".join(f"<td>{esc(text)}</td>" for text in shown)
            lines.append(f"<tr><th scope=row>{esc(row.title)}</th>{cells_of_row}</tr>")
    caption = (
        "In the shape of the paper's Table 2. Mean over the seeds with its 95 % interval, where there are several; a "
        "thawed swarm is an FLS that obeyed a thaw."
    )
    inside = (
        f"<table><caption>{caption}</caption><thead><tr><th scope=col>metric</th>{head}</tr></thead>"
        f"<tbody>{''.join(lines)}</tbody></table>"
    )
    return scrolling(inside, "What it took, by group")


def cell(row: Row, summaries: Sequence[Summary]) -> str:
    """A mean with its bounds; never below 0, for all of these are counts or distances."""
    values = [value for summary in summaries if (value := row.of(summary)) is not None]
    if not values:
        return "–"
    mean = intervals.mean(values)
    few = f" ({len(values)}/{len(summaries)})" if len(values) < len(summaries) else ""
    if math.isnan(mean.low) or mean.low == mean.high:
        return row.show(mean.estimate) + few
    return f"{row.show(mean.estimate)} [{row.show(max(mean.low, 0.0))}, {row.show(mean.high)}]{few}"
