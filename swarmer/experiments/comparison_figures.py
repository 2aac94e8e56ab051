"""A comparison as pictures: for each measure every seed of every contender, and HD as it falls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmer.experiments.comparison import Cell, Comparison, Key, Measure
from swarmer.experiments.results import RUN, STATUS, read_results
from swarmer.experiments.verdicts import named
from swarmer.observe.timeline import NAME as TIMELINE

if TYPE_CHECKING:
    from numpy.typing import NDArray

COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#999999",
    "#000000",
)  # Okabe and Ito
PANELS_MAX = 12  # conditions that are drawn
PER_LINE = 3
WIDE_SHARE = 50.0  # a scale on which the largest is so many times the smallest is logarithmic
LEAST_HD = 1e-6  # cells: less is drawn as this
STEPS = 200  # moments of the curve of HD


def draw(comparison: Comparison, results: Path, out: Path) -> list[Path]:
    """Write an SVG for each measure, and one of HD over time, into the folder `out`. Raises OSError."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    out.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    plain = {"svg.hashsalt": "swarmer", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    with plt.rc_context(plain):  # type: ignore[arg-type]
        made += [
            _save(_measure_figure(comparison, measure, plt), out / f"{measure.column}.svg", plt)
            for measure in comparison.measures
        ]
        curve = _curve_figure(comparison, results, plt)
        if curve is not None:
            made.append(_save(curve, out / "hd_over_time.svg", plt))
    return made


def _save(figure: Any, path: Path, plt: Any) -> Path:
    figure.savefig(path, metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)
    return path


def _conditions(comparison: Comparison) -> list[Key]:
    return list(dict.fromkeys(cell.condition for cell in comparison.cells))[:PANELS_MAX]


def _panels(comparison: Comparison, plt: Any, title: str) -> tuple[Any, list[tuple[Key, Any]]]:
    conditions = _conditions(comparison)
    across = min(PER_LINE, len(conditions))
    down = math.ceil(len(conditions) / across)
    figure, axes = plt.subplots(down, across, figsize=(1.2 + 3.6 * across, 0.8 + 2.8 * down), squeeze=False)
    flat = [axis for row in axes for axis in row]
    for axis in flat[len(conditions) :]:
        axis.set_visible(False)
    for condition, axis in zip(conditions, flat, strict=False):
        if condition:
            axis.set_title(named(condition, comparison.within), fontsize=9)
    flat[0].set_ylabel(title)
    figure.tight_layout()
    return figure, list(zip(conditions, flat, strict=False))


def _measure_figure(comparison: Comparison, measure: Measure, plt: Any) -> Any:
    """Every seed is a point, joined with itself at the other contenders; the bar is the estimate with its interval."""
    figure, panels = _panels(comparison, plt, measure.title)
    for condition, axis in panels:
        cells = [cell for cell in comparison.cells if cell.condition == condition]
        finite = [
            value for cell in cells for value in cell.values[measure.column].values() if math.isfinite(value)
        ]
        top = 1.15 * max(finite, default=1.0)  # where those stand that never got there
        for seed in comparison.seeds:
            places = [(at, cell.values[measure.column].get(seed)) for at, cell in enumerate(cells)]
            there = [(at, min(value, top)) for at, value in places if value is not None]
            axis.plot(*zip(*there, strict=True), color="0.8", lw=0.7, zorder=1) if there else None
        for at, cell in enumerate(cells):
            _draw_cell(axis, at, cell, measure, top)
        names = [named(cell.contender, comparison.between) for cell in cells]
        axis.set_xticks(range(len(cells)), names, rotation=20, ha="right")
        axis.set_xlim(-0.6, len(cells) - 0.4)
        if min(finite, default=0.0) > 0 and max(finite) > WIDE_SHARE * min(finite):
            axis.set_yscale("log")
        else:
            axis.set_ylim(bottom=min(0.0, *finite) if finite else 0.0)
        if len(finite) < sum(len(cell.values[measure.column]) for cell in cells):
            axis.axhline(top, color="0.6", lw=0.6, ls=":")
            axis.annotate("never", (-0.55, top), fontsize=8, color="0.4", va="bottom")
    return figure


def _draw_cell(axis: Any, at: int, cell: Cell, measure: Measure, top: float) -> None:
    values = [min(value, top) for value in cell.values[measure.column].values()]
    if not values:
        return
    colour = COLOURS[at % len(COLOURS)]
    axis.scatter([at] * len(values), values, s=12, color=colour, alpha=0.5, zorder=2, linewidths=0)
    estimate = cell.estimate(measure)
    if math.isfinite(estimate.estimate):
        low, high = (value if math.isfinite(value) else top for value in (estimate.low, estimate.high))
        if not math.isnan(estimate.low):
            axis.plot(
                [at + 0.18, at + 0.18], [low, high], color=colour, lw=2.5, zorder=3, solid_capstyle="butt"
            )
        axis.scatter([at + 0.18], [estimate.estimate], s=26, color=colour, zorder=4, marker="D")


def _curve_figure(comparison: Comparison, results: Path, plt: Any) -> Any:
    """HD as it falls: the median of the seeds, and between the lowest and the highest."""
    curves = _curves(comparison, results)
    if not curves:
        return None
    figure, panels = _panels(comparison, plt, "HD, cells")
    contenders = list(dict.fromkeys(cell.contender for cell in comparison.cells))
    unit = (
        "round"
        if any(measure.column.startswith("rounds_to") for measure in comparison.measures)
        else "emulated s"
    )
    for condition, axis in panels:
        for at, contender in enumerate(contenders):
            t, hd = curves.get((condition, contender), (None, None))
            if t is None or hd is None:
                continue
            colour, name = COLOURS[at % len(COLOURS)], named(contender, comparison.between)
            if t[0] == t[-1]:  # it never moves on, as dead reckoning alone
                axis.axhline(np.median(hd[:, 0]), color=colour, lw=1.3, ls="--", label=name)
                continue
            axis.plot(t, np.median(hd, axis=0), color=colour, lw=1.3, label=name)
            axis.fill_between(t, hd.min(axis=0), hd.max(axis=0), color=colour, alpha=0.15, lw=0)
        axis.set_yscale("log")
        axis.set_xlabel(unit)
    panels[0][1].legend(fontsize=8, frameon=False)
    return figure


def _curves(
    comparison: Comparison, results: Path
) -> dict[tuple[Key, Key], tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Of each contender in each condition: moments (t,), HD (runs, t); a run that ended early stays where it ended."""
    _, rows = read_results(results)
    found: dict[tuple[Key, Key], list[tuple[Any, Any]]] = {}
    drawn = set(_conditions(comparison))
    for row in rows:
        key = tuple(
            tuple(row[name] or "null" for name in names) for names in (comparison.within, comparison.between)
        )
        if row.get(STATUS) != "done" or key[0] not in drawn:
            continue
        try:
            with np.load(results.parent / row[RUN] / TIMELINE, allow_pickle=False) as file:
                t, hd = file["t_s"], file["hd_cells"]
        except (OSError, KeyError, ValueError):
            continue
        known = np.isfinite(hd)
        if known.any():
            found.setdefault((key[0], key[1]), []).append((t[known], np.maximum(hd[known], LEAST_HD)))
    return {key: _together(runs) for key, runs in found.items()}


def _together(runs: Sequence[tuple[Any, Any]]) -> tuple[Any, Any]:
    first, last = max(t[0] for t, _ in runs), max(t[-1] for t, _ in runs)
    grid = np.linspace(first, last, STEPS)
    at = [np.clip(np.searchsorted(t, grid, "right") - 1, 0, len(t) - 1) for t, _ in runs]
    return grid, np.array([hd[index] for (_, hd), index in zip(runs, at, strict=True)])
