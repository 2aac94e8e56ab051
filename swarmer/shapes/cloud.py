"""A checked point cloud: what every engine is given as ground truth."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.errors import BadShape

Points = NDArray[np.float64]  # (F, 3), display cells

UP_AXIS = 1
"""The axis that points up in a picture. A point is (L, H, D): length, height, depth, so height is 1."""

POINTS_MAX = 10_000_000
COORDINATE_MAX = 1e7  # cells; squares and their sums stay exact enough, and it is 500 km of display
SMALLEST_SPACING = 1.0  # cells: a display cell holds one light


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """At least two different points in display cells. Row i is the ground truth of FID i + 1."""

    name: str
    points: Points  # (F, 3), read-only
    dim: int  # 2 where the depth is constant, else 3
    licence: str
    source: str  # how it was made, or the file it was read from
    credit: str = ""
    dropped: int = 0  # duplicates removed, see `make_cloud`

    def __len__(self) -> int:
        return len(self.points)

    @property
    def box_cells(self) -> tuple[float, float, float]:
        """Extent along length, height and depth, display cells."""
        length, height, depth = (float(extent) for extent in np.ptp(self.points, axis=0))
        return length, height, depth

    @property
    def sha256(self) -> str:
        """A hash of the points and their order: two clouds with the same one are the same ground truth."""
        return hashlib.sha256(self.points.astype("<f8").tobytes()).hexdigest()


def make_cloud(
    name: str,
    rows: NDArray[Any],
    *,
    licence: str,
    source: str,
    credit: str = "",
    duplicates: str = "refuse",
    called: str | None = None,
) -> PointCloud:
    """Check rows of (F, 2) or (F, 3) coordinates in display cells and make a cloud of them.

    Rows of two columns get depth 0. Duplicates end in an error (`refuse`), or all but the first of
    each are removed and counted in `dropped` (`drop`). `called`: its name in error lines, if another.
    Raises BadShape: wrong columns, fewer than two points or more than 10^7, a coordinate that is not
    finite or beyond 10^7 cells, duplicates, all points equal.
    """
    called = called or name
    if rows.ndim != 2 or rows.shape[1] not in (2, 3):
        raise BadShape(f"{called}: points need 2 or 3 coordinates each, got an array of shape {rows.shape}")
    if len(rows) > POINTS_MAX:
        raise BadShape(f"{called}: {len(rows)} points; at most {POINTS_MAX:,} are taken")
    points = np.zeros((len(rows), 3))
    points[:, : rows.shape[1]] = rows
    _refuse_bad_numbers(called, points)
    if len(points) < 2:
        raise BadShape(f"{called}: {_count(len(points))}; at least 2 are needed")
    points += 0.0  # -0.0 and 0.0 are one point, also when compared byte by byte
    kept, dropped = _without_duplicates(called, points, duplicates)
    kept.setflags(write=False)
    return PointCloud(
        name=name,
        points=kept,
        dim=2 if np.ptp(kept[:, 2]) == 0 else 3,
        licence=licence,
        source=source,
        credit=credit,
        dropped=dropped,
    )


def with_points(cloud: PointCloud, points: Points) -> PointCloud:
    """The same cloud with other points, checked anew."""
    made = make_cloud(cloud.name, points, licence=cloud.licence, source=cloud.source)
    return replace(cloud, points=made.points, dim=made.dim)


def flattened(cloud: PointCloud, duplicates: str = "refuse") -> PointCloud:
    """The cloud without its depth, checked anew: points that differed in depth alone are duplicates now."""
    flat = make_cloud(
        cloud.name, cloud.points[:, :2], licence=cloud.licence, source=cloud.source, credit=cloud.credit,
        duplicates=duplicates,
    )  # fmt: skip
    return replace(flat, dropped=cloud.dropped + flat.dropped)


def _count(number: int) -> str:
    return "1 point" if number == 1 else f"{number} points"


def _refuse_bad_numbers(name: str, points: Points) -> None:
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise BadShape(
            f"{name}: point {row + 1} is {_tuple(points[row])}; coordinates must be finite numbers"
        )
    far = (np.abs(points) > COORDINATE_MAX).any(axis=1)
    if far.any():
        row = int(np.argmax(far))
        raise BadShape(
            f"{name}: point {row + 1} is {_tuple(points[row])}; "
            f"coordinates must lie within {COORDINATE_MAX:,.0f} cells of 0"
        )


def _without_duplicates(name: str, points: Points, duplicates: str) -> tuple[Points, int]:
    in_order = points[np.lexsort(points.T)]
    if not (in_order[1:] == in_order[:-1]).all(axis=1).any():  # a third of the time of what follows
        return points, 0
    _, first, copies = np.unique(points, axis=0, return_index=True, return_counts=True)
    if len(first) == 1:
        raise BadShape(
            f"{name}: all {len(points)} points are equal, {_tuple(points[0])}; at least 2 must differ"
        )
    if duplicates != "drop":
        more_than_once = points[np.sort(first[copies > 1])]
        shown = ", ".join(_tuple(point) for point in more_than_once[:5])
        rest = ", ..." if len(more_than_once) > 5 else ""
        raise BadShape(
            f"{name}: {len(points) - len(first)} of {len(points)} points are duplicates: {shown}{rest}; "
            "two FLSs cannot share a point, --dedupe (duplicates: drop) removes them"
        )
    return points[np.sort(first)], len(points) - len(first)


def _tuple(point: Points) -> str:
    return "(" + ", ".join(f"{value:g}" for value in point) + ")"
