"""How the report draws: matplotlib's lines as inline SVG whose colours are the page's own, light or dark."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.observe.saved_run import SavedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

# Colours while matplotlib draws; the page's variables take their place (report_assets/page.css).
INK, GRID, FAINT, SOFT = "#010203", "#040506", "#070809", "#0a0b0c"
LINES = tuple(f"#0d0e{i:02x}" for i in range(8))  # told apart in both schemes, 3:1 on either ground
RAMP = tuple(f"#0d0f{i:02x}" for i in range(8))  # from few to many
PAGE_COLOURS = {
    INK: "currentColor", GRID: "var(--grid)", FAINT: "var(--faint)", SOFT: "var(--soft)",
    **{colour: f"var(--c{i})" for i, colour in enumerate(LINES)},
    **{colour: f"var(--r{i})" for i, colour in enumerate(RAMP)},
}  # fmt: skip
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 2)),
    (0, (1.5, 1.5)),
    (0, (7, 2, 1.5, 2)),
)  # colour alone tells nothing
LINE_POINTS = 1500  # samples of a curve that are drawn
FEW_DECADES, ALL_DECADES = 1.3, 0.4  # axes shorter than that have numbers between powers of ten; at each tick
WIDTH, HEIGHT = (
    5.0,
    2.75,
)  # inches: text of 9 points is still read on a phone, and two go side by side on a screen

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "swarmer", "text.parse_math": False, "font.size": 9, "text.color": INK,
    "axes.labelcolor": INK, "axes.edgecolor": GRID, "axes.facecolor": "none", "axes.grid": True, "axes.axisbelow": True,
    "axes.spines.top": False, "axes.spines.right": False, "figure.facecolor": "none", "grid.color": GRID,
    "grid.linewidth": 0.6, "xtick.color": INK, "ytick.color": INK, "legend.frameon": False, "legend.fontsize": 8,
    "lines.linewidth": 1.6, "axes.titlesize": 9,
}  # fmt: skip


class Figure(NamedTuple):
    """A figure with its words and its data. Nothing in it is escaped yet, but for the SVG, which is."""

    key: str  # its id on the page, and the name of its files
    title: str
    svg: str
    caption: str
    alt: str  # what one sees, for who does not
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]  # of the data behind it
    wide: bool = False


class Absent(NamedTuple):
    """A figure for which a run has no data."""

    title: str
    why: str


class Clock(NamedTuple):
    """In what a run counts its time."""

    label: str  # of an axis
    column: str  # of a table
    words: str  # around a moment
    digits: int
    since: str  # the label of an axis that begins at a thaw

    def say(self, t: float | None) -> str:
        """A moment or a span in words.

        >>> SECONDS.say(12.34), ROUNDS.say(5.0), SECONDS.say(None)
        ('12.3 s', 'round 5', 'never')
        """
        return "never" if t is None else self.words.replace("%", f"{t:.{self.digits}f}")


SECONDS = Clock("emulated time [s]", "t_s", "% s", 1, "emulated time since the thaw [s]")
ROUNDS = Clock("round", "round", "round %", 0, "rounds since the thaw")


def clock_of(run: SavedRun) -> Clock:
    """Rounds for the engine that counts them, emulated seconds for all others."""
    engine = run.summary.get("engine") or run.config.get("engine")
    return ROUNDS if engine == "rounds" else SECONDS


def svg_of(
    key: str, alt: str, draw: Callable[[Canvas], None], width: float = WIDTH, height: float = HEIGHT
) -> str:
    """One SVG element, without prolog, with the page's colours and ids of its own; width and height in inches."""
    import matplotlib
    from matplotlib.figure import Figure as Canvas

    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # of letters that its own font lacks: the page's has them
        canvas = Canvas(figsize=(width, height), layout="constrained")
        draw(canvas)
        text = io.StringIO()
        canvas.savefig(text, format="svg", metadata={"Date": None}, dpi=160)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style type=\"text/css\">.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<!--.*?-->", "", svg, flags=re.DOTALL)
    svg = re.sub(
        r' id="(?:figure|axes|patch|line2d|text|matplotlib\.axis|xtick|ytick|legend)[\w.]*"', "", svg
    )
    # Two figures on one page must not share ids.
    svg = re.sub(r'( id="|xlink:href="#|url\(#)', rf"\g<1>{key}-", svg)
    for sentinel, colour in PAGE_COLOURS.items():
        svg = svg.replace(sentinel, colour)
    svg = re.sub(r"\n\s*", "\n", svg)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{_attribute(alt)}" ', 1)


def _attribute(text: str) -> str:
    from html import escape

    return escape(text, quote=True)


def over_time(axes: Axes, clock: Clock, columns: int = 0) -> None:
    """What every figure over time has in common. columns: of its legend, above the axes; 0 for none."""
    axes.set_xlabel(clock.label)
    axes.margins(x=0.01)
    axes.set_xlim(left=0)
    if axes.get_yscale() == "symlog":
        axes.set_ylim(bottom=0)  # only now: before, it would be the end of autoscaling
    if columns:
        legend_above(axes, columns)


def legend_above(axes: Axes, columns: int, size: float = 8.0) -> None:
    """A legend where no curve can be below it."""
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, fontsize=size, columnspacing=1.0,
                handlelength=1.4, borderpad=0.1)  # fmt: skip


def logarithmic(axes: Axes, zero: bool = False) -> None:
    """A logarithmic axis with plain numbers; zero: with a place for 0, for counts."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if zero:
        axes.set_yscale("symlog", linthresh=1)
    else:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(numticks=8))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
    between = NullFormatter() if zero else FuncFormatter(lambda value, _: _between(value, *axes.get_ylim()))
    axes.yaxis.set_minor_formatter(between)


def _between(value: float, low: float, high: float) -> str:
    """What stands at a tick between powers of ten: something on an axis so short that it may have none of these.

    >>> [_between(value, 2, 9) for value in (2, 3, 5)], _between(5, 4.9, 5.2), _between(5, 0.1, 9)
    (['2', '', '5'], '5', '')
    """
    decades = math.log10(high / low)
    leading = round(value / 10 ** math.floor(math.log10(value)), 6)
    shown = decades < FEW_DECADES and (decades < ALL_DECADES or leading in (2, 5))
    return f"{value:,.10g}" if shown else ""


def thinned(t: NDArray[Any], *values: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """So few samples that a curve of them is not larger than it looks; the last is kept."""
    if len(t) <= LINE_POINTS:
        return (t, *values)
    at = np.unique(np.linspace(0, len(t) - 1, LINE_POINTS).round().astype(np.int64))
    return tuple(array[at] for array in (t, *values))


def columns_of(*columns: Any) -> list[list[Any]]:
    """Columns of numbers as rows, without more digits than they deserve; NaN as None."""
    return [[_rounded(value) for value in row] for row in zip(*columns, strict=True)]


def _rounded(value: Any) -> Any:
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value.item() if hasattr(value, "item") else value


def rates(t: NDArray[Any], totals: NDArray[Any], bins: int = 120) -> tuple[NDArray[Any], NDArray[Any]]:
    """What grows, as growth per unit of time in at most `bins` equal spans: their middles and the rates.

    totals: (T,) or (T, K). A total that falls, as one of a replaced process may, counts as none.
    """
    if len(t) < 2 or t[-1] <= t[0]:
        return np.empty(0), np.empty((0, *totals.shape[1:]))
    edges = np.linspace(t[0], t[-1], min(bins, len(t) - 1) + 1)
    flat = totals.reshape(len(t), -1)
    at_edges = np.stack([np.interp(edges, t, column) for column in flat.T], axis=1)
    growth = np.maximum(np.diff(at_edges, axis=0), 0) / np.diff(edges)[:, None]
    return (edges[:-1] + edges[1:]) / 2, growth.reshape(-1, *totals.shape[1:])
