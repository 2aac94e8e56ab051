"""Dead reckoning: an FLS flies the length it was asked to, in a direction that is a little off (SwarMer, section 2)."""

from __future__ import annotations

from collections.abc import Callable
from math import atan, cos, hypot, pi, sin, sqrt, tan
from random import Random

Vec3 = tuple[float, float, float]
DeadReckoning = Callable[[Vec3, float, int, Random], Vec3]
"""(v, ε in radians, dimension 2 or 3, generator) -> the displacement flown. Its length is that of v."""


def full(v: Vec3, epsilon: float, dim: int, rng: Random) -> Vec3:
    """Off by an angle uniform in [-ε, ε]; in 3D in a plane through v turned by an angle uniform in [0, 2π)."""
    angle = rng.uniform(-epsilon, epsilon)
    if dim == 2:
        return _turned_in_plane(v, angle)
    return _turned(v, angle, rng.uniform(0.0, 2.0 * pi))


def one_sided(v: Vec3, epsilon: float, dim: int, rng: Random) -> Vec3:
    """The authors' MATLAB model: L unit(v + e u L tan ε), u uniform in [0, 1], e = unit(v × (v2, -v1, 0)) fixed by v.

    A vector along the depth axis flies without error.
    """
    angle = atan(rng.random() * tan(epsilon))
    if dim == 2:
        return _turned_in_plane(v, angle)
    x, y, z = v
    # v × (y, -x, 0) = (x z, y z, -x² - y²)
    e = (x * z, y * z, -x * x - y * y)
    return _towards(v, e, angle)


def one_sided_random(v: Vec3, epsilon: float, dim: int, rng: Random) -> Vec3:
    """The authors' emulator: an angle atan(u tan ε), u uniform in [0, 1], in a random plane."""
    angle = atan(rng.random() * tan(epsilon))
    if dim == 2:
        return _turned_in_plane(v, angle if rng.random() < 0.5 else -angle)
    return _turned(v, angle, rng.uniform(0.0, 2.0 * pi))


MODELS: dict[str, DeadReckoning] = {model.__name__: model for model in (full, one_sided, one_sided_random)}


def _turned_in_plane(v: Vec3, angle: float) -> Vec3:
    c, s = cos(angle), sin(angle)
    return (v[0] * c - v[1] * s, v[0] * s + v[1] * c, v[2])


def _turned(v: Vec3, angle: float, theta: float) -> Vec3:
    """v turned by `angle` towards the normal of v that lies at `theta` about v."""
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if length == 0.0:
        return v
    x, y, z = v[0] / length, v[1] / length, v[2] / length
    # Any normal of v will do; taking the axis least along v keeps the cross product far from zero.
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        n = hypot(y, z)
        a = (0.0, z / n, -y / n)
    elif abs(y) <= abs(z):
        n = hypot(x, z)
        a = (-z / n, 0.0, x / n)
    else:
        n = hypot(x, y)
        a = (y / n, -x / n, 0.0)
    b = (y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0])
    c, s = cos(theta), sin(theta)
    return _towards(v, (a[0] * c + b[0] * s, a[1] * c + b[1] * s, a[2] * c + b[2] * s), angle)


def _towards(v: Vec3, normal: Vec3, angle: float) -> Vec3:
    """v turned by `angle` towards `normal`, which is at a right angle to v and of any length."""
    n = sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if n == 0.0:
        return v
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    c, s = cos(angle), sin(angle) * length / n
    return (v[0] * c + normal[0] * s, v[1] * c + normal[1] * s, v[2] * c + normal[2] * s)
