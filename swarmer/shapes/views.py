"""How a cloud is looked at: from where, and how near each point then is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.cloud import UP_AXIS, Points


class View(NamedTuple):
    """Where the viewer stands: turned about the vertical from the side, and raised; degrees."""

    azimuth_deg: float = 0.0
    elevation_deg: float = 0.0


SIDE = View(0, 0)  # length to the right, depth towards the viewer
FRONT = View(90, 8)
TOP = View(0, 90)
THREE_QUARTERS = View(30, 16)


def usual_view(dim: int) -> View:
    """Three quarters for a cloud in space, flat on for one in the plane."""
    return SIDE if dim == 2 else THREE_QUARTERS


def seen_from(points: NDArray[Any], view: View, up_axis: int = UP_AXIS) -> Points:
    """Points (F, 3) as (right, up, nearness), same unit, no perspective.

    At azimuth 0 the axis after next to `up_axis` points to the right: for (L, H, D) with H up that is
    L, and D comes towards the viewer.
    """
    turn, raised = np.radians(view.azimuth_deg), np.radians(view.elevation_deg)
    right, up, near = points[:, (up_axis + 2) % 3], points[:, up_axis], points[:, (up_axis + 1) % 3]
    right, near = right * np.cos(turn) - near * np.sin(turn), right * np.sin(turn) + near * np.cos(turn)
    up, near = up * np.cos(raised) - near * np.sin(raised), up * np.sin(raised) + near * np.cos(raised)
    return np.column_stack([right, up, near])


def shade(nearness: NDArray[Any]) -> NDArray[np.float64]:
    """Nearness (F,) as 0 (farthest) to 1 (nearest); 1 for all where all are equally near."""
    span = np.ptp(nearness)
    if span < 1e-9:
        return np.ones(len(nearness))
    return np.asarray((nearness - nearness.min()) / span, dtype=np.float64)
