"""Exactly so many points of a file, upright, in the file's own unit: of points, of a mesh, of a picture."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.errors import BadInput
from swarmer.shapes.cloud import Points, make_cloud
from swarmer.shapes.files import end_of, naming, read_bytes, read_content
from swarmer.shapes.mesh_files import Mesh, mesh_facts
from swarmer.shapes.placing import turned
from swarmer.shapes.sampling import spread_choice, surface_sample

PICTURE = ".png"


class Wish(NamedTuple):
    """What is wanted of the file."""

    points: int | None = None  # None: all points of a file of points
    up: str = "y"  # which axis of the file points up, see `placing.TURNS`
    seed: int = 0
    duplicates: str = "refuse"  # or drop
    invert: bool = False  # of a picture what is light
    flat: bool = False  # as seen from the front, without depth


class Drawn(NamedTuple):
    """Points of a file, and what there is to say about it."""

    points: Points  # (N, 3), the file's unit, height along axis 1
    what: str
    warnings: tuple[str, ...] = ()


def draw_file(path: Path, wish: Wish) -> Drawn:
    """The points of the file that are wished for. Raises BadShape, and BadInput (`points`, `up`, `invert`)."""
    if path.suffix.lower() == PICTURE:
        return _of_picture(path, wish)
    if wish.invert:
        raise BadInput.saying(f"invert: {end_of(str(path))} is no picture (.png)")
    content = read_content(path)
    if isinstance(content, Mesh) and len(content.faces):
        return _of_mesh(path, content, wish)
    return _of_points(path, content.vertices if isinstance(content, Mesh) else content, wish)


def _of_picture(path: Path, wish: Wish) -> Drawn:
    from swarmer.shapes.picture_files import read_silhouette, silhouette_cloud

    if wish.up != "y":
        raise BadInput("up", wish.up, "y for a picture, which is upright")
    count = _needed(wish.points, "a picture")
    data = read_bytes(path)
    with naming(end_of(str(path)), PICTURE):
        mask = read_silhouette(data, wish.invert)
        flat = silhouette_cloud(mask, count, wish.seed)
    rows, columns = mask.shape
    what = f"a picture of {columns} x {rows} pixels, {mask.mean():.0%} of them drawn"
    return Drawn(np.column_stack([flat, np.zeros(count)]), what)


def _of_mesh(path: Path, mesh: Mesh, wish: Wish) -> Drawn:
    count = _needed(wish.points, "a mesh")
    where = end_of(str(path))
    make_cloud(path.stem, mesh.vertices, licence="", source="", called=where)  # for its checks alone
    facts = mesh_facts(mesh)
    with naming(where, path.suffix):
        points = surface_sample(_seen(mesh.vertices, wish), mesh.faces, count, wish.seed)
    what = f"a mesh of {facts.triangles:,} triangle{'s' * (facts.triangles != 1)}"
    what += f" in {facts.bodies} bodies" if facts.bodies > 1 else ""
    warnings = []
    if facts.watertight:
        what += ", watertight"
    else:
        what += ", not watertight"
        warnings.append("the mesh has holes or loose edges; its surface is sampled as it is")
    if facts.flat_triangles:
        warnings.append(
            f"triangles without area: {facts.flat_triangles} of {facts.triangles}; no point is on them"
        )
    return Drawn(points, what, tuple(warnings))


def _of_points(path: Path, rows: NDArray[Any], wish: Wish) -> Drawn:
    where = end_of(str(path))
    checked = partial(make_cloud, path.stem, licence="", source="", called=where)
    cloud = checked(rows, duplicates=wish.duplicates)
    dropped = cloud.dropped
    cloud = checked(_seen(cloud.points, wish), duplicates="drop")  # pressed flat, some come to lie on others
    dropped += cloud.dropped
    count = wish.points or len(cloud)
    if count > len(cloud):
        raise BadInput("points", count, f"2 to {len(cloud)}, as many as {where} has")
    what = f"{len(rows):,} points, {dropped or 'no'} duplicates{' dropped' if dropped else ''}"
    return Drawn(spread_choice(cloud.points, count), what)


def _needed(count: int | None, what: str) -> int:
    if count is None:
        raise BadInput.saying(f"points: {what} needs a count, as --points 760")
    return count


def _seen(points: Points, wish: Wish) -> Points:
    upright = turned(points, wish.up)
    return upright * (1.0, 1.0, 0.0) if wish.flat else upright
