"""A cloud in any unit becomes one in display cells: upright, scaled, its lower corner at `CORNER`, rounded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from swarmer.errors import BadInput
from swarmer.shapes.cloud import COORDINATE_MAX, Points
from swarmer.shapes.generators import CORNER

CELL_M = 0.05  # edge of a display cell
UNITS = {"mm": 0.001 / CELL_M, "cm": 0.01 / CELL_M, "m": 1 / CELL_M, "cells": 1.0}  # cells in one of each
DECIMALS = 3  # of what is written, as the shipped clouds have them
ROUNDED_OFF = 3**0.5 * 10**-DECIMALS  # cells that rounding can take from a distance, at most
SPACING = 1.5  # cells between the nearest two, unless something else is asked for: a light needs 1

# Proper rotations: nothing is mirrored. Rows are the new length, height and depth.
TURNS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "x": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "z": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    "-y": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-z": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
}


class Placed(NamedTuple):
    """Points where a display has them, and what was done to get there."""

    points: Points  # (F, 3), cells, rounded to DECIMALS
    factor: float  # cells per unit of the file


class Size(NamedTuple):
    """How large the cloud shall be; the first that is there counts: box, spacing, scale and unit."""

    box: tuple[float, ...] | None = None  # length and height, perhaps depth; cells
    spacing: float | None = None  # of the nearest two, cells
    scale: float | None = None  # times as large as in the unit
    unit: str | None = None  # of the points, one of UNITS; None: cells

    @property
    def options(self) -> dict[str, str]:
        """The options that say so, and their values."""
        if self.box is not None:
            return {"box": "x".join(f"{side:g}" for side in self.box)}
        if self.spacing is not None:
            return {"spacing": f"{self.spacing:g}"}
        scale = {} if self.scale is None else {"scale": f"{self.scale:g}"}
        return scale if self.unit is None else {**scale, "unit": self.unit}

    @property
    def factor(self) -> float:
        """Cells per unit of the points, by scale and unit."""
        return (1.0 if self.scale is None else self.scale) * UNITS[self.unit or "cells"]

    def __str__(self) -> str:
        return " ".join(f"--{name} {value}" for name, value in self.options.items())

    def refused(self, why: str) -> BadInput:
        """The error line that names the option, its value, and why it cannot be."""
        name, value = next(iter(self.options.items()))
        return BadInput(name, value, why)


class Gaps(NamedTuple):
    """Distances from each point to the nearest other one, cells."""

    least: float
    median: float


def turned(points: Points, up: str) -> Points:
    """The points (F, 3) so that their axis `up` (x, y, z, -x, -y, -z) points up, that is along axis 1."""
    rotation = np.array(TURNS[up], dtype=np.float64)
    upright: Points = points @ rotation.T + 0.0
    return upright


def gaps(points: Points) -> Gaps:
    """The least and the median gap of at least two points (F, 3)."""
    nearest = np.asarray(cKDTree(points).query(points, k=[2])[0])
    return Gaps(float(nearest.min()), float(np.median(nearest)))


def place(points: Points, size: Size) -> Placed:
    """At least two different points (F, 3) of any unit, in display cells.

    Raises BadInput (`box`, `spacing`, `scale`, `unit`): coordinates would be too large, or rounding makes points equal.
    """
    factor = _factor(points, size)
    if not np.ptp(points, axis=0).max() * factor < COORDINATE_MAX - CORNER:
        raise size.refused(f"too large: all coordinates must lie within {COORDINATE_MAX:,.0f} cells")
    placed = _rounded(points, factor)
    if size.box is None and size.spacing is not None and gaps(placed).least < size.spacing:
        factor *= (size.spacing + ROUNDED_OFF) / size.spacing
        placed = _rounded(points, factor)
    equal = len(placed) - len(np.unique(placed, axis=0))
    if equal:
        raise size.refused(
            f"too small: rounded to {DECIMALS} decimals {equal} of {len(placed)} points lie on another one; "
            "make it larger, or take fewer points"
        )
    return Placed(placed, factor)


def _factor(points: Points, size: Size) -> float:
    """Cells per unit of the points."""
    extent = np.ptp(points, axis=0)
    if size.box is not None:
        bound = extent[: len(size.box)] > 0
        if not bound.any():
            raise size.refused("the points differ in depth alone; a box with a depth is needed")
        return float((np.array(size.box)[bound] / extent[: len(size.box)][bound]).min())
    if size.spacing is None:
        return size.factor
    least, widest = gaps(points).least, float(extent.max())
    if not widest * size.spacing < least * COORDINATE_MAX / 2:
        raise size.refused(
            f"too large: the nearest two are {least:.3g} apart in a cloud {widest:.3g} wide; "
            "take fewer of its points (--points), or say how large it shall be (--box)"
        )
    return size.spacing / least


def _rounded(points: Points, factor: float) -> Points:
    rounded: Points = np.round((points - points.min(axis=0)) * factor + CORNER, DECIMALS)
    return rounded
