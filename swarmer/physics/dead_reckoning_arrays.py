"""Dead reckoning of many flights at once: the models of `dead_reckoning`, an array at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Vectors = NDArray[np.float64]  # (n, 3), display cells
ArrayDeadReckoning = Callable[[Vectors, float, int, np.random.Generator], Vectors]
"""(v, ε in radians, dimension 2 or 3, generator) -> the displacements flown. Their lengths are those of v."""


def full(v: Vectors, epsilon: float, dim: int, rng: np.random.Generator) -> Vectors:
    """See `dead_reckoning.full`."""
    angle = rng.uniform(-epsilon, epsilon, len(v))
    if dim == 2:
        return _turned_in_plane(v, angle)
    return _towards(v, _random_normals(v, rng), angle)


def one_sided(v: Vectors, epsilon: float, dim: int, rng: np.random.Generator) -> Vectors:
    """See `dead_reckoning.one_sided`."""
    angle = np.arctan(rng.random(len(v)) * np.tan(epsilon))
    if dim == 2:
        return _turned_in_plane(v, angle)
    x, y, z = v.T
    return _towards(v, np.stack([x * z, y * z, -x * x - y * y], axis=1), angle)


def one_sided_random(v: Vectors, epsilon: float, dim: int, rng: np.random.Generator) -> Vectors:
    """See `dead_reckoning.one_sided_random`."""
    angle = np.arctan(rng.random(len(v)) * np.tan(epsilon))
    if dim == 2:
        return _turned_in_plane(v, np.where(rng.random(len(v)) < 0.5, angle, -angle))
    return _towards(v, _random_normals(v, rng), angle)


MODELS: dict[str, ArrayDeadReckoning] = {
    model.__name__: model for model in (full, one_sided, one_sided_random)
}


def lengths(v: Vectors) -> NDArray[np.float64]:
    """(n,) lengths of (n, 3) vectors."""
    length: NDArray[np.float64] = np.sqrt(np.einsum("ij,ij->i", v, v))
    return length


def _turned_in_plane(v: Vectors, angle: NDArray[np.float64]) -> Vectors:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([v[:, 0] * c - v[:, 1] * s, v[:, 0] * s + v[:, 1] * c, v[:, 2]], axis=1)


def _random_normals(v: Vectors, rng: np.random.Generator) -> Vectors:
    """(n, 3): normals of v at angles uniform in [0, 2π) about it.

    Any basis of the normal plane will do. This one (Duff et al. 2017, Journal of Computer Graphics Techniques 6) is
    exact for every direction, also along an axis.
    """
    theta = rng.uniform(0.0, 2.0 * np.pi, len(v))
    length = lengths(v)
    x, y, z = (v / np.where(length > 0, length, 1.0)[:, None]).T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    c, s = np.cos(theta), np.sin(theta)
    return np.stack(
        [
            (1.0 + sign * x * x * a) * c + b * s,
            sign * b * c + (sign + y * y * a) * s,
            -sign * x * c - y * s,
        ],
        axis=1,
    )


def _towards(v: Vectors, normal: Vectors, angle: NDArray[np.float64]) -> Vectors:
    """v turned by `angle` towards `normal`, which is at a right angle to v and of any length; without one, v."""
    n = lengths(normal)
    there = n > 0
    sine = np.where(there, np.sin(angle) * lengths(v) / np.where(there, n, 1.0), 0.0)
    cosine = np.where(there, np.cos(angle), 1.0)
    flown: Vectors = v * cosine[:, None] + normal * sine[:, None]
    return flown
