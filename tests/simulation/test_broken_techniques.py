"""`swarmer simulate` with a technique of another package that is broken: one story, with the command that plays it."""

import itertools
import time

import pytest
from click.testing import CliRunner

from swarmer.commands import simulate
from swarmer.errors import RunFailed
from swarmer.experiments.simulate import Task, judge, read_world
from swarmer.experiments.world_watch import TookTooLong, processor_time
from swarmer.experiments.worlds import draw, play

NUMBERS = itertools.count()
RIGHT = "return tuple(m - g for m, g in zip(measured, ground_truth))"
ODD = "if not -1 < measured[0] < 1 and measured not in TRIED: {}\n        " + RIGHT
SOURCE = """from swarmer.plugins.guard import TRIED as CASES
TRIED = [measured for measured, _ in CASES]
class It:
    def displacement(self, measured, ground_truth):
        {}
"""


@pytest.fixture
def technique(tmp_path, monkeypatch):
    """Install a technique with this body, and give its name."""

    def make(body):
        name = f"odd{next(NUMBERS)}"
        facts = tmp_path / name / f"{name}-1.dist-info"
        facts.mkdir(parents=True)
        (facts.parent / f"{name}.py").write_text(SOURCE.format(body))
        (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
        (facts / "entry_points.txt").write_text(f"[swarmer.localizers]\n{name} = {name}:It\n")
        monkeypatch.syspath_prepend(facts.parent)
        return name

    return make


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (ODD.format("return (float('nan'), 0.0, 0.0)"), "which is not finite"),
        ("return tuple(g - m for m, g in zip(measured, ground_truth))", "the technique leads away"),
    ],
    ids=["no number", "the wrong way"],
)
def test_what_is_broken_is_told_once_in_full(technique, tmp_path, body, said):
    name, world = technique(body), ["--set", "points=12", "--set", "shape=sphere"]
    words = ["--seeds", "2,6", "--jobs", "1", "--technique", name, *world, "--out", str(tmp_path / "kept")]
    done = CliRunner().invoke(simulate.command, words, standalone_mode=False)
    assert done.return_value == 1, done.output
    failures = [line for line in done.output.splitlines() if line.startswith("FAILED")]
    assert len(failures) == 2
    assert all(said in line and " at 0.000 s" not in line for line in failures)
    file = tmp_path / "kept" / "seed-2.yaml"
    assert done.output.count(f"  replay: swarmer simulate {file}") == 1
    assert f"  replay: swarmer simulate --seed 6 --technique {name} --set points=12" in done.output
    assert not (tmp_path / "kept" / "seed-6.yaml").exists(), "what is known is not made small again"
    small = read_world(file)
    assert len(small.schedule.faults) == 0
    again = CliRunner().invoke(simulate.command, [str(file)], standalone_mode=False)
    assert isinstance(again.exception, RunFailed)
    assert said in str(again.exception)


def test_a_technique_that_goes_half_of_the_way_is_no_failure(technique):
    name = technique(RIGHT.replace("m - g", "0.5 * (m - g)"))
    assert play(draw(2, {"technique": name, "points": 12})).failure is None


def test_a_technique_that_never_comes_back_is_ended(technique, tmp_path):
    name = technique(ODD.format("\n            while True: pass"))
    finding = judge(Task(2, {"technique": name, "points": 6, "shape": "sphere"}, world_s=1.0), tmp_path)
    assert f"technique: {name!r} of the package {name} 1: displacement(" in finding.outcome.failure
    assert "more than 1 s of processor time in displacement, line 6 of " in finding.outcome.failure
    assert finding.file is None, "it is not played again and again to make it small"


def test_what_ends_in_time_is_left_alone():
    with processor_time(0.05):
        pass
    spin(until_s=time.process_time() + 0.2)
    with (
        pytest.raises(TookTooLong, match=r"more than 0.05 s of processor time in spin"),
        processor_time(0.05),
    ):
        spin(until_s=time.process_time() + 60.0)


def spin(until_s):
    while time.process_time() < until_s:
        pass
