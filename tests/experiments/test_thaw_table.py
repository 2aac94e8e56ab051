"""The table of the thaw policies: who is in which table, and who is compared with whom."""

import subprocess
import sys
from importlib import util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "thaw_table.py"
HEAD = "shape,thaw.policy,lambda_ms,radio.loss,seed,status,time_to_hd_s.1,time_to_hd_s.0.01,thaws,wrong_thaws,run\n"


@pytest.fixture
def results(tmp_path):
    lines = []
    for policy, slower in (("timer", 3), ("centralized", 1)):
        for seed in range(1, 7):
            late = "" if (policy, seed) == ("timer", 6) else slower * (10 + seed)
            wrong = "" if policy == "timer" else 0
            lines.append(f"dragon,{policy},200,0.1,{seed},done,{seed},{late},{seed},{wrong},r")
    lines.append("hat,timer,200,0,1,done,4,,2,,r")
    lines.append("hat,timer,200,0,2,failed,,,,,r")
    path = tmp_path / "results.csv"
    path.write_text(HEAD + "\n".join(lines) + "\n")
    return path


def test_a_table_for_each_shape_and_loss(results):
    done = subprocess.run([sys.executable, SCRIPT, results.parent], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "**shape dragon, radio.loss 0.1**",
        "",
        "| lambda_ms | thaw.policy | runs | HD < 1, s | < 0.01, s | thaws | wrong thaws | × centralized |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        "| 200 | `timer` | 6 | 3.5 [1.0, 6.0] | 40.5 [33.0, never] (5/6) | 3.5 [1.5, 5.5] | – | 3.00 [3.00, never] |",
        "| 200 | `centralized` | 6 | 3.5 [1.0, 6.0] | 13.5 [11.0, 16.0] | 3.5 [1.5, 5.5] | 0.0 | 1.00 |",
        "",
        "**shape hat, radio.loss 0**",
        "",
        "| lambda_ms | thaw.policy | runs | HD < 1, s | < 0.01, s | thaws | × centralized |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        "| 200 | `timer` | 1 | 4.0 | never | 2.0 | – |",
    ]


def test_runs_are_compared_with_those_of_their_own_seed():
    spec = util.spec_from_file_location("thaw_table", SCRIPT)
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def row(seed, time):
        return {"seed": seed, module.COMPARED: time}

    reference = [row("1", "10"), row("2", "40"), row("3", "")]
    assert module.against([row("2", "80"), row("1", "20"), row("3", "9"), row("4", "9")], reference) == "2.00"
    assert module.against([row("3", "9")], reference) == "–"


def test_no_sweep_is_one_line(tmp_path):
    done = subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True, text=True)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "results.csv" in done.stderr
