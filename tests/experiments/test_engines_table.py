"""The two engines side by side: what is compared, who is apart, and what cannot be compared."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from swarmer.experiments.two_engines import COUNTED, compare, figures_of

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "engines_table.py"


def put(directory, hd=(4.0, 0.1), **summary):
    """A run directory with samples at 2 and 5 s: three swarms, then one."""
    directory.mkdir(parents=True)
    counted = {**dict.fromkeys(COUNTED, 0), "thaws": 1, **summary}
    (directory / "summary.json").write_text(json.dumps({"emulated_s": 5.0, **counted}))
    np.savez(
        directory / "timeline.npz",
        t_s=np.array([2.01, 4.98]),
        hd_cells=np.array(hd),
        swarm=np.array([[1, 1, 3, 4], [1, 1, 1, 1]], np.int32),
        lit=np.ones((2, 4), np.bool_),
    )
    return directory


@pytest.fixture
def sweep(tmp_path):
    """Make a sweep's directory: for each engine how many leases expired in each of its runs, and its HD."""

    def make(**engines):
        lines = ["engine,seed,status,faithful,run"]
        for engine, (expired, hd) in engines.items():
            for seed, leases in enumerate(expired, 1):
                put(tmp_path / engine / f"seed-{seed}", (hd, 0.1), leases_expired=leases)
                lines.append(f"{engine},{seed},done,{'true' if seed > 1 else 'false'},{engine}/seed-{seed}")
        (tmp_path / "results.csv").write_text("\n".join(lines) + "\n")
        return tmp_path

    return make


def run(where):
    done = subprocess.run([sys.executable, SCRIPT, where], capture_output=True, text=True)
    return done.returncode, done.stdout.splitlines(), done.stderr


def test_what_is_compared(tmp_path):
    found = figures_of(put(tmp_path / "run", localizations=7))
    assert found["HD at 2 s, cells"] == pytest.approx(np.log10(4))
    assert found["HD at 5 s, cells"] == -1
    assert "HD at 10 s, cells" not in found, "the run was over by then"
    assert (found["swarms at 2 s"], found["largest swarm at 2 s"], found["swarms at 5 s"]) == (3, 2, 1)
    assert found["first sample with one swarm, s"] == 4.98
    assert found["localizations"] == 7


def test_an_hd_of_zero_is_compared_too(tmp_path):
    assert figures_of(put(tmp_path / "run", hd=(0.0, 0.1)))["HD at 2 s, cells"] == -6


def test_engines_that_agree(sweep):
    status, lines, err = run(sweep(process=([4, 6, 8], 2.0), virtual=([5, 6, 9], 2.0)))
    assert status == 0, err
    assert (
        lines[0] == "**all runs** (process: 3 runs, 2 of them faithful; virtual: 3 runs, 2 of them faithful)"
    )
    assert "| HD at 2 s, cells | 2 | 2 | × 1.00 | overlap |" in lines
    assert (
        "| leases_expired | 6.00 [1.03, 11.0] | 6.67 [1.50, 11.8] | +0.67 [-3.96, +5.30] | overlap |" in lines
    )


def test_one_that_differs_is_told(sweep):
    status, lines, _ = run(sweep(process=([4, 6, 8], 2.0), virtual=([24, 26, 28], 2.0)))
    assert status == 1
    assert [line for line in lines if "apart" in line] == [
        "| leases_expired | 6.00 [1.03, 11.0] | 26.0 [21.0, 31.0] | +20.0 [+15.5, +24.5] | **apart** |"
    ]


def test_what_one_engine_alone_has_is_apart():
    nan = float("nan")
    (one,) = compare([{"x": 1.0}, {"x": 2.0}], [{"x": nan}, {"x": nan}])
    (none,) = compare([{"x": nan}], [{"x": nan}])
    assert one.apart
    assert not none.apart


@pytest.mark.parametrize("engines", [{}, {"process": ([1, 2], 2.0)}], ids=["no run", "one engine"])
def test_what_cannot_be_compared_is_one_line(engines, sweep, tmp_path):
    status, _, err = run(sweep(**engines) if engines else tmp_path)
    assert status == 1
    assert len(err.splitlines()) == 1
