"""The shapes that a name stands for, and how a name or a file becomes a cloud."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from swarmer.errors import BadInput
from swarmer.shapes import generators
from swarmer.shapes.cloud import POINTS_MAX, PointCloud, Points, make_cloud, with_points
from swarmer.shapes.errors import BadShape
from swarmer.shapes.files import SUFFIXES, read_cloud
from swarmer.shapes.sampling import spread_choice

DUPLICATES = ("refuse", "drop")
OWN_LICENCE = "MIT"


@dataclass(frozen=True, slots=True)
class Entry:
    """One shape of the catalogue: made from a count, or shipped as a file of `data_dir()`."""

    points: int  # its count, or the count it is made with when none is asked for
    about: str
    make: Callable[[int, int], Points] | None = None  # (count, seed) -> (count, 3); None: a shipped file
    licence: str = OWN_LICENCE
    credit: str = ""


# To add a shape: one line here. One that is not made from a count also needs its maker in
# scripts/make_pointclouds.py, which writes the file.
_SHIPPED = "made by scripts/make_pointclouds.py"
CATALOGUE: dict[str, Entry] = {
    "dragon": Entry(760, _SHIPPED),
    "hat": Entry(1562, _SHIPPED),
    "skateboard": Entry(1727, _SHIPPED),
    "racecar": Entry(11_894, _SHIPPED),
    "statue": Entry(22_375, _SHIPPED),
    "chess": Entry(454, _SHIPPED),
    "butterfly": Entry(94, _SHIPPED),
    "butterfly1008": Entry(1008, _SHIPPED),
    "cat": Entry(114, _SHIPPED),
    "teapot": Entry(100, _SHIPPED),
    "sphere": Entry(100, "a Fibonacci lattice", generators.sphere),
    "cube": Entry(125, "a lattice", generators.cube),
    "knot": Entry(300, "a torus knot", generators.knot),
    "random": Entry(100, "uniform in a cube, by seed", generators.random),
}


def data_dir() -> Path:
    """Where the shipped clouds lie: in the installed package, or in the checkout beside it."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "pointclouds"
    return installed if installed.is_dir() else package.parent / "pointclouds"


def load_shape(
    shape: str, points: int | None = None, duplicates: str = "refuse", seed: int = 0
) -> PointCloud:
    """The cloud of a catalogue name or of a file, in display cells.

    shape: a name, or a path: something with a path separator or a known suffix, or an existing file.
    points: exact count. sphere, cube and random are made with it; a mesh is sampled on its surface;
    from other clouds that many of their points are chosen, well spread. None: the shape's own count.
    duplicates: `refuse` or `drop` (see `make_cloud`). seed: for `random` and for sampling meshes.
    Raises BadShape (no such shape, nothing that can be read) and BadInput (`points`, `duplicates`).
    """
    if duplicates not in DUPLICATES:
        raise BadInput("duplicates", duplicates, "refuse (default) or drop")
    if points is not None and not 2 <= points <= POINTS_MAX:
        raise BadInput("points", points, f"a whole number, 2 to {POINTS_MAX:,}")
    entry = CATALOGUE.get(shape)
    if entry is not None:
        return _from_catalogue(shape, entry, points, seed)
    if not is_path(shape):
        raise BadShape(_unknown(shape))
    return read_cloud(Path(shape), points, duplicates, seed)


def is_path(shape: str) -> bool:
    """Whether `shape`, not a catalogue name, means a file."""
    if "/" in shape or Path(shape).suffix.lower() in SUFFIXES:
        return True
    try:
        return Path(shape).is_file()
    except (OSError, ValueError):  # a name too long, a NUL in it
        return False


def place_of(shape: str) -> str:
    """A name of the catalogue as it is; the path of a file that `load_shape` read, as every directory reads it.

    The file's own name stays, also where it is a link: the run is called after it.
    """
    if shape in CATALOGUE:
        return shape
    path = Path(shape)
    return str(path.parent.resolve() / path.name)


def _from_catalogue(name: str, entry: Entry, points: int | None, seed: int) -> PointCloud:
    finish = partial(make_cloud, name, licence=entry.licence, source=entry.about, credit=entry.credit)
    if entry.make is not None:
        return finish(entry.make(points or entry.points, seed))
    own = finish(_shipped(name))
    if points is None:
        return own
    if points > len(own):
        raise BadInput("points", points, f"2 to {len(own)}, as many as {name} has")
    return with_points(own, spread_choice(own.points, points))


def _shipped(name: str) -> Points:
    path = data_dir() / f"{name}.xyz"
    try:
        with path.open(
            encoding="ascii"
        ) as file:  # given a path, loadtxt needs a current directory that is there
            return np.loadtxt(file, ndmin=2)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadShape(
            f"{name}: its shipped file {path} cannot be read ({reason}); install swarmer anew"
        ) from None


def _unknown(shape: str) -> str:
    near = difflib.get_close_matches(shape.lower(), CATALOGUE, n=1)
    hint = (
        f"did you mean {near[0]!r}? " if near else f"it is neither a file nor one of {', '.join(CATALOGUE)}; "
    )
    return f"no {_short(shape)!r}; {hint}`swarmer shapes` lists all"


def _short(text: str) -> str:
    return text if len(text) <= 60 else text[:59] + "…"
