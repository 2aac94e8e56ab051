"""Experiment files: what they stand for, and one line for each that stands for nothing."""

import sys
from pathlib import Path

import pytest

from swarmer import cli
from swarmer.config import load_config
from swarmer.errors import BadInput
from swarmer.experiments import experiment as experiments
from swarmer.experiments.experiment import experiment_names, read_experiment
from swarmer.experiments.runs import asked_of, by_seed, cell_name, check_plans, expand, size, varied_names
from swarmer.settings_file import preset_names

SMALL = "base: {engine: virtual, shape: sphere, points: 12, duration_s: 1}\n"


def paths(*args, **more):
    return [run.path.as_posix() for run in expand(read_experiment(*map(str, args), **more))]


def test_every_combination_with_every_seed(write):
    file = write(SMALL + "grid: {lambda_ms: [100, 500.0], radio: {loss: [0, 0.1]}}\nseeds: [7, 3]\n")
    assert paths(file) == [
        f"lambda_ms={ms},radio.loss={loss}/seed-{seed}"
        for ms in (100, 500)
        for loss in ("0", "0.1")
        for seed in (7, 3)
    ]
    runs = expand(read_experiment(str(file)))
    assert runs[0].varied == {"lambda_ms": 100.0, "radio.loss": 0.0}
    by_hand = load_config(None, [], engine="virtual", shape="sphere", points=12, duration_s=1, lambda_ms=500,
                          seed=3, **{"radio.loss": 0.1, "recording.enabled": False})  # fmt: skip
    assert runs[-1].config == by_hand


def test_a_count_of_seeds_begins_at_1_and_none_is_one(write):
    assert paths(write(SMALL + "seeds: 3")) == ["seed-1", "seed-2", "seed-3"]
    assert paths(write(SMALL)) == ["seed-1"]


def test_options_stand_in_place_of_the_file(write):
    file = write(SMALL + "grid: {eta: [2, 3]}\nblocks: [{base: {points: 14}}, {seeds: 2}]")
    runs = expand(read_experiment(str(file), ["points=20"], "5,9"))
    assert [run.path.as_posix() for run in runs] == [
        f"eta={eta}/seed-{seed}" for eta in (2, 3) for seed in (5, 9)
    ]
    assert {run.config.points for run in runs} == {20}


def test_no_recording_unless_it_is_asked_for(write):
    assert not expand(read_experiment(str(write(SMALL))))[0].config.recording.enabled
    assert not expand(read_experiment(str(write("base: {extends: default}"))))[0].config.recording.enabled
    asked = write(SMALL + "grid: {recording.enabled: [true, false]}")
    assert [run.config.recording.enabled for run in expand(read_experiment(str(asked)))] == [True, False]


BLOCKS = (
    SMALL
    + """
grid: {lambda_ms: [200]}
seeds: 2
blocks:
  - base: {shape: knot}
    grid: {radio.loss: [0, 0.1]}
  - grid: {shape: [sphere, cube], lambda_ms: [200, 500]}
    seeds: 1
"""
)


def test_a_block_adds_to_what_the_file_says(write):
    file = write(BLOCKS)
    assert paths(file) == [
        *(f"shape=knot,lambda_ms=200,radio.loss={loss}/seed-{seed}" for loss in ("0", "0.1") for seed in (1, 2)),
        *(f"lambda_ms={ms},shape={shape}/seed-1" for ms in (200, 500) for shape in ("sphere", "cube")),
    ]  # fmt: skip
    assert varied_names(read_experiment(str(file))) == ["shape", "lambda_ms", "radio.loss"]


def test_more_values_seeds_and_blocks_leave_the_names_as_they_are(write):
    before = paths(write(BLOCKS))
    more = BLOCKS.replace("[0, 0.1]", "[0.2, 0, 0.1]").replace("seeds: 2", "seeds: 4")
    after = paths(write(more + "  - base: {eta: 4}\n    seeds: 1\n"))
    assert set(before) < set(after)


def test_a_run_that_two_blocks_have_is_made_once(write):
    file = write(SMALL + "blocks: [{grid: {eta: [2, 3]}}, {grid: {eta: [3, 4], radio.loss: [0]}}]")
    assert paths(file) == ["eta=2/seed-1", "eta=3/seed-1", "eta=4,radio.loss=0/seed-1"]
    assert size(read_experiment(str(file))) == 4


def test_a_base_extends_a_preset_or_a_file_beside_it(write):
    write("lambda_ms: 123\n", "mine.yaml")
    file = write("base: {extends: paper, eta: 3}\nblocks: [{}, {base: {extends: mine.yaml}}]")
    first, second = expand(read_experiment(str(file)))
    assert (first.config.neighbours, first.config.eta, first.config.lambda_ms) == ("nearest", 3, 500)
    assert second.path.as_posix() == "lambda_ms=123/seed-1"
    assert (second.config.neighbours, second.config.lambda_ms) == ("nearest", 123)


def test_of_a_preset_that_a_block_extends_only_what_differs_is_named(write):
    file = write("base: {engine: virtual}\nblocks: [{}, {base: {extends: paper}}]")
    names = set(varied_names(read_experiment(str(file))))
    assert "neighbours" in names
    assert not names & {"engine", "recording.enabled", "lambda_ms", "extends"}


def test_the_order_of_making_has_every_cell_once_first(write):
    file = write(SMALL + "grid: {eta: [2, 3, 4]}\nseeds: [5, 1]")
    made = [(run.varied["eta"], run.config.seed) for run in by_seed(expand(read_experiment(str(file))))]
    assert made == [(2, 5), (3, 5), (4, 5), (2, 1), (3, 1), (4, 1)]


def test_names_of_folders_stay_apart_and_short():
    long = [cell_name({"shape": f"clouds/{'x' * 300}{end}"}) for end in "ab"]
    assert len(set(long)) == 2
    assert max(map(len, long)) <= 120
    assert cell_name({"shape": "a/b"}) != cell_name({"shape": "a-b"})
    assert cell_name({}) == ""


def test_the_experiments_that_ship_can_be_run():
    assert {"thaw_policies", "loss_and_lambda"} <= set(experiment_names())
    assert not set(experiment_names()) & set(preset_names())
    for name in experiment_names():
        experiment = read_experiment(name)
        runs = expand(experiment)
        if name != "scale_million":  # a minute and a gigabyte to plan
            assert check_plans(runs, experiment.file, asked_of(experiment)) == []
        engines = {run.config.engine for run in runs}
        assert (
            engines == {"process", "virtual"}
            if name == "two_engines"
            else engines in ({"virtual"}, {"rounds"})
        )


def refused(monkeypatch, capsys, *arguments):
    """The one line with which `swarmer sweep` refuses."""
    monkeypatch.setattr(sys, "argv", ["swarmer", "sweep", *map(str, arguments)])
    monkeypatch.setattr(sys, "stderr", sys.stderr)  # main() puts another there
    with pytest.raises(SystemExit) as ended:
        cli.main()
    out, err = capsys.readouterr()
    assert ended.value.code == 2
    assert out == ""
    assert len(err.splitlines()) == 1, err
    return err.strip()


BAD = {
    "a part that is none": ("grdi: {eta: [2]}", "x.yaml: grdi: no such part; did you mean 'grid'?"),
    "a setting that is none": ("grid: {lambda: [2]}", "x.yaml: grid: lambda: no such setting; did you mean 'lambda"),
    "a setting in the base": ("base: {radio: {los: 0}}", "x.yaml: base: radio.los: no such setting; did you mean"),
    "a value of the base": ("base: {eta: 0}", "x.yaml: base: eta: 0 is out of range; whole number, 1 to 1000"),
    "a value of the grid": ("grid: {lambda_ms: [200, -5]}", "x.yaml: grid: lambda_ms: -5 is out of range; milli"),
    "a word": ("grid: {thaw.policy: [timer, centralised]}", "is not a choice; did you mean 'centralized'?"),
    "a group": ("grid: {thaw: [1]}", "x.yaml: grid: thaw: is a group of settings"),
    "no list": ("grid: {eta: 3}", "x.yaml: grid: eta: 3 is not a list of values"),
    "an empty list": ("grid: {eta: []}", "x.yaml: grid: eta: [] is not a list of values"),
    "a value twice": ("grid: {lambda_ms: [200, 200.0]}", "x.yaml: grid: lambda_ms: 200.0 is given twice"),
    "no mapping": ("grid: [eta]", "x.yaml: grid: ['eta'] must be a mapping"),
    "base and grid": ("base: {eta: 2}\ngrid: {eta: [3]}", "x.yaml: base: eta: stands in grid, too"),
    "a seed in the grid": ("grid: {seed: [1, 2]}", "x.yaml: grid: seed: is not given here; give seeds"),
    "a seed in the base": ("base: {seed: 1}", "x.yaml: base: seed: is not given here; give seeds"),
    "no seeds": ("seeds: 0", "x.yaml: seeds: 0 is neither a count"),
    "seeds of words": ("seeds: many", "x.yaml: seeds: 'many' is neither a count"),
    "a bad seed": ("seeds: [1, -1]", "x.yaml: seeds: seed: -1 is out of range"),
    "a seed twice": ("seeds: [4, 4]", "x.yaml: seeds: 4 is given twice"),
    "blocks that are none": ("blocks: {grid: {}}", "x.yaml: blocks: {'grid': {}} is not a list of entries"),
    "a part of a block": ("blocks: [{}, {grdi: {}}]", "x.yaml: block 2: grdi: no such part; did you mean 'grid'?"),
    "a value in a block": ("blocks: [{grid: {eta: [0]}}]", "x.yaml: block 1: grid: eta: 0 is out of range"),
    "a block against the grid": ("grid: {eta: [2]}\nblocks: [{base: {eta: 3}}]", "block 1: base: eta: stands in grid"),
    "extends nothing": ("base: {extends: papr}", "x.yaml: config: no file"),
    "extends a number": ("base: {extends: 3}", "x.yaml: base: extends: 3 is not a preset's name or a path"),
    "not yaml": ("grid: [", "x.yaml: line 1, column 8: "),
    "nothing": ("# all to be done\n", "x.yaml: is empty; an experiment has base, grid, list, random, "),
    "parts with nothing": ("base:\ngrid:\n", "x.yaml: is empty; an experiment has base, grid, list, random, "),
    "extends an experiment": ("base: {extends: x.yaml}", "x.yaml is an experiment file; `swarmer sweep "),
    "no shape": ("base: {shape: dragn}", "x.yaml: shape: no 'dragn'"),
    "no shape in the grid": ("grid: {shape: [sphere, dragn]}", "x.yaml: with shape=dragn: "),
    "a technique": ("base: {technique: telepathy}", "x.yaml: technique: 'telepathy' is not allowed"),
    "eta of too few": ("base: {shape: sphere, points: 4}\ngrid: {eta: [3, 5]}", "x.yaml: with eta=5: eta: 5"),
    "a contradiction": (
        "base: {engine: virtual}\ngrid: {time_scale: [auto, 2]}",
        "x.yaml: with time_scale=2: time_scale: 2 is not for the engine virtual",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_on_one_line(case, write, monkeypatch, capsys, tmp_path):
    text, line = BAD[case]
    out = tmp_path / "out"
    said = refused(monkeypatch, capsys, write(text), "--out", out)
    assert line in said
    assert refused(monkeypatch, capsys, write(text), "--dry-run") == said
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--set", "radio.los=1"], "--set: radio.los: no such setting; did you mean 'radio.loss'?"),
        (["--set", "eta=3"], "--set: eta: stands in grid, too"),
        (["--set", "seed=3"], "--set: seed: is not given here"),
        (["--seeds", "0"], "--seeds: 0 is neither a count"),
        (["--seeds", "x"], "--seeds: 'x' is neither a count"),
        (["--seeds", "3,3"], "--seeds: 3 is given twice"),
        (["--seeds", "5000"], "stands for 10,000 runs; more than 3,000 need --yes"),
        (["--out", ""], "out: '' is not allowed"),
        (["--jobs", "0"], "'--jobs': 0 is not in the range"),
    ],
)
def test_bad_options_are_refused_on_one_line(options, line, write, monkeypatch, capsys):
    assert line in refused(monkeypatch, capsys, write(SMALL + "grid: {eta: [2, 3]}"), *options)


LESS = """
grid: {eta: [2, 3], lambda_ms: [100, 200]}
seeds: 20
small: {base: {duration_s: 0.5}, grid: {eta: [3]}, seeds: 2}
"""


def test_the_small_version_has_its_own_base_values_and_seeds(write):
    file = write(SMALL + LESS)
    assert size(read_experiment(str(file))) == 80
    small = read_experiment(str(file), small=True)
    assert small.name == "x-small"
    runs = expand(small)
    assert [run.path.as_posix() for run in runs] == [
        f"eta=3,lambda_ms={ms}/seed-{seed}" for ms in (100, 200) for seed in (1, 2)
    ]
    assert {run.config.duration_s for run in runs} == {0.5}
    assert len(expand(read_experiment(str(file), [], "7,", small=True))) == 2


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "x.yaml: small: None is not a mapping with base, grid, seeds, blocks"),
        ("small: {seds: 3}", "x.yaml: small: seds: no such part; did you mean 'seeds'?"),
        ("small: {base: {eta: 0}}", "x.yaml: base: eta: 0 is out of range"),
    ],
)
def test_a_small_version_that_cannot_be_is_refused(text, line, write, monkeypatch, capsys):
    assert line in refused(monkeypatch, capsys, write(SMALL + text), "--small")


def test_every_emulation_of_the_paper_has_a_small_version():
    for name in ("fig27_lambda_chess", "fig28_lambda_skateboard", "fig29_30_shapes", "fig31_loss",
                 "fig32_failures_chess", "fig33_failures_skateboard", "speed"):  # fmt: skip
        small = expand(read_experiment(name, small=True))
        assert len(small) < len(expand(read_experiment(name))) / 5


def test_a_name_that_nearly_ships_is_told(monkeypatch, capsys):
    assert "did you mean 'thaw_policies'?" in refused(monkeypatch, capsys, "thaw_policy")


def test_very_many_runs_are_made_only_if_wanted(write):
    file = write(SMALL + "grid: {eta: [2, 3]}\nseeds: 5000")
    assert size(read_experiment(str(file))) == 10_000
    with pytest.raises(BadInput, match="stands for 10,000 runs; more than 3,000 need --yes"):
        cli.load("sweep").main([str(file)], standalone_mode=False)


def test_very_many_runs_are_listed_without_more_ado_and_very_very_many_are_not(write, capsys):
    file = write(SMALL)
    cli.load("sweep").main([str(file), "--dry-run", "--seeds", "3001"], standalone_mode=False)
    assert len(capsys.readouterr().out.splitlines()) == 3001
    file = write(SMALL + "grid: {eta: [2, 3]}")
    with pytest.raises(BadInput, match="more than 100,000 need --yes"):
        cli.load("sweep").main([str(file), "--dry-run", "--seeds", "50001"], standalone_mode=False)


def test_a_dry_run_lists_the_runs_and_makes_none(write, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    file = write(SMALL + "grid: {eta: [2, 3]}")
    cli.load("sweep").main([str(file), "--dry-run"], standalone_mode=False)
    assert capsys.readouterr().out.split() == ["eta=2/seed-1", "eta=3/seed-1"]
    assert [path.name for path in Path.cwd().iterdir()] == ["x.yaml"]


def test_the_quiet_setting_is_one():
    assert set(experiments.QUIET) <= set(experiments.FACTS)


def test_a_sweeps_directory_is_told_from_its_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    with pytest.raises(BadInput, match=r"^experiment: 'mine' is a directory, not a file$"):
        read_experiment("mine")
    Path("mine/experiment.yaml").touch()
    with pytest.raises(BadInput, match=r"not a file; that of the sweep in it is mine/experiment\.yaml$"):
        read_experiment("mine")


IDLE = """base: {extends: authors_code, engine: rounds, shape: sphere, points: 20, radio: {mac: true}}
grid: {radio.loss: [0, 0.1], technique: [signal_strength, triangulation], m: [2, inf]}
seeds: 3
blocks: [{}, {base: {extends: paper, rounds.order: fid}}]
"""


def test_settings_that_nothing_heeds_are_told_once_and_those_of_presets_are_not(write, capsys):
    cli.load("sweep").main([str(write(IDLE)), "--dry-run"], standalone_mode=False)
    assert capsys.readouterr().err.splitlines() == [
        "note: radio.mac, radio.loss: no effect with the engine rounds, which plays no protocol",
        "note: m, rounds.order: no effect with technique triangulation, which has no swarms",
        "note: rounds.order: no effect with m: 2",
    ]
