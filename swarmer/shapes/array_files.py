"""Point clouds as arrays: .npy and .mat. Sizes are read, and judged, before any memory is taken."""

from __future__ import annotations

import io
import math
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.cloud import POINTS_MAX
from swarmer.shapes.errors import BadShape

UNPACKED_BYTES_MAX = POINTS_MAX * 3 * 8 + 2**20
_MAT_COMPRESSED = 15  # the data type miCOMPRESSED of a MATLAB 5 element
_MAT_NUMERIC = frozenset(
    ("double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
)


def read_npy(data: bytes) -> NDArray[Any]:
    """The array's first two or three columns, (N, 2) or (N, 3). Pickled objects are never loaded."""
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise BadShape(f"a .npy of version {version[0]}.{version[1]}; 1.0 and 2.0 are read")
    read_header = (
        np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    )
    shape, _, dtype = read_header(file)
    if dtype.kind not in "iuf":
        raise BadShape(f"an array of {_kind(dtype)}; whole or floating-point numbers are needed")
    _refuse_shape(shape)
    if math.prod(shape) * dtype.itemsize > len(data) - file.tell():
        raise BadShape(f"its header says {shape[0]} x {shape[1]} numbers, the file ends before")
    file.seek(0)
    array: NDArray[Any] = np.load(file, allow_pickle=False)
    return array[:, :3].astype(np.float64)


def read_mat(data: bytes) -> NDArray[Any]:
    """The one numeric N x 2 or N x 3 array among the variables, (N, 2) or (N, 3).

    MATLAB 4 to 7.2; 7.3 files are HDF5 and refused. Cells, structs and objects are not looked into.
    """
    from scipy.io import loadmat, whosmat

    if data[:8] == b"\x89HDF\r\n\x1a\n" or data[:10] == b"MATLAB 7.3":
        raise BadShape("a MATLAB 7.3 file (HDF5) is not read; save it with -v7")
    _refuse_bomb(data)
    variables = whosmat(_file(data))
    clouds = [
        (name, shape)
        for name, shape, kind in variables
        if kind in _MAT_NUMERIC and len(shape) == 2 and shape[1] in (2, 3) and shape[0] >= 1
    ]
    if len(clouds) != 1:
        held = ", ".join(f"{name} {'x'.join(map(str, shape))} {kind}" for name, shape, kind in variables[:5])
        raise BadShape(f"one numeric N x 2 or N x 3 array is needed, it holds: {held or 'nothing'}")
    name, shape = clouds[0]
    _refuse_shape(shape)
    array = loadmat(_file(data), variable_names=[name])[name]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iuf":
        raise BadShape(f"{name} is not an array of real numbers")
    return array.astype(np.float64)


def _refuse_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or shape[1] < 2:
        raise BadShape(f"an array of shape {shape}; points need 2 or 3 columns: (F, 2) or (F, 3)")
    if shape[0] > POINTS_MAX or math.prod(shape) > 16 * POINTS_MAX:
        raise BadShape(f"{shape[0]:,} x {shape[1]} numbers; at most {POINTS_MAX:,} points are taken")


def _refuse_bomb(data: bytes) -> None:
    """Unpack the compressed elements of a MATLAB 5 file, keeping nothing, and refuse too much."""
    at, total = 128, 0
    order = ">" if data[126:128] == b"MI" else "<"
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(order + "II", data, at)
        if kind == _MAT_COMPRESSED:
            total += _unpacked_size(data[at + 8 : at + 8 + size], UNPACKED_BYTES_MAX - total)
            if total > UNPACKED_BYTES_MAX:
                raise BadShape(f"it unpacks to more than {UNPACKED_BYTES_MAX:,} bytes")
        at += 8 + size


def _unpacked_size(packed: bytes, limit: int) -> int:
    unpacker, size = zlib.decompressobj(), 0
    while packed and size <= limit and not unpacker.eof:
        size += len(unpacker.decompress(packed, 2**20))
        packed = unpacker.unconsumed_tail
    return size


def _file(data: bytes) -> Any:
    return io.BytesIO(data)  # scipy reads it gladly, its annotations know of names only


def _kind(dtype: np.dtype[Any]) -> str:
    return "objects" if dtype.hasobject else str(dtype)
