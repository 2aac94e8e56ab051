"""The table of the cycles: those that ended, and runs in which one never does."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "liveness_table.py"


@pytest.fixture
def sweep(tmp_path):
    """Make a sweep's directory of runs, each given by the moments of its thaws; all end at 12 s."""

    def make(**cells):
        lines = ["shape,seed,status,emulated_s,run"]
        for shape, runs in cells.items():
            for seed, thaws in enumerate(runs, 1):
                run = tmp_path / shape / f"seed-{seed}"
                run.mkdir(parents=True)
                events = [f"{at},single_swarm,0,one\n{at},thaw,0,one swarm\n" for at in thaws]
                (run / "events.csv").write_text("t_s,kind,fid,text\n" + "".join(events))
                lines.append(f"{shape},{seed},done,12,{shape}/seed-{seed}")
        (tmp_path / "results.csv").write_text("\n".join(lines) + "\n")
        return tmp_path

    return make


def run(where):
    done = subprocess.run([sys.executable, SCRIPT, where], capture_output=True, text=True)
    return done.returncode, done.stdout.splitlines()[2:], done.stderr


def test_cycles_that_ended_are_counted(sweep):
    status, rows, _ = run(sweep(dragon=[[3, 5, 8, 11], [4, 6.5, 10]], cat=[[5.5, 11.5]]))
    assert status == 0
    assert rows == ["| dragon | 2 | 7 | 7 | 3 | 4.0 | 2.0 | 0 |", "| cat | 1 | 2 | 2 | 2 | 6.0 | 0.5 | 0 |"]


@pytest.mark.parametrize("thaws", [[], [1, 2]], ids=["none ended", "none after the second"])
def test_a_run_that_is_stuck_is_told(thaws, sweep):
    status, rows, _ = run(sweep(dragon=[[2, 4, 6, 8, 10], thaws]))
    assert status == 1
    assert rows == [
        f"| dragon | 2 | {6 + len(thaws)} | {5 + len(thaws)} | {len(thaws)} | 2.0 | {12 - 2 * bool(thaws)}.0 | 1 |"
    ]


def test_no_sweep_is_one_line(tmp_path):
    status, _, err = run(tmp_path)
    assert status == 1
    assert len(err.splitlines()) == 1
