"""Exactly so many points, well spread: of a cloud, of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.cloud import Points
from swarmer.shapes.errors import BadShape

Rows = NDArray[np.int64]

WORK_MAX = 1_000_000_000  # distances measured by one choice, some 10 s
POOL = 10  # candidates per chosen point


def spread_choice(points: Points, count: int) -> Points:
    """`count` of the points (F, 3), each the farthest from all chosen before it, in the cloud's order.

    The first is the one farthest from the centroid; ties go to the lower row, so there is no chance
    in it. Clouds for which that would take too long are thinned evenly first.
    Source: Gonzalez, Clustering to minimize the maximum intercluster distance, 1985.
    """
    pool = np.arange(len(points))
    limit = max(count, WORK_MAX // count)
    if len(points) > limit:
        pool = np.linspace(0, len(points) - 1, limit).astype(np.int64)
    return points[pool[np.sort(_farthest_first(points[pool], count))]]


def surface_sample(vertices: Points, faces: Rows, count: int, seed: int) -> Points:
    """Exactly `count` well spread points (count, 3) of a surface of triangles, in the unit of its vertices.

    vertices: (V, 3), faces: (T, 3) rows of vertices. Up to ten times as many are drawn and the spread
    of them kept. Raises BadShape where the surface has no area.
    """
    drawn = max(count, min(POOL * count, WORK_MAX // count))
    return spread_choice(drawn_on_surface(vertices, faces, drawn, seed), count)


def drawn_on_surface(vertices: Points, faces: Rows, count: int, seed: int) -> Points:
    """`count` points (count, 3) drawn uniformly by area. Arguments and errors as for `surface_sample`."""
    corners = vertices[faces]
    edge, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(edge, other), axis=1)
    if not 0 < area.sum() < np.inf:
        raise BadShape("its surface has no area")
    rng = np.random.default_rng(seed)
    face = rng.choice(len(faces), size=count, p=area / area.sum())
    along, across = rng.random((2, count, 1))
    mirror = along + across > 1  # the other half of the parallelogram, folded back onto the triangle
    along, across = np.where(mirror, 1 - along, along), np.where(mirror, 1 - across, across)
    drawn: Points = corners[face, 0] + along * edge[face] + across * other[face]
    return drawn


def _farthest_first(points: Points, count: int) -> NDArray[np.int64]:
    if count >= len(points):
        return np.arange(len(points))
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1))
    columns = np.ascontiguousarray(points.T)
    away = np.full(len(points), np.inf)
    for i in range(1, count):
        apart = columns - columns[:, chosen[i - 1], None]
        np.minimum(away, np.einsum("ij,ij->j", apart, apart), out=away)
        chosen[i] = np.argmax(away)
    return chosen
