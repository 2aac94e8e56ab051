"""The paper's figures (SwarMer, sections 4 and 6) for one run: the swarm, its work, its distances."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from swarmer.observe.palette import STATE_COLOURS, STATES, Palette
from swarmer.observe.progress import THRESHOLDS
from swarmer.observe.report_data import FAILURES, RunData
from swarmer.observe.report_drawing import (
    FAINT,
    LINES,
    RAMP,
    SOFT,
    Absent,
    Figure,
    columns_of,
    legend_above,
    logarithmic,
    over_time,
    svg_of,
    thinned,
)
from swarmer.observe.report_marks import draw_marks, over_run, said_of
from swarmer.observe.report_words import moment, reached_of
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.summary import has_swarms
from swarmer.observe.words import cells, swarms
from swarmer.shapes.views import seen_from, usual_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

VECTOR_POINTS = 3000  # a cloud of more points is drawn as pixels
CSV_POINTS = 5000  # of a cloud that are written down in the page; all are in timeline.npz
CYCLES_DRAWN = 60
SHORT = 0.4  # of a run: a formation that took less is drawn once more, larger
OLD = "this run was written by a version that did not keep it"
SILENCE = "no datagram was sent"
NO_RADIO = "this engine has no radio, or the run is of a version that did not keep it"
WORK = (
    ("localizations", "localizations"), ("anchorings", "anchorings"), ("leases_granted", "leases granted"),
    ("leases_expired", "leases expired"),
)  # fmt: skip


def hd_figure(data: RunData) -> Figure | Absent:
    """HD over time, with and without translation, thresholds dotted, thaws below."""
    title, (t, hd) = "Hausdorff distance", data.hd
    if not len(t):
        return Absent(title, "never were two FLSs lit at once")
    t_absolute, absolute = data.hd_absolute
    reached = reached_of(data.run.summary)

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        logarithmic(axes)
        axes.plot(*thinned(t[hd > 0], hd[hd > 0]), color=LINES[0], label="translated")
        shown = absolute > 0
        axes.plot(
            *thinned(t_absolute[shown], absolute[shown]),
            color=LINES[1],
            linestyle=(0, (4, 2)),
            label="absolute",
        )
        _thresholds(axes, min(hd[hd > 0], default=1.0))
        for name, at in reached.items():
            if at is not None and name != "0.09":
                axes.plot([at], [float(name)], "o", color=LINES[0], markersize=4)
        _thaw_marks(axes, data)
        axes.set_ylabel("HD [cells]")
        over_run(axes, data.clock, data.marks, 2, named=True)

    first, last = hd[0], hd[-1]
    below = ", ".join(
        f"below {name} {moment(at, data.clock)}" for name, at in reached.items() if at is not None
    )
    alt = f"HD falls from {cells(first)} cells to {cells(last)} at the end" if last < first else (
        f"HD goes from {cells(first)} cells to {cells(last)} at the end"
    )  # fmt: skip
    rows = columns_of(
        t, hd, np.interp(t, t_absolute, absolute) if len(t_absolute) else np.full(len(t), np.nan)
    )
    caption = (
        "Of the lit FLSs, logarithmic. Translated: after moving all by the mean of their errors, as in the paper, for "
        "SwarMer is relative; absolute: without. Dots: first below 1, 0.1, ... cells. Ticks at the bottom: thaws."
        f"{said_of(data.marks, data.clock)}"
    )
    return Figure(
        "hd", title, svg_of("hd", f"{alt}. {below}", draw), caption, alt,
        [data.clock.column, "hd_cells", "hd_absolute_cells"], rows,
    )  # fmt: skip


def formation_figure(data: RunData) -> Figure | None:
    """HD and swarms until the shape was formed, where that is a small part of the run."""
    reached = [at for at in reached_of(data.run.summary).values() if at is not None]
    until = 1.25 * max(reached, default=np.inf)
    t, hd = data.hd
    if not until < SHORT * float(data.t[-1]) or not len(t):
        return None
    shown, early = (hd > 0) & (t <= until), data.t <= until

    def draw(canvas: Canvas) -> None:
        above, below = canvas.subplots(2, 1, sharex=True)
        logarithmic(above)
        logarithmic(below, zero=True)
        above.plot(t[shown], hd[shown], color=LINES[0])
        below.plot(data.t[early], data.swarms[early], color=LINES[2])
        above.set_ylabel("HD [cells]")
        below.set_ylabel("swarms")
        for axes in (above, below):
            thaws = data.moments("thaw")
            axes.vlines(
                thaws[thaws <= until],
                0,
                0.06,
                transform=axes.get_xaxis_transform(),
                color=SOFT,
                linewidth=0.8,
            )
        draw_marks(above, data.marks)
        over_run(below, data.clock, data.marks)
        below.set_xlim(0, until)

    alt = f"The beginning of the run, up to {data.clock.say(until)}: HD falls to {cells(hd[t <= until][-1])} cells"
    caption = "The same two curves, larger: each merge to one swarm and the thaw after it (ticks) lowers HD by a step."
    rows = columns_of(data.t[early], data.timeline.hd_cells[early], data.swarms[early])
    return Figure(
        "formation", "The formation", svg_of("formation", alt, draw, height=3.1), caption, alt,
        [data.clock.column, "hd_cells", "swarms"], rows,
    )  # fmt: skip


def _thresholds(axes: Axes, lowest: float) -> None:
    for name in THRESHOLDS:
        if float(name) > 0.5 * lowest and name != "0.09":
            axes.axhline(float(name), color=FAINT, linewidth=0.8, linestyle=(0, (2, 3)))


def _thaw_marks(axes: Axes, data: RunData) -> None:
    thaws = data.moments("thaw")
    if len(thaws):
        axes.vlines(thaws, 0, 0.035, transform=axes.get_xaxis_transform(), color=SOFT, linewidth=0.8)


def swarms_figure(data: RunData) -> Figure:
    """How many swarms, and how large the largest."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        logarithmic(axes, zero=True)
        axes.plot(*thinned(data.t, data.swarms), color=LINES[0], label="swarms")
        axes.plot(
            *thinned(data.t, data.largest), color=LINES[2], linestyle=(0, (4, 2)), label="FLSs in the largest"
        )
        _thaw_marks(axes, data)
        over_run(axes, data.clock, data.marks, 2)

    last = swarms(int(data.swarms[-1]))
    alt = f"Up to {data.swarms.max()} swarms; {last} at the end, the largest of {data.largest[-1]}"
    caption = "Logarithmic, with a place for 0. At a thaw each FLS is a swarm of its own again. Ticks: thaws."
    rows = columns_of(data.t, data.swarms, data.largest)
    return Figure(
        "swarms", "Swarms", svg_of("swarms", alt, draw), caption, alt, [data.clock.column, "swarms", "largest"], rows
    )  # fmt: skip


def cycles_figure(data: RunData) -> Figure | Absent:
    """Swarms since the last thaw, a line for each cycle."""
    title, cycles = "Swarms in each thaw cycle", data.cycles
    if len(cycles) < 2:
        return Absent(title, "the display never thawed")
    drawn = cycles[1:][:: -(-len(cycles) // CYCLES_DRAWN)]

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        logarithmic(axes, zero=True)
        first = cycles[0]
        axes.plot(
            first.since_s, first.swarms, color=LINES[1], linestyle=(0, (4, 2)), label="from the deployment on"
        )
        for i, cycle in enumerate(drawn):
            shade = RAMP[round((len(RAMP) - 1) * i / max(len(drawn) - 1, 1))]
            label = (
                "after a thaw"
                if len(drawn) == 1
                else {0: "after the first thaw", len(drawn) - 1: "after the last"}.get(i)
            )
            axes.plot(
                cycle.since_s, cycle.swarms, color=shade, linewidth=1.0, marker=".", markersize=2, label=label
            )
        axes.set_xlim(
            0, max(1.5 * np.median([cycle.since_s[-1] for cycle in drawn]), 1e-3, first.since_s[-1])
        )
        axes.set_ylabel("swarms")
        over_time(axes, data.clock, 3)
        axes.set_xlabel(data.clock.since)

    rows = [
        [
            i,
            *columns_of(
                [cycle.begin_s], [cycle.end_s - cycle.begin_s], [cycle.swarms.max()], [cycle.swarms.min()]
            )[0],
        ]
        for i, cycle in enumerate(cycles)
    ]
    single = sum(int(cycle.swarms.min()) == 1 for cycle in cycles)
    alt = f"{len(cycles)} cycles; a sample shows one swarm in {single} of them"
    caption = (
        "The line is a cycle" if len(drawn) == 1 else f"Each line is one of {len(drawn)} cycles"
    ) + ", from a thaw to the next. A thaw at one swarm ends it at once, so samples often miss that moment."
    titles = [
        "cycle",
        f"begin_{data.clock.column}",
        f"length_{data.clock.column}",
        "most_swarms",
        "fewest_swarms",
    ]
    return Figure("cycles", title, svg_of("cycles", alt, draw), caption, alt, titles, rows)


def sizes_figure(data: RunData) -> Figure:
    """In swarms of which size the FLSs are, stacked."""
    edges = [1, 2]
    while edges[-1] <= data.points:
        edges.append(4 * edges[-1] if len(edges) > 2 else 5)
    edges = [edge for edge in edges if edge <= data.points][: len(RAMP)]
    bounds = np.array([*edges, np.inf])
    counts = np.stack([np.histogram(sizes, bounds, weights=sizes)[0] for sizes in data.sizes])
    names = [_size_name(low, high, data.points) for low, high in pairwise(bounds)]

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        axes.stackplot(data.t, 100 * counts.T / data.points, colors=RAMP, labels=names, linewidth=0)
        axes.set_ylabel("% of the FLSs, in swarms of ...")
        axes.set_ylim(0, 100)
        over_run(axes, data.clock, data.marks, len(names))

    alone = 100 * counts[-1, 0] / data.points
    most = f"{data.largest[-1]} of {data.points}"
    alt = f"At the end {alone:.0f} % of the FLSs are alone and the largest swarm has {most}"
    caption = "The share of the FLSs that are in a swarm of each size; what is missing to 100 % is dark."
    rows = columns_of(data.t, *counts.T)
    titles = [data.clock.column, *(f"flss_in_swarms_of_{name.replace('–', '_to_')}" for name in names)]
    return Figure("sizes", "Sizes of swarms", svg_of("sizes", alt, draw), caption, alt, titles, rows)


def _size_name(low: float, high: float, points: int) -> str:
    last = min(high - 1, points)
    return f"{low:.0f}" if last <= low else f"{low:.0f}–{last:.0f}"


def work_figure(data: RunData) -> Figure | Absent:
    """Localizations, anchorings, leases: totals over time."""
    title = "Localizations, anchorings, leases"
    known = [(label, name, data.series(name)) for name, label in WORK]
    shown = [(label, name, values) for label, name, values in known if values is not None]
    if not shown:
        return Absent(title, OLD)

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        logarithmic(axes, zero=True)
        for i, (label, _, values) in enumerate(shown):
            style = ("-", (0, (4, 2)), "-", (0, (1.5, 1.5)))[i % 4]
            axes.plot(*thinned(data.t, values), color=LINES[i], linestyle=style, label=label)
        axes.set_ylabel("so far")
        over_run(axes, data.clock, data.marks, 4)

    alt = "At the end: " + ", ".join(f"{label} {values[-1]:,.0f}" for label, _, values in shown)
    caption = "Totals of all FLSs, logarithmic. A lease expires if its localizer was not heard of in time."
    rows = columns_of(data.t, *(values for *_, values in shown))
    titles = [data.clock.column, *(name for _, name, _ in shown)]
    return Figure("work", title, svg_of("work", alt, draw), caption, alt, titles, rows)


def failures_figure(data: RunData) -> Figure | Absent:
    """HD and who is dark, with the moments of failures."""
    title, failed = "What failures do to HD", data.moments(*FAILURES)
    if not len(failed):
        return Absent(title, "no FLS failed")
    (t, hd), replaced = data.hd, data.moments("replacement")

    def draw(canvas: Canvas) -> None:
        above, below = canvas.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        logarithmic(above)
        if len(t):
            above.plot(*thinned(t[hd > 0], hd[hd > 0]), color=LINES[0])
        above.vlines(
            failed,
            0,
            0.08,
            transform=above.get_xaxis_transform(),
            color=LINES[1],
            linewidth=0.9,
            label="a failure",
        )
        above.set_ylabel("HD [cells]")
        legend_above(above, 1)
        draw_marks(above, data.marks)
        below.plot(*thinned(data.t, data.dark), color=LINES[1], drawstyle="steps-post")
        below.set_ylabel("dark FLSs")
        below.set_ylim(bottom=0)
        over_run(below, data.clock, data.marks)

    alt = (
        f"{len(failed)} failures and {len(replaced)} replacements; up to {data.dark.max()} FLSs dark at once"
    )
    caption = (
        "HD rises when a replacement arrives, with the error of its flight, and falls again as it localizes. Below: "
        "FLSs that were lit once and are dark."
    )
    rows = columns_of(data.t, data.timeline.hd_cells, data.dark)
    return Figure(
        "failures", title, svg_of("failures", alt, draw, height=3.1), caption, alt,
        [data.clock.column, "hd_cells", "dark"], rows,
    )  # fmt: skip


def states_figure(data: RunData) -> Figure:
    """FLSs in each state over time, stacked."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        t, states = thinned(data.t, data.states)
        axes.stackplot(t, states.T, colors=STATE_COLOURS, labels=STATES, linewidth=0)
        axes.set_ylabel("FLSs")
        axes.margins(y=0)
        over_run(axes, data.clock, data.marks)
        legend_above(axes, len(STATES), 7.5)

    last = ", ".join(f"{n} {state}" for state, n in zip(STATES, data.states[-1], strict=True) if n)
    alt = f"At the end: {last}"
    caption = (
        "How many FLSs are in each state, stacked. Waiting: another FLS of its swarm anchors or localizes."
    )
    titles = [data.clock.column, *(state.lower().replace(" ", "_") for state in STATES)]
    return Figure(
        "states", "States", svg_of("states", alt, draw), caption, alt, titles, columns_of(data.t, *data.states.T)
    )  # fmt: skip


def clouds_figure(data: RunData, key: str = "clouds") -> Figure:
    """The display when all had landed, and at the end; ground truth faint behind, one colour a swarm."""
    timeline = data.timeline
    first = timeline.first_all_lit()
    moments = (
        ("most are lit", timeline.most_lit()) if first is None else ("landed", first),
        ("at the end", len(timeline.t_s) - 1),
    )

    def draw(canvas: Canvas) -> None:
        canvas.set_layout_engine("constrained", rect=(0, 0, 1, 0.95))  # room for titles in a larger typeface
        for place, (title, at) in enumerate(moments, 1):
            axes = canvas.add_subplot(1, 2, place)
            _cloud(axes, timeline, at)
            axes.set_title(
                f"{title}: {data.clock.say(timeline.t_s[at])}\nHD {cells(timeline.hd_cells[at])} cells"
            )

    alt = "; ".join(
        f"{title}, {data.clock.say(timeline.t_s[at])}: "
        f"{swarms(int(data.swarms[at])) + ', ' if has_swarms(data.run.summary) else ''}"
        f"HD {cells(timeline.hd_cells[at])} cells"
        for title, at in moments
    )
    at, every = moments[-1][1], slice(None, None, -(-data.points // CSV_POINTS))
    fids = np.arange(1, data.points + 1)[every]
    truth = timeline.truth_rows(float(timeline.t_s[at]))[every]
    rows = columns_of(fids, *truth.T, *timeline.position[at][every].T, timeline.swarm[at][every])
    titles = ["fid", "truth_l", "truth_h", "truth_d", "l", "h", "d", "swarm"]
    which = "every FLS" if len(rows) == data.points else f"{len(rows):,} FLSs"
    colours = "One colour a swarm; grey" if has_swarms(data.run.summary) else "Grey"
    caption = f"{colours}: where the FLSs belong. The CSV has {which} at the end, in cells."
    return Figure(
        key, "The display at two moments", svg_of(key, alt, draw, height=2.9), caption, alt, titles, rows
    )  # fmt: skip


def _cloud(axes: Axes, timeline: SavedTimeline, at: int) -> None:
    truth = timeline.truth_at(float(timeline.t_s[at]))
    view = usual_view(2 if np.ptp(truth[:, 2]) == 0 else 3)
    lit = timeline.lit[at]
    pixels = len(truth) > VECTOR_POINTS
    size = float(np.clip(1300 / len(truth), 0.5, 9))
    seen = seen_from(truth, view)
    axes.scatter(seen[:, 0], seen[:, 1], s=0.5 * size, color=FAINT, linewidths=0, rasterized=pixels)
    where = seen_from(timeline.position[at].astype(float), view)[lit]
    order = np.argsort(where[:, 2])
    colours = Palette(len(timeline.truth)).colours(timeline.swarm[at], lit)[lit] / 255.0
    axes.scatter(where[order, 0], where[order, 1], s=size, c=colours[order], linewidths=0, rasterized=pixels)
    axes.set_aspect("equal")
    axes.set_axis_off()
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    room = 0.12 * max(*(high - low), 1.0)
    axes.set_xlim(low[0] - room, high[0] + room)
    axes.set_ylim(low[1] - room, high[1] + room)
