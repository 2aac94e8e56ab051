"""Meshes and point files of the 3D world: .off .ply .obj .stl .glb, by trimesh (imported only here).

Headers that promise more than the file can hold are refused before trimesh sees them. Nothing
beside the file is opened: no materials, no textures, no linked buffers.
"""

from __future__ import annotations

import io
import json
import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.cloud import POINTS_MAX, Points
from swarmer.shapes.errors import BadShape

_PLY_ELEMENT = re.compile(rb"^\s*element\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)
_OFF_COUNTS = re.compile(rb"^\s*(\d+)\s+(\d+)(?:\s+\d+)?\s*$", re.MULTILINE)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """What a mesh file holds: points, and triangles between them unless it holds points alone."""

    vertices: Points  # (V, 3), each place once, the file's unit
    faces: NDArray[np.int64]  # (T, 3), rows of vertices; (0, 3) for points alone


def read_mesh(data: bytes, kind: str) -> Mesh:
    """The mesh in `data`, all its parts as one, vertices at the same place merged.

    kind: off, ply, obj, stl or glb. Raises BadShape, or whatever trimesh does with a damaged file.
    """
    import trimesh

    _CHECKS.get(kind, _nothing)(data)
    loaded = trimesh.load_scene(
        io.BytesIO(data), file_type=kind, process=False, skip_materials=True, allow_remote=False
    )
    vertices, faces = _joined(loaded)
    if not len(vertices):
        raise BadShape("no points in it")
    _refuse_more(len(vertices), "vertices")
    return _merged(vertices, faces)


def _joined(scene: Any) -> tuple[Points, NDArray[np.int64]]:
    vertices: list[Points] = [np.empty((0, 3))]
    faces: list[NDArray[np.int64]] = [np.empty((0, 3), dtype=np.int64)]
    before = 0
    for part in scene.dump():
        corners = np.asarray(part.vertices, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1] not in (2, 3):
            continue
        placed = np.zeros((len(corners), 3))
        placed[:, : corners.shape[1]] = corners
        triangles = np.asarray(getattr(part, "faces", faces[0]), dtype=np.int64).reshape(-1, 3)
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(placed):
            raise BadShape("a face names a vertex that is not there")
        vertices.append(placed)
        faces.append(triangles + before)
        before += len(placed)
    return np.concatenate(vertices), np.concatenate(faces)


def _merged(vertices: Points, faces: NDArray[np.int64]) -> Mesh:
    """Vertices at one place become the first of them, where faces make the rest mere copies."""
    if not len(faces):
        return Mesh(vertices, faces)
    used = np.unique(faces)
    _, first, which = np.unique(vertices[used] + 0.0, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    place = np.zeros(len(vertices), dtype=np.int64)
    place[used] = rank[which.ravel()]
    return Mesh(vertices[used[first[order]]], place[faces])


def _refuse_more(count: int, what: str) -> None:
    if count > POINTS_MAX:
        raise BadShape(f"{count:,} {what}; at most {POINTS_MAX:,} are taken")


def _nothing(data: bytes) -> None:
    """OBJ and STL name no sizes that could lie beyond the file: trimesh checks STL's one."""


def _check_ply(data: bytes) -> None:
    header = data[: data.find(b"end_header")]
    for name, count in _PLY_ELEMENT.findall(header):
        if not count.isdigit():
            raise BadShape(f"its header counts {count[:20]!r} elements")
        _refuse_more(int(count[:18]), name.decode("ascii", "replace"))
        if int(count) > len(data):
            raise BadShape(f"its header says {int(count):,} elements, the file has {len(data):,} bytes")


def _check_off(data: bytes) -> None:
    counts = _OFF_COUNTS.search(data[:4096])
    for count in counts.groups() if counts else ():
        _refuse_more(int(count[:18]), "vertices or faces")
        if int(count) > len(data):
            raise BadShape(f"its header says {int(count):,} elements, the file has {len(data):,} bytes")


def _check_glb(data: bytes) -> None:
    """Arrays of a GLB without data are zeros of any promised length, and parts may repeat: add them up."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise BadShape("not a binary glTF file")
    size, _ = struct.unpack_from("<II", data, 12)
    tree = json.loads(data[20 : 20 + size])
    accessors = [int(one.get("count", 0)) for one in tree.get("accessors", [])]
    _refuse_more(max([0, *accessors]), "numbers in an array")
    if any(count < 0 for count in accessors) or sum(accessors) > 4 * POINTS_MAX:
        raise BadShape(f"its arrays have {sum(accessors):,} entries together")
    _refuse_more(len(tree.get("nodes", [])) * max([0, *accessors]), "entries, were each part the largest")


_CHECKS = {"ply": _check_ply, "off": _check_off, "glb": _check_glb}
