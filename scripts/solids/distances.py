"""Solids as signed distances, evaluated for many points together, and points drawn on their level sets.

A field takes points (N, 3), (L, H, D) in display cells, and gives (N,): below 0 inside, 0 on the surface,
about the distance near it. Its scale need not be exact: who draws on it divides by its slope.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.sampling import blue_noise

Array = NDArray[np.float64]
Field = Callable[[Array], Array]

FAR = 9.0  # cells: what a field says where a part is out of reach
STEP = 1e-3  # cells, for slopes
SHELL = 0.5  # cells, half the thickness of the layer that points are drawn from
AROUND = 1.117  # cells from a cube's middle to its corners and more; odd, that no middle lies just so far off
NEWTON = 3  # steps from there to the surface
STEEPEST = 5.03  # cells: a field says no more than this beside a surface
DECIMALS = 3  # of a candidate: what two processors round differently must not decide who is chosen
DENSITY = 24  # candidates a cell² of the surface; half as many on the shells


def melted(rows: Array, blend: float, flat: Sequence[float] = (0, 0, 0)) -> Field:
    """Tapered capsules (L, H, D, r, L', H', D', r') (N, 8) melted together, a smooth minimum of `blend` cells.

    flat: a direction in which they are thinner, by 1 + its length.
    """
    normal = np.asarray(flat, dtype=np.float64)
    thinner = float(np.linalg.norm(normal))
    normal = normal / max(thinner, 1e-12)

    def field(points: Array) -> Array:
        total = np.zeros(len(points))
        for row in rows:
            at = _within(points, row, 6 * blend)
            start, axis = row[:3], row[4:7] - row[:3]
            offset = points[at] - start
            along = np.clip(offset @ axis / max(axis @ axis, 1e-12), 0, 1)
            away = offset - along[:, None] * axis
            if thinner:
                away += thinner * (away @ normal)[:, None] * normal
            distance = np.sqrt(np.einsum("ij,ij->i", away, away)) - row[3] - along * (row[7] - row[3])
            total[at] += np.exp(-np.maximum(distance, -200 * blend) / blend)
        reached = total > np.exp(-6.0)
        return np.where(reached, -blend * np.log(np.where(reached, total, 1)), FAR)

    return field


def _within(points: Array, row: Array, margin: float) -> NDArray[np.int64]:
    """Which of the points lie near the capsule's box."""
    reach = max(row[3], row[7]) + margin
    low, high = np.minimum(row[:3], row[4:7]) - reach, np.maximum(row[:3], row[4:7]) + reach
    at = np.flatnonzero((points[:, 0] > low[0]) & (points[:, 0] < high[0]))
    for axis in (1, 2):
        at = at[(points[at, axis] > low[axis]) & (points[at, axis] < high[axis])]
    return at


def slab(centre: Sequence[float], half: Sequence[float], rounding: float = 0.3) -> Field:
    """A box with rounded edges."""

    def field(points: Array) -> Array:
        out = np.abs(points - np.array(centre)) - np.array(half) + rounding
        outside = np.sqrt((np.maximum(out, 0) ** 2).sum(axis=1))
        return np.asarray(outside + np.minimum(out.max(axis=1), 0) - rounding)

    return field


def drum(centre: Sequence[float], axis: int, radius: float, half: float, rounding: float = 0.3) -> Field:
    """A cylinder along a coordinate axis with rounded edges."""

    def field(points: Array) -> Array:
        offset = points - np.array(centre)
        across = np.delete(offset, axis, axis=1)
        out = np.column_stack([np.hypot(*across.T) - radius, np.abs(offset[:, axis]) - half]) + rounding
        outside = np.hypot(*np.maximum(out, 0).T)
        return np.asarray(outside + np.minimum(out.max(axis=1), 0) - rounding)

    return field


def ellipsoid(centre: Sequence[float], radii: Sequence[float]) -> Field:
    def field(points: Array) -> Array:
        scaled = (points - np.array(centre)) / np.array(radii)
        return np.asarray((np.sqrt((scaled**2).sum(axis=1)) - 1) * min(radii))

    return field


def loft(sections: Sequence[Sequence[float]], squareness: float = 3.0) -> Field:
    """A hull along the height axis, from sections (H, middle L, half width, lowest D, highest D), H rising.

    Each section is a superellipse: 2 is an ellipse, much more a box.
    """
    knots = np.asarray(sections, dtype=np.float64)

    def field(points: Array) -> Array:
        at = points[:, 1]
        middle, half, low, high = (np.interp(at, knots[:, 0], column) for column in knots.T[1:])
        tall = (high - low) / 2
        across = np.abs(points[:, 0] - middle) / half
        up = np.abs(points[:, 2] - (high + low) / 2) / tall
        round_it = (across**squareness + up**squareness) ** (1 / squareness) - 1
        ends = np.maximum(knots[0, 0] - at, at - knots[-1, 0])
        return np.asarray(np.maximum(round_it * np.minimum(half, tall), ends))

    return field


def union(*fields: Field) -> Field:
    return lambda points: reduce(np.minimum, (field(points) for field in fields))


def without(field: Field, *holes: Field) -> Field:
    """The first, less the others."""
    return lambda points: reduce(np.maximum, (-hole(points) for hole in holes), field(points))


def both_sides(field: Field) -> Field:
    """What the field has at L > 0, also mirrored to L < 0."""
    return lambda points: field(points * np.where(points[:, :1] < 0, (-1.0, 1.0, 1.0), 1.0))


class Cubes(NamedTuple):
    """The unit cubes of a box that may hold a level set: their middles, the field there and its steepness."""

    middle: Array  # (N, 3)
    value: Array  # (N,)
    steep: Array  # (N,)


def cubes_of(field: Field, box: Sequence[Sequence[float]], deepest: float) -> Cubes:
    """The cubes of the box, lowest and highest (L, H, D), where the field is not far from `deepest` to 0."""
    axes = [np.arange(low, high) + 0.5 for low, high in zip(*box, strict=True)]
    middle = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    value = field(middle)
    near = (value < STEEPEST) & (value > deepest - STEEPEST)
    slope = _slope(field, middle[near], value[near])
    return Cubes(middle[near], value[near], np.maximum(np.linalg.norm(slope, axis=1), 0.7))


def drawn_on_level(
    field: Field, level: float, cubes: Cubes, density: float, rng: np.random.Generator
) -> Array:
    """Points (N, 3) on the surface where `field` is `level`, some `density` on a cell².

    They are drawn uniformly from a thin layer around the surface, then moved onto it along the slope.
    """
    near = np.abs(cubes.value - level) < cubes.steep * (SHELL + AROUND)
    number = rng.poisson(density / (2 * SHELL), int(near.sum()))
    points = np.repeat(cubes.middle[near], number, axis=0) + rng.uniform(-0.5, 0.5, (number.sum(), 3))
    for step in range(NEWTON):
        value = field(points)
        slope = _slope(field, points, value)
        squared = np.maximum((slope**2).sum(axis=1), 1e-6)
        away = (value - level) / squared
        if step == 0:
            close = np.abs(away) * np.sqrt(squared) < SHELL
            points, slope, away = points[close], slope[close], away[close]
        points = points - away[:, None] * slope
    arrived = np.abs(field(points) - level) < 0.05
    return np.asarray(points[arrived])


def _slope(field: Field, points: Array, value: Array) -> Array:
    return np.column_stack([(field(points + step) - value) / STEP for step in STEP * np.eye(3)])


def filled(
    field: Field,
    box: Sequence[Sequence[float]],
    count: int,
    *,
    levels: Sequence[float],
    inner_weight: float,
    dark: Field | None = None,
) -> Array:
    """`count` points (count, 3), blue noise over the surface and over shells inside of it.

    levels: of the shells, each below 0. inner_weight: how dense they are beside the surface (see
    `blue_noise`). dark: where it is below 0, nothing is lit: grooves, joints.
    """
    rng = np.random.default_rng(count)
    cubes = cubes_of(field, box, min(levels))
    first = drawn_on_level(field, 0.0, cubes, DENSITY, rng)
    inner = [drawn_on_level(field, level, cubes, DENSITY / 2, rng) for level in levels]
    candidates = np.vstack([first, *inner]).round(DECIMALS)
    weight = np.where(np.arange(len(candidates)) < len(first), 1.0, inner_weight)
    if dark is not None:
        lit = dark(candidates) > 0
        candidates, weight = candidates[lit], weight[lit]
    return np.asarray(candidates[blue_noise(candidates, count, weight=weight)])
