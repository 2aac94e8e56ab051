"""What is drawn, and what the command prints."""

import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from swarmer.commands.shapes import command
from swarmer.errors import BadInput
from swarmer.shapes.braille import terminal_picture
from swarmer.shapes.catalogue import CATALOGUE, load_shape
from swarmer.shapes.drawing import Panel, draw_clouds
from swarmer.shapes.views import FRONT, SIDE, THREE_QUARTERS, TOP, seen_from, usual_view


def run(*arguments):
    return CliRunner().invoke(command, list(arguments), catch_exceptions=False)


def test_the_viewer_sees_length_to_the_right_height_up_and_depth_towards_him():
    axes = np.eye(3)
    np.testing.assert_allclose(seen_from(axes, SIDE), axes, atol=1e-12)
    np.testing.assert_allclose(seen_from(axes, TOP)[1], [0, 0, 1], atol=1e-12)
    assert seen_from(axes, FRONT)[0, 2] > 0.9  # from the front the head is nearest
    np.testing.assert_allclose(seen_from(axes, SIDE, up_axis=2)[2], [0, 1, 0], atol=1e-12)
    assert (usual_view(2), usual_view(3)) == (SIDE, THREE_QUARTERS)


def test_a_corner_of_dots():
    points = np.array([[0, 0, 0], [0, 3, 0], [3, 0, 0]], dtype=float)
    assert terminal_picture(points, SIDE, columns=2, rows=1) == "⡁⢀"
    assert terminal_picture(points, SIDE, columns=2, rows=1, ascii_only=True) == "o."


def test_colour_is_only_where_it_is_asked_for():
    points = load_shape("dragon").points
    plain, coloured = (terminal_picture(points, THREE_QUARTERS, colour=colour) for colour in (False, True))
    assert "\x1b" not in plain
    assert coloured.count("\x1b[38;2;") > 20
    assert all(len(line) <= 76 for line in plain.splitlines())
    assert len(plain.splitlines()) <= 30


@pytest.mark.parametrize("points", [np.array([[0, 0, 0], [0, 0, 5.0]]), np.array([[0, 0, 0], [1e6, 0, 0.0]])])
def test_degenerate_clouds_are_drawn_too(points):
    assert terminal_picture(points, SIDE).strip("\n")


def test_pictures(tmp_path):
    points = load_shape("sphere").points
    red = np.tile([1.0, 0, 0], (len(points), 1))
    draw_clouds([("before", points, None), ("after", points, red)], tmp_path / "two.png")
    draw_clouds([Panel("flat", points[:2], None, TOP)], tmp_path / "one.svg")
    assert (tmp_path / "two.png").read_bytes().startswith(b"\x89PNG")
    assert "flat" in (tmp_path / "one.svg").read_text()


def test_the_catalogue_is_a_table():
    lines = run().output.splitlines()
    assert lines[0].split()[:3] == ["name", "points", "dim"]
    assert [line.split()[0] for line in lines[1 : 1 + len(CATALOGUE)]] == list(CATALOGUE)
    assert "95 x 59 x 57" in lines[1]


def test_show_draws_and_tells_the_facts(tmp_path):
    result = run("show", "dragon", "--out", str(tmp_path / "d.png"))
    assert (result.exit_code, "\x1b" in result.output) == (0, False)
    assert "760" in result.output
    assert "95 x 59 x 57 cells" in result.output
    assert (tmp_path / "d.png").stat().st_size > 10_000


def test_show_warns_of_lights_that_are_too_near(tmp_path):
    (tmp_path / "near.xyz").write_text("0 0 0\n0 0 0\n0.5 0 0\n3 0 1\n")
    result = run("show", str(tmp_path / "near.xyz"), "--dedupe")
    assert "1 duplicates removed" in result.output
    assert "scale the shape by 2" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("show", "dragn"), "shape: no 'dragn'"),
        (("show", "sphere", "--eta", "100"), "eta: 100"),
        (("show", "sphere", "--points", "1"), "points: 1"),
        (("show", "sphere", "--out", "x.doc"), "out: 'x.doc'"),
        (("show", "sphere", "--out", "/nowhere/x.png"), "out: '/nowhere/x.png'"),
    ],
)
def test_bad_input_of_the_command(arguments, line):
    with pytest.raises(BadInput) as caught:
        run(*arguments)
    assert str(caught.value).startswith(line)


def test_a_picture_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    def full(panels, path, dpi):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    out = tmp_path / "x.png"
    out.write_text("mine")
    monkeypatch.setattr("swarmer.shapes.drawing.draw_clouds", full)
    with pytest.raises(BadInput, match="No space left on device"):
        run("show", "sphere", "--out", str(out))
    assert [path.name for path in tmp_path.iterdir()] == ["x.png"]
    assert out.read_text() == "mine"


def test_a_seed_below_0_is_refused():
    result = CliRunner().invoke(command, ["show", "random", "--seed", "-1"])
    assert result.exit_code == 2
    assert "'--seed': -1 is not in the range" in result.stderr


def test_naming_the_command_costs_no_numpy():
    code = "import sys, swarmer.commands.shapes; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
