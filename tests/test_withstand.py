"""`scripts/withstand.py`: some of each count; what fails is told with the command that plays it alone."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parent.parent / "scripts"
sys.path.insert(0, str(SCRIPTS / ".." / "tests" / "simulation"))
from mutants import MUTANTS  # noqa: E402


def withstand(*arguments):
    return subprocess.run(
        [sys.executable, SCRIPTS / "withstand.py", *arguments], capture_output=True, text=True, timeout=200
    )


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPTS))
    spec = importlib.util.spec_from_file_location("withstand", SCRIPTS / "withstand.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "withstand", module)
    spec.loader.exec_module(module)
    return module


def test_some_of_each_count_hold():
    done = withstand("--worlds", "2", "--fresh", "1", "--schedules", "2", "--inputs", "0.001")
    assert done.returncode == 0, done.stdout + done.stderr
    told = [line.split(":")[0] for line in done.stdout.splitlines()]
    assert told[0] == "worlds"
    assert told[1].startswith("fresh worlds from ")
    assert told[2:] == ["schedules", *["decoder", "mac", "machine"] * 2]
    assert "2 played, 0 failed" in done.stdout


def test_what_fails_is_told_with_its_command(script, monkeypatch, capsys):
    next(one for one in MUTANTS if one.name == "V reversed").apply(monkeypatch)
    assert script.main(["--worlds", "1", "--fresh", "0", "--schedules", "2", "--inputs", "0"]) == 1
    told = capsys.readouterr().out
    assert "play it: swarmer simulate --seed 1\n" in told
    assert "play it: python scripts/withstand.py --schedule 1\n" in told
    assert script.main(["--schedule", "1"]) == 1


@pytest.mark.parametrize(("more", "status"), [([], 0), (["--strict"], 1)])
def test_what_a_fresh_seed_finds_is_told_loudly(more, status, script, monkeypatch, capsys):
    next(one for one in MUTANTS if one.name == "V reversed").apply(monkeypatch)
    nothing = ["--worlds", "0", "--schedules", "0", "--inputs", "0"]
    assert script.main([*nothing, "--fresh", "3", *more]) == status
    told = capsys.readouterr().out
    assert "FRESH SEEDS HAVE FOUND" in told
    assert "play it: swarmer simulate --seed " in told


def test_a_failing_input_is_told_with_its_command(script, monkeypatch, capsys):
    def fails(rng, count):
        raise AssertionError("so it is")

    monkeypatch.setitem(script.PARTS, "mac", (fails, 100))
    assert script.main(["--worlds", "0", "--fresh", "0", "--schedules", "0", "--inputs", "0.01"]) == 1
    assert (
        "play it: python scripts/fuzz.py --seed 1 --decoder 0 --mac 1 --machine 0" in capsys.readouterr().out
    )


def test_a_schedule_is_the_same_again():
    first, again = withstand("--schedule", "5"), withstand("--schedule", "5")
    assert first.returncode == 0, first.stdout
    assert first.stdout == again.stdout
    assert "held: 30 lit, 1 swarms" in first.stdout
