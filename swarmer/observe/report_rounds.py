"""The report's figures of a run in rounds (SwarMer, figures 15 to 19), from its rounds.csv."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmer.observe.report_drawing import (
    LINES,
    Absent,
    Figure,
    clock_of,
    columns_of,
    legend_above,
    over_time,
    svg_of,
)
from swarmer.observe.run_directory import ROUNDS
from swarmer.observe.saved_run import BROKEN, SavedRun
from swarmer.observe.summary import has_swarms
from swarmer.observe.words import cells

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

Rounds = dict[str, NDArray[np.float64]]  # (rounds + 1,) each, the first is the deployment


def read_rounds(run: SavedRun) -> Rounds:
    """rounds.csv by column, empty cells as NaN; nothing if no round is there that can be read."""
    path: Path = run.path / ROUNDS
    try:
        with path.open(newline="", encoding="utf-8") as file:
            titles, *rows = csv.reader(file)
        values = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
        return {title: values[:, i] for i, title in enumerate(titles)} if len(rows) > 1 else {}
    except BROKEN:
        return {}


def merging_figure(run: SavedRun) -> Figure | Absent | None:
    """Who localizes and who anchors in each round, and how many swarms merge at one anchor, where there are swarms."""
    rounds = read_rounds(run)
    if not {"round", "localizing", "anchors", "group_mean", "group_max"} <= rounds.keys():
        return None
    number, clock = rounds["round"][1:], clock_of(run)
    counts = [rounds[name][1:] for name in ("localizing", "anchors")]
    names = ("group_mean", "group_max") if has_swarms(run.summary) else ()
    groups = [rounds[name][1:] for name in names]

    def draw(canvas: Canvas) -> None:
        panels = [("FLSs", ("localizing", "anchors"), counts)]
        panels += [("swarms", ("swarms in a group, mean", "most"), groups)] if groups else []
        places = canvas.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        colours = iter(LINES)
        for axes, (unit, labels, curves) in zip(places, panels, strict=True):
            for style, label, values in zip(("-", (0, (4, 2))), labels, curves, strict=True):
                axes.plot(number, values, color=next(colours), linestyle=style, marker=".", label=label)
            axes.set_ylabel(unit)
            legend_above(axes, 2)
            axes.set_ylim(bottom=0)
        over_time(places[-1], clock)

    alt = (
        f"In the first round {counts[0][0]:.0f} FLSs localize relative to {counts[1][0]:.0f} anchors"
        if len(number)
        else "-"
    )
    below = " Below: how many swarms merge at one anchor; it peaks right after a thaw." if groups else ""
    caption = f"{alt}.{below}"
    titles = ["round", "localizing", "anchors", *names]
    return Figure(
        "merging", "Who localizes in each round", svg_of("merging", alt, draw, height=3.1), caption, alt, titles,
        columns_of(number, *counts, *groups),
    )  # fmt: skip


def flights_figure(run: SavedRun) -> Figure | Absent | None:
    """How far the localizing FLSs fly in each round."""
    rounds = read_rounds(run)
    names = ("flight_min", "flight_mean", "flight_max")
    if not {"round", *names} <= rounds.keys():
        return None
    number, clock = rounds["round"][1:], clock_of(run)
    low, mean, high = (rounds[name][1:] for name in names)

    def draw(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        axes.fill_between(
            number, low, high, color=LINES[0], alpha=0.2, linewidth=0, label="shortest to longest"
        )
        axes.plot(number, mean, color=LINES[0], marker=".", label="mean")
        axes.set_ylabel("cells")
        axes.set_ylim(bottom=0)
        over_time(axes, clock, 2)

    alt = (
        f"The mean is {cells(mean[0])} cells in the first round and {cells(mean[-1])} in the last"
        if len(number)
        else "-"
    )
    caption = f"{alt}. It falls as the shape forms, but not in every round: a merge moves whole swarms."
    return Figure(
        "flights", "Flights of the localizing FLSs", svg_of("flights", alt, draw), caption, alt, ["round", *names],
        columns_of(number, low, mean, high),
    )  # fmt: skip
