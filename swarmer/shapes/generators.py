"""Shapes made from a count alone: sphere, cube, knot, random. Their lower corner lies at `CORNER`."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from swarmer.shapes.cloud import Points

CORNER = 3.0  # cells, of every shape of the catalogue: the dispatcher at (0, 0, 0) stays outside
SPACING = 2.0  # cells between nearest points of sphere and cube
KNOT_RADII = (2.0, 1.0)  # of the torus and of its tube, in one another's unit
RANDOM_GAP = 1.0  # cells, least distance of two random points
RANDOM_ROOM = 27.0  # cubic cells per random point, so some 3 cells from one to the next


def sphere(count: int, seed: int = 0) -> Points:
    """`count` points on a sphere, (count, 3), nearest two 2 cells apart; a Fibonacci lattice.

    Latitudes are (2i + 1)/count - 1, longitudes i times the golden angle (Gonzalez 2010,
    Mathematical Geosciences 42). `seed` is not used.
    """
    index = np.arange(count)
    height = (2 * index + 1) / count - 1
    angle = index * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    unit = np.column_stack([ring * np.cos(angle), height, ring * np.sin(angle)])
    gap = np.asarray(cKDTree(unit).query(unit, k=[2])[0]).min()
    return to_corner(unit * (SPACING / gap))


def cube(count: int, seed: int = 0) -> Points:
    """The box lattice nearest to a cube with at least `count` points, 2 cells apart, trimmed to `count`.

    What is too many goes from the corners inwards, opposite points together. `seed` is not used.
    """
    sides = _sides(count)
    lattice = np.array(list(product(*(range(side) for side in sides))), dtype=np.float64)
    offset = lattice - (np.array(sides) - 1) / 2
    far = (offset**2).sum(axis=1)
    row = np.arange(len(lattice))
    pair = np.minimum(row, row[::-1])  # product order: the opposite of row i is row -1 - i
    keep = np.sort(np.lexsort((row, pair, far))[:count])
    return to_corner(lattice[keep] * SPACING)


def knot(count: int, seed: int = 0) -> Points:
    """`count` points evenly along a trefoil, the (2, 3) torus knot, (count, 3), nearest two 2 cells apart.

    The curve runs twice around the torus and three times through it. `seed` is not used.
    """
    turn = np.linspace(0, 2 * np.pi, 64 * count + 1)
    ring = KNOT_RADII[0] + KNOT_RADII[1] * np.cos(3 * turn)
    curve = np.column_stack(
        [ring * np.cos(2 * turn), ring * np.sin(2 * turn), KNOT_RADII[1] * np.sin(3 * turn)]
    )
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.arange(count) * length[-1] / count
    points = np.column_stack([np.interp(at, length, column) for column in curve.T])
    gap = np.asarray(cKDTree(points).query(points, k=[2])[0]).min()
    return to_corner(points * (SPACING / gap))


def random(count: int, seed: int = 0) -> Points:
    """`count` uniform points in a cube of 27 cells³ each, no two nearer than 1 cell; darts, by `seed`."""
    rng = np.random.default_rng(seed)
    side = (RANDOM_ROOM * count) ** (1 / 3)
    points = np.empty((0, 3))
    while len(points) < count:
        darts = rng.uniform(0, side, size=(2 * (count - len(points)), 3))
        both = np.concatenate([points, darts])
        pairs = cKDTree(both).query_pairs(RANDOM_GAP, output_type="ndarray")
        later = np.unique(pairs.max(axis=1))  # the older of two that are too near stays
        points = np.delete(both, later, axis=0)[:count]
    return to_corner(points)


def to_corner(points: Points) -> Points:
    """Shift so that the least coordinate along each axis is `CORNER`."""
    moved: Points = points - points.min(axis=0) + CORNER
    return moved


def _sides(count: int) -> tuple[int, int, int]:
    side = 1
    while side**3 < count:
        side += 1
    boxes = [(side, side - 1, side - 1), (side, side, side - 1), (side, side, side)]
    return next(box for box in boxes if box[0] * box[1] * box[2] >= count)
