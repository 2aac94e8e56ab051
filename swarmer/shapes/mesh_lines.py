"""Meshes that are text, .off and .obj, looked through line by line: what is wrong gets its line's number.

trimesh reads them, but of a damaged one it tells what broke inside it, and of one that was cut, nothing.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator

from swarmer.errors import shown
from swarmer.shapes.cloud import POINTS_MAX
from swarmer.shapes.errors import BadShape

_OFF_WORD = re.compile(r"^\s*\w*OFF\b", re.IGNORECASE)
_OBJ_CORNER_0 = re.compile(rb"^[ \t]*f[ \t](?:[^\n]*[ \t])?0+(?:[/\s]|$)", re.MULTILINE)

Line = tuple[int, list[str]]  # its number in the file, its words


def refuse_bad_off(data: bytes) -> None:
    """Refuse an OFF that has fewer lines than its header says, or a line that cannot be. Raises BadShape."""
    lines = _lines(data)
    number, words = next(lines, (1, []))
    words = _OFF_WORD.sub("", " ".join(words)).split()
    if not words:
        number, words = next(lines, (number, []))
    if len(words) < 2 or not all(word.isascii() and word.isdigit() for word in words[:2]):
        raise BadShape(f"line {number}: the numbers of vertices and faces are needed, as in `8 12 0`")
    vertices, faces = int(words[0][:18]), int(words[1][:18])
    for count in (vertices, faces):
        if count > POINTS_MAX:
            raise BadShape(f"{count:,} vertices or faces; at most {POINTS_MAX:,} are taken")
        if count > len(data):
            raise BadShape(f"its header says {count:,} elements, the file has {len(data):,} bytes")
    for row in range(vertices + faces):
        number, words = next(lines, (number, []))
        if not words:
            raise BadShape(
                f"its header says {vertices} vertices and {faces} faces, {row} lines follow; the file was cut"
            )
        if row < vertices:
            _refuse_bad_vertex(number, words)
        else:
            count = _whole(words[0], number)
            if len(words) <= count:
                raise BadShape(f"line {number}: a face of {count} vertices names {len(words) - 1}")
            for word in words[1 : count + 1]:
                _refuse_absent(number, _whole(word, number), 0, vertices)


def refuse_before_obj(data: bytes) -> None:
    """What trimesh would take: too many vertices, and 0 for the last one, though they count from 1. Raises BadShape."""
    vertices = data.count(b"\nv ")
    if vertices > POINTS_MAX:
        raise BadShape(f"{vertices:,} vertices; at most {POINTS_MAX:,} are taken")
    found = _OBJ_CORNER_0.search(data)
    if found:
        line = 1 + data.count(b"\n", 0, found.start())
        raise BadShape(f"line {line}: a face names vertex 0; the first is 1")


def refuse_bad_obj(data: bytes) -> None:
    """Refuse the first line of an OBJ that cannot be: a vertex without three numbers, a face without its vertices."""
    lines = [(number, words) for number, words in _lines(data) if words[0] in ("v", "f")]
    vertices = sum(words[0] == "v" for _, words in lines)
    for number, words in lines:
        if words[0] == "v":
            _refuse_bad_vertex(number, words[1:])
            continue
        for word in words[1:]:
            corner = _whole(word.partition("/")[0], number)
            _refuse_absent(number, corner if corner > 0 else corner + vertices + 1, 1, vertices + 1)


def _lines(data: bytes) -> Iterator[Line]:
    """The lines that hold something besides a comment."""
    for number, line in enumerate(io.TextIOWrapper(io.BytesIO(data), "utf-8", "replace"), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            yield number, words


def _refuse_bad_vertex(number: int, words: list[str]) -> None:
    for word in words[:3]:
        try:
            value = float(word)
        except ValueError:
            raise BadShape(f"line {number}: {shown(word)} is not a number") from None
        if not math.isfinite(value):
            raise BadShape(f"line {number}: {shown(word)} is not a finite number")
    if len(words) < 3:
        raise BadShape(f"line {number}: a vertex needs 3 numbers, got {len(words)}")


def _whole(word: str, number: int) -> int:
    try:
        return int(word[:18])
    except ValueError:
        raise BadShape(f"line {number}: {shown(word)} is not the number of a vertex") from None


def _refuse_absent(number: int, vertex: int, first: int, end: int) -> None:
    if not first <= vertex < end:
        raise BadShape(f"line {number}: a face names vertex {vertex}; there are {first} to {end - 1}")
