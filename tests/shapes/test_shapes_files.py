"""Every format, written and read back; and what a file that cannot be used is told."""

import numpy as np
import pytest
from scipy.io import savemat

from swarmer.errors import BadInput
from swarmer.shapes.catalogue import load_shape
from swarmer.shapes.errors import BadShape
from swarmer.shapes.files import FORMATS

trimesh = pytest.importorskip("trimesh")

POINTS = np.array([[1, 2, 3], [4.5, 5, 6], [-7, 8, 9.25], [0, 0, 1]])
TEXTS = {
    "plain": "1 2 3\n4.5 5 6\n-7 8 9.25\n0 0 1\n",
    "commas": "1,2,3\r\n4.5,5,6\r\n-7,8,9.25\r\n0,0,1",
    "mixed": "\n1;2;3\n 4.5\t5   6 # a comment\n\n// another\n-7, 8, 9.25\n0 0 1\n\n",
    "counted": "4\n1 2 3\n4.5 5 6\n-7 8 9.25\n0 0 1\n",
    "header": "length,height,depth\n1,2,3\n4.5,5,6\n-7,8,9.25\n0,0,1\n",
    "colours": "1 2 3 255 0 0\n4.5 5 6 255 0 0\n-7 8 9.25 0 0 0\n0 0 1 1 1 1\n",
    "marked": "\ufeff1 2 3\n4.5e0 5 6\n-7 8 9.25\n0 0 1\n",
}


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return str(path)


def refusal(path, **options):
    with pytest.raises(BadInput) as caught:
        load_shape(str(path), **options)
    line = str(caught.value)
    assert "\n" not in line
    return line


@pytest.mark.parametrize("suffix", ["ptcld", "txt", "csv", "xyz", "XYZ"])
@pytest.mark.parametrize("text", TEXTS)
def test_text(tmp_path, suffix, text):
    shape = load_shape(write(tmp_path / f"my.{suffix}", TEXTS[text]))
    np.testing.assert_array_equal(shape.points, POINTS)
    assert (shape.name, shape.source, shape.dim) == ("my", f"my.{suffix}", 3)


def test_a_molecule(tmp_path):
    text = "4\nstep 5\nC 1 2 3\nH 4.5 5 6\nH -7 8 9.25\nO 0 0 1\n"
    np.testing.assert_array_equal(load_shape(write(tmp_path / "m.xyz", text)).points, POINTS)
    assert "line 2" in refusal(write(tmp_path / "m.txt", text)) or "line 3" in refusal(tmp_path / "m.txt")


def test_two_columns_are_a_flat_shape(tmp_path):
    shape = load_shape(write(tmp_path / "flat.csv", "x,y\n1,2\n3,4\n"))
    assert (shape.dim, shape.points.tolist()) == (2, [[1, 2, 0], [3, 4, 0]])


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("1 2 3\n4 five 6\n", "line 2: 'five' is not a number"),
        ("1 2 3\n4 5 nan\n", "line 2: 'nan' is not a finite number"),
        ("1 2 3\n4 5 1e999\n", "line 2: '1e999' is not a finite number"),
        ("1 2 3\n4 5\n", "line 2: 2 columns; 3 columns as before"),
        ("1 2 3\n4\n", "line 2: 1 column; 3 columns as before"),
        ("1.5\n2.5\n", "line 1: 1 column; 2 or 3 columns are needed"),
        ("5\n1 2 3\n4 5 6\n", "says 5 points, 2 follow"),
        ("1,5;2,5;3,5\n", "decimal commas"),
        ("1_0 2 3\n", "line 1: '1_0' is not a number"),
        ("1 2 x3\n1 2 3\n4 5 6\n", "line 1: 'x3' is not a number"),
        ("# nothing\n", "no points in it"),
        ("1 2 3\n", "1 point; at least 2"),
        ("1 2 3\n1 2 3\n", "all 2 points are equal"),
        ("1 2 3\n1 2 3\n4 5 6\n", "1 of 3 points are duplicates: (1, 2, 3)"),
        (b"\x00\x01\x02", "not a text file"),
        (b"1 2 \xff\n", "line 1: '\ufffd' is not a number"),
        (b"", "the file is empty"),
    ],
)
def test_bad_text_is_told_where(tmp_path, text, line):
    path = write(tmp_path / "bad.txt", text)
    told = refusal(path)
    assert told.startswith("shape: ")
    assert "bad.txt" in told
    assert line in told


def test_dropped_duplicates_are_counted(tmp_path):
    shape = load_shape(write(tmp_path / "d.txt", "1 2 3\n1 2 3\n4 5 6\n"), duplicates="drop")
    assert (len(shape), shape.dropped) == (2, 1)


@pytest.mark.parametrize("dtype", ["f8", "f4", "i4", "u1", ">f8"])
def test_npy(tmp_path, dtype):
    points = np.abs(np.round(POINTS)).astype(dtype)
    np.save(tmp_path / "p.npy", points)
    np.testing.assert_array_equal(load_shape(str(tmp_path / "p.npy")).points, points)
    np.save(tmp_path / "f.npy", np.asfortranarray(points[:, :2]))
    assert load_shape(str(tmp_path / "f.npy")).dim == 2


@pytest.mark.parametrize(
    ("array", "line"),
    [
        (np.array([[1, "a"]], dtype=object), "array of objects"),
        (np.ones((3, 3)) * 1j, "array of complex128"),
        (np.array([["a", "b", "c"]]), "whole or floating-point"),
        (np.ones(6), "array of shape (6,)"),
        (np.ones((3, 1)), "array of shape (3, 1)"),
        (np.ones((2, 3, 3)), "array of shape (2, 3, 3)"),
        (np.empty((0, 3)), "0 points"),
        (np.array([[1, 2, np.nan], [1, 2, 3]]), "point 1 is (1, 2, nan)"),
    ],
)
def test_bad_arrays(tmp_path, array, line):
    np.save(tmp_path / "p.npy", array, allow_pickle=True)
    assert line in refusal(tmp_path / "p.npy")


@pytest.mark.parametrize("version", ["4", "5"])
@pytest.mark.parametrize("compressed", [False, True])
def test_mat(tmp_path, version, compressed):
    path = tmp_path / "p.mat"
    savemat(path, {"cloud": POINTS, "eta": 5.0}, format=version, do_compression=compressed and version == "5")
    np.testing.assert_array_equal(load_shape(str(path)).points, POINTS)


def test_a_mat_file_must_leave_no_choice(tmp_path):
    savemat(tmp_path / "two.mat", {"a": POINTS, "b": POINTS})
    assert "it holds: a 4x3 double, b 4x3 double" in refusal(tmp_path / "two.mat")
    savemat(tmp_path / "none.mat", {"a": {"field": POINTS}, "b": POINTS.T})
    assert "one numeric N x 2 or N x 3 array is needed" in refusal(tmp_path / "none.mat")
    savemat(tmp_path / "complex.mat", {"a": POINTS * 1j})
    assert "real numbers" in refusal(tmp_path / "complex.mat")
    assert "HDF5" in refusal(write(tmp_path / "new.mat", b"MATLAB 7.3 MAT-file" + b" " * 200))


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(2, radius=10)


@pytest.mark.parametrize("suffix", ["off", "ply", "obj", "stl", "glb"])
def test_meshes(tmp_path, ball, suffix):
    path = tmp_path / f"ball.{suffix}"
    ball.export(path)
    assert len(load_shape(str(path))) == len(ball.vertices)
    sample = load_shape(str(path), points=300, seed=1)
    radius = np.linalg.norm(sample.points, axis=1)
    assert len(sample) == 300
    assert 9.5 < radius.min() <= radius.max() < 10 + 1e-5
    np.testing.assert_array_equal(sample.points, load_shape(str(path), points=300, seed=1).points)
    assert not np.array_equal(sample.points, load_shape(str(path), points=300, seed=2).points)
    assert sample.source == f"300 points of the surface in ball.{suffix}"


@pytest.mark.parametrize("suffix", ["off", "ply", "obj"])
def test_points_without_faces(tmp_path, suffix):
    rows = [" ".join(f"{value:g}" for value in row) for row in POINTS]
    ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    text = {
        "off": "OFF\n4 0 0\n" + "\n".join(rows),
        "ply": ply + "\n".join(rows),
        "obj": "\n".join(f"v {row}" for row in rows),
    }[suffix]
    path = write(tmp_path / f"p.{suffix}", text + "\n")
    np.testing.assert_array_equal(load_shape(path).points, POINTS)
    assert len(load_shape(path, points=2)) == 2
    assert "2 to 4, as many as" in refusal(path, points=5)


def test_a_mesh_without_area_cannot_be_sampled(tmp_path):
    path = write(tmp_path / "line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    assert len(load_shape(path)) == 3
    assert "its surface has no area" in refusal(path, points=10)


@pytest.mark.parametrize("head", ["OFF 3 1 0\n", "OFF\n3 1 0 # counts\n", "# mine\nOFF\n3 1\n"])
def test_the_counts_of_an_off_are_not_taken_from_its_vertices(tmp_path, head):
    (tmp_path / "x.off").write_text(head + "900000 0 0\n0 900000 0\n0 0 900000\n3 0 1 2\n")
    assert len(load_shape(str(tmp_path / "x.off"))) == 3


def test_vertices_that_no_face_uses_are_left_out(tmp_path):
    path = write(tmp_path / "q.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\nf 1 2 3 4\n")
    assert load_shape(path).points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


@pytest.mark.parametrize("suffix", sorted(FORMATS))
def test_nonsense_in_every_format(tmp_path, suffix):
    contents = (b"\x00" * 64, b"\xff" * 200, b"nonsense", b"{}", b"1", b"solid\n", b"OFF\n", b"ply\n")
    for number, content in enumerate(contents):
        assert refusal(write(tmp_path / f"{number}{suffix}", content)).startswith("shape: ")


def test_a_suffix_that_nobody_reads(tmp_path):
    assert ".doc is not known; one of .ptcld" in refusal(write(tmp_path / "a.doc", "1 2 3"))


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    path = write(tmp_path / "p.xyz", "1 2 3\n")

    def denied(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.read_bytes", denied)
    assert "cannot be read: Permission denied" in refusal(path)


def test_a_bad_shape_is_bad_input():
    assert issubclass(BadShape, BadInput)
