"""The report's figures as inline SVG: no request leaves the page, and colours follow its light or dark ground."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from swarmer.observe.palette import STATE_COLOURS, STATES, Palette
from swarmer.observe.progress import THRESHOLDS
from swarmer.observe.saved_run import SavedTimeline
from swarmer.shapes.views import seen_from, usual_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of text and lines while matplotlib draws; the page's own take their place.
INK, GRID, FAINT = "#010203", "#040506", "#070809"
PAGE_COLOURS = {INK: "currentColor", GRID: "var(--grid)", FAINT: "var(--faint)"}
LINES = ("#3d8bd9", "#e4572e", "#2a9d6f", "#8d6bd1", "#c98a06", "#c2438a", "#5b7083", "#7aa40d")
VECTOR_POINTS = 4000  # a cloud of more points is drawn as pixels
LINE_POINTS = 2000  # samples of a curve that are drawn

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "swarmer",
    "font.size": 10,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GRID,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.facecolor": "none",
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
}


class Curve(NamedTuple):
    """A run in a figure of several."""

    label: str
    timeline: SavedTimeline


def hd_figure(curves: Sequence[Curve], reached: dict[str, float | None] | None = None) -> str:
    """HD over time on a logarithmic axis, thresholds dotted; `reached` marks when one run got below each."""

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_yscale("log")
        lowest = np.inf
        for i, (label, timeline) in enumerate(curves):
            shown = np.isfinite(timeline.hd_cells) & (timeline.hd_cells > 0)
            t_s, hd = _thinned(timeline.t_s[shown], timeline.hd_cells[shown])
            axes.plot(t_s, hd, color=LINES[i % len(LINES)], label=label)
            lowest = min([lowest, *hd])
        for name in THRESHOLDS:
            if float(name) > 0.5 * lowest and name != "0.09":
                axes.axhline(float(name), color=FAINT, linewidth=0.8, linestyle=(0, (2, 3)))
        for name, t_s in (reached or {}).items():
            if t_s is not None and name != "0.09":
                axes.plot([t_s], [float(name)], "o", color=LINES[0], markersize=5)
                note = f"< {name}: {t_s:.1f} s"
                axes.annotate(note, (t_s, float(name)), (6, 4), textcoords="offset points", fontsize=9)
        axes.set_ylabel("Hausdorff distance [cells]")
        _finish_over_time(axes, len(curves) > 1)

    return _svg(draw, 7.6, 3.6)


def swarms_figure(curves: Sequence[Curve]) -> str:
    """Number of swarms over time, logarithmic."""

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_yscale("symlog", linthresh=1)
        for i, (label, timeline) in enumerate(curves):
            axes.plot(*_thinned(timeline.t_s, timeline.swarms()), color=LINES[i % len(LINES)], label=label)
        axes.set_ylabel("swarms")
        axes.set_ylim(bottom=0)
        axes.yaxis.set_major_formatter("{x:g}")
        _finish_over_time(axes, len(curves) > 1)

    return _svg(draw, 7.6, 2.6)


def states_figure(timeline: SavedTimeline) -> str:
    """FLSs in each state over time, stacked."""

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        t_s, states = _thinned(timeline.t_s, timeline.states(len(STATES)))
        axes.stackplot(t_s, states.T, colors=STATE_COLOURS, labels=STATES, linewidth=0)
        axes.set_ylabel("FLSs")
        axes.margins(y=0)
        _finish_over_time(axes, False)
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=len(STATES), fontsize=9, handlelength=1.0
        )

    return _svg(draw, 7.6, 2.8)


def clouds_figure(timeline: SavedTimeline) -> str:
    """The display when all had landed, and at the end; ground truth faint behind, one colour a swarm."""

    def draw(figure: Figure) -> None:
        first = first_all_lit(timeline)
        for place, (title, at) in enumerate((("landed", first), ("at the end", len(timeline.t_s) - 1)), 1):
            axes = figure.add_subplot(1, 2, place)
            _cloud(axes, timeline, at)
            axes.set_title(
                f"{title}: {timeline.t_s[at]:.1f} s, HD {timeline.hd_cells[at]:.3g} cells", fontsize=10
            )

    return _svg(draw, 7.6, 3.7)


def first_all_lit(timeline: SavedTimeline) -> int:
    """The first sample by which every FLS had been lit; the one with most lit if that never was."""
    ever = np.logical_or.accumulate(timeline.lit, axis=0).all(axis=1)
    return int(ever.argmax() if ever.any() else timeline.lit.sum(axis=1).argmax())


def _cloud(axes: Axes, timeline: SavedTimeline, at: int) -> None:
    truth = timeline.truth
    view = usual_view(2 if np.ptp(truth[:, 2]) == 0 else 3)
    lit = timeline.lit[at]
    pixels = len(truth) > VECTOR_POINTS
    size = float(np.clip(2600 / len(truth), 0.6, 14))
    seen = seen_from(truth, view)
    axes.scatter(seen[:, 0], seen[:, 1], s=0.5 * size, color=FAINT, linewidths=0, rasterized=pixels)
    where = seen_from(timeline.position[at].astype(float), view)[lit]
    order = np.argsort(where[:, 2])
    colours = Palette(len(truth)).colours(timeline.swarm[at], lit)[lit] / 255.0
    axes.scatter(where[order, 0], where[order, 1], s=size, c=colours[order], linewidths=0, rasterized=pixels)
    axes.set_aspect("equal")
    axes.set_axis_off()
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    room = 0.12 * max(*(high - low), 1.0)
    axes.set_xlim(low[0] - room, high[0] + room)
    axes.set_ylim(low[1] - room, high[1] + room)


def _thinned(t_s: Any, values: Any) -> tuple[Any, Any]:
    step = max(1, len(t_s) // LINE_POINTS)
    return t_s[::step], values[::step]


def _finish_over_time(axes: Axes, legend: bool) -> None:
    axes.set_xlabel("emulated time [s]")
    axes.margins(x=0.01)
    axes.set_xlim(left=0)
    if legend:
        axes.legend(fontsize=9)


def _svg(draw: Callable[[Figure], None], width: float, height: float) -> str:
    """One SVG element, without prolog, with the page's colours; width and height in inches."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None}, dpi=160)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style type=\"text/css\">.*?</style>", "", svg, flags=re.DOTALL)
    for sentinel, colour in PAGE_COLOURS.items():
        svg = svg.replace(sentinel, colour)
    return svg
