"""`swarmer report`: one HTML file about one run or several, from what is whole in their directories."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from swarmer.config import setting_facts
from swarmer.engines.result import Live, RunResult, Snapshot
from swarmer.errors import BadInput
from swarmer.observe import report_figures, report_page
from swarmer.observe.files import write_text
from swarmer.observe.progress import Progress
from swarmer.observe.report_page import Section, Setting
from swarmer.observe.run_directory import REPORT
from swarmer.observe.saved_run import SavedRun, load
from swarmer.observe.summary import make_summary

RUNS_MAX = 24


def write_report(paths: list[Path], out: Path | None = None) -> Path:
    """Write the report and give its path.

    out: the file; None is RUN/report.html for one run, ./report.html for several. A file that is there is replaced
    only if it is a report. Raises BadInput for what is not a run directory, RunFailed if the file cannot be written.
    """
    if len(paths) > RUNS_MAX:
        raise BadInput(
            "run", f"{len(paths)} runs", f"at most {RUNS_MAX} in one report; `swarmer compare` takes more"
        )
    runs = [load(path) for path in paths]
    if out is None:
        out = paths[0] / REPORT if len(paths) == 1 else Path(REPORT)
    _refuse_foreign(out)
    write_text(out, make_report(runs))
    return out


def make_report(runs: list[SavedRun]) -> str:
    """The page as a text."""
    for run in runs:
        if not run.summary:
            run.summary = derived_summary(run)
    if len(runs) == 1:
        return report_page.single(runs[0], _own_figures(runs[0]), settings(runs[0].config))
    return report_page.several(runs, _shared_figures(runs), _differing(runs))


def derived_summary(run: SavedRun) -> dict[str, Any]:
    """What the timeline alone tells of a run that left no summary; empty without a timeline."""
    timeline = run.timeline
    if timeline is None or not len(timeline.t_s):
        return {}
    progress = Progress.of(timeline.truth)
    live, alive = Live(None, None, None, None, None, None), np.ones(len(timeline.truth), dtype=np.bool_)
    for i, t_s in enumerate(timeline.t_s):
        position = timeline.position[i].astype(np.float64)
        snapshot = Snapshot(
            float(t_s), position, timeline.swarm[i], timeline.state[i], timeline.lit[i], alive, {}, live
        )
        progress.update(snapshot)
    engine = str(run.config.get("engine", "?"))
    result = RunResult(engine, "unfinished", float(timeline.t_s[-1]), float("nan"))
    seed = run.config.get("seed", run.manifest.get("seed", 0))
    return make_summary(progress, result, run.shape, len(timeline.truth), seed)


def settings(config: dict[str, Any]) -> list[Setting]:
    """The settings of a run, those that differ from their default first."""
    flat = _flat(config)
    known = [fact for fact in setting_facts() if fact.name in flat]
    rows = [Setting(fact.name, flat.pop(fact.name), fact.default, fact.unit, fact.help) for fact in known]
    rows += [Setting(name, value, None, "", "") for name, value in flat.items()]
    return sorted(rows, key=lambda row: not row.changed)


def _flat(config: dict[str, Any], lead: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in config.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{lead}{name}.")
        else:
            flat[f"{lead}{name}"] = value
    return flat


def _differing(runs: list[SavedRun]) -> dict[str, list[Any]]:
    """Settings that are not the same in all runs, with their value in each."""
    flats = [_flat(run.config) for run in runs]
    names = dict.fromkeys(name for flat in flats for name in flat)
    rows = {name: [flat.get(name) for flat in flats] for name in names}
    return {name: values for name, values in rows.items() if any(value != values[0] for value in values)}


def _own_figures(run: SavedRun) -> list[Section]:
    timeline = run.timeline
    if timeline is None or not len(timeline.t_s):
        return []
    curve = [report_figures.Curve(run.name, timeline)]
    return [
        Section(
            "The display",
            report_figures.clouds_figure(timeline),
            "One colour a swarm; ground truth faint behind.",
        ),
        Section("Hausdorff distance", report_figures.hd_figure(curve, run.summary.get("time_to_hd_s")), ""),
        Section("Swarms", report_figures.swarms_figure(curve), ""),
        Section("States", report_figures.states_figure(timeline), ""),
    ]


def _shared_figures(runs: list[SavedRun]) -> list[Section]:
    labels = _labels(runs)
    seen = [(label, run.timeline) for label, run in zip(labels, runs, strict=True)]
    curves = [report_figures.Curve(label, line) for label, line in seen if line is not None and len(line.t_s)]
    if not curves:
        return []
    figures = [
        Section("Hausdorff distance", report_figures.hd_figure(curves), ""),
        Section("Swarms", report_figures.swarms_figure(curves), ""),
    ]
    return figures + [Section(label, report_figures.clouds_figure(line), "") for label, line in curves]


def _labels(runs: list[SavedRun]) -> list[str]:
    """A name for each run, each only once."""
    names = [run.name for run in runs]
    return [name if names.count(name) == 1 else f"{name} ({i})" for i, name in enumerate(names, 1)]


def _refuse_foreign(out: Path) -> None:
    if out.is_dir():
        raise BadInput("out", str(out), "a file name; it is a directory")
    if not out.exists():
        return
    with out.open("rb") as file:
        if report_page.GENERATOR.encode() not in file.read(1000):
            raise BadInput("out", str(out), "a file is there that is no report of ours; choose another name")
