"""The report over a sweep: one HTML file with its figures, its table, what failed, and the experiment itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from swarmer.errors import BadInput
from swarmer.experiments.comparison import Measure, Row
from swarmer.experiments.experiment import EXPERIMENT
from swarmer.experiments.results import MESSAGE, RESULTS, RUN, STATUS, read_results
from swarmer.experiments.sweep_directory import written_name
from swarmer.experiments.sweep_figures import CellFigures, cells_of, figure_of, measures_of, swept
from swarmer.experiments.tables import table_of, unfaithful
from swarmer.observe import report_page
from swarmer.observe.files import write_text
from swarmer.observe.report import refuse_foreign
from swarmer.observe.report_drawing import Absent, Figure
from swarmer.observe.report_page import Part
from swarmer.observe.run_directory import REPORT

FAILED_SHOWN = 50


def is_sweep(path: Path) -> bool:
    """Is it the directory of a sweep?"""
    return (path / RESULTS).is_file() and written_name(path / EXPERIMENT) is not None


def write_sweep_report(sweep: Path, out: Path | None = None) -> Path:
    """Write the report over a sweep's directory and give its path.

    out: the file; None is SWEEP/report.html. Raises BadInput for a table of another format, or none finished in it;
    RunFailed if the file cannot be written.
    """
    try:
        settings, rows = read_results(sweep / RESULTS)
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or error).removeprefix(f"{sweep / RESULTS}: ")
        raise BadInput(
            "run", str(sweep), f"the directory of a run or a sweep; its {RESULTS}: {reason}"
        ) from None
    if not any(row.get(STATUS) == "done" for row in rows):
        raise BadInput("run", str(sweep), "a sweep with a finished run; none is finished there")
    out = out or sweep / REPORT
    refuse_foreign(out)
    write_text(out, page_of(sweep, settings, rows))
    return out


def page_of(sweep: Path, settings: list[str], rows: list[Row]) -> str:
    """The page as a text."""
    name = written_name(sweep / EXPERIMENT) or sweep.name
    measures = measures_of(rows)
    cells = cells_of(settings, rows, measures)
    parts = [
        Part("figures", "Figures", report_page.figures(_figures(measures, settings, cells))),
        _table_part(sweep / RESULTS),
        *_failed_part(rows),
        _experiment_part(sweep),
    ]
    done = sum(row.get(STATUS) == "done" for row in rows)
    lead = f"{_counted(done, 'finished run')} of {_counted(len(cells), 'cell')}; "
    lead += f"swept: {', '.join(settings) or 'the seed alone'}"
    heading = f"The sweep {name}"
    return report_page.page(
        f"swarmer: {name}", heading, verdict(measures, settings, cells), lead, _notes(sweep), parts
    )


def verdict(measures: Sequence[Measure], settings: Sequence[str], cells: Sequence[CellFigures]) -> str:
    """Which cell was best in each measure, in a sentence."""
    told = []
    for measure in measures:
        having = [cell for cell in cells if measure.column in cell.values]
        best = min(having, key=lambda cell: cell.values[measure.column].estimate)
        value = best.values[measure.column].estimate
        if math.isinf(value):
            told.append(f"{measure.title}: never")
            continue
        where = ", ".join(f"{name}={value}" for name, value in zip(settings, best.key, strict=True))
        told.append(
            f"least {measure.title}: {value:.3g}" + (f" ({where})" if where and len(having) > 1 else "")
        )
    text = "; ".join(told) + "."
    return text[:1].upper() + text[1:]


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _figures(
    measures: Sequence[Measure], settings: Sequence[str], cells: Sequence[CellFigures]
) -> list[Figure | Absent]:
    axes = swept(settings, cells)
    if not axes:
        return [Absent("Measures over settings", "only the seed varies")]
    return [figure_of(measure, settings, cells, axes) for measure in measures]


def _table_part(results: Path) -> Part:
    shown = table_of(results)
    words = (
        "When an HD was reached is a median with an interval by ranks, all else a mean with Student's t, both of 95 %; "
        "(6/10) is how many of the runs got there."
    )
    table = report_page.table(shown.titles, shown.rows, "A row for each cell")
    return Part("table", "Every cell", f"<p>{report_page.esc(words)}</p>{table}")


def _failed_part(rows: Sequence[Row]) -> list[Part]:
    failed = [row for row in rows if row.get(STATUS) != "done"]
    if not failed:
        return []
    lines = [[row[RUN], row.get(STATUS) or "", row.get(MESSAGE) or ""] for row in failed[:FAILED_SHOWN]]
    caption = f"{len(failed)} runs; the same command makes them anew"
    return [
        Part("failed", "Runs that failed", report_page.table(["run", "status", "message"], lines, caption))
    ]


def _experiment_part(sweep: Path) -> Part:
    text = (sweep / EXPERIMENT).read_text("utf-8", errors="replace")
    again = f"swarmer sweep {sweep / EXPERIMENT}"
    box = report_page.scrolling(f"<pre>{report_page.esc(text)}</pre>", "The experiment's file")
    return Part("experiment", "The experiment", f"<p><code>{report_page.esc(again)}</code></p>{box}")


def _notes(sweep: Path) -> str:
    late = unfaithful(sweep / RESULTS)
    return report_page.note(f"{late} runs are not faithful: see the column of that name.") if late else ""
