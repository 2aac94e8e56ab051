"""`swarmer shapes make`: any file becomes a cloud that can be run."""

import shlex
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from scipy.io import savemat
from scipy.spatial import cKDTree

from swarmer.commands import shapes_make
from swarmer.commands.shapes import command
from swarmer.errors import BadInput, RunFailed
from swarmer.shapes import placing
from swarmer.shapes.catalogue import load_shape
from swarmer.shapes.files import FORMATS
from swarmer.shapes.placing import Size, place, turned

trimesh = pytest.importorskip("trimesh")

TORUS = trimesh.creation.torus(2, 0.5, major_sections=24, minor_sections=12)
MESHES = {".off", ".ply", ".obj", ".stl", ".glb"}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def make(*arguments):
    return CliRunner().invoke(command, ["make", *map(str, arguments)], catch_exceptions=False)


def refusal(*arguments):
    with pytest.raises(BadInput) as caught:
        make(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def least_gap(points):
    return np.asarray(cKDTree(points).query(points, k=[2])[0]).min()


def write_torus(path):
    """The torus in the format that the suffix says: a mesh, or its vertices."""
    vertices = np.asarray(TORUS.vertices)
    if path.suffix in MESHES:
        TORUS.export(path)
    elif path.suffix == ".npy":
        np.save(path, vertices)
    elif path.suffix == ".mat":
        savemat(path, {"points": vertices})
    else:
        np.savetxt(path, vertices, delimiter="," if path.suffix == ".csv" else " ")


@pytest.mark.parametrize("suffix", sorted(FORMATS))
def test_every_format_becomes_a_cloud_that_runs(suffix):
    write_torus(Path("ring" + suffix))
    result = make("ring" + suffix, "--points", 150, "--out", "out.xyz", "--up", "z")
    assert result.exit_code == 0
    cloud = load_shape("out.xyz")
    assert (len(cloud), cloud.dim, cloud.dropped) == (150, 3, 0)
    np.testing.assert_allclose(cloud.points.min(axis=0), 3)
    assert 1.5 <= least_gap(cloud.points) < 1.51
    length, height, depth = cloud.box_cells
    assert height < 0.3 * length, "its z axis points up now"
    assert length == pytest.approx(depth, rel=0.1)
    assert all(len(number.partition(".")[2]) == 3 for number in Path("out.xyz").read_text().split())
    assert result.output.splitlines()[-1].endswith("swarmer-run --shape out.xyz")


def test_a_picture_becomes_a_flat_cloud():
    drawn = np.full((60, 120), 255, dtype=np.uint8)
    drawn[10:50, 20:100] = 0
    Image.fromarray(drawn).save("bar.png")
    result = make("bar.png", "--points", 90, "--box", "80x80")
    cloud = load_shape("bar.xyz")
    assert (len(cloud), cloud.dim) == (90, 2)
    assert cloud.box_cells == pytest.approx((80, 40, 0), abs=3)
    assert "a picture of 120 x 60 pixels, 44% of them drawn" in result.output
    assert refusal("ring.off", "--invert") == "invert: 'ring.off' is no picture (.png)"
    assert refusal("bar.png", "--points", 9, "--up", "z", "--out", "o.xyz").startswith(
        "up: 'z' is not allowed; y for a picture"
    )
    make("bar.png", "--points", 90, "--invert", "--out", "frame.xyz", "--box", "80x80")
    frame = load_shape("frame.xyz").points
    middle = (frame.min(axis=0) + frame.max(axis=0)) / 2
    assert np.linalg.norm(frame - middle, axis=1).min() > 5


def test_what_was_done_is_told():
    np.savetxt("p.txt", [[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0.2, 0]])
    output = make("p.txt", "--dedupe").output
    assert "4 points, 1 duplicates dropped" in output
    assert "scale   15 cells for 1 in the file (--spacing 1.5)" in output
    assert "wrote   p.xyz: 3 points, box 1.5 x 3 x 0 cells = 0.075 x 0.15 x 0 m" in output
    assert "nearest two 1.50 cells apart" in output
    assert Path("p.xyz").read_text() == "3.000 3.000 3.000\n4.500 3.000 3.000\n3.000 6.000 3.000\n"


@pytest.mark.parametrize(
    ("options", "box"),
    [
        (("--box", "60x60x60"), (60, 60, 12)),
        (("--box", "1000 x 30 X 1000"), (30, 30, 6)),
        (("--box", "40×50"), (40, 40, 8)),
        (("--unit", "cm"), (1, 1, 0.2)),
        (("--unit", "m"), (100, 100, 20)),
        (("--unit", "mm", "--scale", "400"), (40, 40, 8)),
        (("--scale", "8"), (40, 40, 8)),
    ],
)
def test_the_size_is_what_was_asked_for(options, box):
    TORUS.export("ring.stl")  # 5 x 5 x 1
    result = make("ring.stl", "--points", 200, *options)
    np.testing.assert_allclose(load_shape("ring.xyz").box_cells, box, rtol=0.06)
    assert ("lights need 1" in result.stderr) == (box[0] < 10)


@pytest.mark.parametrize("said", ["--box 9x9", "--spacing 2", "--scale 3", "--unit m", "--scale 3 --unit cm"])
def test_the_size_is_told_as_it_was_asked_for(said):
    Path("p.txt").write_text("0 0 0\n1 0 0\n")
    assert f"cells for 1 in the file ({said})" in make("p.txt", *said.split()).output


@pytest.mark.parametrize("up", placing.TURNS)
def test_turning_is_a_rotation_that_brings_the_axis_up(up):
    axis = {"x": 0, "y": 1, "z": 2}[up[-1]]
    pointed = np.eye(3)[axis] * (-1 if up[0] == "-" else 1)
    np.testing.assert_array_equal(turned(pointed[None], up), [[0, 1, 0]])
    assert np.linalg.det(turned(np.eye(3), up)) == pytest.approx(1), "nothing is mirrored"


@pytest.mark.parametrize("spacing", [0.5, 1.0, 1.5, 3.3333])
def test_rounding_leaves_the_nearest_two_as_far_apart_as_was_asked(spacing):
    for seed in range(20):
        points = np.random.default_rng(seed).random((60, 3)) * 10.0 ** (seed - 10)
        assert spacing <= least_gap(place(points, Size(spacing=spacing)).points) < spacing + 0.004


def test_a_cloud_far_from_zero_keeps_its_shape():
    points = np.array(list(product(range(4), repeat=3))) * 1e-3
    near, far = (place(points + offset, Size(spacing=2)).points for offset in (0.0, 4096.0))
    np.testing.assert_allclose(near, far, atol=0.002)


def test_what_cannot_be_written_without_loss_is_refused():
    np.savetxt("two.txt", [[0, 0, 0], [1, 0, 0], [1.0001, 0, 0], [900, 0, 0]])
    assert "box: '1x1x1' is not allowed; too small: rounded to 3 decimals 1 of 4 points lie on" in refusal(
        "two.txt", "--box", "1x1x1"
    )
    assert "--points" in refusal("two.txt", "--spacing", "1000")
    assert "within 10,000,000 cells" in refusal("two.txt", "--scale", "11200")
    for said, line in {
        "--scale 0.5": "scale: '0.5' is not allowed; too small",
        "--unit mm": "unit: 'mm' is not allowed; too small",
        "--scale 9 --unit mm": "scale: '9' is not allowed; too small",
    }.items():
        assert refusal("two.txt", *said.split()).startswith(line)
    assert sorted(path.name for path in Path().iterdir()) == ["two.txt"]
    np.savetxt("three.txt", [[0, 0, 0], [1, 0, 0], [1.01, 0, 0], [9, 0, 0], [10, 0, 0]])
    assert "uneven: most points are 150 cells from the next, the nearest two 1.5" in make("three.txt").stderr


def test_a_depth_alone_does_not_fit_into_a_box_without_one():
    np.savetxt("line.txt", [[0, 0, 0], [0, 0, 5]])
    assert "differ in depth alone" in refusal("line.txt", "--box", "9x9")
    make("line.txt", "--box", "9x9x9")
    assert load_shape("line.xyz").box_cells == (0, 0, 9)


def test_flat_is_what_one_sees_from_the_front():
    np.savetxt("p.txt", [[0, 0, 0], [0, 0, 9], [4, 0, 1], [4, 4, 1]])
    assert "1 duplicates dropped" in make("p.txt", "--flat").output
    assert (load_shape("p.xyz").dim, len(load_shape("p.xyz"))) == (2, 3)
    TORUS.export("ring.obj")
    make("ring.obj", "--points", 200, "--flat")
    ring = load_shape("ring.xyz")
    assert (ring.dim, len(ring)) == (2, 200)
    middle = ring.points - (ring.points.max(axis=0) + ring.points.min(axis=0)) / 2
    assert np.linalg.norm(middle, axis=1).min() > 0.5 * np.linalg.norm(middle, axis=1).max()


def test_a_mesh_with_holes_and_bad_triangles_is_sampled_with_a_warning():
    vertices = np.vstack([TORUS.vertices, [[0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    count = len(TORUS.vertices)
    faces = np.vstack([TORUS.faces[:-40], [[count, count + 1, count + 2]]])
    trimesh.Trimesh(vertices, faces, process=False).export("open.off")
    result = make("open.off", "--points", 100)
    assert "not watertight" in result.output
    assert "holes or loose edges" in result.stderr
    assert "triangles without area: 1 of" in result.stderr
    assert len(load_shape("open.xyz")) == 100


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_a_scene_of_several_bodies_is_one_shape(suffix):
    scene = trimesh.Scene()
    for number in range(3):
        box = trimesh.creation.box()
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([5 * number, 0, 0]))
    scene.export(f"boxes.{suffix}")
    result = make(f"boxes.{suffix}", "--points", 120, "--box", "110x110x110")
    assert "a mesh of 36 triangles in 3 bodies, watertight" in result.output
    length, height, _ = load_shape("boxes.xyz").box_cells
    assert (length, height) == pytest.approx((110, 10), abs=1)


def test_a_mesh_without_faces_is_points():
    Path("p.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    assert "3 points, no duplicates" in make("p.obj").output
    assert "2 to 3, as many as" in refusal("p.obj", "--points", 4, "--force")


def test_the_seed_decides_what_is_drawn():
    TORUS.export("ring.off")
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        make("ring.off", "--points", 50, "--seed", seed, "--out", f"{name}.xyz")
    first, same, other = (Path(f"{name}.xyz").read_text() for name in "abc")
    assert first == same != other
    bar = np.full((60, 60), 255, dtype=np.uint8)
    bar[10:50, 20:40] = 0
    Image.fromarray(bar).save("bar.png")
    for name, seed in (("d", 1), ("e", 2)):
        make("bar.png", "--points", 50, "--seed", seed, "--out", f"{name}.xyz")
    assert Path("d.xyz").read_text() != Path("e.xyz").read_text()


def test_a_file_that_is_there_stays_unless_force_is_said():
    Path("p.txt").write_text("0 0 0\n1 0 0\n")
    Path("p.xyz").write_text("mine")
    assert "--force" in refusal("p.txt")
    assert Path("p.xyz").read_text() == "mine"
    make("p.txt", "--force")
    assert len(load_shape("p.xyz")) == 2
    Path("link.xyz").symlink_to("p.xyz")
    for out in ("p.xyz", "./p.xyz", "link.xyz"):
        assert "another file than the one that is read" in refusal("p.xyz", "--out", out, "--force")


def test_a_link_to_nothing_stays_too():
    Path("p.txt").write_text("0 0 0\n1 0 0\n")
    Path("link.xyz").symlink_to("nowhere.xyz")
    assert "it is there already" in refusal("p.txt", "--out", "link.xyz")
    assert Path("link.xyz").is_symlink()


@pytest.mark.parametrize(
    ("out", "line"),
    [
        ("cloud.txt", "ends in .xyz"),
        ("cloud", "ends in .xyz"),
        ("", "ends in .xyz"),
        ("a\nb.xyz", "without special characters"),
        ("nowhere/cloud.xyz", "a directory that is there"),
        ("dir.xyz", "that is a directory"),
        ("x" * 300 + ".xyz", "File name too long"),
    ],
)
def test_a_bad_place_for_the_cloud_is_refused(out, line):
    Path("p.txt").write_text("0 0 0\n1 0 0\n")
    Path("dir.xyz").mkdir()
    told = refusal("p.txt", "--force", "--out", out)
    assert told.startswith("out: ")
    assert line in told


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--points", "1"), "points: 1 is not allowed"),
        (("--points", "10000001"), "points: 10000001 is not allowed"),
        ((), "points: a mesh needs a count, as --points 760"),
        (("--points", "9", "--box", "9"), "box: '9' is not allowed"),
        (("--points", "9", "--box", "1x2x3x4"), "box: "),
        (("--points", "9", "--box", "axb"), "box: "),
        (("--points", "9", "--box", "0x1x1"), "box: "),
        (("--points", "9", "--box", "nanx1x1"), "box: "),
        (("--points", "9", "--box", "1e9x1x1"), "box: "),
        (("--points", "9", "--spacing", "0"), "spacing: 0.0 is not allowed"),
        (("--points", "9", "--spacing", "inf"), "spacing: inf is not allowed"),
        (("--points", "9", "--scale", "-1"), "scale: -1.0 is not allowed"),
        (("--points", "9", "--scale", "nan"), "scale: nan is not allowed"),
        (
            ("--points", "9", "--scale", "1", "--spacing", "1"),
            "size: --spacing with --scale/--unit; only one",
        ),
        (("--points", "9", "--unit", "m", "--box", "9x9"), "size: --box with --scale/--unit; only one"),
    ],
)
def test_bad_options_are_refused_in_one_line(options, line):
    TORUS.export("ring.ply")
    assert refusal("ring.ply", *options).startswith(line)
    assert not Path("ring.xyz").exists()


def test_a_name_of_the_catalogue_needs_no_making():
    assert refusal("dragon", "--points", 100).endswith("`swarmer-run --shape dragon --points N` runs it")


def test_the_help_knows_the_axes_and_units():
    assert tuple(placing.TURNS) == shapes_make.AXES
    assert tuple(placing.UNITS) == shapes_make.MEASURES


@pytest.mark.parametrize("name", ["-v.xyz", "my shape.xyz", "it's.xyz", "$HOME.xyz", "a;b.xyz"])
def test_the_next_command_can_be_pasted(name):
    Path("p.txt").write_text("0 0 0\n1 0 0\n")
    line = make("p.txt", f"--out={name}").output.splitlines()[-1]
    *_, option, path = shlex.split(line)
    assert option == "--shape"
    assert not path.startswith("-")
    assert Path(path).samefile(name)


def test_a_disk_that_is_full_leaves_nothing(monkeypatch):
    Path("p.txt").write_text("0 0 0\n1 0 0\n")

    def full(fd, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("swarmer.observe.files.write_bytes", full)
    with pytest.raises(RunFailed, match=r"^p.xyz: No space left on device; nothing was written$"):
        make("p.txt")
    assert [path.name for path in Path().iterdir()] == ["p.txt"]
