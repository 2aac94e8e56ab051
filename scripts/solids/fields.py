"""Smooth bodies from tapered capsules, curves, and points spread over both.

Lengths are in display cells; a point is (L, H, D): length, height (up), depth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swarmer.shapes.sampling import drawn_on_surface

Array = NDArray[np.float64]
Field = Callable[[float, float, float], float]


def smooth_curve(knots: Sequence[Sequence[float]], steps: int = 12) -> Array:
    """A Catmull-Rom curve through `knots` (K, C), `steps` pieces a span: ((K - 1) * steps + 1, C).

    Any number of columns: a fourth one, the radius, is smoothed along.
    """
    knot = np.asarray(knots, dtype=np.float64)
    padded = np.vstack([2 * knot[0] - knot[1], knot, 2 * knot[-1] - knot[-2]])
    t = (np.arange(steps) / steps)[:, None]
    spans = []
    for before, start, end, after in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        spans.append(
            start
            + 0.5 * t * (end - before)
            + t**2 * (before - 2.5 * start + 2 * end - 0.5 * after)
            + t**3 * (1.5 * (start - end) + 0.5 * (after - before))
        )
    return np.vstack([*spans, knot[-1:]])


def evenly(curve: Array, spacing: float, start: float = 0.0) -> Array:
    """Points about `spacing` apart along a polyline (N, C), both ends included when `start` is 0."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve[:, :3], axis=0), axis=1))])
    count = max(1, round((length[-1] - start) / spacing))
    at = np.linspace(start, length[-1], count + 1)
    return np.column_stack([np.interp(at, length, column) for column in curve.T])


def capsules(*chains: Array) -> Array:
    """Rows (L, H, D, r, L', H', D', r') of all consecutive pairs of the chains' rows (L, H, D, r)."""
    return np.vstack([np.hstack([chain[:-1], chain[1:]]) for chain in chains])


def smooth_union(rows: Array, blend: float) -> Field:
    """The field of tapered capsules melted together: > 0 inside, its zero is the surface.

    A capsule's signed distance is taken with the radius of the nearest point of its axis; the
    smooth minimum is -b log(sum exp(-d / b)) with `blend` b in cells.
    """
    start, axis = rows[:, :3], rows[:, 4:7] - rows[:, :3]
    radius, taper = rows[:, 3], rows[:, 7] - rows[:, 3]
    squared = np.maximum((axis**2).sum(axis=1), 1e-12)

    def field(x: float, y: float, z: float) -> float:
        offset = np.array([x, y, z]) - start
        along = np.clip((offset * axis).sum(axis=1) / squared, 0.0, 1.0)
        away = offset - along[:, None] * axis
        distance = np.sqrt((away * away).sum(axis=1)) - radius - along * taper
        nearest = distance.min()
        return float(-nearest + blend * np.log(np.exp((nearest - distance) / blend).sum()))

    return field


def body(rows: Array, blend: float, edge: float) -> manifold3d.Manifold:
    """The closed surface of `smooth_union(rows, blend)`, triangles of some `edge` cells."""
    reach = np.maximum(rows[:, 3], rows[:, 7]).max() + 2 * blend
    low = np.minimum(rows[:, :3], rows[:, 4:7]).min(axis=0) - reach
    high = np.maximum(rows[:, :3], rows[:, 4:7]).max(axis=0) + reach
    return manifold3d.Manifold.level_set(smooth_union(rows, blend), [*low, *high], edge)


def drawn_on(solid: manifold3d.Manifold, count: int, seed: int) -> Array:
    """`count` points (count, 3) drawn uniformly by area on the surface of `solid`."""
    mesh = solid.to_mesh()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return drawn_on_surface(vertices, np.asarray(mesh.tri_verts, dtype=np.int64), count, seed)


def fill_up(lines: Array, candidates: Array, weight: Array, count: int) -> Array:
    """`lines` and as many of the candidates as make `count` points, each as far as may be from the rest.

    A candidate's distance counts `weight` times, so a heavier part of the surface gets more points:
    blue noise of varying density.
    """
    chosen = [*lines]
    away = np.full(len(candidates), np.inf)
    for point in lines:
        away = np.minimum(away, np.linalg.norm(candidates - point, axis=1))
    while len(chosen) < count:
        best = int(np.argmax(away * weight))
        chosen.append(candidates[best])
        away = np.minimum(away, np.linalg.norm(candidates - candidates[best], axis=1))
    return np.array(chosen)


def thinned(points: Array, gap: float) -> Array:
    """The points without those nearer than `gap` to an earlier one."""
    kept: list[Array] = []
    for point in points:
        if not kept or np.linalg.norm(np.array(kept) - point, axis=1).min() >= gap:
            kept.append(point)
    return np.array(kept)


def drawn_on_sheets(sheets: Sequence[Array], count: int, seed: int) -> Array:
    """`count` points (count, 3) drawn uniformly by area on grids (rows, columns, 3) of points."""
    corners, faces, first = [], [], 0
    for sheet in sheets:
        rows, columns = sheet.shape[:2]
        at = first + np.arange(rows * columns).reshape(rows, columns)
        one, right, above, other = at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]
        faces += [
            np.stack(three, axis=-1).reshape(-1, 3) for three in ((one, right, other), (one, other, above))
        ]
        corners.append(sheet.reshape(-1, 3))
        first += rows * columns
    return drawn_on_surface(np.vstack(corners), np.vstack(faces).astype(np.int64), count, seed)


def settled(points: Array, fixed: int, candidates: Array, weight: Array, rounds: int = 12) -> Array:
    """The points with all but the first `fixed` moved to the middle of what is nearest to them: Lloyd's way.

    The middle is taken over the candidates, density `weight` squared as in `fill_up`, and the one
    nearest to it is the new place, so that nothing leaves the surface.
    """
    moved, tree = points.copy(), cKDTree(candidates)
    mass = weight**2
    for _ in range(rounds):
        owner = np.asarray(cKDTree(moved).query(candidates)[1])
        total = np.bincount(owner, mass, minlength=len(moved))
        owning = np.flatnonzero(total[fixed:]) + fixed
        sums = np.column_stack(
            [np.bincount(owner, mass * axis, minlength=len(moved)) for axis in candidates.T]
        )
        moved[owning] = candidates[np.asarray(tree.query(sums[owning] / total[owning, None])[1])]
    return moved


def spread(lines: Array, candidates: Array, weight: Array, count: int, gap: float) -> Array:
    """`count` points (count, 3): the lines, thinned, then the candidates' blue noise, settled.

    What comes nearer than `gap` cells to an earlier one while settling is put elsewhere.
    """
    fixed = thinned(lines, gap)
    points = settled(fill_up(fixed, candidates, weight, count), len(fixed), candidates, weight)
    return fill_up(thinned(points, gap), candidates, weight, count)


def boxed(points: Array, box: Sequence[float]) -> Array:
    """The points, stretched along each axis to fill the box exactly, lower corner at 0."""
    at_corner = points - points.min(axis=0)
    return np.asarray(at_corner * (np.array(box) / at_corner.max(axis=0)))
