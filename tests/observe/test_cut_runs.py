"""A run directory cut at any byte, killed, or with strange content: what is whole is shown, the rest is named."""

import os
import random
import shutil

import pytest
from click.testing import CliRunner

from swarmer.commands.replay import command as replay
from swarmer.config import load_config
from swarmer.engines.result import Event
from swarmer.errors import SwarmerError
from swarmer.experiments.one_run import perform
from swarmer.observe import saved_run
from swarmer.observe.report import derived_summary, first_single_swarm, make_report
from swarmer.observe.saved_run import load

NAMES = ("config.yaml", "manifest.json", "summary.json", "events.csv", "timeline.npz")


def cut(finished_run, tmp_path, name, share):
    run = tmp_path / "cut"
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(finished_run, run)
    data = (run / name).read_bytes()
    (run / name).write_bytes(data[: int(len(data) * share)])
    return run


@pytest.mark.parametrize("name", NAMES)
def test_file_cut_at_any_byte(finished_run, tmp_path, name):
    rng = random.Random(name)
    for share in [0.0, *(rng.random() for _ in range(12))]:
        run = load(cut(finished_run, tmp_path, name, share))
        whole = run.config and run.manifest and run.summary and run.events and run.timeline is not None
        if name not in ("events.csv", "config.yaml"):  # a shorter CSV or YAML may be a good one
            assert not whole
            assert any(name in line for line in run.missing)
        for other in {"manifest.json", "summary.json", "timeline.npz"} - {name}:
            assert not any(other in line for line in run.missing)


@pytest.mark.parametrize("name", NAMES)
def test_report_and_terminal_of_a_cut_run(finished_run, tmp_path, name, quick):
    run = cut(finished_run, tmp_path, name, 0.4)
    page = make_report([load(run)])
    assert ("Not everything is there" in page) == bool(load(run).missing)
    if name == "timeline.npz":
        with pytest.raises(SwarmerError, match="no timeline"):
            CliRunner().invoke(
                replay, [str(run), "--terminal"], standalone_mode=False, catch_exceptions=False
            )
    else:
        assert "lit" in CliRunner().invoke(replay, [str(run), "--terminal"], catch_exceptions=False).output


def test_bytes_turned_over(finished_run, tmp_path, quick):
    turned_over(finished_run, tmp_path, 5, 40)


def test_what_has_bytes_turned_over_is_drawn(finished_run, tmp_path):
    turned_over(finished_run, tmp_path, 6, 6)


def turned_over(finished_run, tmp_path, seed, times):
    rng = random.Random(seed)
    for _ in range(times):
        name = rng.choice(NAMES)
        run = cut(finished_run, tmp_path, name, 1.0)
        data = bytearray((run / name).read_bytes())
        for _ in range(rng.randint(1, 20)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        (run / name).write_bytes(data)
        make_report([load(run)])


STRANGE = [
    "", "[]", "null", "NaN", "{", "\x00\xff", "[" * 3000, "a: &x [*x]", '{"time_to_hd_s": 3}',
    '{"points": "many", "emulated_s": "long", "shape": null, "hd_cells": []}', '{"points": 1%s}' % ("0" * 400),
    '{"lit_share": "all", "launch_s": [1], "memory_mb_per_fls": {"a": 2}}', r'{"shape": "\ud800", "seed": 1}',
    '{"relay_late_ms": {"p99": []}, "processes": "x"}', "shape: !!python/object/apply:os.system [echo]",
]  # fmt: skip


@pytest.mark.parametrize("text", STRANGE)
@pytest.mark.parametrize("name", ["config.yaml", "manifest.json", "summary.json"])
def test_strange_content(finished_run, tmp_path, name, text, quick):
    run = cut(finished_run, tmp_path, name, 0.0)
    (run / name).write_text(text, encoding="utf-8")
    assert "<html" in make_report([load(run)])


def test_a_run_killed_in_its_first_second_has_left_samples(tmp_path, fake):
    from swarmer.observe.collector import Collector
    from swarmer.observe.run_directory import RunDirectory

    collector = Collector(RunDirectory.create(tmp_path / "run", "ball", 1, ["swarmer-run"]))
    fake.feed(collector, fake.plan(recording={"enabled": False}), 0.9)
    assert len(load(tmp_path / "run").timeline.t_s) >= 5


def test_a_seed_that_nothing_tells_is_not_made_up(finished_run, tmp_path, quick):
    run = shutil.copytree(finished_run, tmp_path / "run")
    for name in ("config.yaml", "manifest.json", "summary.json"):
        (run / name).unlink()
    page = make_report([load(run)])
    assert "unfinished, engine ?, seed ?, " in page
    assert "None" not in page


def test_killed_run_is_reported_from_its_streams(tmp_path, fake):
    from swarmer.observe.collector import Collector
    from swarmer.observe.run_directory import RunDirectory

    collector = Collector(RunDirectory.create(tmp_path / "run", "ball", 1, ["swarmer-run"]))
    fake.feed(collector, fake.plan(recording={"enabled": False}), 25.0)  # and then nothing: it was killed
    run = load(tmp_path / "run")
    assert 200 <= len(run.timeline.t_s) < 250
    assert {line.split(":")[0] for line in run.missing} >= {"summary.json", "timeline.npz", "events.csv"}
    page = make_report([run])
    assert "unfinished" in page
    assert run.summary["time_to_hd_s"]["0.1"] is not None


@pytest.mark.parametrize("policy", ["roster", "centralized", "timer"])
def test_a_run_without_its_summary_was_one_swarm_as_soon_as_with_it(tmp_path, policy):
    """A thaw at one swarm comes before a sample shows it: the counters and the events know of it."""
    settings = {"engine": "virtual", "shape": "dragon", "points": 30, "duration_s": 12, "thaw.policy": policy}
    done = perform(load_config(**settings), tmp_path / "run")
    known = done.summary["first_single_swarm_s"]
    (tmp_path / "run" / "summary.json").unlink()
    run = load(tmp_path / "run")
    found = derived_summary(run)["first_single_swarm_s"]
    assert known - 0.05 <= found <= known + 0.1
    run.timeline.series = {}
    blind = derived_summary(run)["first_single_swarm_s"]
    assert blind == pytest.approx(found) if policy == "centralized" else blind >= found


@pytest.mark.parametrize(
    ("kind", "text", "known"),
    [
        ("thaw", "thaw 1 began", False),
        ("thaw", "overdue", False),
        ("thaw", "one swarm", True),
        ("single_swarm", "", True),
    ],
)
def test_only_thaws_that_say_so_were_at_one_swarm(finished_run, kind, text, known):
    run = load(finished_run)
    run.timeline.series, run.events = {}, [Event(0.3, kind, 0, text), Event(1e6, "single_swarm", 0, "")]
    assert first_single_swarm(run.events, run.timeline) == (0.3 if known else None)


@pytest.mark.parametrize("name", ["config.yaml", "manifest.json", "summary.json"])
def test_what_is_too_large_is_not_read(finished_run, tmp_path, name, quick):
    run = cut(finished_run, tmp_path, name, 1.0)
    with (run / name).open("r+b") as file:
        file.truncate(1 << 30)  # with a hole: it takes no disk
    saved = load(run)
    assert any(line.startswith(f"{name}: cannot be read (larger than") for line in saved.missing)
    assert "Not everything is there" in make_report([saved])


def test_of_endless_events_the_first_are_read(finished_run, tmp_path, monkeypatch):
    run = cut(finished_run, tmp_path, "events.csv", 0.0)
    (run / "events.csv").write_text("t_s,kind,fid,text\n" + "1.0,failed,3,x\n" * 100)
    monkeypatch.setattr(saved_run, "LARGEST_EVENTS", 18 + 10 * 15 + 7)
    saved = load(run)
    assert len(saved.events) == 10
    assert "events.csv: only its first 0 MB are read" in saved.missing


@pytest.mark.parametrize("what", ["pipe", "endless"])
def test_what_is_no_file_is_not_waited_for(finished_run, tmp_path, what):
    run = cut(finished_run, tmp_path, "summary.json", 1.0)
    for name in NAMES:
        (run / name).unlink()
        os.mkfifo(run / name) if what == "pipe" else (run / name).symlink_to("/dev/zero")
    assert len(load(run).missing) >= len(NAMES)
    with pytest.raises(SwarmerError, match="no timeline"):
        CliRunner().invoke(replay, [str(run), "--terminal"], standalone_mode=False, catch_exceptions=False)
