"""`swarmer shapes check`: what the planner sees, and what a run would take; and the table of all shapes."""

import numpy as np
import pytest
from click.testing import CliRunner

from swarmer.commands import shapes_check
from swarmer.commands.shapes import command
from swarmer.engines.limits import MEMORY_MB_PER_FLS
from swarmer.errors import BadInput
from swarmer.shapes.catalogue import CATALOGUE, load_shape
from swarmer.shapes.neighbours import neighbour_plan


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def check(*arguments):
    return CliRunner().invoke(command, ["check", *map(str, arguments)], catch_exceptions=False)


def rows(result):
    return dict(line.split(maxsplit=1) for line in result.output.splitlines() if line[0] != " ")


def clusters(count, size, apart=100.0):
    """Lattices of size points, far from each other."""
    own = np.indices((size, 1, 1)).reshape(3, -1).T * 2.0
    return np.concatenate([own + [apart * number, 0, 0] for number in range(count)])


def test_the_facts_are_those_of_the_plan():
    plan = neighbour_plan(load_shape("dragon").points)
    result = check("dragon")
    told = rows(result)
    assert (result.exit_code, result.stderr) == (0, "")
    assert told["shape"] == "dragon: 760 points in 3D"
    assert told["box"] == "95 x 59 x 57 cells = 4.75 x 2.95 x 2.85 m"
    assert told["spacing"].startswith(f"nearest two {plan.spacing_min_cells:.3g} cells apart, median ")
    assert told["nearest"] == f"η 5: 1 part, {plan.one_way_share:.0%} of the links one-way"
    assert f"longest link {plan.longest_link_cells:.3g} cells" in told["connected"]
    assert told["memory"].startswith(f"up to {760 * MEMORY_MB_PER_FLS:.0f} MB")
    assert "launch some 2 s" in told["time"]
    assert all(len(line) <= 120 for line in result.output.splitlines())


def test_parts_that_do_not_know_of_each_other_are_told():
    np.save("far.npy", clusters(3, 10))
    told = rows(check("far.npy"))
    assert told["nearest"].startswith("η 5: 3 parts")
    assert told["connected"].startswith("1 part, joined by 2 links; longest link 82 cells")
    assert "neighbours=nearest never: its 3 parts" in check("far.npy").output


def test_one_way_links_are_told_where_there_are_any():
    np.save("ring.npy", [[np.cos(turn) * 9, np.sin(turn) * 9, 0] for turn in np.arange(8) * np.pi / 4])
    assert "nearest too: all its links go both ways" in check("ring.npy", "--eta", 2).output
    np.save("ray.npy", [[0, 0, 0], [2, 0, 0], [5, 0, 0]])
    assert "33% of the links one-way" in check("ray.npy", "--eta", 1).output
    assert "may leave two swarms silent" in check("ray.npy", "--eta", 1).output


def test_what_a_run_would_suffer_from_is_warned_of():
    np.savetxt("near.xyz", [[0, 0, 0], [0, 0, 0], [0.25, 0, 0], [3, 0, 1]])
    result = check("near.xyz", "--dedupe", "--eta", 2)
    assert "3 points in 3D, 1 duplicates dropped" in result.output
    assert "points come as near as 0.25 cells; lights need 1, so scale the shape by 4" in result.stderr
    assert "η 2 is more than half of the 3 points" in result.stderr
    assert result.exit_code == 0
    with pytest.raises(BadInput, match=r"1 of 4 points are duplicates: \(0, 0, 0\); .*--dedupe"):
        check("near.xyz")


def test_points_are_counted_and_eta_is_refused_as_in_a_run():
    assert rows(check("dragon", "--points", 100))["shape"] == "dragon: 100 points in 3D"
    with pytest.raises(BadInput, match=r"^points: 761 is not allowed; 2 to 760"):
        check("dragon", "--points", 761)
    with pytest.raises(BadInput, match=r"^eta: 100 is not allowed; 1 to 99"):
        check("sphere", "--eta", 100)


def test_a_machine_that_is_too_small_is_a_warning(monkeypatch):
    refusal = BadInput("points", 100, "at most 7 FLSs fit")
    monkeypatch.setattr(shapes_check, "machine_trouble", lambda count: refusal)
    result = check("sphere")
    assert result.exit_code == 0, "the shape is a good one"
    assert rows(result)["memory"].startswith("too little here")
    assert f"too much for this machine: {refusal}" in result.stderr


def test_more_flss_than_there_are_addresses_are_refused():
    assert shapes_check.machine_trouble(2) is None
    assert str(shapes_check.machine_trouble(10**7)).startswith("points: 10000000 is not allowed; ")


def test_the_table_fits_a_terminal():
    lines = CliRunner().invoke(command, [], catch_exceptions=False).output.splitlines()
    assert max(len(line) for line in lines) <= 80
    assert [line.split()[0] for line in lines[1 : 1 + len(CATALOGUE)]] == list(CATALOGUE)
