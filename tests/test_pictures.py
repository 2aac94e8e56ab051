"""scripts/make_pictures.py: a run's timeline and the catalogue become the pictures of README.md."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
PICTURES = [ROOT / "docs" / "pictures" / name for name in ("before_after.png", "shapes.png")]


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("make_pictures", ROOT / "scripts" / "make_pictures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def timeline(folder, lit=None):
    """Four FLSs: dark, landed one after the other, then perfect, then a little off again."""
    truth = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 1], [4, 4, 2]], dtype=float)
    off = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]], dtype=float)
    position = np.stack([truth + 9, truth + off, truth + off / 2, truth, truth + off / 4])
    if lit is None:
        lit = np.array([[0, 0, 0, 0], [1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1]], dtype=bool)
    hd = np.array([np.nan, 0.0, 0.5, 0.0, 0.2])
    np.savez(
        folder / "timeline.npz", truth=truth, position=position, lit=lit, hd_cells=hd, t_s=np.arange(5.0)
    )
    return truth, off


def test_before_is_where_each_landed_and_after_the_best_whole_sample(script, tmp_path):
    truth, off = timeline(tmp_path)
    seen = script.moments(tmp_path / "timeline.npz")
    assert np.allclose(seen.landed[:3], truth[:3] + off[:3])
    assert np.allclose(seen.landed[3], truth[3] + off[3] / 2)  # it landed a sample later
    assert np.allclose(seen.localized, truth)
    assert seen.localized_s == 3.0


def test_the_picture_is_drawn_and_small(script, tmp_path):
    timeline(tmp_path)
    script.main([str(tmp_path), str(tmp_path / "new" / "folder")])
    with Image.open(tmp_path / "new" / "folder" / "before_after.png") as picture:
        assert picture.width > 1.5 * picture.height
        assert picture.mode == "P"


@pytest.mark.parametrize("dark", [True, False])
def test_what_cannot_be_drawn_is_said(script, tmp_path, dark):
    if dark:
        timeline(tmp_path, np.zeros((5, 4), dtype=bool))
    with pytest.raises(SystemExit, match=r"error: .*timeline\.npz"):
        script.main([str(tmp_path), str(tmp_path)])


def test_the_shapes_fill_their_places(script, tmp_path):
    script.main(["shapes", str(tmp_path)])
    with Image.open(tmp_path / "shapes.png") as picture:
        pixels = np.asarray(picture.convert("L"))
    assert pixels.shape == (2 * script.TILE, script.COLUMNS * script.TILE)
    for row in np.split(pixels, 2):
        for place in np.split(row, script.COLUMNS, axis=1):
            assert (place > 60).any(axis=1).sum() > script.TILE / 3


@pytest.mark.parametrize("picture", PICTURES)
def test_the_pictures_of_the_readme_are_there_and_small(picture):
    assert picture.stat().st_size < 400_000
