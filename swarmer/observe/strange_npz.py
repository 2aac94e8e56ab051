"""An .npz that somebody else wrote, read without trust: what it promises is judged before memory is taken.

A few kilobytes of an archive can unpack to terabytes, and a header can promise an array of any size. So sizes are read
first, from the archive's list and from each array's own header, which must agree; types must be those expected.
"""

from __future__ import annotations

import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import DTypeLike, NDArray

# What an archive raises that is none, was cut, or lies.
BROKEN = (
    OSError, ValueError, KeyError, IndexError, TypeError, EOFError, RuntimeError, NotImplementedError, MemoryError,
    OverflowError, zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error,
)  # fmt: skip
INFLATED_MOST = 1100  # bytes that deflate makes of one: 1032 at the very most
SLACK = 1 << 16  # bytes of a member beside its data: a header has at most so many
KINDS = {
    "f": "fiu",
    "i": "iu",
    "b": "b",
    "U": "U",
}  # kinds of numpy's that may stand for a kind that is wanted
READ_HEADER = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def arrays(
    path: Path, needed: Mapping[str, DTypeLike], optional: Mapping[str, DTypeLike], room: int | None = None
) -> dict[str, NDArray[Any]]:
    """The arrays of these names, as these types; an optional one only where it is there. Pickles are never loaded.

    room: bytes that they may fill; None: `largest`. Raises one of BROKEN for what cannot be read, or would fill more.
    """
    with zipfile.ZipFile(path) as archive:
        there = set(archive.namelist())
        wanted = dict(needed) | {name: of for name, of in optional.items() if f"{name}.npy" in there}
        room = largest() if room is None else room
        for name, dtype in wanted.items():
            room -= _promised(archive, name, np.dtype(dtype))
            if room < 0:
                raise ValueError(
                    f"it would fill more than the {largest() >> 20:,} MB that may be taken for it"
                )
        return {name: _read(archive, name, np.dtype(dtype)) for name, dtype in wanted.items()}


def largest() -> int:
    """Bytes that an archive may fill: half of this machine's memory; where it does not tell, a gigabyte."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    except (ValueError, OSError, AttributeError):
        return 1 << 30


def _promised(archive: zipfile.ZipFile, name: str, dtype: np.dtype[Any]) -> int:
    """Bytes of an array, as a member's header says. Raises ValueError unless the archive can hold, and has, as many."""
    info = archive.getinfo(f"{name}.npy")
    with archive.open(info) as member:
        version = npy.read_magic(member)
        if version not in READ_HEADER:
            raise ValueError(f"{name}: a .npy of version {version[0]}.{version[1]}")
        shape, _, given = READ_HEADER[version](member)
    if given.kind not in KINDS[dtype.kind]:
        raise ValueError(f"{name}: an array of {given}, not of {dtype}")
    size = math.prod(shape) * given.itemsize
    if min(shape, default=0) < 0 or not size <= info.file_size <= size + SLACK:
        raise ValueError(f"{name}: its header does not go with its size")
    if info.file_size > INFLATED_MOST * info.compress_size + SLACK:
        raise ValueError(f"{name}: it says that it unpacks to more than it can")
    return size + math.prod(shape) * dtype.itemsize * (given != dtype)


def _read(archive: zipfile.ZipFile, name: str, dtype: np.dtype[Any]) -> NDArray[Any]:
    with archive.open(f"{name}.npy") as member:
        array: NDArray[Any] = npy.read_array(member, allow_pickle=False)
    return array if dtype.kind == "U" else array.astype(dtype, copy=False)
