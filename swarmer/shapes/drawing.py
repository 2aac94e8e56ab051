"""Clouds as a picture: lights on a dark ground, the nearer the brighter. Needs matplotlib, imported inside."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.cloud import UP_AXIS
from swarmer.shapes.views import THREE_QUARTERS, View, seen_from, shade

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GROUND = "#0b0e14"
WORDS = "#c9d1d9"
NEAR = np.array([1.00, 0.80, 0.36])
MIDDLE = np.array([0.93, 0.35, 0.38])
FAR = np.array([0.29, 0.22, 0.60])
INCHES = 4.6  # of one panel
MARGIN = 0.04  # of the picture's extent, left around the lights


class Panel(NamedTuple):
    """One cloud of a picture."""

    title: str
    points: NDArray[Any]  # (F, 3), display cells
    colours: NDArray[Any] | None = None  # (F, 3), red, green, blue, each 0 to 1; None: by nearness
    view: View = THREE_QUARTERS


def draw_clouds(
    panels: Sequence[Panel | tuple[str, NDArray[Any], NDArray[Any] | None]],
    path: str | Path,
    *,
    columns: int | None = None,
    up_axis: int = UP_AXIS,
    dpi: int = 110,
) -> None:
    """Draw clouds side by side, all to one scale, into a PNG (or what the suffix says).

    panels: at least one; a plain tuple is (title, points, colours). columns: panels in a row, all when
    None. up_axis: which axis of the points is up. Raises OSError where `path` cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = [Panel(*panel) for panel in panels]
    seen = [seen_from(panel.points, panel.view, up_axis) for panel in shown]
    width, height = (max(np.ptp(one[:, axis]) for one in seen) for axis in (0, 1))
    margin = MARGIN * max(width, height) + 1
    width, height = width + 2 * margin, height + 2 * margin
    columns = columns or len(shown)
    rows = -(-len(shown) // columns)
    panel_height = min(1.6, max(0.5, height / width)) * INCHES + 0.35
    figure = Figure(figsize=(columns * INCHES, rows * panel_height), facecolor=GROUND)
    FigureCanvasAgg(figure)
    for number, (panel, at) in enumerate(zip(shown, seen, strict=True), start=1):
        axes = figure.add_subplot(rows, columns, number)
        _draw(axes, panel, at, width, height)
    figure.subplots_adjust(
        left=0.01, right=0.99, bottom=0.01, top=1 - 0.35 / (rows * panel_height), wspace=0.02
    )
    figure.savefig(
        path, dpi=dpi, facecolor=GROUND, metadata={"Software": None} if Path(path).suffix == ".png" else {}
    )


def _draw(axes: Axes, panel: Panel, seen: NDArray[Any], width: float, height: float) -> None:
    order = np.argsort(seen[:, 2], kind="stable")  # the farthest first, so that the nearest cover
    near = shade(seen[:, 2])
    base = _by_nearness(near) if panel.colours is None else panel.colours * (0.45 + 0.55 * near[:, None])
    inches_per_cell = INCHES / width
    size = np.clip(66 * inches_per_cell, 1.2, 4.2) * (0.62 + 0.38 * near)  # diameter, typographic points
    for spread, alpha in ((2.6, 0.10), (1.0, 1.0)):  # a glow, then the light
        right, up = seen[order, 0], seen[order, 1]
        axes.scatter(right, up, s=(spread * size[order]) ** 2, c=base[order], alpha=alpha, linewidths=0)
    middle = (seen[:, :2].max(axis=0) + seen[:, :2].min(axis=0)) / 2
    axes.set_xlim(middle[0] - width / 2, middle[0] + width / 2)
    axes.set_ylim(middle[1] - height / 2, middle[1] + height / 2)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(panel.title, color=WORDS, fontsize=9, pad=4)


def _by_nearness(near: NDArray[np.float64]) -> NDArray[np.float64]:
    to_middle, to_near = (np.clip(2 * near - step, 0, 1)[:, None] for step in (0, 1))
    colours: NDArray[np.float64] = (FAR + (MIDDLE - FAR) * to_middle) * (1 - to_near) + NEAR * to_near
    return colours
