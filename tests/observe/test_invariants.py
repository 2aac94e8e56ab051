"""Checks of a run for who runs it: `--check`, what a broken invariant tells, and the page that lists them."""

import json
from importlib import util
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from swarmer import cli
from swarmer.errors import BadInput
from swarmer.messages import Kind, Message, Swarm, To
from swarmer.observe.invariants import INVARIANTS
from swarmer.observe.invariants.being import Always, Deploying
from swarmer.radio import ReplayWindow
from swarmer.state_machine import State

DOCS = Path(__file__).resolve().parents[2] / "docs"
SMALL = ["--shape", "sphere", "--points", "20", "--duration", "4", "--no-recording", "--engine", "virtual"]


def run(*arguments):
    done = CliRunner().invoke(cli.load("run"), [*SMALL, *map(str, arguments)], standalone_mode=False)
    return done, done.return_value


def summary_of(directory):
    return json.loads((directory / "summary.json").read_text("utf-8"))


def test_a_run_that_is_checked_says_how_much(tmp_path):
    done, status = run("--check", "--out", tmp_path / "checked")
    assert status == 0, done.output
    summary = summary_of(tmp_path / "checked")
    assert summary["invariants_checked"] > 1000
    assert summary["invariant_violations"] == 0
    run("--out", tmp_path / "plain")
    plain = summary_of(tmp_path / "plain")
    assert plain["invariants_checked"] is None
    assert plain["trace_sha256"] == summary["trace_sha256"], "checks change nothing"


def test_a_broken_invariant_stops_the_run_and_tells(tmp_path, monkeypatch):
    monkeypatch.setattr(ReplayWindow, "fresh", lambda *_: True)
    copies = ["--set", "radio.duplicate=0.5"]
    done, status = run("--check", *copies, "--out", tmp_path / "broken")
    assert status == 1
    summary = summary_of(tmp_path / "broken")
    assert summary["status"] == "failed"
    assert summary["invariant_violations"] == 1
    broken = summary["violation"]
    assert broken["invariant"] == "S12 ids"
    assert summary["message"].startswith(
        f"S12 ids: FLS {broken['fid']} at {broken['t_s']:.4f} s: handles number"
    )
    assert 2 <= len(broken["last"]) <= 20
    assert broken["last"][-1].startswith(f"{broken['t_s']:.4f} s  FLS {broken['fid']} ")
    for line in (broken["guards"], broken["last"][-1]):
        assert line in done.output
    # The command makes the same run up to there.
    again = next(line for line in done.output.splitlines() if line.startswith("  again  "))
    arguments = again.split(" run ", 1)[1].split()
    done = CliRunner().invoke(
        cli.load("run"), [*arguments, "--out", str(tmp_path / "again")], standalone_mode=False
    )
    second = summary_of(tmp_path / "again")
    assert second["violation"] == broken
    assert second["trace_sha256"] == summary["trace_sha256"]


def test_a_datagram_that_cannot_be_is_told_in_words():
    facts = SimpleNamespace(ids_decide=True, rules=SimpleNamespace(epochs=True, count=20))
    step = SimpleNamespace(m=SimpleNamespace(fid=3, incarnation=0, epoch=2), thaws=0)
    own = Message(
        int(Kind.MERGE),
        3,
        0,
        2,
        Swarm(3, 0),
        1,
        (0.0, 0.0, 0.0),
        int(To.SWARM),
        Swarm(3, 0),
        other=Swarm(1, 2),
    )
    check = Always(facts)
    assert check.said(step, own) is None
    words = "MERGE(1.2) to swarm 3, signed 5 of epoch 2, vector (0.0, 0.0, 0.0), range 1e+09"
    assert check.said(step, own._replace(sender=5)) == f"signs as another: {words}"
    assert check.said(step, own._replace(kind=int(Kind.THAW_ANNOUNCE))).startswith(
        "speaks to the wrong ones: THAW_ANNOUNCE to swarm 3, signed 3 of"
    )
    dark = SimpleNamespace(m=SimpleNamespace(state=State.DEPLOYING), sent=[own, own])
    assert Deploying(facts).after(dark).startswith("is dark, and says MERGE(1.2) to swarm 3, signed 3 of")


def test_only_virtual_time_can_be_checked(tmp_path):
    arguments = ["--check", "--shape", "sphere", "--points", "20", "--out", str(tmp_path / "no")]
    with pytest.raises(BadInput, match="check: the engine process cannot be checked"):
        CliRunner().invoke(cli.load("run"), arguments, standalone_mode=False, catch_exceptions=False)
    assert not (tmp_path / "no").exists()


def test_every_invariant_says_in_a_sentence_what_it_guards():
    assert len({kind.name for kind in INVARIANTS}) == len(INVARIANTS)
    for kind in INVARIANTS:
        assert kind.guards[0].isupper()
        assert kind.guards.endswith(".")


def test_the_page_lists_every_invariant():
    spec = util.spec_from_file_location("invariants_list", DOCS / "invariants_list.py")
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    table = module.list_markdown()
    assert "<!-- invariants: list -->" in (DOCS / "invariants.md").read_text("utf-8")
    assert all(f"| {kind.name} | {kind.title} | {kind.guards} |" in table for kind in INVARIANTS)
