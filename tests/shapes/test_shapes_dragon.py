"""The dragon as it is shipped, and made anew."""

import numpy as np
from remake import assert_made_anew, remaking

from swarmer.shapes.catalogue import data_dir, load_shape
from swarmer.shapes.neighbours import neighbour_plan


def test_the_dragon_keeps_its_count_box_and_gap():
    cloud = load_shape("dragon")
    plan = neighbour_plan(cloud.points)
    assert len(cloud) == 760
    np.testing.assert_allclose(cloud.points.min(axis=0), [3, 3, 3])
    np.testing.assert_allclose(cloud.points.max(axis=0), [98, 62, 60])
    assert plan.spacing_min_cells >= 1.2
    assert plan.components == 1
    assert plan.longest_link_cells < 10
    assert cloud.licence == "MIT"


def test_its_readme_tells_the_same():
    row = next(
        line for line in (data_dir() / "README.md").read_text().splitlines() if line.startswith("| `dragon`")
    )
    plan = neighbour_plan(load_shape("dragon").points)
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:] == [
        "760", "95 x 59 x 57", f"{plan.spacing_min_cells:.2f}", str(plan.components), f"{plan.longest_link_cells:.1f}",
    ]  # fmt: skip


def test_it_stands_upright_and_its_wings_are_the_widest_part():
    points = load_shape("dragon").points
    low, high = points[points[:, 1] < 10], points[points[:, 1] > 45]
    assert np.ptp(low[:, 2]) < 25 < 50 < np.ptp(high[:, 2])
    head = points[points[:, 0] > 85]
    assert head[:, 1].min() > 30


@remaking
def test_the_script_makes_it_anew(monkeypatch):
    assert_made_anew("dragon", monkeypatch)
