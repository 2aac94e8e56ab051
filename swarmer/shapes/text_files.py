"""Point clouds as text: .ptcld, .xyz, .csv, .txt.

One point a line, numbers separated by blanks, tabs, commas or semicolons. Two columns are length and
height (depth 0); of three or more the first three are taken, so colours may follow. `#` and `//`
start a comment, empty lines do not count. A single header line and a leading line with the count are
understood; a count that is not kept means that the file was cut, and is refused.

.ptcld is the format of the SwarMer authors' clouds: rows of three whole numbers, nothing else.
"""

from __future__ import annotations

import io
import math
import re
from array import array
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from swarmer.errors import shown
from swarmer.shapes.cloud import POINTS_MAX
from swarmer.shapes.errors import BadShape

_BETWEEN = re.compile(r"[\s,;]+")
_DECIMAL_COMMA = re.compile(r"\d,\d")
BLOCK = 2**20  # bytes
LINE_MAX = 10_000  # characters: a row of a cloud with colours and normals has some 200


def refuse_many_lines(file: BinaryIO) -> None:
    """Refuse what has more lines than a cloud may have points, before it is read: at a glance, in little memory.

    Lines with a `#` do not count. Raises BadShape.
    """
    lines = 0
    while block := file.read(BLOCK):
        lines += block.count(b"\n") - block.count(b"#")
        if lines > POINTS_MAX:
            raise BadShape(f"more than {POINTS_MAX:,} lines; at most so many points are taken")


def read_text(data: bytes) -> NDArray[Any]:
    """Rows (N, 2) or (N, 3). Raises BadShape with the number of the line that cannot be understood."""
    return _parsed(data, labels=False)


def read_xyz(data: bytes) -> NDArray[Any]:
    """As `read_text`; also the chemists' form: count, a line of comment, rows led by a symbol."""
    return _parsed(data, labels=True)


def _parsed(data: bytes, *, labels: bool) -> NDArray[Any]:
    if b"\0" in data[:4096]:
        raise BadShape("not a text file")
    rows = array("d")  # one after the other: lists of floats would be ten times the memory
    columns = count = 0
    declared: int | None = None
    seen = 0  # lines with something in them
    for number, line in enumerate(io.TextIOWrapper(io.BytesIO(data), "utf-8-sig", "replace"), start=1):
        if len(line) > LINE_MAX:
            raise BadShape(
                f"line {number}: {len(line):,} characters; a line of points has at most {LINE_MAX:,}"
            )
        fields = _fields(line, number)
        if not fields:
            continue
        seen += 1
        if seen == 1 and len(fields) == 1 and fields[0].isascii() and fields[0].isdigit():
            declared = int(fields[0][:18])
            continue
        if labels and len(fields) > 3 and _number(fields[0]) is None:
            fields = fields[1:]
        values = [_number(field) for field in fields[:3]]
        if not count and _is_header(values, seen, declared is not None, labels):
            continue
        row = _row(values, fields, columns or len(values), number)
        rows.extend(row)
        columns, count = len(row), count + 1
        if count > POINTS_MAX:
            raise BadShape(f"line {number}: more than {POINTS_MAX:,} points")
    if not count:
        raise BadShape("no points in it")
    if declared is not None and declared != count:
        raise BadShape(
            f"its first line says {declared} points, {count} follow; the file was cut or is no cloud"
        )
    return np.frombuffer(rows, dtype=np.float64).reshape(count, columns)


def _is_header(values: list[float | None], seen: int, counted: bool, labels: bool) -> bool:
    """A first line, or one after the count, without any number; or a molecule's line of comment."""
    if labels and counted and seen == 2:
        return None in values
    return seen == 1 + counted and not any(value is not None for value in values)


def _fields(line: str, number: int) -> list[str]:
    line = line.split("#", 1)[0].split("//", 1)[0].strip()
    if ";" in line and _DECIMAL_COMMA.search(line):
        raise BadShape(f"line {number}: {shown(line)} has decimal commas; a decimal point is needed")
    return [field for field in _BETWEEN.split(line) if field]


def _number(field: str) -> float | None:
    try:
        return None if "_" in field else float(field)
    except ValueError:
        return None


def _row(values: list[float | None], fields: list[str], columns: int, number: int) -> list[float]:
    if len(values) < 2 or len(values) != columns:
        wanted = f"{columns} columns as before" if columns >= 2 else "2 or 3 columns"
        raise BadShape(f"line {number}: {len(fields)} column{'s' * (len(fields) != 1)}; {wanted} are needed")
    row = []
    for value, field in zip(values, fields, strict=False):
        if value is None:
            raise BadShape(f"line {number}: {shown(field)} is not a number")
        if not math.isfinite(value):
            raise BadShape(f"line {number}: {shown(field)} is not a finite number")
        row.append(value)
    return row
