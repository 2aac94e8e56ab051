"""The packages under examples/ work as a user's own: found by entry point, named by a setting, run by an FLS."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from swarmer.config import load_config
from swarmer.errors import BadInput
from swarmer.plan import make_localizer, make_plan
from swarmer.plugins import ENTRY_POINTS

DAMPED = Path(__file__).resolve().parent.parent / "examples" / "damped"
SETTINGS = ["shape=sphere", "points=12", "technique=damped"]


@pytest.fixture
def installed(tmp_path):
    """What an installation of the example puts on the path: its code, and the facts of its pyproject.toml."""
    project = tomllib.loads((DAMPED / "pyproject.toml").read_text("utf-8"))["project"]
    facts = tmp_path / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = [f"[{ENTRY_POINTS}]"] + [f"{k} = {v}" for k, v in project["entry-points"][ENTRY_POINTS].items()]
    (facts / "entry_points.txt").write_text("\n".join(lines) + "\n")
    (tmp_path / "swarmer_damped.py").write_text((DAMPED / "swarmer_damped.py").read_text("utf-8"))
    return tmp_path


def test_an_outside_technique_is_found_by_its_name(installed, monkeypatch):
    with pytest.raises(BadInput, match="damped"):
        make_plan(load_config(None, SETTINGS))
    monkeypatch.syspath_prepend(installed)
    plan = make_plan(load_config(None, SETTINGS))
    assert plan.rules.technique == "swarmer_damped:Damped"
    vector = make_localizer(plan.rules.technique).displacement((2.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert vector == pytest.approx((0.7, 0.0, 0.0))
    sys.modules.pop("swarmer_damped", None)


@pytest.mark.processes
def test_an_outside_technique_flies(installed):
    code = "from swarmer import cli; cli.main_run()"
    options = [option for setting in SETTINGS for option in ("--set", setting)]
    done = subprocess.run(
        [sys.executable, "-c", code, *options, "--duration", "3", "--json", "--no-recording", "--out", "run"],
        cwd=installed, capture_output=True, text=True, timeout=60,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), *filter(None, sys.path)])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["localizations"] > 0
