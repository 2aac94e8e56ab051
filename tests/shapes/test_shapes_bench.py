"""The table about clouds: each of its rows can be measured."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.mark.parametrize(
    ("name", "counts", "result"),
    [
        ("plan", (760,), "parts "),
        ("bridges", (100,), "parts "),
        ("sample", (100,), "points 100"),
        ("pair", (200, 100), "optimal"),
    ],
)
def test_a_row_is_time_memory_and_what_came_of_it(name, counts, result):
    done = subprocess.run(
        [sys.executable, "-c", f"from bench.shapes import measured; measured({name!r}, {counts!r})"],
        env={**os.environ, "PYTHONPATH": str(SCRIPTS)}, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["seconds"] > 0
    assert found["peak_mb"] > 10
    assert result in found["result"]
