"""Settings: bad values generated from the declared ranges, layers, presets, and what an error says."""

import dataclasses
import math
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from swarmer.config import BATTERY_S, RunConfig, load_config, setting_facts
from swarmer.errors import BadInput
from swarmer.settings import Setting
from swarmer.settings_file import flat_layers, preset_dir, preset_names

ROOT = Path(__file__).resolve().parent.parent
FACTS = setting_facts()
NUMBERS = [fact for fact in FACTS if fact.kind in ("number", "whole")]
BY_NAME = pytest.mark.parametrize("fact", FACTS, ids=lambda fact: fact.name)
CONTRACT_NAMES = {
    "shape",
    "points",
    "engine",
    "seed",
    "duration_s",
    "time_scale",
    "lambda_ms",
    "epsilon_deg",
    "eta",
    "lease_ms",
    "m",
    "technique",
    "anchor",
    "neighbours",
    "duplicates",
    "thaw.policy",
    "radio.loss",
    "radio.loss_sender",
    "radio.loss_receiver",
    "radio.delay_ms",
    "radio.mac",
    "failure.rate",
    "recording.rate_hz",
}

# What another setting must be for every value of this one to be good.
BESIDES = {
    "challenge_on_available": {"accept_gap_ms": 20},
    "epochs": {"thaw.policy": "timer"},
    "virtual.latency_min_ms": {"virtual.latency_max_ms": 60_000},
    "virtual.latency_max_ms": {"virtual.latency_min_ms": 0},
    "battery.standby_group": {"battery.light_s": 30},
    "transition.shape": {"transition.at_s": 5},
    "transition.at_s": {"transition.shape": "cube", "duration_s": 1_000_000},
    "transition.points": {"transition.shape": "cube", "transition.at_s": 5},
}

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def refused(*args: object, **flags: object) -> BadInput:
    with pytest.raises(BadInput) as caught:
        load_config(*args, **flags)
    line = str(caught.value)
    assert caught.value.exit_status == 2
    assert line.isprintable()
    assert len(line) < 1000
    return caught.value


def one_line_at_most(action: Callable[[], RunConfig]) -> bool:
    try:
        return isinstance(action(), RunConfig)
    except BadInput as error:
        return str(error).isprintable()


def good_values(fact: Setting) -> st.SearchStrategy:
    if fact.kind in ("number", "whole"):
        low = fact.low + 1e-9 if fact.above else fact.low
        numbers = (
            st.floats(low, fact.high) if fact.kind == "number" else st.integers(int(low), int(fact.high))
        )
        values = numbers | st.sampled_from(fact.words) if fact.words else numbers
    elif fact.kind in ("choice", "name"):
        values = st.sampled_from(fact.words)
    elif fact.kind == "flag":
        values = st.booleans()
    elif fact.kind == "text":
        values = st.text("abcxyz019./_- é", min_size=1).filter(str.strip)
    elif fact.kind == "rows":
        plain = st.none() | st.booleans() | st.integers() | st.floats(-1e9, 1e9) | st.text("abc:{} é")
        values = st.lists(
            st.dictionaries(st.text("abc", min_size=1), plain | st.lists(plain, max_size=3)), max_size=3
        )
    else:
        values = st.lists(st.lists(st.floats(-100, 100), min_size=3, max_size=3), min_size=1, max_size=16)
    return values | st.none() if fact.none else values


def bad_values(fact: Setting) -> st.SearchStrategy:
    """Wrong type, wrong word, or just outside the range: from the declaration alone."""
    wrong = st.sampled_from([[], {}, {"a": 1}, "", "no such word", "\0", "nan", "-3"])
    if not fact.none:
        wrong |= st.none()
    if fact.kind in ("number", "whole"):
        beyond = [
            fact.high + 1,
            fact.high * 2 + 1,
            fact.low - 1,
            -math.inf,
            math.inf,
            math.nan,
            True,
            False,
            10**400,
        ]
        beyond += [fact.low] if fact.above else []
        beyond += [fact.low + 0.5] if fact.kind == "whole" else []
        return wrong | st.sampled_from(beyond)
    if fact.kind in ("choice", "name"):
        return wrong | st.text(max_size=12).filter(lambda text: text not in fact.words) | st.just(1.5)
    if fact.kind == "flag":
        return wrong | st.sampled_from([0, 1, "true", "on", 0.0])
    if fact.kind == "text":
        texts = st.integers() | st.booleans() | st.sampled_from(["", " ", "a\0b", "a\nb", "x" * 5000, []])
        return texts if fact.none else texts | st.none()
    if fact.kind == "rows":
        return wrong.filter(lambda value: value != []) | st.sampled_from(
            [[3], ["kill"], [{}, None], [{}] * 10_001]
        )
    return wrong | st.sampled_from(
        [[[0, 0]], [[0, 0, "x"]], [[0, 0, math.nan]], [[0, 0, 0]] * 17, [0, 0, 0], 5]
    )


def layered(name: str, value: object) -> dict:
    """As a settings file gives it: nested."""
    group, _, field = name.rpartition(".")
    return {group: {field: value}} if group else {field: value}


@BY_NAME
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_a_bad_value_is_refused_by_name(fact, data):
    value = data.draw(bad_values(fact))
    with pytest.raises(BadInput) as caught:
        RunConfig.from_flat({fact.name: value})
    line = caught.value.lines[0]
    assert line.startswith(f"{fact.name}: ")
    assert line.endswith(fact.allowed)
    assert line.isprintable()


@BY_NAME
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_a_good_value_survives_the_file(fact, data):
    value = data.draw(good_values(fact))
    batteries = ("failure.battery_s", "battery.light_s", "battery.flight_s")
    assume(fact.name not in batteries or value == 0 or value >= BATTERY_S)  # a rule of its own
    if fact.name in ("transition.shape", "transition.at_s"):  # each needs the other
        assume(value is not None and value != 1_000_000)
    besides = BESIDES.get(fact.name, {})
    config = RunConfig.from_flat({fact.name: value, **besides})
    assert RunConfig.from_flat(yaml_flat(config)) == config


def yaml_flat(config: RunConfig) -> dict:
    return flat_layers(None, (), yaml.safe_load(config.to_yaml()), FACTS)


@BY_NAME
def test_the_default_is_in_its_own_range(fact):
    assert fact.checked(fact.default) == fact.default
    assert fact.help
    assert fact.help[0] not in "AEIOU" or fact.help.isupper() or fact.help.split()[0] in ("H,", "UDP")
    assert fact.default is not None or fact.none


@given(
    found=st.dictionaries(
        st.sampled_from([fact.name for fact in FACTS] + ["radio", "x"]), anything, max_size=4
    )
)
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_mapping_gives_a_config_or_one_line(found):
    assert one_line_at_most(lambda: RunConfig.from_flat(found))


@given(text=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_file_gives_a_config_or_one_line(tmp_path, text):
    file = tmp_path / "any.yaml"
    file.write_bytes(text)
    assert one_line_at_most(lambda: load_config(file))


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("lease_ms=-5", "lease_ms: -5 is out of range; milliseconds, 1 to 60000 (default 250)"),
        ("radio.los=1", "radio.los: no such setting; did you mean 'radio.loss'?"),
        ("loss=1", "loss: no such setting; did you mean 'radio.loss'?"),
        ("radio=5", "radio: is a group of settings; give one of them, such as 'radio.loss'"),
        ("m=3", "m: 3 is not a choice; inf or 2 (default inf)"),
        ("anchor=lowset", "anchor: 'lowset' is not a choice; did you mean 'lowest'? lowest, largest, smallest, "
                          "challenger or random (default lowest)"),
        ("engine=clustr", "engine: 'clustr' is not a choice; did you mean 'cluster'? process, virtual, rounds or "
                          "cluster (default process)"),
        ("rounds=5", "rounds: is a group of settings; give one of them, such as 'rounds.max_rounds'"),
        ("lambda_ms=abc", "lambda_ms: 'abc' is not a number; milliseconds, 1 to 600000 (default 500)"),
        ("lambda_ms=1:30", "lambda_ms: '1:30' is not a number; milliseconds, 1 to 600000 (default 500)"),
        ("radio.mac=1", "radio.mac: 1 is neither true nor false; true or false (default false)"),
        ("seed", "--set: 'seed' is not NAME=VALUE, such as radio.loss=0.1"),
    ],
)  # fmt: skip
def test_what_an_error_says(override, line):
    assert str(refused(overrides=[override])) == line


@pytest.mark.parametrize(
    ("override", "name", "value"),
    [
        ("lambda_ms=1e3", "lambda_ms", 1000.0),
        ("seed=7.0", "seed", 7),
        ("m=2.0", "m", 2),
        ("m=.inf", "m", "inf"),
        ("thaw.policy=off", "thaw.policy", "off"),
        ("busy_join=off", "busy_join", "off"),
        ("neighbour_reply=off", "neighbour_reply", False),
        ("eta=null", "eta", None),
        ("shape=1e3", "shape", "1e3"),
        ("shape=a=b: c", "shape", "a=b: c"),
        ("time_scale=0.5", "time_scale", 0.5),
        ("radio={loss: 0.25}", "radio.loss", 0.25),
        ("deploy.dispatchers=[[0, 0, 0], [9, 0, 0]]", "deploy.dispatchers", ((0, 0, 0), (9, 0, 0))),
    ],
)
def test_what_an_override_means(override, name, value):
    found = load_config(overrides=[override]).flat()[name]
    assert found == value
    assert type(found) is type(value)


def test_everything_wrong_is_counted_and_one_line_shown():
    error = refused(overrides=["lease_ms=0", "radio.loss=2", "nope=1"])
    assert str(error).endswith("(and 2 more)")
    assert [line.partition(":")[0] for line in error.lines] == ["nope", "lease_ms", "radio.loss"]
    assert pickle.loads(pickle.dumps(error)).lines == error.lines


def test_later_layers_win(tmp_path):
    (tmp_path / "base.yaml").write_text("seed: 2\nradio: {loss: 0.1, mac: true}\nlambda_ms: 1e2\n")
    (tmp_path / "top.yaml").write_text("extends: base.yaml\nradio:\n  loss: 0.2\nthaw.spread: 3\nrange:\n")
    config = load_config(tmp_path / "top.yaml", ["seed=3", "seed=4"], lease_ms=100, points=None)
    assert (config.seed, config.radio.loss, config.radio.mac, config.thaw.spread) == (4, 0.2, True, 3)
    assert (config.lambda_ms, config.lease_ms, config.points) == (100, 100, None)
    assert config.changed(**{"radio.loss": 0}).flat() == config.flat() | {"radio.loss": 0}


def test_one_end_of_the_radio_may_differ():
    radio = load_config(
        overrides=["radio.loss=0.1", "radio.loss_sender=0", "radio.reorder_receiver=0.5"]
    ).radio
    assert (radio.sender_loss, radio.receiver_loss) == (0, 0.1)
    assert (radio.sender_reorder, radio.receiver_reorder) == (0, 0.5)


def test_what_follows_from_the_defaults():
    config = load_config()
    assert (config.eta_of(760), config.eta_of(4), config.changed(eta=9).eta_of(4)) == (5, 3, 3)
    assert config.thaw_h_s(1024) == 10
    assert config.waiting_bound == 500
    assert config.changed(lease_ms=400).waiting_bound == 800
    assert (config.merge_limit, config.changed(m=2).merge_limit) == (math.inf, 2)
    assert "range.start_cells" in str(refused(range={"start_cells": 9, "max_cells": 5}))


@pytest.mark.parametrize("policy", ["roster", "census", "corner"])
def test_a_policy_that_counts_reports_needs_epochs(policy):
    line = str(refused(epochs=False, thaw={"policy": policy}))
    assert "\n" not in line
    assert "epochs" in line
    assert policy in line
    assert "thaw.policy: timer" in line
    assert load_config(thaw={"policy": policy}).epochs
    assert not load_config("paper").epochs


def test_what_counts_as_rest_follows_from_what_is_flown_at_all():
    assert load_config().rest_below_cells == pytest.approx(0.01)
    assert load_config(flight_threshold_cells=0.1).rest_below_cells == pytest.approx(1.0)
    assert load_config(thaw={"rest_below_cells": 0}).rest_below_cells == 0


def test_accepting_without_a_gap_and_challenging_at_once_would_flood():
    line = str(refused(challenge_on_available=True))
    assert "accept_gap_ms" in line
    assert "challenge_on_available" in line
    assert load_config(challenge_on_available=True, accept_gap_ms=1).accept_gap_ms == 1


FILES = {
    "alias bomb": ("a: &a [x, x]\nb: &b [*a, *a]\n", "line 2, column 8: an alias (*name) is not allowed"),
    "3,000 brackets": ("shape: " + "[" * 3000, "nested too deep"),
    "deep mapping": ("".join(" " * depth + "a:\n" for depth in range(100)), "nested too deep"),
    "10 MB": ("# " + "x" * 10_000_000, "too large; at most 1 MB"),
    "100,000 keys": ("".join(f"a{number}: 1\n" for number in range(100_000)), "too long; at most 10000"),
    "4,000 unknown keys": ("".join(f"a{number}: 1\n" for number in range(4000)), "(and 3999 more)"),
    "twice": ("seed: 1\nseed: 2\n", "line 2, column 1: 'seed' is given twice"),
    "twice, two ways": ("radio.loss: 0.1\nradio: {loss: 0.2}\n", "radio.loss: is given twice"),
    "a list": ("- seed\n", "must be a mapping"),
    "a word": ("seed\n", "must be a mapping"),
    "two documents": ("seed: 1\n---\nseed: 2\n", "but found another document"),
    "python tag": ("seed: !!python/object/apply:os.system [true]\n", "is not allowed; plain values only"),
    "binary tag": ("seed: !!binary aGVsbG8=\n", "is not allowed; plain values only"),
    "set tag": ("seed: !!set {1}\n", "is not allowed; plain values only"),
    "merge key": ("<<: {seed: 2}\n", "a key must be a name"),
    "key off": ("off: 1\n", "a key must be a name"),
    "key list": ("[1, 2]: 3\n", "a key must be a name"),
    "tab": ("radio:\n\tloss: 1\n", "line 2, column 1: found character '\\t' that cannot start any token"),
    "an experiment": ("base: {seed: 1}\n", "file.yaml is an experiment file; `swarmer sweep "),
    "unclosed": ("radio: {loss: 1\n", "expected ',' or '}'"),
    "huge integer": ("seed: " + "9" * 5000 + "\n", "seed: '9999"),
    "not UTF-8": (b"shape: \xff\xfe\n", "not YAML"),
    "extends itself": ("extends: file.yaml\n", "extends: file.yaml -> file.yaml never ends"),
    "extends nothing": ("extends: nowhere\n", "config: no file 'nowhere'"),
    "extends a list": ("extends: [default]\n", "is not a preset's name or a path"),
    "date": ("seed: 2020-13-45\n", "seed: '2020-13-45' is not a number"),
    "time": ("duration_s: 1:30\n", "duration_s: '1:30' is not a number"),
}


@pytest.mark.parametrize(("content", "words"), FILES.values(), ids=FILES)
def test_a_hostile_file_is_refused_with_one_line(tmp_path, content, words):
    file = tmp_path / "file.yaml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert words in str(refused(file))


@pytest.mark.parametrize(
    "file", ["papr", "no/such.yaml", "a\0b", "x" * 5000, "/dev/null/x", "/", "/dev/zero"]
)
def test_a_file_that_is_none_is_refused(file):
    refused(file)


def test_a_chain_of_files_ends(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.yaml").write_text(f"extends: {other}.yaml\n")
    assert "a.yaml -> b.yaml -> a.yaml" in str(refused(tmp_path / "a.yaml"))


def test_the_presets():
    assert preset_names() == ["authors_code", "default", "paper"]
    assert load_config("default") == load_config()
    paper, authors = load_config("paper"), load_config("authors_code")
    assert (paper.neighbours, paper.probe_every, paper.epochs, paper.busy_join) == (
        "nearest",
        0,
        False,
        "all",
    )
    assert (authors.m, authors.thaw.policy, authors.neighbour_reply, authors.deploy.error) == (
        2,
        "centralized",
        False,
        "shared",
    )
    for name in preset_names():
        config = load_config(name)
        assert RunConfig.from_flat(yaml_flat(config)) == config


def test_the_names_scripts_rely_on():
    assert not CONTRACT_NAMES - {fact.name for fact in FACTS}


def test_the_resolved_file_runs_again(tmp_path):
    config = load_config("authors_code", ["radio.loss=1e-3", "busy_join=off", "shape=./a: b"], seed=5)
    text = config.to_yaml()
    (tmp_path / "config.yaml").write_text(text)
    assert load_config(tmp_path / "config.yaml") == config
    assert load_config(tmp_path / "config.yaml").to_yaml() == text
    assert re.match(r"# .*\n[^#]*$", text)


def test_a_config_does_not_change():
    with pytest.raises(ValueError, match="frozen"):
        load_config().seed = 5
    with pytest.raises(dataclasses.FrozenInstanceError):
        FACTS[0].default = 5


def test_generated_files_are_up_to_date():
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "settings_reference.py", "--check"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{done.stdout}{done.stderr}`make fix` makes them anew"


def test_the_settings_load_no_numerical_library():
    program = (
        "import sys, swarmer.config; print(*{'numpy', 'scipy', 'matplotlib', 'rerun'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_presets_lie_where_the_package_is():
    assert (preset_dir() / "default.yaml").is_file()
