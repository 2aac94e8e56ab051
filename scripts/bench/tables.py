"""What all tables share: the machine's line, columns, numbers as one reads them, medians over repeats."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median

Row = Sequence[object]


def machine_line() -> str:
    """Cores, model, load now, versions: what a figure means nothing without."""
    load = " ".join(f"{value:.1f}" for value in os.getloadavg())
    return (
        f"{len(os.sched_getaffinity(0))} cores, {cpu_model()}, {platform.system()} {platform.release()}, "
        f"Python {platform.python_version()}; load at the start {load}"
    )


def cpu_model() -> str:
    """The processor's name, as the system gives it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def show(title: str, columns: Row, rows: Iterable[Row], notes: Sequence[str] = ()) -> None:
    """One table, the first column to the left."""
    table = [[text(cell) for cell in row] for row in (columns, *rows)]
    widths = [max(len(row[at]) for row in table) for at in range(len(columns))]
    words = [all(" " in row[at] for row in table[1:]) for at in range(len(columns))]
    print(f"\n{title}")
    for number, row in enumerate(table):
        cells = [
            cell.ljust(widths[at]) if at == 0 or words[at] else cell.rjust(widths[at])
            for at, cell in enumerate(row)
        ]
        print("  " + "  ".join(cells).rstrip())
        if number == 0:
            print("  " + "  ".join("-" * width for width in widths))
    for note in notes:
        print(f"  {note}")
    print(end="", flush=True)


def text(cell: object) -> str:
    """A number with three digits that count; nothing as a dash."""
    if cell is None:
        return "-"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if not isinstance(cell, float):
        return str(cell)
    if cell == 0 or abs(cell) >= 100:
        return f"{cell:.0f}"
    return f"{cell:.{1 if abs(cell) >= 10 else 2 if abs(cell) >= 0.1 else 3}f}"


def ratio(cell: float, to: float) -> str:
    """`cell` as a multiple of `to`."""
    return f"x{text(cell / to)}" if to else "-"


def median_of(repeat: int, action: Callable[[], float]) -> float:
    """The median of so many tries."""
    return median(action() for _ in range(max(1, repeat)))
