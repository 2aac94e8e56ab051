"""`swarmer-run --engine rounds`: the run directory, the summary, and what is refused in one line."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from swarmer.config import load_config, setting_facts
from swarmer.engines.named import make_engine
from swarmer.errors import BadInput
from swarmer.experiments.one_run import perform
from swarmer.observe.report import write_report
from swarmer.plan import make_plan

SWARMER = Path(__file__).resolve().parent.parent / "swarmer"


def swarmer_run(*arguments, **more):
    code = "import sys; from swarmer import cli; sys.argv[0] = 'swarmer-run'; cli.main_run()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=60, **more
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small run with everything, and what was said of it."""
    out = tmp_path_factory.mktemp("rounds") / "run"
    arguments = [
        "--shape",
        "sphere",
        "--points",
        "60",
        "--rounds",
        "40",
        "--set",
        "lambda_ms=3",
        "--out",
        str(out),
    ]
    done = swarmer_run("--engine", "rounds", *arguments, cwd=out.parent)
    assert done.returncode == 0, done.stderr
    return out, done


def test_a_run_leaves_what_any_other_does_and_a_line_for_each_round(run):
    out, done = run
    assert done.stdout.splitlines()[-1] == str(out)
    names = {path.name for path in out.iterdir()}
    assert names == {
        "config.yaml", "manifest.json", "summary.json", "events.csv", "log.txt", "recording.rrd", "timeline.npz",
        "rounds.csv",
    }  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    rows = list(csv.DictReader((out / "rounds.csv").open()))
    assert [int(row["round"]) for row in rows] == list(range(summary["rounds"] + 1))
    assert float(rows[-1]["hd_cells"]) == pytest.approx(summary["hd_cells"])
    with np.load(out / "timeline.npz") as timeline:
        assert timeline["t_s"].tolist() == list(range(summary["rounds"] + 1))
        assert timeline["position"].shape == (summary["rounds"] + 1, 60, 3)
        assert timeline["hd_cells"] == pytest.approx([float(row["hd_cells"]) for row in rows])
        assert [len(np.unique(swarm)) for swarm in timeline["swarm"]] == [int(row["swarms"]) for row in rows]


def test_the_summary_counts_rounds_and_has_no_clock(run):
    summary = json.loads((run[0] / "summary.json").read_text())
    assert summary["engine"] == "rounds"
    assert summary["converged"] is True
    assert list(summary["rounds_to_hd"]) == ["1", "0.1", "0.09", "0.01", "0.001"]
    reached = [value for value in summary["rounds_to_hd"].values() if value is not None]
    assert reached == sorted(reached)
    assert reached[-1] <= summary["rounds"] <= 40
    assert summary["first_single_swarm_round"] == summary["formation_rounds"][0]
    assert summary["single_swarm_count"] == len(summary["formation_rounds"])
    assert summary["thaws_at_one_swarm"] == summary["thaws"] == len(summary["formation_rounds"]) - 1
    for name in (
        "emulated_s",
        "time_to_hd_s",
        "first_single_swarm_s",
        "datagrams_sent",
        "faithful",
        "leases_expired",
    ):
        assert summary[name] is None
    assert summary["localizations"] > summary["anchorings"] > 0


def test_what_is_said_of_it(run):
    said = run[1].stderr
    assert "60 points in 3D, neighbours the 5 nearest (η) where the FLSs are, anew in each round" in said
    assert "note: lambda_ms: no effect with the engine rounds, which plays no protocol" in said
    assert "one swarm at round " in said
    assert " rounds in " in said


@pytest.mark.parametrize(
    ("arguments", "missed"),
    [
        (["--rounds", "2"], "the HD asked for was not reached"),
        (["--set", "rounds.max_thaws=0"], "the HD asked for was not reached at a single swarm"),
        (["--until-hd", "0.5"], None),
        (["--until-hd", "0.0001", "--rounds", "2"], "the HD asked for was not reached"),
        (["--set", "rounds.stop=none", "--rounds", "9"], None),
        (["--set", "rounds.stop=none", "--set", "rounds.max_thaws=1"], None),
    ],
)
def test_not_converged_is_said_where_an_hd_was_asked_for_and_missed(tmp_path, arguments, missed):
    arguments = ["--engine", "rounds", "--shape", "butterfly", "--no-recording", *arguments]
    done = swarmer_run(*arguments, "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = [line.strip() for line in done.stderr.splitlines() if "not converged" in line]
    assert said == ([] if missed is None else [f"not converged: {missed}"])


@pytest.mark.parametrize("killed", [False, True])
def test_nothing_is_said_of_the_swarms_of_a_yardstick(tmp_path, killed):
    arguments = [
        "--engine",
        "rounds",
        "--shape",
        "butterfly",
        "--set",
        "technique=triangulation",
        "--rounds",
        "9",
    ]
    done = swarmer_run(*arguments, "--no-recording", "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "swarm" not in "".join(line for line in done.stderr.splitlines() if " HD " in line)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert {summary[name] for name in ("swarms_last", "single_swarm_count", "thaws_at_one_swarm")} == {None}
    if killed:
        (tmp_path / "run" / "summary.json").unlink()
    page = write_report([tmp_path / "run"]).read_text("utf-8")
    said = (
        "by then the 94 FLSs had not formed the shape"
        if killed
        else "<p class=verdict>The 94 FLSs did not form"
    )
    assert said in page
    assert "this report cannot say why: runs in rounds keep none" in page
    for words in (
        "one swarm<",
        "one swarm and",
        "--engine virtual",
        "swarms in a group",
        "One colour a swarm;",
        "<span>thaws<",
    ):
        assert words not in page, words
    for figure in ("swarms", "cycles", "sizes"):
        assert f'<figure id="{figure}"' not in page


def test_its_settings_run_again_to_the_same(run, tmp_path):
    again = perform(load_config(run[0] / "config.yaml"), tmp_path / "again")
    assert again.status == "done"
    with np.load(run[0] / "timeline.npz") as one, np.load(tmp_path / "again" / "timeline.npz") as other:
        for name in one.files:
            np.testing.assert_array_equal(one[name], other[name])  # NaN is NaN here
    assert (run[0] / "rounds.csv").read_bytes() == (tmp_path / "again" / "rounds.csv").read_bytes()


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"points": 1}, "points: 1 is out of range"),
        ({"eta": 60}, "eta: 60 is not allowed; 1 to 59 for 60 FLSs"),
        ({"eta": 0}, "eta: 0 is out of range"),
        ({"m": 3}, "m: 3 is not a choice; inf or 2"),
        ({"epsilon_deg": 45.5}, "epsilon_deg: 45.5 is out of range; degrees, 0 to 45"),
        ({"epsilon_deg": -1}, "epsilon_deg: -1 is out of range"),
        ({"rounds.stop_hd_cells": 0}, "rounds.stop_hd_cells: 0 is out of range"),
        ({"rounds.max_rounds": 0}, "rounds.max_rounds: 0 is out of range"),
        ({"rounds.anchor": "best"}, "rounds.anchor: 'best' is not a choice"),
        ({"rounds.dim": 2}, "rounds.dim: 2 is not allowed; sphere is"),
        ({"technique": "telepathy"}, "technique: 'telepathy' is not allowed"),
        ({"time_scale": 1}, "time_scale: 1 is not for the engine rounds"),
    ],
)
def test_bad_input_is_one_line(settings, line):
    with pytest.raises(BadInput) as refused:
        make_plan(load_config(engine="rounds", **{"shape": "sphere", "points": 60, **settings}))
    assert str(refused.value).startswith(line)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 3\n1 2 nan\n", "nan"),
        ("1 2 3\n1 2 3\n4 5 6\n", "duplicates"),
        ("1 2 3\n", "1 point"),
        ("1 2\n3 4 5\n", "3"),
        ("a b c\n", "a"),
    ],
)
def test_a_bad_cloud_is_refused(text, said, tmp_path):
    (tmp_path / "cloud.xyz").write_text(text)
    with pytest.raises(BadInput) as refused:
        make_plan(load_config(engine="rounds", shape=str(tmp_path / "cloud.xyz")))
    assert said in str(refused.value)


def test_on_the_command_line_bad_input_ends_with_status_2():
    for arguments in (["--rounds", "none"], ["--set", "rounds.dim=2"], ["--trace"], ["--check"]):
        done = swarmer_run("--engine", "rounds", *arguments)
        assert done.returncode == 2, arguments
        [line] = done.stderr.splitlines()
        assert line.startswith("error: ")


def test_more_neighbours_than_half_of_the_flss_are_told(capsys):
    from swarmer.commands.run import tell_plan

    tell_plan(make_plan(load_config(engine="rounds", shape="sphere", points=10, eta=6)))
    assert "note: eta: 6 is more than half of the 10 FLSs" in capsys.readouterr().err
    tell_plan(make_plan(load_config(engine="rounds", shape="sphere", points=5)))
    assert "note" not in capsys.readouterr().err


@pytest.mark.parametrize("preset", ["paper", "authors_code"])
def test_a_preset_is_no_change_that_would_have_to_be_told(preset):
    config = load_config(preset, engine="rounds")
    base = load_config(preset)
    assert config.ignored(config.unlike(base)) == []
    config = config.changed(lambda_ms=7)
    [line] = config.ignored(config.unlike(base))
    assert line.startswith("lambda_ms: no effect")
    config = load_config(preset, **{"rounds.max_rounds": 3})
    [line] = config.ignored(config.unlike(base))
    assert line == "rounds.max_rounds: 3 has no effect with the engine process; only rounds has it"


def test_the_two_presets_differ_as_the_text_and_the_program_do():
    paper, program = (load_config(preset).rounds for preset in ("paper", "authors_code"))
    assert (paper.anchor, program.anchor) == ("lowest", "largest")
    assert (paper.dead_reckoning, program.dead_reckoning) == ("flight", "one_sided")
    assert load_config("paper").flight.dead_reckoning == "full"
    assert (program.order, program.pairing, program.max_thaws) == ("fid", "exact", 5)
    assert paper.hd_translation == program.hd_translation == "sampled"


def test_every_setting_that_is_said_to_be_heeded_is_one():
    from swarmer.config import HEEDED_IN_ROUNDS

    assert {fact.name for fact in setting_facts()} >= set(HEEDED_IN_ROUNDS)


def test_the_engine_is_made_by_its_name():
    plan = make_plan(load_config(engine="rounds", shape="cat"))
    assert make_engine(plan).name == "rounds"
