"""Tables of the pages on oracles and on charging, as Markdown: python scripts/figures_table.py oracles runs/oracles

Reads the results.csv of a sweep; a row for each cell, medians and means with intervals as docs/sweeps.md has them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from swarmer.experiments.results import RESULTS
from swarmer.experiments.tables import Column, Row, bounded, markdown_of, mean_shown, time_shown
from swarmer.metrics import intervals


def fine(rows: list[Row], name: str) -> str:
    """A mean of something small, never below 0, with its interval.

    >>> fine([{"hd": "0.5"}, {"hd": "0.5"}], "hd")
    '0.500'
    """
    values = [float(row[name]) for row in rows if row.get(name)]
    if not values:
        return "–"
    mean = intervals.mean(values)
    return bounded(mean._replace(low=max(mean.low, 0.0)), lambda value: f"{value:.3f}")


PAGES = {
    "oracles": (
        Column("HD < 0.1, s", "time_to_hd_s.0.1", time_shown),
        Column("absolute HD < 0.1, s", "time_to_hd_absolute_s.0.1", time_shown),
        Column("absolute HD < 0.01, s", "time_to_hd_absolute_s.0.01", time_shown),
        Column("HD at the end", "hd_cells", fine),
        Column("absolute HD at the end", "hd_absolute_cells", fine),
    ),
}

PAGES["standbys"] = (
    Column("lit, mean", "illumination_mean", fine),
    Column("lit, least", "illumination_min", fine),
    Column("fully lit", "fully_lit_share", fine),
    Column("median HD, cells", "hd_median_cells", fine),
    Column("departures", "departures", mean_shown),
)

if __name__ == "__main__":
    try:
        page, sweep = sys.argv[1:]
        print(markdown_of(Path(sweep) / RESULTS, PAGES[page]), end="")
    except (OSError, ValueError, KeyError) as error:
        sys.exit(
            f"error: {error}; usage: python scripts/figures_table.py {'|'.join(PAGES)} DIRECTORY_OF_A_SWEEP"
        )
