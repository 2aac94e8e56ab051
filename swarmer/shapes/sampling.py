"""Exactly so many points, well spread: of a cloud, of a surface.

Two ways. Farthest-first takes the point farthest from all chosen before it: no chance in it, but it measures
every point against every chosen one. Blue noise throws darts: points in random order, each taken if none
taken before is nearer than a radius, and the radius sought at which so many are taken as are wanted.
Against weighted sample elimination (Yuksel 2015) it reaches the same least gap in a fraction of the time, and
what it saves buys more candidates, which widen the gap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swarmer.errors import BadInput
from swarmer.shapes.cloud import Points
from swarmer.shapes.errors import BadShape

Rows = NDArray[np.int64]
Cells = NDArray[np.float64]

WORK_MAX = 1_000_000_000  # distances measured by one farthest-first choice, some 10 s; beyond it, blue noise
POOL = 10  # candidates per point chosen farthest-first
FEW = 2000  # points of a surface that are chosen farthest-first
DARTS = 1_000_000  # candidates on a surface for a blue noise ..
DARTS_EACH = (5, 40)  # .. but no fewer and no more than these per point
FIRST_THROW = 64  # candidates looked at together, then twice as many, and so on
TRIALS = 16  # radii tried
SURPLUS = 0.004  # share of the count by which a trial may exceed it, to be good enough
SATURATED = 1.6  # radius at which a surface is full, by the mean gap of as many points in disorder
NARROW = 1.01  # ratio of two radii, too many points and too few, between which none is sought
TINY = 1e-150  # a radius that only a duplicate violates; its square is a number still


def spread_choice(points: Points, count: int) -> Points:
    """`count` of the points (F, 3), far from each other, in the cloud's order; all where there are no more.

    Each is the farthest from all chosen before it, the first the one farthest from the centroid, ties
    going to the lower row. Clouds for which that would take too long get `blue_noise` of a fixed seed.
    Source: Gonzalez, Clustering to minimize the maximum intercluster distance, 1985.
    """
    if count >= len(points):
        return points.copy()
    quick = len(points) * count <= WORK_MAX
    return points[np.sort(_farthest_first(points, count)) if quick else blue_noise(points, count)]


def surface_sample(vertices: Points, faces: Rows, count: int, seed: int) -> Points:
    """Exactly `count` well spread points (count, 3) of a surface of triangles, in the unit of its vertices.

    vertices: (V, 3), faces: (T, 3) rows of vertices. Its `gap_share` is 0.6 or more, where the surface
    comes no nearer to itself than its points are apart. Raises BadShape where the surface has no area.
    """
    if count <= FEW:
        return spread_choice(drawn_on_surface(vertices, faces, POOL * count, seed), count)
    least, most = DARTS_EACH
    drawn = drawn_on_surface(vertices, faces, min(max(DARTS, least * count), most * count), seed)
    return drawn[blue_noise(drawn, count, seed=seed)]


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


def gap_share(points: Points, area: float) -> float:
    """The least distance of two points (F, 3) as a share of what the best arrangement in the plane has.

    That is the hexagonal one: F points on `area`, in the square of their unit, sqrt(2 area / (sqrt(3) F))
    apart. Blue noise of 5, 10, 20, 40 candidates a point comes to some 0.65, 0.70, 0.73, 0.75.
    """
    gap = np.asarray(cKDTree(points).query(points, k=[2])[0]).min()
    return float(gap / np.sqrt(2 * area / (np.sqrt(3) * len(points))))


def blue_noise(
    candidates: Points, count: int, *, weight: Cells | None = None, kept: int = 0, seed: int = 0
) -> Rows:
    """Rows (count,), ascending, of candidates (N, 2 or 3) that are well spread; the first `kept` among them.

    weight: (N,), > 0; a candidate's distance to those chosen before it counts that many times, so where
    it is 2, points stand half as far apart. No two are equal but what `kept` holds. Time grows as N log N,
    memory as N; candidates should be several per point (see `gap_share`), drawn evenly.
    Source: Bridson, Fast Poisson disk sampling in arbitrary dimensions, 2007, for the darts; the search
    of the radius is ours. Raises BadInput (`count`, `weight`), and BadShape where fewer than `count`
    candidates differ.
    """
    if not max(kept, 1) <= count <= len(candidates):
        raise BadInput(
            "count", count, f"{max(kept, 1)} to {len(candidates)}, as many as there are candidates"
        )
    weight = np.ones(len(candidates)) if weight is None else weight
    if not (weight.min() > 0 and np.isfinite(weight).all()):
        raise BadInput("weight", float(weight.min()), "finite numbers above 0")
    shuffled = kept + np.random.default_rng(seed).permutation(len(candidates) - kept)
    order = np.concatenate([np.arange(kept), shuffled])
    return np.sort(order[_exactly(candidates[order], weight[order], count, kept)])


def _exactly(points: Points, weight: Cells, count: int, kept: int) -> Rows:
    """`count` rows of darts thrown in the order of the points, at the largest radius that was found for it."""
    start = np.arange(kept)
    best, low, high = start, 0.0, np.inf
    radius = _first_radius(points[:count], weight)
    for _ in range(TRIALS if radius > 0 else 0):
        taken = _thrown(points, weight, radius, start)
        if len(taken) >= count:
            best, low = taken, radius
            if len(taken) <= (1 + SURPLUS) * count + 1:
                break
        else:
            high = radius
        if high < NARROW * low:
            break
        # A little more than wanted is wanted: `best` has to be no fewer.
        radius *= np.sqrt((len(taken) - kept + 1) / ((1 + SURPLUS / 2) * count - kept + 1))
        if not low < radius < high:
            radius = np.sqrt(low * high) if low > 0 else high / 2
    if len(best) < count:
        best = _thrown(points, weight, TINY, best)
    if len(best) < count:
        raise BadShape(f"{count} points of {len(best)} different ones")
    return best[:count]


def _first_radius(disorder: Points, weight: Cells) -> float:
    if len(disorder) < 2:
        return 0.0
    return float(SATURATED * np.mean(cKDTree(disorder).query(disorder, k=[2])[0]) * weight.mean())


def _thrown(points: Points, weight: Cells, radius: float, start: Rows) -> Rows:
    """`start` and every later row that has, when its turn comes, none taken within radius / weight of it.

    They are looked at in throws, each twice as large as the one before: what room the first left is so
    little that of the next no more than a few compete for it, wherever the points crowd.
    """
    taken, reach = start, radius / weight
    at, size = len(start), FIRST_THROW
    while at < len(points):
        rows = np.arange(at, min(at + size, len(points)))
        if len(taken):
            nearest = cKDTree(points[taken]).query(points[rows], distance_upper_bound=reach[rows].max())[0]
            rows = rows[nearest >= reach[rows]]
        taken = np.concatenate([taken, rows[_first_come(points[rows], reach[rows])]])
        at, size = at + size, 2 * size
    return taken


def _first_come(points: Points, reach: Cells) -> NDArray[np.bool_]:
    """Which of the points (N, 3) are taken, each if no earlier one taken is nearer than its own reach.

    In rounds: who has no earlier rival left is taken, and refuses its later rivals.
    """
    taken, open_still = np.zeros(len(points), dtype=bool), np.ones(len(points), dtype=bool)
    if not len(points):
        return taken
    pairs = cKDTree(points).query_pairs(reach.max(), output_type="ndarray")
    early, late = pairs.min(axis=1), pairs.max(axis=1)
    rivals = np.linalg.norm(points[early] - points[late], axis=1) < reach[late]
    early, late = early[rivals], late[rivals]
    while len(early):
        free = open_still.copy()
        free[late] = False
        taken |= free
        open_still &= ~free
        open_still[late[free[early]]] = False
        left = open_still[early] & open_still[late]
        early, late = early[left], late[left]
    return taken | open_still


def _farthest_first(points: Points, count: int) -> Rows:
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1))
    columns = np.ascontiguousarray(points.T)
    away = np.full(len(points), np.inf)
    for i in range(1, count):
        apart = columns - columns[:, chosen[i - 1], None]
        np.minimum(away, np.einsum("ij,ij->j", apart, apart), out=away)
        chosen[i] = np.argmax(away)
    return chosen
