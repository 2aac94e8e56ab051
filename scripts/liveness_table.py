"""In how many thaw cycles did one swarm form? As Markdown: python scripts/liveness_table.py runs/liveness

Reads a sweep whose thaws come at one swarm alone (configs/experiments/liveness.yaml), so every cycle that ended did so
in one swarm. The last cycle of a run is open: cut off by the run's end, or stuck. It counts as stuck if it was open for
more than three times the longest cycle that ended in any run of its cell, or if none ended. The exit status is 1 if a
run is stuck.
"""

from __future__ import annotations

import csv
import math
import sys
from pathlib import Path
from typing import NamedTuple

from swarmer.experiments.results import RESULTS, RUN, STATUS, read_results

TITLES = (
    "runs",
    "cycles",
    "in one swarm",
    "fewest in a run",
    "longest cycle, s",
    "longest open, s",
    "stuck runs",
)
PATIENCE = 3  # times the longest cycle that ended


class Cycles(NamedTuple):
    """The cycles of one run, in emulated seconds."""

    ended: list[float]  # how long each took that ended in one swarm
    open: float  # how long the last had lasted at the end of the run


def cycles_of(run: Path, emulated_s: float) -> Cycles:
    """From the run's events; the first cycle begins at the go signal. Raises OSError, ValueError."""
    with (run / "events.csv").open(newline="", encoding="utf-8") as file:
        thaws = [float(row["t_s"]) for row in csv.DictReader(file) if row["kind"] == "thaw"]
    begun = [0.0, *thaws]
    return Cycles([after - at for at, after in zip(begun, thaws, strict=False)], emulated_s - begun[-1])


def table(sweep: Path) -> tuple[str, int]:
    """The table, and how many runs are stuck. Raises OSError, ValueError."""
    settings, rows = read_results(sweep / RESULTS)
    cells: dict[tuple[str, ...], list[Cycles]] = {}
    for row in rows:
        if row[STATUS] == "done":
            cell = cells.setdefault(tuple(row[name] for name in settings), [])
            cell.append(cycles_of(sweep / row[RUN], float(row["emulated_s"])))
    lines = [[*settings, *TITLES], ["---"] * (len(settings) + len(TITLES))]
    stuck_runs = 0
    for cell, runs in cells.items():
        longest = max((time for run in runs for time in run.ended), default=math.nan)
        stuck = sum(not run.ended or run.open > PATIENCE * longest for run in runs)
        ended = sum(len(run.ended) for run in runs)
        fewest, still_open = min(len(run.ended) for run in runs), max(run.open for run in runs)
        figures = [len(runs), ended + stuck, ended, fewest, f"{longest:.1f}", f"{still_open:.1f}", stuck]
        lines.append([*cell, *map(str, figures)])
        stuck_runs += stuck
    return "".join(f"| {' | '.join(line)} |\n" for line in lines), stuck_runs


if __name__ == "__main__":
    try:
        (where,) = sys.argv[1:]
        text, number = table(Path(where))
    except (OSError, ValueError) as error:
        sys.exit(f"error: {error}; usage: python scripts/liveness_table.py DIRECTORY_OF_A_SWEEP")
    print(text, end="")
    sys.exit(number > 0)
