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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from swarmer.shapes.cloud import POINTS_MAX, Points
from swarmer.shapes.errors import BadShape
from swarmer.shapes.mesh_lines import refuse_bad_obj, refuse_bad_off, refuse_before_obj

_PLY_ELEMENT = re.compile(rb"^\s*element\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)

EMPTY_PER_BYTE = (
    16  # entries of arrays without data for each byte of a file; such arrays are small changes of others
)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """What a mesh file holds: points, and triangles between them unless it holds points alone."""

    vertices: Points  # (V, 3), each place once, the file's unit
    faces: NDArray[np.int64]  # (T, 3), rows of vertices; (0, 3) for points alone


class MeshFacts(NamedTuple):
    """What one likes to know of a mesh before its surface is sampled."""

    triangles: int
    flat_triangles: int  # without area: three corners on a line
    bodies: int  # parts that share no vertex
    watertight: bool  # each edge belongs to two triangles: there is an inside and an outside


def mesh_facts(mesh: Mesh) -> MeshFacts:
    """Count, look for holes. The vertices are those of `read_mesh`, each place once."""
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = ~(cross != 0).any(axis=1)
    joined = np.sort(mesh.faces, axis=1)
    proper = mesh.faces[(joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2])]
    edges = np.sort(np.concatenate([proper[:, :2], proper[:, 1:], proper[:, ::2]]), axis=1)
    sides = np.unique(edges, axis=0, return_counts=True)[1]
    count = len(mesh.vertices)
    graph = coo_array((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    label = connected_components(graph.tocsr(), directed=False)[1]
    return MeshFacts(
        triangles=len(mesh.faces),
        flat_triangles=int(flat.sum()),
        bodies=len(np.unique(label[proper])),
        watertight=bool(len(sides)) and bool((sides == 2).all()),
    )


def read_mesh(data: bytes, kind: str) -> Mesh:
    """The mesh in `data`, all its parts as one, vertices at the same place merged.

    kind: off, ply, obj, stl or glb. Raises BadShape, or whatever trimesh does with a damaged file.
    """
    import trimesh

    _CHECKS[kind](data)
    try:
        loaded = trimesh.load_scene(
            io.BytesIO(data), file_type=kind, process=False, skip_materials=True, allow_remote=False
        )
    except Exception:
        if kind == "obj":
            refuse_bad_obj(data)
        raise
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
        _refuse_bad_parts(placed, triangles)
        vertices.append(placed)
        faces.append(triangles + before)
        before += len(placed)
    return np.concatenate(vertices), np.concatenate(faces)


def _refuse_bad_parts(vertices: Points, faces: NDArray[np.int64]) -> None:
    """Said by the numbers of vertices and faces in the file, as long as they have them. 1 is the first."""
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        place = ", ".join(f"{value:g}" for value in vertices[row])
        raise BadShape(f"vertex {row + 1} is ({place}); coordinates must be finite numbers")
    astray = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if astray.any():
        face = int(np.argmax(astray))
        named = ", ".join(str(corner + 1) for corner in faces[face])
        raise BadShape(f"face {face + 1} names the vertices {named}; there are {len(vertices)}")


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


def _check_stl(data: bytes) -> None:
    """A binary one has its length in its header; an ASCII one begins with `solid`, and so do some binary ones."""
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:512]:
        _refuse_more(data.count(b"vertex"), "vertices")
        return
    if len(data) < 84:
        raise BadShape("neither an ASCII nor a binary STL")
    (triangles,) = struct.unpack_from("<I", data, 80)
    if 84 + 50 * triangles > len(data):
        raise BadShape(
            f"its header says {triangles:,} triangles, the file has {len(data):,} bytes; it was cut, or is no STL"
        )
    _refuse_more(3 * triangles, "vertices")


def _check_ply(data: bytes) -> None:
    header = data[: data.find(b"end_header")]
    for name, count in _PLY_ELEMENT.findall(header):
        if not count.isdigit():
            raise BadShape(f"its header counts {count[:20]!r} elements")
        _refuse_more(int(count[:18]), name.decode("ascii", "replace"))
        if int(count) > len(data):
            raise BadShape(f"its header says {int(count):,} elements, the file has {len(data):,} bytes")


def _check_glb(data: bytes) -> None:
    """Arrays of a GLB without data are zeros of any promised length, and parts may repeat: add them up."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise BadShape("not a binary glTF file")
    size, _ = struct.unpack_from("<II", data, 12)
    tree = json.loads(data[20 : 20 + size])
    if any("draco" in name or "meshopt" in name for name in tree.get("extensionsRequired", [])):
        raise BadShape("its meshes are compressed, which is not read; export it without compression")
    arrays = tree.get("accessors", [])
    counts = [int(array.get("count", 0)) for array in arrays]
    _refuse_more(max([0, *counts]), "numbers in an array")
    empty = sum(count for count, array in zip(counts, arrays, strict=True) if "bufferView" not in array)
    if min([0, *counts]) < 0 or empty > EMPTY_PER_BYTE * len(data):
        raise BadShape(f"its arrays without data have {empty:,} entries, the file has {len(data):,} bytes")
    parts = [sum(_entries(part, counts) for part in mesh["primitives"]) for mesh in tree.get("meshes", [])]
    shown = sum(parts[node["mesh"]] for node in tree.get("nodes", []) if "mesh" in node)
    _refuse_more(shown // 4, "vertices in its parts together")


def _entries(part: dict[str, Any], counts: list[int]) -> int:
    """Vertices and corners of faces that a part of a mesh lists."""
    arrays = [part["attributes"].get("POSITION"), part.get("indices")]
    return sum(counts[array] for array in arrays if array is not None)


_CHECKS = {
    "ply": _check_ply,
    "off": refuse_bad_off,
    "obj": refuse_before_obj,
    "stl": _check_stl,
    "glb": _check_glb,
}
