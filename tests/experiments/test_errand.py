"""A run made elsewhere, without Ray: what is brought is what a run here leaves."""

import json
import os
import signal
import threading
import time
from multiprocessing.context import SpawnProcess
from pathlib import Path

import pytest
from helpers import children, gone, wait_for

from swarmer.errors import BadInput, RunFailed
from swarmer.experiments import errand
from swarmer.experiments.errand import Brought, Errand, do, put_down
from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.on_ray import plan_here
from swarmer.experiments.one_run import Outcome, perform
from swarmer.experiments.runs import expand
from swarmer.experiments.sweep_directory import SweepDirectory
from swarmer.observe.run_directory import hold, let_go

TINY = "base: {engine: virtual, shape: sphere, points: 12, duration_s: 2}\n"


@pytest.fixture
def first(write):
    return lambda text=TINY: expand(read_experiment(str(write(text))))[0]


@pytest.fixture(autouse=True)
def desks(tmp_path, monkeypatch):
    """Where runs are made; nothing stays there. The worker ends with the test."""
    place = tmp_path / "tmp"
    place.mkdir()
    monkeypatch.setattr(errand.tempfile, "tempdir", str(place))
    yield place
    if errand._pool is not None:
        errand._pool.__exit__(None, None, None)
        errand._pool = None
    assert list(place.iterdir()) == []


def test_a_run_made_elsewhere_is_the_run_made_here(first, tmp_path):
    run = first()
    brought = do(Errand(run.config, ["swarmer", "sweep", "x.yaml"]))
    put_down(brought, tmp_path / "there")
    assert perform(run.config, tmp_path / "here").status == brought.outcome.status == "done"
    names = [{path.name for path in (tmp_path / place).iterdir()} for place in ("here", "there")]
    assert names[0] == names[1]
    traces = [
        json.loads((tmp_path / place / "summary.json").read_text())["trace_sha256"]
        for place in ("here", "there")
    ]
    assert traces[0] == traces[1]
    assert json.loads((tmp_path / "there" / "manifest.json").read_text())["command"] == "swarmer sweep x.yaml"


def test_a_file_of_points_travels_and_the_run_is_known_again(first, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.xyz").write_text("".join(f"{at} {at * at % 7} 0\n" for at in range(8)))
    run = first("base: {engine: virtual, shape: mine.xyz, duration_s: 0.5}")
    job = Errand(run.config, [], plan_here(run))
    Path("mine.xyz").rename("away.xyz")  # as on another machine
    brought = do(job)
    Path("away.xyz").rename("mine.xyz")
    assert brought.outcome.status == "done"
    put_down(brought, tmp_path / "o" / run.path)
    (tmp_path / "o" / "experiment.yaml").write_text("# The experiment x, by swarmer 1\n")
    with SweepDirectory(tmp_path / "o") as directory:
        assert list(directory.finished([run])) == [run.path]
    assert plan_here(first()) is None


def test_a_worker_makes_one_run_after_the_other_in_one_process(first):
    do(Errand(first().config, []))
    process = errand._pool._slots[0].process.pid
    do(Errand(first().config, []))
    assert errand._pool._slots[0].process.pid == process


def test_a_run_that_fails_brings_why(first):
    run = first()
    spoilt = run.config.model_copy(update={"shape": "nothing"})
    brought = do(Errand(spoilt, []))
    assert brought.outcome.status == "failed"
    assert "nothing" in brought.outcome.message


def test_what_is_too_large_is_not_sent(first, monkeypatch):
    monkeypatch.setattr(errand, "SENT_MB_MAX", 0.001)
    outcome, files = do(Errand(first().config, []))
    assert files == {}
    assert outcome.status == "failed"
    assert "at most 0 are sent; record less" in outcome.message


def test_a_run_that_is_ended_from_outside_leaves_nothing(first):
    long = first(TINY.replace("duration_s: 2", "duration_s: 100000"))
    before, workers = set(children(os.getpid())), set()

    def interrupt():
        wait_for(lambda: set(children(os.getpid())) - before, 60)
        workers.update(set(children(os.getpid())) - before)
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    heard = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        thread.start()
        with pytest.raises(KeyboardInterrupt):
            do(Errand(long.config, []))
    finally:
        thread.join()
        signal.signal(signal.SIGINT, heard)
    assert errand._pool is None
    assert workers
    wait_for(lambda: gone(workers))


def test_an_interruption_while_the_process_is_born_is_heard(first, desks, monkeypatch):
    """Ray interrupts once: what is lost then runs on until the worker is killed, and stays on the disk."""
    born, workers = SpawnProcess.start, []

    def start(process):
        os.kill(os.getpid(), signal.SIGINT)
        born(process)
        workers.append(process.pid)

    monkeypatch.setattr(SpawnProcess, "start", start)
    heard = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            do(Errand(first(TINY.replace("duration_s: 2", "duration_s: 100000")).config, []))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, heard)
    wait_for(lambda: gone(workers))
    assert workers
    assert list(desks.iterdir()) == []


def test_an_interruption_while_the_directory_is_made_leaves_none(first, desks, monkeypatch):
    make, made = Path.mkdir, []

    def interrupted(path, *more, **named):
        make(path, *more, **named)
        if path.name.startswith(errand.DESK):
            made.append(path)
            raise KeyboardInterrupt

    monkeypatch.setattr(Path, "mkdir", interrupted)
    with pytest.raises(KeyboardInterrupt):
        do(Errand(first().config, []))
    assert made
    assert list(desks.iterdir()) == []


def test_what_killed_workers_left_is_cleared_away(first, desks):
    (desks / f"{errand.DESK}999999999-x").mkdir()  # no process has this id
    do(Errand(first().config, []))


def test_what_a_worker_of_another_container_holds_stays(desks):
    """Its process is none of ours to see, though the directory for temporary files is the same."""
    desk = desks / f"{errand.DESK}999999999-x"
    desk.mkdir()
    lock = hold(desk)
    errand.clear_desks()
    assert desk.exists()
    let_go(lock)
    errand.clear_desks()
    assert not desk.exists()


def test_half_a_run_is_replaced_and_a_strangers_file_is_not(tmp_path):
    path = tmp_path / "seed-1"
    path.mkdir()
    (path / "events.csv.partial").touch()
    (path / "summary.json").write_text('{"status": "failed"}')
    put_down(Brought(Outcome("done"), {"summary.json": b"{}", "log.txt": b"x"}), path)
    assert {one.name for one in path.iterdir()} == {"summary.json", "log.txt"}
    (path / "thesis.tex").touch()
    with pytest.raises(BadInput, match=r"thesis\.tex"):
        put_down(Brought(Outcome("done"), {"summary.json": b"{}"}), path)


def test_a_summary_is_written_last(tmp_path, monkeypatch):
    written = []
    monkeypatch.setattr(errand, "_write", lambda path, data: written.append(path.name))
    put_down(Brought(Outcome("done"), {"summary.json": b"", "a": b"", "timeline.npz": b""}), tmp_path / "r")
    assert written == ["a", "timeline.npz", "summary.json"]


def test_a_file_in_the_way_of_the_directory_is_said(tmp_path):
    (tmp_path / "cell").touch()
    with pytest.raises((BadInput, RunFailed)):
        put_down(Brought(Outcome("done"), {"summary.json": b""}), tmp_path / "cell" / "seed-1")
