"""Where a fault strikes: every way to say it, and what is refused."""

import pytest

from swarmer.errors import BadInput
from swarmer.fault_places import Ground, Place, longest_axis, place, slabs

# Five points in a row along L, the last one high up.
POINTS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (3.0, 0.0, 0.0), (4.0, 9.0, 0.0)]
GROUND = Ground(5, POINTS, seed=3)


@pytest.mark.parametrize(
    ("given", "fids"),
    [
        ([4, 2, 2], (2, 4)),
        ("all", (1, 2, 3, 4, 5)),
        ({"half": "low", "axis": "L"}, (1, 2)),
        ({"half": "high", "axis": "L"}, (3, 4, 5)),
        ({"half": "high", "axis": "H"}, (3, 4, 5)),
        ({"box": [[0.5, -1, -1], [3, 1, 1]]}, (2, 3, 4)),
        ({"box": [[3, 1, 1], [0.5, -1, -1]]}, (2, 3, 4)),
        ({"centre": [2, 0, 0], "radius": 1}, (2, 3, 4)),
        ({"share": 1}, (1, 2, 3, 4, 5)),
    ],
    ids=str,
)
def test_a_place(given, fids):
    assert place("where", given, GROUND, "x") == Place(fids)


def test_a_swarm_is_looked_up_later():
    assert place("where", {"swarm_of": 4}, GROUND, "x") == Place((), 4)


def test_a_share_is_drawn_from_the_seed_and_for_its_purpose():
    ground = Ground(100, None, 3)
    drawn = place("where", {"share": 0.1}, ground, "kill 1.0")
    assert len(drawn.fids) == 10
    assert place("where", {"share": 0.1}, ground, "kill 1.0") == drawn
    assert place("where", {"share": 0.1}, ground, "kill 2.0") != drawn
    assert place("where", {"share": 0.1}, ground._replace(seed=4), "kill 1.0") != drawn
    assert len(place("where", {"share": 0.0001}, ground, "kill 1.0").fids) == 1


@pytest.mark.parametrize(
    "given",
    [
        None, [], [0], [6], [1.0], ["1"], "everybody", {}, {"share": 0}, {"share": 1.5}, {"share": True},
        {"half": "left", "axis": "L"}, {"half": "low"}, {"half": "low", "axis": ["L"]}, {"half": "low", "axis": "X"},
        {"box": [[0, 0, 0]]}, {"box": [[0, 0, 0], [1, 1]]}, {"box": [[0, 0, 0], [1, 1, float("nan")]]}, {"box": 3},
        {"centre": [0, 0, 0]}, {"centre": [0, 0, 0], "radius": -1}, {"centre": "here", "radius": 1},
        {"swarm_of": 9}, {"swarm_of": [1]}, {"share": 0.1, "half": "low"}, 7,
    ],
    ids=str,
)  # fmt: skip
def test_no_place(given):
    with pytest.raises(BadInput, match=r"where: .* is not allowed; a list of FIDs, 1 to 5, `all`, or one of"):
        place("where", given, GROUND, "x")


def test_a_place_where_nobody_is():
    with pytest.raises(BadInput, match="at least one point"):
        place("where", {"centre": [50, 0, 0], "radius": 1}, GROUND, "x")


def test_without_points_there_are_only_fids():
    with pytest.raises(BadInput):
        place("where", {"half": "low", "axis": "L"}, Ground(5), "x")


def test_slabs_hold_everybody_once_and_are_alike():
    rows = slabs([(float(at % 7), 0.0, 0.0) for at in range(23)], 4, "L")
    assert sorted(row for part in rows for row in part) == list(range(23))
    assert {len(part) for part in rows} == {5, 6}
    assert longest_axis(POINTS) == "H"
