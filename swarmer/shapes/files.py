"""A file becomes a cloud: what is refused before it is read, and who reads what."""

from __future__ import annotations

import shlex
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from swarmer.errors import BadInput, shown
from swarmer.shapes.array_files import read_mat, read_npy
from swarmer.shapes.cloud import PointCloud, make_cloud, with_points
from swarmer.shapes.errors import BadShape
from swarmer.shapes.mesh_files import Mesh, read_mesh
from swarmer.shapes.sampling import spread_choice, surface_sample
from swarmer.shapes.text_files import read_text, read_xyz, refuse_many_lines

FILE_BYTES_MAX = 512 * 2**20
PICTURES = frozenset((".png", ".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp", ".svg"))


class _Format(NamedTuple):
    read: Callable[[bytes], NDArray[Any] | Mesh]
    what: str


FORMATS: dict[str, _Format] = {
    ".ptcld": _Format(read_text, "rows of numbers"),
    ".txt": _Format(read_text, "rows of numbers"),
    ".csv": _Format(read_text, "rows of numbers, a header line may lead"),
    ".xyz": _Format(read_xyz, "rows of numbers, or a molecule: count, comment, `C 1.0 2.0 3.0`"),
    ".npy": _Format(read_npy, "one array (F, 2) or (F, 3 or more)"),
    ".mat": _Format(read_mat, "MATLAB 4 to 7.2, one numeric N x 2 or N x 3 array"),
    ".off": _Format(lambda data: read_mesh(data, "off"), "mesh"),
    ".ply": _Format(lambda data: read_mesh(data, "ply"), "mesh or points"),
    ".obj": _Format(lambda data: read_mesh(data, "obj"), "mesh or points"),
    ".stl": _Format(lambda data: read_mesh(data, "stl"), "mesh"),
    ".glb": _Format(lambda data: read_mesh(data, "glb"), "mesh or points"),
}
SUFFIXES = frozenset(FORMATS)


def read_cloud(
    path: Path, points: int | None = None, duplicates: str = "refuse", seed: int = 0
) -> PointCloud:
    """The cloud in the file, its numbers taken as display cells.

    A mesh with faces gives its vertices, or, with `points`, that many points of its surface; a file
    of points gives them all, or a choice of them. A shape that is small in its own unit keeps its
    size, so its spacing may come out under one cell: nothing is scaled here.
    Raises BadShape (`shape: ...`, one line) and BadInput (`points`).
    """
    content = read_content(path)
    return _cloud(content, path, end_of(str(path)), points, duplicates, seed)


def read_content(path: Path) -> NDArray[Any] | Mesh:
    """What the file holds, in its own unit: rows (N, 2) or (N, 3), not yet looked at, or a mesh.

    Raises BadShape (`shape: ...`, one line that names the file).
    """
    where = end_of(str(path))
    _refuse_what_is_no_file(path, where)
    form = FORMATS.get(path.suffix.lower())
    if form is None:
        raise BadShape(f"{where}: {_not_known(path)}")
    with naming(where, path.suffix):
        if form.read in (read_text, read_xyz):
            with path.open("rb") as file:
                refuse_many_lines(file)
        return form.read(path.read_bytes())


def read_bytes(path: Path) -> bytes:
    """All of a plain file that is neither empty nor too large. Raises BadShape, naming it."""
    where = end_of(str(path))
    _refuse_what_is_no_file(path, where)
    with naming(where, path.suffix):
        return path.read_bytes()


def _not_known(path: Path) -> str:
    if path.suffix.lower() in PICTURES:
        is_png = path.suffix.lower() == ".png"
        png = path if is_png else path.with_suffix(".png")
        name = pasteable(png) if len(str(png)) <= 70 else "FILE.png"
        saved = "" if is_png else "save it as PNG, then "
        return f"a picture is no cloud; {saved}`swarmer shapes make {name} --points N` makes one of its silhouette"
    return f"{path.suffix or 'no suffix'} is not known; one of {' '.join(FORMATS)}"


def pasteable(path: Path) -> str:
    """The path as a shell takes it for a file: quoted where it must be, and never mistaken for an option."""
    text = str(path)
    return shlex.quote("./" + text if text.startswith("-") else text)


def _cloud(
    content: NDArray[Any] | Mesh, path: Path, where: str, points: int | None, duplicates: str, seed: int
) -> PointCloud:
    rows = content.vertices if isinstance(content, Mesh) else content
    finish = partial(make_cloud, path.stem, licence="the file's own", called=where, duplicates=duplicates)
    if points is not None and isinstance(content, Mesh) and len(content.faces):
        finish(rows, source=path.name)  # for its checks alone
        with naming(where, path.suffix):
            sample = surface_sample(rows, content.faces, points, seed)
        return finish(sample, source=f"{points} points of the surface in {path.name}")
    cloud = finish(rows, source=path.name)
    if points is None:
        return cloud
    if points > len(cloud):
        raise BadInput("points", points, f"2 to {len(cloud)}, as many as {where} has")
    return with_points(cloud, spread_choice(cloud.points, points))


def _refuse_what_is_no_file(path: Path, where: str) -> None:
    try:
        status = path.stat()
    except FileNotFoundError:
        raise BadShape(f"{where}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise BadShape(f"{where}: cannot be read: {_reason(error)}") from None
    if stat.S_ISDIR(status.st_mode):
        raise BadShape(f"{where} is a directory, not a point cloud")
    if not stat.S_ISREG(status.st_mode):
        raise BadShape(f"{where} is not a plain file")
    if status.st_size == 0:
        raise BadShape(f"{where}: the file is empty")
    if status.st_size > FILE_BYTES_MAX:
        raise BadShape(f"{where}: {status.st_size:,} bytes; at most {FILE_BYTES_MAX:,} are read")


@contextmanager
def naming(where: str, suffix: str) -> Iterator[None]:
    """Make one line that names the file of whatever is raised while it is read."""
    try:
        yield
    except BadShape as error:
        raise BadShape(f"{where}: {str(error).removeprefix('shape: ')}") from None
    except OSError as error:
        raise BadShape(f"{where}: cannot be read: {_reason(error)}") from None
    except MemoryError:
        raise BadShape(f"{where}: does not fit into memory") from None
    except Exception as error:  # scipy and trimesh raise whatever a damaged file happens to break
        raise BadShape(f"{where}: cannot be read as {suffix}: {_reason(error)}") from None


def end_of(path: str) -> str:
    """The path as error lines show it: its end, where it is long."""
    return shown(path if len(path) <= 70 else "…" + path[-69:])


def _reason(error: Exception) -> str:
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return shown(text).strip("'\"")
