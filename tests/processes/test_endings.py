"""Runs that are ended in every way, at moments of fixed seeds; `scripts/endings.py --count 300` makes fresh ones."""

import subprocess
import sys
from pathlib import Path

import pytest
from endings import WAYS, draw, play

SEEDS = (*range(len(WAYS) + 4), len(WAYS) + WAYS.index("viewer_killed"))


@pytest.mark.parametrize("seed", SEEDS, ids=lambda seed: f"{seed}-{draw(seed).way}")
def test_however_a_run_ends_nothing_is_left_of_it(tmp_path, seed):
    wrong = play(draw(seed), tmp_path)
    assert wrong is None, f"python scripts/endings.py --seed {seed} --count 1: {draw(seed).words()}: {wrong}"


def test_the_seeds_have_every_way():
    assert {draw(seed).way for seed in SEEDS} == set(WAYS)
    assert {draw(seed).viewer for seed in SEEDS} == {"", "web", "desktop"}
    assert draw(3) == draw(3)


def test_the_script_makes_as_many_as_told(tmp_path):
    script = Path(__file__).parents[2] / "scripts" / "endings.py"
    done = subprocess.run(
        [sys.executable, script, "--count", "2", "--seed", "0"], capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert done.stdout.splitlines()[-1] == "2 runs ended, 0 of them badly"
