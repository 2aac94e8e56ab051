"""results.csv: one row per run that has ended, the settings that vary, the seed, then what its summary says.

`time_to_hd_s.0.1` is the value "0.1" within the summary's `time_to_hd_s`. Empty is null. A row of a failed run has its
status and its message. The last column, `run`, is the run's directory within the sweep's.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from swarmer.errors import BadInput
from swarmer.experiments.runs import Run, spelled
from swarmer.observe.files import write_text

RESULTS = "results.csv"
RUN = "run"
STATUS, MESSAGE = "status", "message"


class Results:
    """The rows of one sweep, in the order of its runs, whatever the order in which they end."""

    def __init__(self, path: Path, runs: Iterable[Run], varied: Iterable[str]) -> None:
        """path: of the table. varied: the settings that vary, the first columns."""
        self.path = path
        self._runs = list(runs)
        self._varied = list(varied)
        self._ended: dict[Path, Mapping[str, Any]] = {}

    def add(self, run: Run, summary: Mapping[str, Any] | None, message: str = "") -> None:
        """A run has ended. summary: None for one that failed before it had any."""
        self._ended[run.path] = flat(summary or {STATUS: "failed", MESSAGE: message})

    def write(self) -> None:
        """Write the table, whole or not at all. Raises RunFailed."""
        first = [*self._varied, "seed"]
        rest = [name for name in self._summary_names() if name not in first]
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow([*first, *rest, RUN])
        settings = {}
        for run in self._runs:
            row = self._ended.get(run.path)
            if row is not None:
                if run.cell not in settings:
                    settings[run.cell] = run.config.flat()
                own = [_cell(settings[run.cell][name]) for name in self._varied]
                table.writerow(
                    [*own, run.config.seed, *(_cell(row.get(name)) for name in rest), run.path.as_posix()]
                )
        write_text(self.path, text.getvalue())

    def _summary_names(self) -> list[str]:
        """What the summaries hold, in their order: that of whole ones, for a failed run may have two names alone."""
        rows = [self._ended[run.path] for run in self._runs if run.path in self._ended]
        rows.sort(key=lambda row: row.get(STATUS) != "done")
        return list(dict.fromkeys(name for row in rows for name in row))


def check_ours(path: Path) -> None:
    """Raises BadInput for a file in the table's place that is none of ours: it would be written over."""
    try:
        if path.exists():
            read_results(path)
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or error).removeprefix(f"{path}: ")
        raise BadInput.saying(f"out: {path}: {reason}; choose another directory with --out") from None


def flat(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The summary with the values inside its values under names of their own.

    >>> flat({"thaws": 6, "time_to_hd_s": {"1": 5.5, "0.1": None}})
    {'thaws': 6, 'time_to_hd_s.1': 5.5, 'time_to_hd_s.0.1': None}
    """
    row: dict[str, Any] = {}
    for name, value in summary.items():
        if isinstance(value, dict):
            row |= {f"{name}.{inner}": entry for inner, entry in value.items()}
        else:
            row[name] = value
    return row


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return json.dumps(value) if isinstance(value, list | dict) else spelled(value)


def read_results(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """The settings that vary, and the rows, of a table that `Results` wrote. Raises OSError, ValueError."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            table = csv.DictReader(file)
            columns = list(table.fieldnames or ())
            if "seed" not in columns or RUN not in columns:
                raise ValueError(f"{path}: is not a table of runs: no column seed or {RUN}")
            return columns[: columns.index("seed")], list(table)
    except (csv.Error, MemoryError) as error:
        why = str(error) or "it does not fit into memory"
        raise ValueError(f"{path}: is not a table of runs: {why}") from None
