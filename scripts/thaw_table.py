"""The thaw policies side by side, as Markdown: python scripts/thaw_table.py runs/thaw_policies

Reads the results.csv of a sweep. A table for each shape and loss, a row for each challenge interval and policy. Beside
the times stands how many times as long as `centralized` a policy took to HD < 0.01 cells, run by run on the same seeds.
"""

from __future__ import annotations

import sys
from pathlib import Path

from swarmer.experiments.results import RESULTS, STATUS, read_results
from swarmer.experiments.tables import COLUMNS, Row, bounded, time_shown
from swarmer.metrics.intervals import NEVER, median

POLICY, REFERENCE = "thaw.policy", "centralized"
TABLES_BY = ("shape", "radio.loss")  # what all rows of one table have in common
COMPARED = "time_to_hd_s.0.01"


def pages(path: Path) -> str:
    """All tables. path: of a results.csv. Raises OSError, ValueError."""
    settings, rows = read_results(path)
    done = [row for row in rows if row[STATUS] == "done"]
    within = [name for name in settings if name not in TABLES_BY]
    heads = [name for name in TABLES_BY if name in settings]
    parts = []
    for head, its in grouped(done, heads).items():
        said = ", ".join(f"{name} {value}" for name, value in zip(heads, head, strict=True))
        parts.append(f"**{said or 'all runs'}**\n\n{table(its, within)}")
    return "\n".join(parts)


def table(rows: list[Row], settings: list[str]) -> str:
    """One table: a row for each cell, in the order of the other settings, then of the policies as the file has them."""
    others = [name for name in settings if name != POLICY]
    shown = [
        one
        for one in COLUMNS
        if one.name in rows[0] and (one.show is time_shown or any(row[one.name] for row in rows))
    ]
    titles = [*others, POLICY, "runs", *(column.title for column in shown), f"× {REFERENCE}"]
    lines = [titles, ["---"] * len(titles)]
    for other, its in grouped(rows, others).items():
        cells = {policy[0]: runs for policy, runs in grouped(its, [POLICY]).items()}
        for policy, runs in cells.items():
            figures = [column.show(runs, column.name) for column in shown]
            ratio = against(runs, cells.get(REFERENCE, []))
            lines.append([*other, f"`{policy}`", str(len(runs)), *figures, ratio])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def grouped(rows: list[Row], names: list[str]) -> dict[tuple[str, ...], list[Row]]:
    """Rows that have the same values of `names`, in the order of their first."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return groups


def against(runs: list[Row], reference: list[Row]) -> str:
    """The median, over the seeds that both have, of a run's time by the reference's; its interval.

    A run that never got there took infinitely longer; a seed with which the reference never did is left out.
    """
    times = {row["seed"]: float(row[COMPARED]) for row in reference if row[COMPARED]}
    ratios = [
        (float(row[COMPARED]) if row[COMPARED] else NEVER) / times[row["seed"]] for row in runs if row["seed"] in times
    ]  # fmt: skip
    return (
        bounded(median(ratios), lambda ratio: "never" if ratio == NEVER else f"{ratio:.2f}")
        if ratios
        else "–"
    )


if __name__ == "__main__":
    try:
        (sweep,) = sys.argv[1:]
        print(pages(Path(sweep) / RESULTS), end="")
    except (OSError, ValueError) as error:
        sys.exit(f"error: {error}; usage: python scripts/thaw_table.py DIRECTORY_OF_A_SWEEP")
