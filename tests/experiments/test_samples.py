"""Samples and lists in an experiment file: reproducible, spread as they say, and taken up again."""

import math
from collections import Counter

import pytest

from swarmer.errors import BadInput
from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.runs import expand, size, varied_names
from swarmer.experiments.samples import LATIN, RANDOM, Range, Sample
from swarmer.experiments.sweep_directory import as_file

BASE = "base: {engine: virtual, shape: sphere, points: 12, duration_s: 1}\n"
RANGES = """  ranges:
    radio: {loss: {min: 0, max: 0.3}}
    lambda_ms: {min: 50, max: 1000, scale: log}
    eta: {min: 3, max: 6}
    thaw.policy: [timer, roster]
"""


def drawn(file):
    return [run.varied for run in expand(read_experiment(str(file)))]


@pytest.mark.parametrize("kind", [RANDOM, LATIN])
def test_draws_are_settings_within_their_ranges_and_the_same_every_time(kind, write):
    file = write(BASE + f"{kind}:\n  n: 40\n{RANGES}seeds: 2\n")
    experiment = read_experiment(str(file))
    runs = expand(experiment)
    assert size(experiment) == len(runs) == 80
    assert varied_names(experiment) == ["radio.loss", "lambda_ms", "eta", "thaw.policy"]
    draws = [run.varied for run in runs if run.config.seed == 1]
    assert draws == drawn(file)[::2]
    for draw in draws:
        assert 0 <= draw["radio.loss"] <= 0.3
        assert 50 <= draw["lambda_ms"] <= 1000
        assert isinstance(draw["eta"], int)
    assert {draw["eta"] for draw in draws} == {3, 4, 5, 6}
    assert {draw["thaw.policy"] for draw in draws} == {"timer", "roster"}
    other = write(file.read_text().replace("n: 40\n", "n: 40\n  seed: 2\n"))
    assert drawn(other)[::2] != draws


def test_these_are_the_draws_on_every_machine():
    sample = Sample(RANDOM, 2, 1, {"radio.loss": Range(0, 0.3), "eta": Range(3, 6, whole=True)})
    assert sample.draws() == [{"radio.loss": 0.124576, "eta": 5}, {"radio.loss": 0.00830923, "eta": 3}]
    latin = Sample(LATIN, 3, 1, {"radio.loss": Range(0, 0.3)})
    assert [draw["radio.loss"] for draw in latin.draws()] == [0.125277, 0.229495, 0.0896172]


def test_a_latin_hypercube_has_one_draw_in_each_strip_of_each_range():
    ranges = {"a": Range(0, 20), "b": Range(1, 2**20, log=True), "c": Range(1, 4, whole=True)}
    draws = Sample(LATIN, 20, 7, ranges).draws()
    assert sorted(int(draw["a"]) for draw in draws) == list(range(20))
    assert sorted(int(math.log2(draw["b"])) for draw in draws) == list(range(20))
    assert set(Counter(draw["c"] for draw in draws).values()) == {5}


def test_more_random_draws_and_more_settings_leave_those_that_there_are():
    ranges = {"a": Range(0, 1), "b": Range(0, 1)}
    few, many = Sample(RANDOM, 5, 3, ranges).draws(), Sample(RANDOM, 9, 3, ranges).draws()
    assert many[:5] == few
    wider = Sample(RANDOM, 5, 3, {"z": Range(0, 1)} | ranges).draws()
    assert [{"a": draw["a"], "b": draw["b"]} for draw in wider] == few


def test_a_list_is_combined_with_the_grid_and_every_seed(write):
    file = write(
        BASE + "list: [{eta: 3}, {eta: 4, radio: {loss: 0.1}}]\ngrid: {lambda_ms: [100, 200]}\nseeds: 2"
    )
    paths = [run.path.as_posix() for run in expand(read_experiment(str(file)))]
    assert paths == [
        f"{cell},lambda_ms={ms}/seed-{seed}"
        for cell in ("eta=3", "eta=4,radio.loss=0.1") for ms in (100, 200) for seed in (1, 2)
    ]  # fmt: skip


def test_a_block_has_a_list_or_a_sample_of_its_own_or_that_of_the_file(write):
    file = write(
        BASE + "random: {n: 3, ranges: {eta: {min: 2, max: 9}}}\n"
        "blocks: [{base: {lambda_ms: 100}}, {random: {n: 2, ranges: {radio.loss: [0, 0.1, 0.2]}}}]"
    )
    blocks = read_experiment(str(file)).blocks
    assert [(block.sample.n, list(block.sample.ranges)) for block in blocks] == [
        (3, ["eta"]),
        (2, ["radio.loss"]),
    ]


def test_a_sample_is_written_down_as_it_was_given(write):
    text = BASE + f"list: [{{epsilon_deg: 3}}]\nneeds: {{cores: 2}}\nlatin_hypercube:\n  n: 5\n{RANGES}"
    first = read_experiment(str(write(text)))
    again = read_experiment(str(write(as_file(first), "again.yaml")))
    assert expand(again) == expand(first)
    assert again.blocks == first.blocks


BAD = {
    "no mapping": ("random: 5", "random: 5 is not a mapping with n, seed, ranges"),
    "no n": ("random: {ranges: {eta: [3]}}", "random: n: None is not a number of draws"),
    "no ranges": ("random: {n: 5}", "random: ranges: None is not a mapping"),
    "a part": ("random: {n: 5, rnges: {}, ranges: {eta: [3]}}", "random: rnges: no such part; did you mean 'ranges'"),
    "a seed": ("random: {n: 5, seed: -1, ranges: {eta: [3]}}", "random: seed: -1 is not a whole number"),
    "a setting": ("random: {n: 5, ranges: {etta: {min: 1, max: 2}}}", "random: ranges: etta: no such setting; did you"),
    "a bound": ("random: {n: 5, ranges: {eta: {min: 1, mx: 2}}}", "eta: mx: no such part; did you mean 'max'?"),
    "a bound that is no number": ("random: {n: 5, ranges: {eta: {min: a, max: 2}}}", "eta: min: 'a' is not a number"),
    "a bound out of range": ("random: {n: 5, ranges: {eta: {min: 0, max: 2}}}", "eta: 0 is out of range; whole number"),
    "bounds the wrong way": ("random: {n: 5, ranges: {eta: {min: 4, max: 3}}}", "eta: min 4 is above max 3"),
    "a logarithm of 0": ("random: {n: 5, ranges: {radio.loss: {min: 0, max: 0.1, scale: log}}}", "has no logarithm"),
    "a scale": ("random: {n: 5, ranges: {eta: {min: 3, max: 4, scale: lg}}}", "scale: 'lg' is not one of linear"),
    "whole of half": ("random: {n: 5, ranges: {lambda_ms: {min: 1.5, max: 4, whole: true}}}", "whole bounds"),
    "a range of words": ("random: {n: 5, ranges: {thaw.policy: {min: 1, max: 2}}}", "is not a list of values"),
    "a word": ("random: {n: 5, ranges: {thaw.policy: [tmer]}}", "did you mean 'timer'?"),
    "a sample of seeds": ("random: {n: 5, ranges: {seed: {min: 1, max: 9}}}", "random: seed: is not given here"),
    "two samples": ("random: {n: 5, ranges: {eta: [3]}}\nlatin_hypercube: {n: 5, ranges: {eta: [3]}}", "give one of"),
    "grid and sample": ("grid: {eta: [3]}\nrandom: {n: 5, ranges: {eta: [3]}}", "random: eta: stands in grid, too"),
    "base and sample": ("base: {eta: 3}\nrandom: {n: 5, ranges: {eta: [3]}}", "base: eta: stands in random, too"),
    "no list": ("list: {eta: 3}", "list: {'eta': 3} is not a list of settings"),
    "a list's setting": ("list: [{eta: 3}, {etta: 3}]", "list entry 2: etta: no such setting; did you mean 'eta'?"),
    "a list's entry twice": ("list: [{eta: 3}, {eta: 3}]", "list entry 2: is given twice"),
    "list and grid": ("list: [{eta: 3}]\ngrid: {eta: [3]}", "list: eta: stands in grid, too"),
    "a need": ("needs: {core: 3}", "needs: core: no such need; did you mean 'cores'?"),
    "half a core": ("needs: {cores: 0.5}", "needs: cores: 0.5 is not a whole number, 1 to 1024"),
    "no memory": ("needs: {memory_mb: 0}", "needs: memory_mb: 0 is not megabytes"),
    "needs of a block": ("blocks: [{needs: 3}]", "block 1: needs: 3 is not a mapping"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_is_refused_on_one_line(case, write):
    text, line = BAD[case]
    with pytest.raises(BadInput) as refused:
        read_experiment(str(write(text)))
    [said] = refused.value.lines
    assert said.startswith(str(write(text)))
    assert line in said
