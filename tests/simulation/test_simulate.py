"""`swarmer simulate`: what breaks is found, made small, kept and played again; what holds says so."""

import pytest
from click.testing import CliRunner
from mutants import MUTANTS

from swarmer.commands import simulate
from swarmer.errors import BadInput, RunFailed
from swarmer.experiments.pool import Pool
from swarmer.experiments.simulate import Task, judge, read_world, shrink_world, write_world
from swarmer.experiments.worlds import draw, play


def run(*words):
    return CliRunner().invoke(simulate.command, [*words], catch_exceptions=True, standalone_mode=False)


def break_rule(name, patch):
    next(one for one in MUTANTS if one.name == name).apply(patch)


@pytest.mark.parametrize("rule", ["V reversed", "lease never expires"])
def test_a_broken_rule_is_found_shrunk_and_replayed(rule, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        break_rule(rule, patch)
        done = run("--seeds", "1,2,3,4", "--jobs", "1", "--out", str(tmp_path / "not" / "there"))
        assert done.return_value == 1, done.output
        file = next(iter(sorted(tmp_path.rglob("seed-*.yaml"))))
        assert f"replay: swarmer simulate {file}" in done.output
        number = int(file.stem.removeprefix("seed-"))
        small, whole = read_world(file), draw(number)
        assert small.settings["points"] <= min(8, whole.settings["points"])
        assert len(small.schedule.faults) <= 5
        again = run(str(file))
        assert isinstance(again.exception, RunFailed)
        assert f"seed {number} at" in str(again.exception)
        assert play(small).invariant == play(whole).invariant
        assert isinstance(run("--seed", str(number)).exception, RunFailed)
    assert run(str(file)).return_value == 0, "with the rule as it should be it holds"


def test_what_is_given_stays_when_a_world_is_shrunk(monkeypatch):
    break_rule("V reversed", monkeypatch)
    world = draw(1, {"points": 12, "radio.loss": 0.1})
    small = shrink_world(world, play(world), frozenset({"points", "radio.loss"}), 5.0)
    assert (small.settings["points"], small.settings["radio.loss"]) == (12, 0.1)
    assert len(small.settings) < len(world.settings)


def test_a_world_survives_its_file(tmp_path):
    for seed in range(1, 20):
        world = draw(seed)
        write_world(tmp_path / "w.yaml", world, play(world))
        again = read_world(tmp_path / "w.yaml")
        assert again == world
    assert play(again).digest == play(world).digest


def test_until_stops_there():
    whole, part = run("--seed", "7"), run("--seed", "7", "--until", "0.5")
    assert (whole.return_value, part.return_value) == (0, 0)
    events = [int(done.output.split(" events")[0].split()[-1]) for done in (whole, part)]
    assert 0 < events[1] < events[0]


def test_workers_find_what_one_process_finds(tmp_path):
    tasks = [Task(seed, {"technique": "physical_movement"}) for seed in (1, 2, 3)]
    with Pool(2, tmp_path, judge) as pool:
        found = {task.seed: finding for task, finding in pool.outcomes(tasks, lambda _: None, lambda: None)}
    assert {seed: finding.outcome.digest for seed, finding in found.items()} == {
        task.seed: judge(task, tmp_path).outcome.digest for task in tasks
    }


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--seed", "1", "--minutes", "1"), "--minutes: not beside --seed"),
        (("--until", "3"), "--until: is for one world"),
        (("--technique", "mine"), "technique"),
        (("--set", "lambda_ms=-1"), "lambda_ms: -1 is out of range"),
        (("--set", "engine=process"), "engine: is the world's own"),
        (("--seeds", "0"), "--seeds: 0 is neither a count"),
        (("--set", "shape=nowhere.xyz", "--seeds", "2", "--jobs", "1"), "no world is possible"),
        (("nowhere.yaml",), "nowhere.yaml: No such file"),
    ],
)
def test_bad_input_is_one_line(words, line):
    done = run(*words)
    assert isinstance(done.exception, BadInput), done.output
    assert line in str(done.exception)


@pytest.mark.parametrize("option", ["--minutes", "--seconds", "--until"])
def test_nan_is_no_time(option):
    assert "nan is no number" in str(run("--seed", "1", option, "nan").exception)


@pytest.mark.parametrize(
    "text",
    ["seed: 1\n", "seed: x\nsettings: {points: 3}\n", "seed: 1\nsettings: {points: 1}\n", "more: 1\n",
     "seed: 1\nsettings: {points: 3, x: 1}\n", "seed: 1\nsettings: {points: 3}\nfaults: [{at: 1}]\n"],
)  # fmt: skip
def test_a_file_that_is_no_world(tmp_path, text):
    path = tmp_path / "w.yaml"
    path.write_text(text)
    assert isinstance(run(str(path)).exception, BadInput)
