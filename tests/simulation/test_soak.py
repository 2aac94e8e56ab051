"""Worlds full of faults, always the same ones; scripts/withstand.py plays the count, `swarmer simulate` fresh ones."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from swarmer.config import setting_facts
from swarmer.engines.virtual_faults import StormyFls
from swarmer.experiments.simulate import read_world
from swarmer.experiments.worlds import DEFAULTS, THAW_POLICIES, draw, play
from swarmer.faults import WHAT, from_text, shrink, to_yaml
from swarmer.observe.invariants import INVARIANTS
from swarmer.radio import ReplayWindow

SEEDS = range(1, 61)
HERE = Path(__file__).parent
FOUND = [int(line.split()[0]) for line in (HERE / "seeds.txt").read_text("utf-8").splitlines()]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_world_full_of_faults_heals(seed):
    outcome = play(draw(seed))
    assert outcome.failure is None, f"swarmer simulate --seed {seed}: {outcome.failure}"


@pytest.mark.parametrize("seed", FOUND)
def test_a_world_that_has_shown_a_fault_holds(seed):
    """Kept whole, for the same seed may be another world once more is drawn."""
    path = HERE / "found" / f"seed-{seed}.yaml"
    outcome = play(read_world(path))
    assert outcome.failure is None, f"swarmer simulate {path}: {outcome.failure}"


def test_the_same_seed_is_the_same_world():
    assert draw(7) == draw(7)
    assert play(draw(7)).digest == play(draw(7)).digest


def test_another_seed_is_another_world():
    assert play(draw(7)).digest != play(draw(8)).digest


def test_the_worlds_have_every_kind_of_fault_and_of_thaw():
    worlds = [draw(seed) for seed in SEEDS]
    faults = [fault for world in worlds for fault in world.schedule.faults]
    assert {fault.what for fault in faults} == set(WHAT)
    assert any(fault.swarm_of for fault in faults)
    assert any(fault.kinds and fault.source for fault in faults)
    assert {world.settings["thaw.policy"] for world in worlds} == set(THAW_POLICIES)
    assert any(not world.schedule.faults for world in worlds)
    assert {
        "radio.loss",
        "radio.duplicate",
        "radio.reorder",
        "radio.delay_ms",
        "failure.rate",
        "failure.battery_s",
    } <= {name for world in worlds for name in world.settings}


NOT_DRAWN = {
    "duration_s", "until_hd_cells",  # how long a world lasts is the calm's matter
    "duplicates",  # no shape that is drawn has any
    "faults.schedule", "faults.calm_s", "faults.file", "faults.random",  # a world has its own schedule
    "recording.rate_hz", "recording.enabled", "recording.positions_per_s",  # nothing is recorded
}  # fmt: skip


def test_the_worlds_have_every_setting_of_the_engine():
    """A setting that is new must be drawn, too, or stand above with a reason."""
    drawn = {
        name for seed in range(300) for name, value in draw(seed).settings.items() if value != DEFAULTS[name]
    }
    heeded = {fact.name for fact in setting_facts() if fact.only in ("", "virtual")}
    assert heeded - drawn == NOT_DRAWN


def test_a_schedule_survives_its_text():
    for seed in SEEDS:
        world = draw(seed)
        assert from_text(to_yaml(world.schedule), world.settings["points"]) == world.schedule


def test_a_world_that_cannot_heal_is_a_failure(monkeypatch):
    """The checks would see it: an FLS that stays cut off is never in the one swarm."""
    worlds = [draw(seed) for seed in SEEDS]
    promised = (
        world for world in worlds
        if world.settings["points"] > 8 and "transition.shape" not in world.settings  # or FLS 1 may have to leave
    )  # fmt: skip
    world = next(world for world in promised if play(world).took_s is not None)
    hear = StormyFls.hear

    def hear_all_but_one(fls, message, stamp):
        if 1 not in (message.sender, fls.fid):
            hear(fls, message, stamp)

    monkeypatch.setattr(StormyFls, "hear", hear_all_but_one)
    outcome = play(world)
    assert outcome.invariant == "L1"
    assert "no single swarm" in outcome.failure


def test_a_failing_schedule_is_shrunk_to_what_it_needs(monkeypatch):
    """A radio that forgets whom it has heard, after somebody's death: of all the faults one death is left."""
    fresh, died = ReplayWindow.fresh, []
    die = StormyFls.die
    monkeypatch.setattr(StormyFls, "die", lambda fls: (died.append(fls.fid), die(fls)))
    monkeypatch.setattr(ReplayWindow, "fresh", lambda *call: fresh(*call) or bool(died))

    def fails(schedule):
        died.clear()
        return play(world._replace(schedule=schedule)).invariant == "S12"

    world = next(
        draw(seed) for seed in SEEDS
        if "radio.duplicate" in draw(seed).settings and len(draw(seed).schedule.faults) > 3
        and any(fault.what == "kill" for fault in draw(seed).schedule.faults)
    )  # fmt: skip
    assert fails(world.schedule)
    small = shrink(world.schedule, fails)
    assert [(fault.what, len(fault.where)) for fault in small.faults] == [("kill", 1)]


def test_every_invariant_had_something_to_look_at():
    seen = sum((play(draw(seed)).seen for seed in range(1, 25)), Counter())
    rare = {invariant.name for invariant in INVARIANTS if seen[invariant.name] < 10}
    assert rare <= {"L1", "L5"}
    assert seen["L1"] + seen["L5"] >= 5


def test_the_soak_begins_by_the_clock_and_says_where_it_stands():
    command = [sys.executable, "-m", "swarmer", "simulate", "--seconds", "0.5", "--jobs", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 failed" in done.stdout.splitlines()[-1]
