"""Where a fault strikes, as a schedule has it: FIDs, everybody, a share, or a part of the display; pure.

A place that is not a list of FIDs needs the display's points, and becomes the list before anything runs. Only "the
swarm of FLS 17 at that moment" stays open until then.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from swarmer.errors import BadInput
from swarmer.streams import stream

AXES = {"L": 0, "H": 1, "D": 2}
SHAPES = ({"share"}, {"half", "axis"}, {"box"}, {"centre", "radius"}, {"swarm_of"})
ALLOWED = (
    "a list of FIDs, 1 to {count}, `all`, or one of {{share: 0.1}}, {{half: low|high, axis: L|H|D}}, "
    "{{box: [[L, H, D], [L, H, D]]}}, {{centre: [L, H, D], radius: CELLS}}, {{swarm_of: FID}}"
)
Points = Sequence[Sequence[float]]


class Ground(NamedTuple):
    """What places are looked up in."""

    count: int  # type: ignore[assignment]  # F; hides tuple.count, which nobody needs
    points: Points | None = None  # (F, 3), display cells; None: there are only FIDs
    seed: int = 0  # of the run


class Place(NamedTuple):
    """FIDs; or, if `swarm_of` is not 0, whoever is then in the swarm of that FLS."""

    fids: tuple[int, ...]
    swarm_of: int = 0


def place(name: str, given: Any, ground: Ground, purpose: str) -> Place:
    """The place that a schedule gives as `name`. purpose: what a share is drawn for. Raises BadInput."""
    everybody = range(1, ground.count + 1)
    if given == "all":
        return Place(tuple(everybody))
    if isinstance(given, list) and given and all(is_fid(fid, ground.count) for fid in given):
        return Place(tuple(sorted(set(given))))
    if isinstance(given, Mapping) and set(given) in SHAPES:
        if "swarm_of" in given and is_fid(given["swarm_of"], ground.count):
            return Place((), given["swarm_of"])
        if "share" in given and is_number(given["share"]) and 0.0 < given["share"] <= 1.0:
            rng = stream(ground.seed, f"fault place {purpose}")
            many = max(1, round(given["share"] * ground.count))
            return Place(tuple(sorted(rng.sample(everybody, many))))
        if (rows := _region(given, ground.points)) is not None:
            if not rows:
                raise BadInput(name, given, "a place with at least one point of the shape")
            return Place(tuple(row + 1 for row in rows))
    raise BadInput(name, given, ALLOWED.format(count=ground.count))


def _region(given: Mapping[str, Any], points: Points | None) -> list[int] | None:
    """Rows of the points in a part of the display; None if it says no part."""
    if points is None:
        return None
    if "half" in given and given["half"] in ("low", "high") and is_axis(given["axis"]):
        low, high = slabs(points, 2, given["axis"])
        return low if given["half"] == "low" else high
    if "box" in given:
        corners = given["box"]
        if isinstance(corners, list) and len(corners) == 2 and all(map(_is_position, corners)):
            bounds = list(zip(*map(sorted, zip(*corners, strict=True)), strict=True))
            return [row for row, point in enumerate(points) if _between(bounds[0], point, bounds[1])]
    if "centre" in given and _is_position(given["centre"]):
        radius = given["radius"]
        if is_number(radius) and radius >= 0.0:
            return [row for row, point in enumerate(points) if math.dist(point, given["centre"]) <= radius]
    return None


def slabs(points: Points, parts: int, axis: str) -> list[list[int]]:
    """The rows of `points` in so many parts side by side along an axis, as equal in number as they can be."""
    along = sorted(range(len(points)), key=lambda row: (points[row][AXES[axis]], row))
    edges = [len(points) * part // parts for part in range(parts + 1)]
    return [sorted(along[low:high]) for low, high in pairwise(edges)]


def longest_axis(points: Points) -> str:
    """Along which the display is longest; of equal ones the first."""
    spans = {name: max(p[at] for p in points) - min(p[at] for p in points) for name, at in AXES.items()}
    return max(spans, key=lambda name: spans[name])


def _between(low: Sequence[float], point: Sequence[float], high: Sequence[float]) -> bool:
    return all(least <= part <= most for least, part, most in zip(low, point, high, strict=True))


def _is_position(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(is_number, value))


def is_number(value: Any) -> bool:
    """A finite number; a bool is none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < math.inf


def is_axis(value: Any) -> bool:
    """The name of one."""
    return isinstance(value, str) and value in AXES


def is_fid(value: Any, count: int) -> bool:
    """The FID of one of `count` FLSs."""
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= count
