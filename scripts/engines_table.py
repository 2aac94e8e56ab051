"""The two engines side by side, as Markdown: python scripts/engines_table.py runs/two_engines

Reads the run directories of a sweep whose grid has both engines. A table for each cell of the other settings, a row for
each quantity: its mean in either engine with an interval of 95 %, what they differ by, and whether the intervals
overlap. HD is compared, and averaged, by its logarithm. Ends with status 1 if any do not overlap.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

from swarmer.experiments.results import RESULTS, RUN, STATUS, read_results
from swarmer.experiments.tables import Row
from swarmer.experiments.two_engines import Comparison, compare, figures_of
from swarmer.metrics.intervals import Interval

ENGINE, ENGINES = "engine", ("process", "virtual")
TITLES = ("", *(f"`{engine}`" for engine in ENGINES), "difference", "intervals")


def tables(sweep: Path) -> tuple[str, int]:
    """All tables of a sweep's directory, and how many rows are apart. Raises OSError, KeyError, ValueError."""
    settings, rows = read_results(sweep / RESULTS)
    if ENGINE not in settings:
        raise ValueError(f"{sweep}: the engine does not vary")
    others = [name for name in settings if name != ENGINE]
    cells: dict[tuple[str, ...], dict[str, list[Row]]] = {}
    for row in rows:
        cells.setdefault(tuple(row[name] for name in others), {}).setdefault(row[ENGINE], []).append(row)
    parts, apart = [], 0
    for cell, by_engine in cells.items():
        missing = [engine for engine in ENGINES if engine not in by_engine]
        if missing:
            raise ValueError(f"{sweep}: there is no run with the engine {missing[0]}")
        done = [[row for row in by_engine[engine] if row[STATUS] == "done"] for engine in ENGINES]
        found = compare(*([figures_of(sweep / row[RUN]) for row in its] for its in done))
        apart += sum(one.apart for one in found)
        head = ", ".join(f"`{name}` {value}" for name, value in zip(others, cell, strict=True))
        counts = "; ".join(_count(engine, by_engine[engine]) for engine in ENGINES)
        lines = [TITLES, ["---"] * len(TITLES), *map(cells_of, found)]
        parts.append(
            f"**{head or 'all runs'}** ({counts})\n\n"
            + "".join(f"| {' | '.join(line)} |\n" for line in lines)
        )
    return "\n".join(parts), apart


def _count(engine: str, rows: list[Row]) -> str:
    """How many runs an engine made, and what cannot be said of all of them."""
    done = [row for row in rows if row[STATUS] == "done"]
    faithful = sum(row["faithful"] == "true" for row in done)
    failed = f", {len(rows) - len(done)} failed" if len(rows) > len(done) else ""
    return f"{engine}: {len(done)} runs, {faithful} of them faithful{failed}"


def cells_of(comparison: Comparison) -> list[str]:
    """A row of a table."""
    is_hd = comparison.quantity.startswith("HD")
    show: Callable[[float], str] = _power if is_hd else _number
    return [
        comparison.quantity,
        bounded(comparison.one, show),
        bounded(comparison.other, show),
        bounded(comparison.difference, _ratio if is_hd else _signed),
        "**apart**" if comparison.apart else "overlap",
    ]


def bounded(interval: Interval, show: Callable[[float], str]) -> str:
    """An estimate with its bounds, where it has any."""
    if math.isnan(interval.low) or interval.low == interval.high:
        return show(interval.estimate)
    return f"{show(interval.estimate)} [{show(interval.low)}, {show(interval.high)}]"


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.1f}" if abs(value) >= 10 else f"{value:.2f}"


def _signed(value: float) -> str:
    return ("+" if value > 0 else "") + _number(value)


def _power(value: float) -> str:
    return "–" if math.isnan(value) else f"{10**value:.2g}"


def _ratio(value: float) -> str:
    return "–" if math.isnan(value) else f"× {10**value:.2f}"


if __name__ == "__main__":
    try:
        (given,) = sys.argv[1:]
        text, rows_apart = tables(Path(given))
    except (OSError, KeyError, ValueError) as error:
        sys.exit(f"error: {error}; usage: python scripts/engines_table.py DIRECTORY_OF_A_SWEEP")
    print(text, end="")
    sys.exit(1 if rows_apart else 0)
