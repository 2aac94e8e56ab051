"""A setting that another one makes idle is told, and it is true: the run is the same with and without it."""

import pytest

from swarmer.config import load_config
from swarmer.engines.rounds_idle import idle_settings
from swarmer.experiments.one_run import perform
from swarmer.plan import make_plan

BASE = {
    "engine": "rounds",
    "shape": "sphere",
    "points": 25,
    "recording.enabled": False,
    "rounds.max_rounds": 6,
}


def lines(**settings):
    config = load_config(None, (), **BASE, **settings)
    return idle_settings(config, make_plan(config).rules, config.unlike())


@pytest.mark.parametrize(
    ("given", "idle", "why"),
    [
        ({}, {"rounds.pairing": "exact"}, "m: inf"),
        ({"m": 2}, {"rounds.order": "fid"}, "m: 2"),
        ({}, {"neighbours": "nearest"}, "rounds.neighbours: estimated"),
        ({}, {"rounds.box_cells": 300}, "deploy.start: dispatcher"),
        ({}, {"rounds.pm_first_leg": "exact"}, "technique signal_strength, which flies one way"),
        ({}, {"rounds.yardstick_radius": "average", "rounds.yardstick_confidence": 0.5},
         "technique signal_strength, which is none of the yardsticks"),
        ({"technique": "trilateration"},
         {"m": 2, "rounds.neighbours": "planned", "rounds.anchor": "lowest", "rounds.order": "fid",
          "rounds.pairing": "exact", "rounds.threshold_cells": 9, "rounds.max_thaws": 0, "rounds.stop": "none"},
         "technique trilateration, which has no swarms"),
        ({"technique": "dead_reckoning"}, {"rounds.anchor": "lowest"}, "technique dead_reckoning, which has no swarms"),
    ],
)  # fmt: skip
def test_what_is_idle_is_told_and_changes_nothing(tmp_path, given, idle, why):
    assert lines(**given) == []
    assert lines(**given, **idle) == [f"{', '.join(idle)}: no effect with {why}"]
    runs = []
    for number, settings in enumerate((given, {**given, **idle})):
        perform(load_config(None, (), **BASE, **settings), tmp_path / str(number))
        runs.append((tmp_path / str(number) / "rounds.csv").read_text())
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    "heeded",
    [
        {"m": 2, "rounds.pairing": "exact"},
        {"rounds.order": "fid", "rounds.neighbours": "planned", "neighbours": "nearest"},
        {"deploy.start": "random", "rounds.box_cells": 300},
        {"technique": "physical_movement", "rounds.pm_first_leg": "exact"},
        {"technique": "triangulation", "rounds.yardstick_order": "sequential"},
        {
            "rounds.anchor": "lowest",
            "rounds.threshold_cells": 1,
            "rounds.max_thaws": 2,
            "rounds.stop": "none",
        },
    ],
)
def test_what_is_heeded_is_not_told(heeded):
    assert lines(**heeded) == []


def test_other_engines_have_their_own_lines_and_presets_change_nothing():
    config = load_config(None, (), **{**BASE, "engine": "virtual"}, **{"rounds.box_cells": 300})
    assert idle_settings(config, make_plan(config).rules, config.unlike()) == []
    for preset in ("paper", "authors_code"):
        for technique in ("signal_strength", "triangulation"):
            config = load_config(preset, (), **BASE, technique=technique)
            rules = make_plan(config).rules
            assert idle_settings(config, rules, config.unlike(load_config(preset))) == []


def test_the_neighbours_of_a_yardstick_are_those_in_the_shape(capsys):
    from swarmer.commands.run import tell_plan

    for eta, k in ((2, 3), (5, 5)):
        tell_plan(
            make_plan(
                load_config(None, (), **{**BASE, "shape": "butterfly"}, technique="trilateration", eta=eta)
            )
        )
        assert f"neighbours the {k} nearest in the shape (η, 3 at least)" in capsys.readouterr().err
