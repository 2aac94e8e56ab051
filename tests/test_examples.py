"""The packages under examples/ work as a user's own: installed by pip, found by entry point, named by a setting."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from swarmer.config import load_config
from swarmer.entry_points import SENSOR_ERRORS, TECHNIQUES, THAW_POLICIES, installed
from swarmer.errors import BadInput
from swarmer.experiments.one_run import perform
from swarmer.plan import make_localizer, make_plan

pytestmark = pytest.mark.timeout(300)  # pip and whole commands, on a busy machine
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
PACKAGES = sorted(path.parent for path in EXAMPLES.glob("*/pyproject.toml"))
ALL = ["technique=damped", "sensing.model=echoes", "sensing.error_percent=20", "thaw.policy=half"]
SPHERE = ["shape=sphere", "points=12"]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder into which pip has installed them, without asking any index."""
    target = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [
            sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps",
            "--no-build-isolation", "--target", str(target), *map(str, PACKAGES),
        ],
        capture_output=True, text=True, timeout=250,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return target


@pytest.fixture
def path(site, monkeypatch):
    monkeypatch.syspath_prepend(site)
    yield site
    for package in PACKAGES:
        sys.modules.pop(f"swarmer_{package.name}", None)


def test_each_package_says_what_it_adds():
    groups = [*tomllib.loads((PACKAGES[0] / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]]
    for package in PACKAGES[1:]:
        groups += tomllib.loads((package / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]
    assert sorted(groups) == sorted([TECHNIQUES, SENSOR_ERRORS, THAW_POLICIES])


@pytest.mark.parametrize("setting", ALL[:2] + ALL[3:])
def test_without_the_package_its_name_is_refused(setting):
    with pytest.raises(BadInput, match=setting.partition("=")[2]):
        make_plan(load_config(None, [*SPHERE, setting]))


def test_with_it_the_name_is_a_setting(path):
    plan = make_plan(load_config(None, [*SPHERE, *ALL]))
    assert (plan.rules.technique, plan.rules.sensing_model, plan.rules.thaw_policy) == (
        "swarmer_damped:Damped", "swarmer_echoes:echoes", "swarmer_half:Half",
    )  # fmt: skip
    assert installed(TECHNIQUES)["damped"].package == "swarmer-damped 0.1"
    vector = make_localizer(plan.rules.technique).displacement((2.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert vector == pytest.approx((0.7, 0.0, 0.0))


def test_all_three_in_virtual_time(path, tmp_path):
    settings = [*SPHERE, *ALL, "points=40", "engine=virtual", "duration_s=8", "recording.enabled=false"]
    outcome = perform(load_config(None, settings), tmp_path / "run")
    assert outcome.status == "done", outcome.message
    summary = outcome.summary
    assert summary["thaws"] >= 5
    assert summary["thaws_by_clock"] == 0
    assert summary["wrong_thaws"] > summary["thaws"] / 2, "half is not all"
    assert 0.05 < summary["hd_cells"] < 10, "it localizes, as well as such a sensor lets it"


@pytest.mark.processes
def test_all_three_in_processes(site, tmp_path):
    code = "from swarmer import cli; cli.main_run()"
    options = [option for setting in (*SPHERE, *ALL) for option in ("--set", setting)]
    done = subprocess.run(
        [sys.executable, "-c", code, *options, "--duration", "4", "--json", "--no-recording", "--out", "run"],
        cwd=tmp_path, capture_output=True, text=True, timeout=250,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(site), *filter(None, sys.path)])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["localizations"] > 0
    assert summary["thaws"] > 0


def test_my_technique_is_compared_with_others(site, tmp_path):
    """By default in rounds, with a confidence interval, and on the same seeds."""
    code = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer'; cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "compare", "--technique", "damped", "--shape", "sphere",
         "--points", "20", "--rounds", "20", "--seeds", "6", "--jobs", "1", "--out", "o"],
        cwd=tmp_path, capture_output=True, text=True, timeout=250,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(site), *filter(None, sys.path)])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = [line.split()[0] for line in done.stdout.splitlines()[1:6]]
    assert rows == ["signal_strength", "dead_reckoning", "triangulation", "trilateration", "damped"]
    assert "rounds to HD < 0.09" in done.stdout
    assert "effect" in done.stdout
