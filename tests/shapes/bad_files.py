"""Every bad file that a user or an enemy may hand over, as one table: name, bytes, and words of the answer.

A name's suffix is the format that is claimed. `test_shapes_bad_inputs` shows each to every command.
"""

import io
import json
import pickle
import struct
import zlib
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.io import savemat


class Bad(NamedTuple):
    name: str
    content: bytes | Callable[[], bytes]
    words: str  # of the one line


BALL = trimesh.creation.icosphere(2)
PLY = (
    "ply\nformat {}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n{}end_header\n"
)
FACES = "element face {}\nproperty list {} int vertex_indices\n"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def npy(shape, kind="<f8"):
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": kind, "fortran_order": False, "shape": shape})
    return file.getvalue()


def saved(array):
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def zipped(array):
    file = io.BytesIO()
    np.savez_compressed(file, array)
    return file.getvalue()


def mat(form="5", **variables):
    file = io.BytesIO()
    savemat(file, variables, format=form)
    return file.getvalue()


@cache
def mat_bomb():
    packed = zlib.compress(bytes(260 * 2**20), 1)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    return head + struct.pack("<II", 15, len(packed)) + packed


def glb(**tree):
    text = json.dumps({"asset": {"version": "2.0"}, **tree}).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text


def ball(suffix):
    exported = BALL.export(file_type=suffix)
    return exported if isinstance(exported, bytes) else exported.encode()


def cut(suffix):
    return lambda: ball(suffix)[: len(ball(suffix)) * 2 // 3]


GRID = np.arange(30.0).reshape(10, 3)
NOISE = np.random.default_rng(2).bytes(3000)
ARRAY = {"componentType": 5126, "type": "VEC3"}
PARTS = [{"primitives": [{"attributes": {"POSITION": 0}}]}]

BAD_FILES = [
    # no cloud in it
    Bad("empty.xyz", b"", "the file is empty"),
    Bad("comments.txt", b"# nothing\n\n", "no points in it"),
    Bad("one.csv", b"1,2,3\n", "1 point; at least 2"),
    Bad("one.npy", saved(GRID[:1]), "1 point; at least 2"),
    Bad("none.npy", saved(GRID[:0]), "0 points; at least 2"),
    Bad("equal.ptcld", b"1 2 3\n" * 4, "all 4 points are equal, (1, 2, 3)"),
    Bad("equal.mat", mat(p=np.ones((5, 3))), "all 5 points are equal, (1, 1, 1)"),
    Bad("double.xyz", b"1 2 3\n4 5 6\n1 2 3\n", "1 of 3 points are duplicates: (1, 2, 3); two FLSs"),
    Bad("none.obj", b"# nothing\n", "no points in it"),
    Bad("none.off", b"OFF\n0 0 0\n", "no points in it"),
    Bad("point.stl", lambda: trimesh.Trimesh([[1, 1, 1]] * 3, [[0, 1, 2]], process=False).export(file_type="stl"),
        "1 point; at least 2"),
    # numbers that are none
    Bad("nan.txt", b"1 2 3\n4 nan 6\n", "line 2: 'nan' is not a finite number"),
    Bad("inf.csv", b"1,2,3\n4,5,-inf\n", "line 2: '-inf' is not a finite number"),
    Bad("over.xyz", b"1 2 3\n4 5 1e999\n", "line 2: '1e999' is not a finite number"),
    Bad("far.xyz", b"1 2 3\n4 5 1e8\n", "point 2 is (4, 5, 1e+08); coordinates must lie within"),
    Bad("words.ptcld", b"1 2 3\n4 five 6\n", "line 2: 'five' is not a number"),
    Bad("columns.csv", b"1,2,3\n" * 99 + b"1,2\n", "line 100: 2 columns; 3 columns as before are needed"),
    Bad("column.txt", b"1.5\n2.5\n", "line 1: 1 column; 2 or 3 columns are needed"),
    Bad("nan.npy", saved(np.where(GRID == 4, np.nan, GRID)), "point 2 is (3, nan, 5)"),
    Bad("inf.mat", mat(p=np.where(GRID == 4, np.inf, GRID)), "point 2 is (3, inf, 5)"),
    Bad("nan.obj", TRIANGLE.replace("1 0 0", "1 nan 0").encode() + b"f 1 2 3\n", "vertex 2 is (1, nan, 0)"),
    Bad("inf.off", b"OFF\n3 1 0\n0 0 0\n0 inf 0\n0 1 0\n3 0 1 2\n", "line 4: 'inf' is not a finite number"),
    Bad("nan.ply", (PLY.format("ascii 1.0", 2, "") + "1 2 3\n1 nan 3\n").encode(), "vertex 2 is (1, nan, 3)"),
    Bad("complex.npy", saved(GRID * 1j), "an array of complex128"),
    Bad("flat.npy", saved(GRID.ravel()), "an array of shape (30,)"),
    Bad("column.npy", saved(GRID[:, :1]), "an array of shape (10, 1)"),
    # faces
    Bad("face.obj", TRIANGLE.encode() + b"f 1 2 99\n", "line 4: a face names vertex 99; there are 1 to 3"),
    Bad("zero.obj", TRIANGLE.encode() + b"f 0 1 2\n", "line 4: a face names vertex 0; the first is 1"),
    Bad("face.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "line 6: a face names vertex 7; there are 0 to 2"),
    Bad("face.ply", (PLY.format("ascii 1.0", 3, FACES.format(1, "uchar")) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n").encode(),
        "face 1 names the vertices 1, 2, 8; there are 3"),
    Bad("short.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "line 6: a face of 3 vertices names 2"),
    Bad("flat.off", b"OFF\n3 1 0\n0 0\n1 0\n0 1\n3 0 1 2\n", "line 3: a vertex needs 3 numbers, got 2"),
    # what is not what it says
    Bad("zeros.xyz", bytes(200), "not a text file"),
    Bad("noise.txt", NOISE.replace(b"\0", b"\x01"), "is not a number"),
    *(Bad(f"noise{suffix}", NOISE, words) for suffix, words in {
        ".npy": "cannot be read as .npy", ".mat": "cannot be read", ".ply": "cannot be read as .ply",
        ".stl": "it was cut, or is no STL", ".glb": "not a binary glTF file", ".obj": "no points in it",
        ".off": "line 1: the numbers of vertices and faces are needed"}.items()),
    Bad("line.txt", b"1 2 3 " * 500_000, "line 1: 3,000,000 characters"),
    Bad("pickle.npy", pickle.dumps({"points": [1, 2, 3]}), "cannot be read as .npy"),
    Bad("objects.npy", saved(np.array([[1, None, 2]] * 3, dtype=object)), "an array of objects"),
    Bad("objects.mat", mat(p=np.array([[1, "x", 2]] * 3, dtype=object)), "it holds: p 3x3 cell"),
    Bad("struct.mat", mat(p={"x": GRID}), "it holds: p 1x1 struct"),
    Bad("two.mat", mat(p=GRID, q=GRID), "it holds: p 10x3 double, q 10x3 double"),
    Bad("new.mat", b"MATLAB 7.3 MAT-file".ljust(300), "HDF5"),
    Bad("archive.npz", zipped(GRID), ".npz is not known; one of .ptcld"),
    Bad("archive.npy", zipped(GRID), "cannot be read as .npy"),
    Bad("page.html", b"<html>", ".html is not known; one of .ptcld"),
    Bad("noname", b"1 2 3\n", "no suffix is not known"),
    # cut
    Bad("count.xyz", b"5\n1 2 3\n4 5 6\n", "says 5 points, 2 follow; the file was cut"),
    Bad("cut.npy", saved(GRID)[:-9], "its header says 10 x 3 numbers, the file ends before"),
    Bad("cut.mat", mat(p=GRID)[:300], "cannot be read"),
    Bad("cut.ply", cut("ply"), "cannot be read as .ply"),
    Bad("cut.stl", cut("stl"), "its header says 320 triangles"),
    Bad("cut.glb", cut("glb"), "cannot be read as .glb"),
    Bad("cut.off", cut("off"), "its header says 162 vertices and 320 faces"),
    # sizes that are claimed
    Bad("huge.npy", npy((10**12, 3)), "at most 10,000,000 points"),
    Bad("wide.npy", npy((3, 10**12)), "at most 10,000,000 points"),
    Bad("large.npy", npy((10**7, 3)), "the file ends before"),
    Bad("minus.npy", npy((-3, 3)), "cannot be read as .npy"),
    Bad("huge.ply", PLY.format("binary_little_endian 1.0", 10**12, "").encode(), "at most 10,000,000 are taken"),
    Bad("large.ply", PLY.format("ascii 1.0", 9 * 10**6, "").encode(), "says 9,000,000 elements, the file has"),
    Bad("list.ply", (PLY.format("binary_little_endian 1.0", 1, FACES.format(1, "uint"))).encode() + bytes(12)
        + b"\xff" * 40, "cannot be read as .ply"),
    Bad("huge.off", b"OFF\n1000000000000 1 0\n0 0 0\n", "at most 10,000,000 are taken"),
    Bad("large.off", b"OFF\n20 9000000 0\n0 0 0\n", "says 9,000,000 elements"),
    Bad("huge.stl", bytes(80) + b"\xff" * 4 + bytes(50), "its header says 4,294,967,295 triangles"),
    Bad("huge.glb", glb(accessors=[{**ARRAY, "count": 10**12}]), "at most 10,000,000 are taken"),
    Bad("large.glb", glb(accessors=[{**ARRAY, "count": 9 * 10**6}] * 4, meshes=PARTS, nodes=[{"mesh": 0}]),
        "arrays without data have 36,000,000 entries"),
    Bad("minus.glb", glb(accessors=[{**ARRAY, "count": -5}]), "arrays without data have -5 entries"),
    Bad("many.glb", glb(accessors=[{**ARRAY, "count": 10**6, "bufferView": 0}], meshes=PARTS, nodes=[{"mesh": 0}] * 99),
        "vertices in its parts together; at most 10,000,000"),
    Bad("packed.glb", glb(extensionsRequired=["KHR_draco_mesh_compression"]), "its meshes are compressed"),
    Bad("deep.glb", struct.pack("<4sIIII", b"glTF", 2, 100_020, 100_000, 0x4E4F534A) + b"[" * 100_000,
        "cannot be read as .glb"),
    Bad("large.mat", mat(p=GRID).replace(struct.pack("<ii", 10, 3), struct.pack("<ii", 9 * 10**6, 3)),
        "cannot be read as .mat"),
    Bad("large4.mat", mat("4", p=GRID).replace(struct.pack("<ii", 10, 3), struct.pack("<ii", 9 * 10**6, 3)),
        "cannot be read as .mat"),
    Bad("bomb.mat", mat_bomb, "it unpacks to more than"),
]  # fmt: skip
