"""FLSs that know where they are, in virtual time, with every invariant checked."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from virtual_runs import Watcher

from swarmer.config import load_config
from swarmer.engines.virtual import VirtualEngine
from swarmer.errors import BadInput
from swarmer.faults import Fault, Schedule
from swarmer.observe.invariants import Checks
from swarmer.plan import make_plan

PAGE = Path(__file__).parents[2] / "docs" / "oracles.md"
SMALL = {"shape": "random", "points": 30, "duration_s": 10}


def fly(count, faults=None, **settings):
    plan = make_plan(load_config(None, (), **{**SMALL, "oracle.count": count, **settings}))
    checks, watcher = Checks(plan, faults), Watcher()
    with VirtualEngine(plan, (checks,), *([] if faults is None else [faults])) as engine:
        result = engine.run(watcher)
    assert result.status == "done", result.message
    return result, watcher, checks


def off(watcher, fids):
    """How far these FLSs are from their points at each sample at which they are lit."""
    rows = np.array(fids) - 1
    truth = watcher.plan.cloud.points[rows]
    return [
        np.linalg.norm(one.position[rows] - truth, axis=1)[one.lit[rows]].max(initial=0.0)
        for one in watcher.samples
    ]


def test_with_an_oracle_the_display_stands_where_it_should():
    _, relative, _ = fly(0)
    _, absolute, checks = fly(1)
    assert relative.progress.hd < 0.01 < relative.progress.hd_absolute()
    assert absolute.progress.hd < 0.01
    assert absolute.progress.hd_absolute() < 0.01
    assert absolute.progress.time_to_hd_absolute_s["0.1"] < 4
    assert relative.progress.time_to_hd_absolute_s is None
    assert checks._named("S14").looked > 20


def test_an_oracle_is_lit_where_it_belongs_and_never_moves_again():
    _, watcher, _ = fly(3)
    oracles = watcher.plan.rules.oracles
    assert len(oracles) == 3
    assert max(off(watcher, oracles)) < 0.001
    others = [fid for fid in range(1, 31) if fid not in oracles]
    assert max(off(watcher, others)) > 0.1


@pytest.mark.parametrize("policy", ["timer", "census", "corner", "centralized", "off"])
def test_under_every_thaw_policy(policy):
    _, watcher, _ = fly(2, **{"thaw.policy": policy, "thaw.h_s": 1.0})
    assert watcher.progress.hd_absolute() < (1.0 if policy == "off" else 0.05)


@pytest.mark.parametrize("anchor", ["largest", "smallest", "challenger", "random"])
@pytest.mark.parametrize("join", ["newcomer", "all"])
def test_whatever_else_decides_who_anchors(anchor, join):
    _, watcher, _ = fly(2, anchor=anchor, busy_join=join, m=2, **{"radio.loss": 0.1})
    assert watcher.progress.hd_absolute() < 0.2
    fly(2, anchor=anchor, busy_join=join, duration_s=6, **{"failure.rate": 0.1})


def test_where_all_know_nobody_needs_to_move():
    _, watcher, _ = fly(30)
    assert watcher.progress.hd_absolute() < 0.001
    assert watcher.progress.first_single_swarm_s is not None, "they merge"


def test_an_oracle_that_fails_is_replaced_by_one():
    oracle = make_plan(load_config(None, (), **SMALL, **{"oracle.count": 1})).rules.oracles[0]
    kill = Schedule((Fault(4.0, "kill", (oracle,), 0.5),))
    _, watcher, _ = fly(1, kill)
    assert [event.fid for event in watcher.events if event.kind == "replacement"] == [oracle]
    assert max(off(watcher, [oracle])) < 0.001
    assert watcher.progress.lit_share == 1
    assert watcher.progress.hd_absolute() < 0.01


def test_without_its_oracle_a_display_is_relative_again():
    """It stays about where the absolute one stood, and forms as ever."""
    oracle = make_plan(load_config(None, (), **SMALL, **{"oracle.count": 1})).rules.oracles[0]
    kill = Schedule((Fault(4.0, "kill", (oracle,)),))
    _, watcher, checks = fly(1, kill, **{"thaw.policy": "timer", "thaw.h_s": 2.0})
    lives = [life for life in checks.facts.lives if life is not None and life.alive]
    assert len(lives) == 29
    assert not any(life.machine.absolute for life in lives), "they have thawed since"
    assert watcher.progress.hd < 0.1


def test_an_oracle_takes_part_in_a_transition():
    change = {"transition.shape": "cube", "transition.points": 30, "transition.at_s": 4.0}
    _, watcher, _ = fly(2, **change)
    assert watcher.progress.hd_absolute() < 0.01


def test_more_oracles_than_points_are_refused():
    with pytest.raises(BadInput, match=r"oracle.count"):
        make_plan(load_config(None, (), **SMALL, **{"oracle.count": 31}))


def test_the_example_of_the_page(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from swarmer.commands.run import command
    from swarmer.observe.saved_run import load

    line = next(line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("    swarmer-run"))
    monkeypatch.chdir(tmp_path)
    words = [*shlex.split(line)[1:], "--no-recording", "--out", "run"]
    done = CliRunner().invoke(command, words, standalone_mode=False)
    assert done.exception is None, done.output
    summary = load(tmp_path / "run").summary
    assert summary["hd_absolute_cells"] < 0.01
    assert summary["time_to_hd_absolute_s"]["0.1"] < 10
