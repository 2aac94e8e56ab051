"""The gallery, as the docs are built: every shape with pictures that are there and facts that are true."""

import os
import re
import struct
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from swarmer.shapes.catalogue import CATALOGUE, load_shape
from swarmer.shapes.neighbours import neighbour_plan

ROOT = Path(__file__).resolve().parent.parent
IMAGE = re.compile(r'<img src="([^"]+)" alt="([^"]+)"')
FACT = re.compile(r"<dt>(.*?)</dt><dd>(.*?)</dd>")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("mkdocs") is None, reason="needs the extra `docs`"),
]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built pages."""
    folder = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr[-2000:]
    return folder


@pytest.fixture(scope="module")
def parts(site):
    """What the page says of each shape, as HTML, by the id of its heading."""
    page = (site / "gallery.html").read_text("utf-8")
    found = re.split(r'<h3 id="([^"]+)"', page)[1:]
    return dict(zip(found[::2], found[1::2], strict=True))


def test_every_shape_of_the_catalogue_has_its_part_and_no_other(parts):
    assert list(parts) == list(CATALOGUE)


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_shape_has_pictures_that_are_there(site, parts, name):
    shown = IMAGE.findall(parts[name].partition("<h2")[0])
    titles = [said.removeprefix(f"{name}, ") for _, said in shown]
    flat = load_shape(name).dim == 2
    assert titles == (["flat"] if flat else ["three quarters", "side", "front"])
    for path, _ in shown:
        data = (site / path).read_bytes()
        assert data.startswith(b"\x89PNG")
        width, height = struct.unpack_from(">II", data, 16)
        assert min(width, height) > 250
        assert len(data) > 8000  # more than its ground


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_facts_of_a_shape_are_those_of_its_points(parts, name):
    facts = dict(FACT.findall(parts[name]))
    cloud = load_shape(name)
    plan = neighbour_plan(cloud.points)
    assert facts["points"].partition(", or")[0].replace(",", "") == str(len(cloud))
    assert [
        float(side) for side in facts["box, L × H × D"].removesuffix(" cells").split(" × ")
    ] == pytest.approx(cloud.box_cells, abs=0.051)
    assert facts["nearest two"] == f"{plan.spacing_min_cells:.2f} cells apart"
    assert facts["parts at η = 5"] == str(plan.components)
    assert facts["longest planned link"] == f"{plan.longest_link_cells:.1f} cells"
    assert facts["licence"].startswith(cloud.licence)
    assert (ROOT / facts["made by"].removeprefix("<code>").removesuffix("</code>")).is_file()


def test_the_shapes_at_a_glance_lead_to_their_parts_and_each_picture_is_another(site, parts):
    page = (site / "gallery.html").read_text("utf-8")
    tiles = page.partition('<div class="gallery">')[2].partition("</div>")[0]
    assert re.findall(r'href="#([^"]+)"', tiles) == list(CATALOGUE)
    paths = {path for path, _ in IMAGE.findall(page)}
    assert {path for path, _ in IMAGE.findall(tiles)} < paths
    assert len({(site / path).read_bytes() for path in paths}) == len(paths)


def test_the_page_is_in_the_navigation_and_leads_on(site):
    assert 'href="gallery.html"' in (site / "index.html").read_text("utf-8")
    page = (site / "gallery.html").read_text("utf-8")
    assert "swarmer shapes make" in page
    assert "<!-- gallery" not in page
