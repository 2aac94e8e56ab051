"""The pages' own drawings: a scenario as a sequence, curves, clouds, and the runs that are made for them."""

import importlib
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from swarmer.observe.moves import Flight, Move
from swarmer.observe.scenario import read

ROOT = Path(__file__).resolve().parent.parent
RECEIVED = re.compile(r"^\d+ <= (?!0 )\d+ ", re.MULTILINE)


@pytest.fixture(scope="module")
def docs():
    """The modules beside the pages, by name."""
    sys.path.insert(0, str(ROOT / "docs"))
    yield importlib.import_module
    sys.path.remove(str(ROOT / "docs"))


@pytest.mark.parametrize("name", ["pair_lower_anchors", "lease_runs_out", "merge_below_threshold"])
def test_a_sequence_has_an_arrow_for_every_datagram_that_arrives(docs, name):
    path = ROOT / "tests" / "scenarios" / f"{name}.txt"
    drawing = docs("sequence_figure").sequence_svg(path, "said <so>")
    arrived = [line for block in read(path).blocks for line in block.expected if RECEIVED.match(line)]
    assert drawing.count("marker-end") == len(arrived) > 3
    assert "said &lt;so&gt;" in drawing
    for line in arrived:
        assert f">{line.split()[3]}</text>" in drawing
    assert "BusyLocalizing</text>" in drawing


def test_a_sequence_of_what_does_not_come_of_it_is_refused(docs, tmp_path):
    text = (ROOT / "tests" / "scenarios" / "lease_runs_out.txt").read_text("utf-8")
    path = tmp_path / "wrong.txt"
    path.write_text(text.replace("leases 1->0", "leases 1->2"))
    with pytest.raises(ValueError, match=r"wrong\.txt, "):
        docs("sequence_figure").sequence_svg(path, "")


def test_a_curve_falls_where_hd_falls(docs):
    drawn = docs("drawn")
    t_s = np.linspace(0, 10, 11)
    hd = np.array([np.nan, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01])
    drawing = drawn.hd_curve(t_s, hd, [drawn.Mark(2.0, "red"), drawn.Mark(20.0, "red")], "said")
    heights = [float(pair.split(",")[1]) for pair in re.search(r"points='([^']+)'", drawing)[1].split()]
    assert heights == sorted(heights)  # y grows downwards
    assert len(heights) == 10
    assert drawing.count("stroke-dasharray") == 1, "a mark beyond the end is not drawn"
    assert ">0.01</text>" in drawing


def test_a_cloud_has_its_swarms_colours_and_leaves_out_the_dark(docs):
    drawn = docs("drawn")
    truth = np.array([[0, 0, 0], [4, 0, 1], [0, 4, 2]], dtype=float)
    lit = np.array([True, True, False])
    drawing = drawn.cloud(truth, truth + 0.5, np.array([1, 2, 0], np.int32), lit, "said")
    assert drawing.count("<circle") == 3 + 2
    assert len(set(re.findall(r"fill='(#\w+)'", drawing))) == 2


def test_there_are_five_runs_and_each_is_another(docs):
    runs = docs("five_runs").RUNS
    assert len({run.command for run in runs}) == len({run.title for run in runs}) == 5
    for run in runs:
        program, *options = shlex.split(run.command)
        assert (program, "--engine") == ("swarmer-run", options[0])


def test_a_run_of_a_page_is_made_by_its_command(docs):
    runs = docs("small_runs")
    run = runs.made("swarmer-run --engine virtual --shape sphere --points 12 --duration 2 --trace")
    assert run.timeline.truth.shape == (12, 3)
    assert run.log.moves
    assert docs("five_runs").picture(run).count("<svg") == 3
    with pytest.raises(RuntimeError, match="no 'nonsense'"):
        runs.made("swarmer-run --shape nonsense")
    with pytest.raises(ValueError, match="no run"):
        runs.made("rm -r x")


def test_the_move_that_is_shown_is_of_a_swarm_and_not_of_all(docs):
    explained = docs("explained")

    def move(fliers, vector):
        flights = [Flight(fid, 0.0, 0.1, 1.0) for fid in range(1, fliers + 1)]
        return Move(0.0, f"{fliers}.0#1", "FOLLOW", 1, 2, "1", False, set(), (vector, 0.0, 0.0), flights)

    one, few, many, everybody = move(1, 9), move(5, 1), move(5, 2), move(20, 9)
    assert explained.chosen([one, few, many, everybody], 20) is many
