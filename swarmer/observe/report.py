"""`swarmer report`: one HTML file about one run or several, from what is whole in their directories.

What a report of one run shows stands in `PARTS` and `FIGURES`, in this order. To add a section, write a function that
gets the saved run and gives a `Part`, or None where the run has nothing for it (its rules: report_page.py), and name it
in `PARTS`. It may listen to the moment that the view in space shows, and set it (report_assets/scene.js).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmer.engines.result import Event, Live, RunResult, Snapshot
from swarmer.errors import BadInput
from swarmer.observe import report_costs, report_figures, report_page, report_rounds, report_words
from swarmer.observe.cause_page import write_cause
from swarmer.observe.files import write_text
from swarmer.observe.progress import Progress
from swarmer.observe.report_data import RunData, data_of
from swarmer.observe.report_drawing import Absent, Figure
from swarmer.observe.report_hosts import hosts_part
from swarmer.observe.report_page import Part
from swarmer.observe.report_scene import scene_part
from swarmer.observe.report_several import several
from swarmer.observe.run_directory import REPORT
from swarmer.observe.saved_run import SavedRun, load
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.summary import has_swarms, make_summary

RUNS_MAX = 24
AT_ONE_SWARM = ("thaw", "one swarm")  # kind and text of the event

FIGURES: tuple[Callable[[RunData], Figure | Absent | None], ...] = (
    report_figures.hd_figure,
    report_figures.swarms_figure,
    report_figures.formation_figure,
    report_figures.cycles_figure,
    report_figures.sizes_figure,
    lambda data: report_rounds.merging_figure(data.run),
    lambda data: report_rounds.flights_figure(data.run),
    report_figures.work_figure,
    report_figures.states_figure,
    report_costs.distance_figure,
    report_figures.failures_figure,
    report_costs.rate_figure,
    report_costs.kinds_figure,
    report_costs.fidelity_figure,
    report_figures.clouds_figure,
)
OF_SWARMS = {
    report_figures.swarms_figure,
    report_figures.formation_figure,
    report_figures.cycles_figure,
    report_figures.sizes_figure,
}


def figures_part(run: SavedRun) -> Part | None:
    """The paper's figures for this run; None for a run without a sample."""
    data = data_of(run)
    if data is None:
        return None
    made = [make for make in FIGURES if has_swarms(run.summary) or make not in OF_SWARMS]
    return Part(
        "figures",
        "Figures",
        report_page.figures([one for make in made if (one := make(data)) is not None]),
    )


PARTS: tuple[Callable[[SavedRun], Part | None], ...] = (
    report_words.setting_part,
    scene_part,
    figures_part,
    hosts_part,
    report_words.summary_part,
    report_words.events_part,
)


def write_report(paths: list[Path], out: Path | None = None) -> Path:
    """Write the report and give its path.

    out: the file; None is RUN/report.html for one run, ./report.html for several. A file that is there is replaced
    only if it is a report. Raises BadInput for what is not a run directory, RunFailed if the file cannot be written.
    """
    if len(paths) > RUNS_MAX:
        raise BadInput(
            "run", f"{len(paths)} runs", f"at most {RUNS_MAX} in one report; `swarmer compare` takes more"
        )
    twice = next((path for i, path in enumerate(paths) if path.resolve() in _resolved(paths[:i])), None)
    if twice is not None:
        raise BadInput("run", str(twice), "each run once: it is named twice, and would count as two seeds")
    runs = [summed_up(load(path)) for path in paths]
    if out is None:
        out = paths[0] / REPORT if len(paths) == 1 else Path(REPORT)
    refuse_foreign(out)
    cause = [write_cause(runs[0], out, refuse_foreign)] if len(runs) == 1 else []
    write_text(out, make_report(runs, cause))
    return out


def _resolved(paths: Sequence[Path]) -> list[Path]:
    return [path.resolve() for path in paths]


def make_report(runs: list[SavedRun], cause: Sequence[Part] = ()) -> str:
    """The page as a text. cause: of one run, the part on why HD rose."""
    runs = [summed_up(run) for run in runs]
    return single(runs[0], cause) if len(runs) == 1 else several(runs)


def summed_up(run: SavedRun) -> SavedRun:
    """The run, with a summary of what there is if it left none."""
    run.summary = run.summary or derived_summary(run)
    return run


def single(run: SavedRun, cause: Sequence[Part] = ()) -> str:
    """The report of one run. cause: the part on why HD rose, which stands behind the figures."""
    above = [
        report_page.note(str(run.summary["message"])) if run.summary.get("message") else "",
        report_page.missing_note([run]),
        report_words.tiles(run),
    ]
    heading = report_words.heading(run)
    made = [part for make in PARTS if (part := make(run)) is not None]
    behind = next((i for i, part in enumerate(made) if part.key == "summary"), len(made))
    made[behind:behind] = cause
    return report_page.page(
        f"swarmer: {run.name}", heading, report_words.verdict(run), report_words.lead(run), "\n".join(above), made
    )  # fmt: skip


def derived_summary(run: SavedRun) -> dict[str, Any]:
    """What timeline and events tell of a run that left no summary; empty without a timeline."""
    timeline = run.timeline
    if timeline is None or not len(timeline.t_s):
        return {}
    standings = timeline.standings()
    progress = Progress.through(standings)
    live, alive = Live(None, None, None, None, None, None), np.ones(len(timeline.truth), dtype=np.bool_)
    for i, t_s in enumerate(timeline.t_s):
        position = timeline.position[i].astype(np.float64)
        snapshot = Snapshot(
            float(t_s), position, timeline.swarm[i], timeline.state[i], timeline.lit[i], alive, {}, live
        )
        progress.update(snapshot)
    counters = {
        name: float(values[-1]) for name, values in timeline.series.items() if np.isfinite(values[-1])
    }
    engine = str(run.config.get("engine", "?"))
    result = RunResult(
        engine, report_words.UNFINISHED, float(timeline.t_s[-1]), float("nan"), counters=counters
    )
    result.first_single_swarm_s = first_single_swarm(run.events, timeline)
    seed = run.config.get("seed", run.manifest.get("seed"))
    points = int(standings[0].member.sum())
    return make_summary(progress, result, run.shape, points, seed, len(timeline.truth))


def first_single_swarm(events: Sequence[Event], timeline: SavedTimeline) -> float | None:
    """When all were one swarm for the first time, by what was written down up to the last sample; None: not at all.

    A thaw at one swarm ends it before a sample shows it, but is counted; the engine tells of the centralized ones.
    Other thaws may have begun by the clock.
    """
    counted = timeline.series.get("thaws_at_one_swarm", np.zeros(0))
    known = [
        event.t_s
        for event in events
        if event.kind == "single_swarm" or (event.kind, event.text) == AT_ONE_SWARM
    ]
    if (seen := np.flatnonzero(counted > 0)).size:
        counted_s = float(timeline.t_s[seen[0]])
        begun = [event.t_s for event in events if event.kind == "thaw" and event.t_s <= counted_s]
        known.append(max(begun, default=counted_s))
    return min((t_s for t_s in known if t_s <= timeline.t_s[-1]), default=None)


def refuse_foreign(out: Path) -> None:
    """Raises BadInput if a file is there that is no report."""
    if out.is_dir():
        raise BadInput("out", str(out), "a file name; it is a directory")
    if not out.parent.is_dir():
        raise BadInput("out", str(out), "a file in a directory that is there")
    if not out.exists():
        return
    with out.open("rb") as file:
        if report_page.GENERATOR.encode() not in file.read(1000):
            raise BadInput("out", str(out), "a file is there that is no report of ours; choose another name")
