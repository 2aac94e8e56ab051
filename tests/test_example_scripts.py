"""The scripts under examples/ do what their first lines say."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from swarmer.config import load_config
from swarmer.observe.report import write_report
from swarmer.plan import make_plan

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def output_of(example, *arguments, place):
    """Run a script of an example as its first lines say."""
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / example), *arguments],
        cwd=place,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_an_outside_observer_and_a_witness_see_a_run(tmp_path):
    out = output_of(
        "watch/watch.py", "shape=sphere", "points=20", "duration_s=3", "failure.rate=0.05", place=tmp_path
    ).splitlines()
    assert sum("cells from its point" in line for line in out) == 3
    assert any("replacement incarnation 1" in line for line in out)
    last = re.fullmatch(r"done: (\d+) flights, (\d+) cells in all", out[-1])
    assert int(last[1]) >= 20
    assert not list(tmp_path.iterdir())


def test_an_outside_engine_leaves_a_run_that_can_be_reported(tmp_path):
    out = output_of(
        "perfect/perfect.py", "run", "shape=sphere", "points=20", "duration_s=3", "recording.enabled=no",
        place=tmp_path,
    )  # fmt: skip
    assert out.startswith("HD 0 cells after 3")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    assert (summary["engine"], summary["status"], summary["swarms_last"]) == ("perfect", "done", 1)
    assert summary["time_to_hd_s"]["0.001"] is not None
    assert summary["distance_cells_mean"] > 1
    assert "20 FLSs" in write_report([tmp_path / "run"]).read_text("utf-8")


def test_an_outside_shape_is_one(tmp_path):
    (tmp_path / "ring.xyz").write_text(output_of("ring/ring.py", "60", place=tmp_path))
    plan = make_plan(load_config(None, [f"shape={tmp_path / 'ring.xyz'}"]))
    assert plan.size == 60
    assert plan.neighbours.spacing_min_cells == pytest.approx(2.0, abs=0.02)
