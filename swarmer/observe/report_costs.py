"""The report's figures of what a run cost: distances flown, datagrams and bytes, and whether the machine kept up."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from swarmer.observe.report_data import RunData
from swarmer.observe.report_drawing import (
    FAINT,
    LINES,
    SOFT,
    Absent,
    Figure,
    columns_of,
    legend_above,
    rates,
    svg_of,
    thinned,
)
from swarmer.observe.report_figures import NO_RADIO, OLD, SILENCE
from swarmer.observe.report_marks import draw_marks, over_run
from swarmer.observe.words import cells, count

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

KINDS_DRAWN = 7  # the rest is drawn as one


def distance_figure(data: RunData) -> Figure | Absent:
    """Cells flown to localize and to follow: over time, and how they fall on the FLSs."""
    title = "Distance flown"
    localizing, following = data.series("localizing_cells"), data.series("following_cells")
    if localizing is None or following is None:
        return Absent(title, OLD)
    total = data.series("distance_cells")
    flown, points = data.timeline.flown_cells, data.points

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot(1, 2 if flown is not None else 1, 1)
        axes.stackplot(
            data.t, np.stack([localizing, following]) / points, colors=LINES[:2], labels=("localizing", "following"),
            linewidth=0,
        )  # fmt: skip
        axes.set_ylabel("cells an FLS, mean")
        over_run(axes, data.clock, data.marks, 2)
        if flown is not None:
            beside = canvas.add_subplot(1, 2, 2)
            bins = np.linspace(0, max(float(flown.max()), 1e-9), 24)
            for i in range(2):
                beside.hist(flown[:, i], bins.tolist(), histtype="step", color=LINES[i], linewidth=1.4)
            beside.set_xlabel("cells flown by the end")
            beside.set_ylabel("FLSs")

    means = (localizing[-1] / points, following[-1] / points)
    rest = (
        ""
        if total is None
        else f"; deploying, {cells((total[-1] - localizing[-1] - following[-1]) / points)} more, is left out"
    )
    alt = f"By the end an FLS has flown {cells(means[0])} cells to localize and {cells(means[1])} to follow its swarm"
    caption = f"{alt}, in the mean{rest}." + (
        "" if flown is None else " Right: how many FLSs have flown how far."
    )
    columns = [localizing, following] + ([] if total is None else [total])
    titles = [data.clock.column, "localizing_cells", "following_cells"] + (
        [] if total is None else ["distance_cells"]
    )
    return Figure(
        "distance", title, svg_of("distance", alt, draw), caption, alt, titles, columns_of(data.t, *columns)
    )  # fmt: skip


def rate_figure(data: RunData) -> Figure | Absent:
    """Datagrams sent in a second, by kind, and their bytes."""
    title = "Datagrams and bytes per second"
    kinds = data.by_kind
    if not kinds:
        return _rate_without_kinds(data, title)
    named, rest = kinds[:KINDS_DRAWN], kinds[KINDS_DRAWN:]
    names = [name for name, *_ in named] + (["OTHERS"] if rest else [])
    totals = [sent for _, sent, _ in named] + (
        [np.sum([sent for _, sent, _ in rest], axis=0)] if rest else []
    )
    middles, growth = rates(data.t, np.stack(totals, axis=1))
    _, delivered = rates(data.t, np.sum([one for *_, one in kinds], axis=0))
    if not len(middles):
        return Absent(title, "there are too few samples")
    size = data.datagram_bytes

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        axes.stackplot(middles, growth.T, colors=LINES, labels=[_plain(name) for name in names], linewidth=0)
        axes.set_ylabel("datagrams sent per second")
        _kilobytes(axes, size)
        over_run(axes, data.clock, data.marks)
        legend_above(axes, 4, 7)

    peak = growth.sum(axis=1)
    alt = f"{count(peak.mean())} datagrams sent per second in the mean, {count(peak.max())} at most"
    caption = (
        f"{alt}; a datagram has {size:.0f} bytes. A broadcast is sent once and delivered to many: "
        f"{count(delivered.mean())} deliveries per second in the mean."
    )
    titles = [
        data.clock.column,
        *(f"sent_{name.lower()}_per_s" for name in names),
        "sent_bytes_per_s",
        "delivered_per_s",
    ]
    rows = columns_of(middles, *growth.T, peak * size, delivered)
    return Figure("rate", title, svg_of("rate", alt, draw, height=3.1), caption, alt, titles, rows)


def _rate_without_kinds(data: RunData, title: str) -> Figure | Absent:
    sent = data.grows("datagrams_sent")
    if sent is None:
        return Absent(title, _why_no_radio(data))
    middles, growth = rates(data.t, sent)
    if not len(middles):
        return Absent(title, "there are too few samples")

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        axes.plot(middles, growth, color=LINES[0])
        axes.set_ylabel("datagrams sent per second")
        axes.set_ylim(bottom=0)
        _kilobytes(axes, data.datagram_bytes)
        over_run(axes, data.clock, data.marks)

    alt = f"{count(growth.mean())} datagrams sent per second in the mean, {count(growth.max())} at most"
    rows = columns_of(middles, growth, growth * data.datagram_bytes)
    titles = [data.clock.column, "sent_per_s", "sent_bytes_per_s"]
    return Figure("rate", title, svg_of("rate", alt, draw), f"{alt}.", alt, titles, rows)


def _why_no_radio(data: RunData) -> str:
    sent = data.series("datagrams_sent")
    return NO_RADIO if sent is None or sent[-1] > 0 else SILENCE


def _kilobytes(axes, size: float) -> None:  # type: ignore[no-untyped-def]
    """The same in kilobytes, on the right."""
    axes.grid(axis="x", visible=False)
    other = axes.secondary_yaxis("right", functions=(lambda n: n * size / 1e3, lambda kb: kb * 1e3 / size))
    other.set_ylabel("kB per second")


def kinds_figure(data: RunData) -> Figure | Absent:
    """Datagrams and bytes by kind, sent and delivered."""
    title, kinds = "Datagrams and bytes by kind", data.by_kind
    if not kinds:
        return Absent(title, _why_no_radio(data))
    size = data.datagram_bytes
    names = [_plain(name) for name, *_ in kinds]
    sent, delivered = (np.array([one[i][-1] for one in kinds]) for i in (1, 2))

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        places = np.arange(len(kinds))
        axes.barh(places - 0.2, sent, 0.38, color=LINES[0], label="sent")
        axes.barh(places + 0.2, delivered, 0.38, color=LINES[4], label="delivered")
        axes.set_xscale("log")
        axes.set_xlim(left=0.8)
        axes.xaxis.set_major_formatter(lambda value, _: count(value))
        axes.set_yticks(places, names)
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("datagrams")
        legend_above(axes, 2)

    rows = [
        [name, int(one), int(other), int(one * size), int(other * size)]
        for (name, *_), one, other in zip(kinds, sent, delivered, strict=True)
    ]
    out, got = sent.sum(), delivered.sum()
    alt = f"Most are sent of {names[0]}: {count(sent[0])} of {count(out)}; delivered in all: {count(got)}"
    caption = f"Of the whole run, logarithmic; {count(out * size)} bytes sent, {count(got * size)} delivered."
    titles = ["kind", "sent", "delivered", "sent_bytes", "delivered_bytes"]
    height = max(2.4, 0.55 + 0.19 * len(kinds))
    return Figure("kinds", title, svg_of("kinds", alt, draw, height=height), caption, alt, titles, rows)


def fidelity_figure(data: RunData) -> Figure | Absent:
    """How late timers and messages were, and how fast emulated time went."""
    title = "Fidelity"
    late = {
        name: data.series(f"{key}_late_p99_ms")
        for name, key in (("timers", "timer"), ("messages", "handled"))
    }
    shown = {name: values for name, values in late.items() if values is not None}
    if not shown:
        return Absent(title, "no lateness was recorded")
    scale = (
        data.series("time_scale") if data.run.summary.get("engine") != "virtual" else None
    )  # there it says nothing
    lease = data.run.config.get("lease_ms")
    bound = lease / 2 if isinstance(lease, (int, float)) else None

    def draw(canvas: Canvas) -> None:
        axes, below = (canvas.add_subplot(), None) if scale is None else canvas.subplots(2, 1, sharex=True)
        for i, (name, values) in enumerate(shown.items()):
            axes.plot(*thinned(data.t, values), color=LINES[i], linestyle=("-", (0, (4, 2)))[i], label=name)
        if bound is not None:
            axes.axhline(bound, color=SOFT, linewidth=1, linestyle=(0, (2, 2)), label="half a lease")
        axes.set_ylim(bottom=0)
        axes.set_ylabel("late, p99 [ms]")
        legend_above(axes, 3)
        if scale is not None and below is not None:
            draw_marks(axes, data.marks)
            below.plot(*thinned(data.t, scale), color=LINES[2])
            below.axhline(1, color=FAINT, linewidth=0.8)
            below.set_ylim(bottom=0)
            below.set_ylabel("time scale")
        over_run(below or axes, data.clock, data.marks)

    worst = max(float(np.nanmax(values)) for values in shown.values())
    alt = f"The 99th percentiles of lateness are {worst:.0f} emulated ms at most"
    limit = (
        "" if bound is None else f", {'within' if worst <= bound else 'beyond'} half a lease, {bound:g} ms"
    )
    how = "Of the run so far." if scale is None else (
        "Of the last seconds. Below: emulated seconds per second of the wall clock, which a slow machine lowers."
    )  # fmt: skip
    caption = f"{alt}{limit}. {how}"
    columns = [*shown.values()] + ([] if scale is None else [scale])
    titles = [data.clock.column, *(f"{name}_late_p99_ms" for name in shown)] + (
        [] if scale is None else ["time_scale"]
    )
    return Figure(
        "fidelity", title, svg_of("fidelity", alt, draw, height=2.75 if scale is None else 3.1), caption, alt,
        titles, columns_of(data.t, *columns),
    )  # fmt: skip


def _plain(name: str) -> str:
    return name.replace("_", " ").capitalize() if name == "OTHERS" else name.replace("_", " ")
