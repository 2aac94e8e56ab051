"""The report of several runs: those that differ in nothing but the seed are one group, a curve with its interval.

A curve is the mean over the seeds of a group with Student's 95 % interval; of HD, whose orders of magnitude count, the
mean of its logarithm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.metrics import intervals
from swarmer.observe import report_figures, report_page, report_words
from swarmer.observe.report_data import Curve, RunData, data_of
from swarmer.observe.report_drawing import (
    DASHES,
    FAINT,
    LINES,
    Absent,
    Clock,
    Figure,
    clock_of,
    columns_of,
    legend_above,
    logarithmic,
    over_time,
    rates,
    svg_of,
)
from swarmer.observe.report_page import Part, esc, scrolling
from swarmer.observe.report_table_2 import table_2
from swarmer.observe.report_values import text_of
from swarmer.observe.report_words import flat_settings, reached_of
from swarmer.observe.saved_run import SavedRun

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

# Settings in which runs of one group may differ: what chance does, and what the machine makes of it.
NOT_GROUPING = {"seed", "recording.enabled", "recording.rate_hz", "radio.port"}
REPEATING = ("virtual", "rounds")  # engines whose run is the same each time that it is made
GRID = 240  # moments at which the runs of a group are compared
CLOUDS_MAX = 4
LABEL_MAX = 60  # characters of a group's name, which stands above every figure
HD_FLOOR = 1e-9  # cells: the logarithm of nothing smaller is taken
OTHERWISE = "unset"


@dataclass(eq=False)
class Group:
    """Runs that differ in nothing but their seed."""

    label: str
    runs: list[SavedRun]
    data: list[RunData] = field(default_factory=list)  # of those that have samples

    @property
    def name(self) -> str:
        """The label with the number of runs, and of seeds where some have the same."""
        if len(self.runs) == 1:
            return self.label
        seeds = len({_seed(run) for run in self.runs})
        same = "" if seeds == len(self.runs) else f"{len(self.runs)} runs, "
        return f"{self.label} ({same}{seeds} seed{'s' * (seeds != 1)})"


class Overlay(NamedTuple):
    """A figure in which each group is one curve."""

    key: str
    title: str
    unit: str  # of its axis
    of: Callable[[RunData], Curve | None]
    scale: str = "linear"  # linear | log | counts, which is logarithmic with a place for 0
    caption: str = ""


def groups_of(runs: Sequence[SavedRun]) -> tuple[list[Group], dict[str, list[Any]]]:
    """The runs in groups, in the order of their first; and each setting that differs, with its value in every run."""
    flats = [_settings(run) for run in runs]
    names = dict.fromkeys(name for flat in flats for name in flat)
    values_of = {name: [flat.get(name) for flat in flats] for name in names}
    differing = {
        name: values for name, values in values_of.items() if any(value != values[0] for value in values)
    }
    telling = {name: values for name, values in differing.items() if name not in NOT_GROUPING}
    names_shown = _enough(telling)
    groups: dict[tuple[str, ...], Group] = {}
    for i, run in enumerate(runs):
        label = (
            ", ".join(f"{name} {_short(name, telling[name][i], run)}" for name in names_shown) or "all runs"
        )
        which = tuple(text_of(values[i]) for values in telling.values())
        if which not in groups:
            groups[which] = Group(_cut(label, len(groups) + 1), [])
        group = groups[which]
        group.runs.append(run)
        if (data := data_of(run)) is not None:
            group.data.append(data)
    return list(groups.values()), differing


def _cut(label: str, number: int) -> str:
    """A name that is too long ends in its number, so that no two are the same."""
    return label if len(label) <= LABEL_MAX else f"{label[: LABEL_MAX - 6]}… #{number}"


def _enough(telling: dict[str, list[Any]]) -> list[str]:
    """So few settings that they tell apart what all together do, and the engine, which says what the rest means: the
    others stand in the table.

    >>> _enough({"engine": ["rounds", "virtual"], "rounds.m": [2, 3], "lambda_ms": [5, 5]})
    ['engine']
    >>> _enough({"points": [60, 100], "engine": ["rounds", "virtual"]})
    ['engine', 'points']
    """
    found: list[str] = []
    told = 1
    for name in telling:
        tried = [telling[one] for one in (*found, name)]
        number = len({tuple(map(text_of, row)) for row in zip(*tried, strict=True)})
        if number > told:
            found, told = [*found, name], number
    return ["engine", *found] if "engine" in telling and "engine" not in found else found


def _settings(run: SavedRun) -> dict[str, Any]:
    flat = flat_settings(run.config)
    for name in ("shape", "engine", "seed"):  # where the settings are gone
        if name not in flat and run.summary.get(name) is not None:
            flat[name] = run.summary[name]
    return flat


def _short(name: str, value: Any, run: SavedRun) -> str:
    if value is None and name == "points":  # all that the shape has; a run that ended says how many
        value = run.summary.get(name, "all")
    text = OTHERWISE if value is None else text_of(value)
    return text if len(text) <= 40 else "…" + text[-39:]


# -- the page --------------------------------------------------------------------------------------------------------


def several(runs: Sequence[SavedRun]) -> str:
    """The report of several runs, side by side."""
    groups, differing = groups_of(runs)
    names = labels(runs)
    parts = [
        Part("table-2", "What it took", table_2([(group.name, group.runs) for group in groups])),
        Part("figures", "Figures", report_page.figures(_figures(groups))),
        Part("settings", "Settings that differ", _differing(names, differing)),
        Part("summary", "All numbers of every run", _summaries(names, runs)),
        Part("run", "To run them again", report_words.commands(runs)),
    ]
    above = report_page.missing_note(runs) + _mixed_note(runs, groups)
    return report_page.page(
        f"swarmer: {len(runs)} runs", f"{len(runs)} runs compared", verdict(groups), ", ".join(names), above, parts
    )  # fmt: skip


def verdict(groups: Sequence[Group]) -> str:
    """The comparison in one sentence: which group came how near how soon."""
    clocks = {clock_of(run) for group in groups for run in group.runs}
    if len(clocks) > 1:
        return (
            "Some of these runs count rounds and some emulated seconds: compare how near they came, not when."
        )
    clock = clocks.pop()
    found = {group.label: _nearest(group) for group in groups}
    common = max((name for near in found.values() for name in list(near)[:1]), key=float, default="1")
    told = []
    for group in groups:
        near = found[group.label]
        if not near:
            told.append((np.inf, np.inf, f"{group.name}: HD not below 1 cell"))
            continue
        least = min(near, key=float)
        said = [_reached(near[name], len(group.runs), name, clock) for name in dict.fromkeys((common, least))]
        told.append((float(least), _median(near[common]), f"{group.name}: HD {', '.join(said)}"))
    told.sort(key=lambda one: one[:2])
    how = " (medians)" if any(len(group.runs) > 1 for group in groups) else ""
    return "; ".join(words for *_, words in told) + how + "."


def _nearest(group: Group) -> dict[str, list[float | None]]:
    """When each run came below each threshold that most of the group came below, the lowest first."""
    times = [reached_of(run.summary) for run in group.runs]
    names = {key for one in times for key in one if key != "0.09"}
    reached = {name: [one.get(name) for one in times] for name in sorted(names, key=float)}
    return {
        name: all_of
        for name, all_of in reached.items()
        if sum(t is not None for t in all_of) * 2 > len(times)
    }


def _median(reached: Sequence[float | None]) -> float:
    return intervals.median([intervals.NEVER if t is None else float(t) for t in reached]).estimate


def _reached(reached: Sequence[float | None], runs: int, name: str, clock: Clock) -> str:
    few = sum(t is not None for t in reached)
    of = f" in {few} of {runs}" if few < runs else ""
    return f"below {name} {report_words.moment(_median(reached), clock)}{of}"


def _seed(run: SavedRun) -> Any:
    return _settings(run).get("seed")


def _repeated(groups: Sequence[Group]) -> list[str]:
    """Runs of an engine that repeats itself, made twice from the same seed: they are one, and no spread."""
    lines = []
    for group in groups:
        by_seed: dict[Any, list[SavedRun]] = {}
        for run in group.runs:
            if run.summary.get("engine") in REPEATING:
                by_seed.setdefault(_seed(run), []).append(run)
        for same in by_seed.values():
            if len(same) > 1:
                names = ", ".join(run.name for run in same)
                lines.append(f"{names}: the same run more than once: its intervals are too narrow.")
    return lines


def _mixed_note(runs: Sequence[SavedRun], groups: Sequence[Group]) -> str:
    """What to beware of where the runs are of different kinds."""
    lines = []
    shapes = list(dict.fromkeys(run.shape for run in runs))
    if len(shapes) > 1:
        lines.append(
            f"They are of different shapes ({', '.join(shapes)}): totals grow with the number of FLSs and HD with the "
            "size of the shape; shares, means of one FLS and times are what can be compared."
        )
    if len({clock_of(run) for run in runs}) > 1:
        lines.append(
            "Some count rounds, some emulated seconds: both stand on one axis of each figure, and a round is no second."
        )
    unlike = [run.name for run in runs if run.summary.get("faithful") is False]
    if unlike:
        lines.append(f"Not faithful, so their times are partly the machine's: {', '.join(unlike)}.")
    lines += _repeated(groups)
    return report_page.note("Before comparing:", lines) if lines else ""


def labels(runs: Sequence[SavedRun]) -> list[str]:
    """A name for each run, each only once."""
    names = [run.name for run in runs]
    return [name if names.count(name) == 1 else f"{name} ({i})" for i, name in enumerate(names, 1)]


def _differing(names: Sequence[str], differing: dict[str, list[Any]]) -> str:
    if not differing:
        return "<p>None: the runs differ in nothing that is set.</p>"
    return _side_by_side(names, {key: list(map(text_of, row)) for key, row in differing.items()}, "Settings")


def _summaries(names: Sequence[str], runs: Sequence[SavedRun]) -> str:
    keys = dict.fromkeys(key for run in runs for key in run.summary)
    rows = {key: [text_of(run.summary.get(key)) for run in runs] for key in keys if key != "format"}
    return _side_by_side(names, {key: row for key, row in rows.items() if set(row) != {"–"}}, "Summaries")


def _side_by_side(names: Sequence[str], rows: dict[str, list[str]], caption: str) -> str:
    head = "".join(f"<th scope=col>{esc(name)}</th>" for name in names)
    lines = "".join(
        f"<tr><td><code>{esc(key)}</code></td>{''.join(f'<td>{esc(text)}</td>' for text in row)}</tr>"
        for key, row in rows.items()
    )
    inside = f"<table><thead><tr><th scope=col>name</th>{head}</tr></thead><tbody>{lines}</tbody></table>"
    return scrolling(inside, caption)


# -- the figures -----------------------------------------------------------------------------------------------------


def _figures(groups: Sequence[Group]) -> list[Figure | Absent]:
    made = [overlay(one, groups) for one in OVERLAYS]
    shown = [group for group in groups if group.data][:CLOUDS_MAX]
    for i, group in enumerate(shown, 1):
        figure = report_figures.clouds_figure(group.data[0], f"clouds-{i}")
        made.append(figure._replace(title=f"The display: {group.label}"))
    return made


def overlay(one: Overlay, groups: Sequence[Group]) -> Figure | Absent:
    """Each group as a curve, with the interval over its seeds."""
    bands = []
    for group in groups:
        curves = [curve for data in group.data if (curve := one.of(data)) is not None and len(curve[0])]
        if curves:
            bands.append(
                (group, band(curves, one.scale == "log", 100.0 if one.unit.startswith("%") else np.inf))
            )
    if not bands:
        return Absent(one.title, "no run has data for it")
    clocks = {data.clock for group, _ in bands for data in group.data}
    clock = clocks.pop()
    label = "emulated time [s], or rounds" if clocks else clock.label

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        if one.scale != "linear":
            logarithmic(axes, zero=one.scale == "counts")
        for group, (t, middle, low, high) in bands:
            i = groups.index(group)  # in each figure the same colour
            colour, dash = LINES[i % len(LINES)], DASHES[i // 2 % len(DASHES)]
            shown = middle > 0 if one.scale == "log" else np.isfinite(middle)
            axes.plot(t[shown], middle[shown], color=colour, linestyle=dash, label=group.name)
            if np.isfinite(low).any():
                axes.fill_between(t, low, high, color=colour, alpha=0.2, linewidth=0)
        if one.scale == "log":
            for name in ("1", "0.1", "0.01"):
                axes.axhline(float(name), color=FAINT, linewidth=0.8, linestyle=(0, (2, 3)))
        axes.set_ylabel(one.unit)
        over_time(axes, clock)
        axes.set_xlabel(label)
        if one.scale == "linear":
            axes.set_ylim(bottom=0)
        if len(bands) > 1:
            legend_above(axes, 1 if len(bands) < 4 else 2, 7.5)

    rows = [[group.label, *row] for group, values in bands for row in columns_of(*values)]
    alt = "; ".join(f"{group.name}: {_last(values)} {one.unit} at the end" for group, values in bands)
    seeds = max(len(group.data) for group, _ in bands)
    spread = " The band is the 95 % interval of the mean over the seeds." if seeds > 1 else ""
    missing = [group.label for group in groups if group not in [which for which, _ in bands]]
    without = f" Without data: {', '.join(missing)}." if missing else ""
    titles = ["group", "t", "mean", "low_95", "high_95"]
    height = 2.75 + 0.16 * max(0, len(bands) // (1 if len(bands) < 4 else 2) - 1)
    return Figure(
        one.key, one.title, svg_of(one.key, alt, draw, height=height), (one.caption + spread + without).strip(), alt,
        titles, rows,
    )  # fmt: skip


def band(
    curves: Sequence[Curve], logarithm: bool = False, most: float = np.inf
) -> tuple[NDArray[np.float64], ...]:
    """Moments, mean, low, high of several curves on one grid, as far as all of them go; NaN bounds for a single one.

    logarithm: the mean is that of the logarithms, so it is the geometric one. Nothing here is below 0; most: or above.
    """
    begin, end = max(curve[0][0] for curve in curves), min(curve[0][-1] for curve in curves)
    if len(curves) == 1 or end <= begin:
        t, values = curves[0]
        return t, values, np.full(len(t), np.nan), np.full(len(t), np.nan)
    t = np.linspace(begin, end, GRID)
    stack = np.stack([np.interp(t, *curve) for curve in curves])
    if logarithm:
        stack = np.log(np.maximum(stack, HD_FLOOR))
    found = np.array([intervals.mean(column.tolist())[:3] for column in stack.T])
    found = np.exp(found) if logarithm else np.clip(found, 0.0, most)
    return t, found[:, 0], found[:, 1], found[:, 2]


def _last(values: tuple[NDArray[np.float64], ...]) -> str:
    return f"{values[1][-1]:.3g}"


def _rate(name: str, factor: float = 1.0) -> Callable[[RunData], Curve | None]:
    """How fast a total grows."""

    def curve(data: RunData) -> Curve | None:
        total = data.grows(name)
        return None if total is None else rates(data.t, total * factor, 60)

    return curve


def _total(name: str, each: bool = False) -> Callable[[RunData], Curve | None]:
    """A total over time; each: for one FLS in the mean."""

    def curve(data: RunData) -> Curve | None:
        found = data.series(name)
        return None if found is None else (data.t, np.nan_to_num(found) / (data.points if each else 1))

    return curve


def _state(at: int) -> Callable[[RunData], Curve]:
    return lambda data: (data.t, 100.0 * data.states[:, at] / data.points)


def _largest(data: RunData) -> Curve:
    return data.t, 100.0 * data.largest / data.points


def _dark(data: RunData) -> Curve | None:
    return (data.t, data.dark.astype(np.float64)) if data.dark.any() else None


def _cycle_swarms(data: RunData) -> Curve | None:
    """The mean number of swarms so long after a thaw, over all cycles."""
    cycles = [cycle for cycle in data.cycles[1:] if len(cycle.since_s) > 1]
    if not cycles:
        return None
    t = np.linspace(0, float(np.median([cycle.since_s[-1] for cycle in cycles])), 40)
    stack = [np.interp(t, cycle.since_s, cycle.swarms, right=np.nan) for cycle in cycles]
    return t, np.nanmean(np.vstack([*stack, np.interp(t, cycles[0].since_s, cycles[0].swarms)]), axis=0)


OVERLAYS = (
    Overlay("hd", "Hausdorff distance, translated", "cells", lambda data: data.hd, "log",
            "After moving all FLSs by the mean of their errors; of several seeds the geometric mean."),
    Overlay("hd-absolute", "Hausdorff distance, absolute", "cells", lambda data: data.hd_absolute, "log",
            "Without any move; of several seeds the geometric mean."),
    Overlay("swarms", "Swarms", "swarms", lambda data: (data.t, data.swarms.astype(np.float64)), "counts"),
    Overlay("cycles", "Swarms in a thaw cycle", "swarms", _cycle_swarms, "counts",
            "So long after a thaw, in the mean over a run's cycles."),
    Overlay("largest", "The largest swarm", "% of the FLSs", _largest),
    Overlay("localizations", "Localizations", "so far", _total("localizations")),
    Overlay("anchorings", "Anchorings", "so far", _total("anchorings")),
    Overlay("granted", "Leases granted", "so far", _total("leases_granted")),
    Overlay("expired", "Leases expired", "so far", _total("leases_expired")),
    Overlay("localizing", "Flown to localize", "cells an FLS, mean", _total("localizing_cells", each=True)),
    Overlay("following", "Flown to follow", "cells an FLS, mean", _total("following_cells", each=True)),
    Overlay("datagrams", "Datagrams sent per second", "per second", _rate("datagrams_sent")),
    Overlay("bytes", "Bytes sent per second", "kB per second", _rate("bytes_sent", 1e-3)),
    Overlay("available", "Available", "% of the FLSs", _state(1)),
    Overlay("busy", "Busy Anchor", "% of the FLSs", _state(2)),
    Overlay("busy-localizing", "Busy Localizing", "% of the FLSs", _state(3)),
    Overlay("waiting", "Waiting", "% of the FLSs", _state(4)),
    Overlay("dark", "Dark after a failure", "FLSs", _dark),
    Overlay("late", "Fidelity: messages late, p99", "emulated ms", _total("handled_late_p99_ms")),
)  # fmt: skip
