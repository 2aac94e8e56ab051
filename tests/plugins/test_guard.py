"""A plugin of another package that goes wrong is named, with its package: before the run, or when it happens."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from swarmer.config import load_config
from swarmer.engines.stopping import PATIENCE_S
from swarmer.entry_points import _installed
from swarmer.errors import BadInput, PluginFailed
from swarmer.experiments.one_run import perform
from swarmer.plan import make_plan, make_sensor, make_thaw_policy
from swarmer.plugins.arrays import fixes_of, like
from swarmer.plugins.fixing import FIXED, Fixes
from swarmer.plugins.guard import GuardedLocalizer, vector_of

GROUPS = {
    "technique": "swarmer.localizers", "sensing.model": "swarmer.sensor_errors", "thaw.policy": "swarmer.thaw_policies",
}  # fmt: skip
BASE = ["shape=sphere", "points=12", "engine=virtual", "duration_s=5", "recording.enabled=false"]
number = iter(range(1000))

DISPLACEMENT = "class It:\n    def displacement(self, measured, ground_truth):\n        {}\n"
LEGS = DISPLACEMENT.format("return (1, 2, 3)") + "    def legs(self, measured, ground_truth):\n        {}\n"
DRAW = "def It(share, accurate):\n    return lambda rng: {}\n"
DELAY = """from swarmer.protocol.thaw import Silent
class It(Silent):
    def __init__(self, count, h_s, spread):
        {}
    def delay_s(self, rng):
        {}
"""
SOON = DELAY.format("pass", "return 1.0")


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Make an installed package of one module, and the setting that picks what it adds."""

    def make(setting, source):
        name = f"strange{next(number)}"
        home = tmp_path / name
        facts = home / f"{name}-2.dist-info"
        facts.mkdir(parents=True)
        (home / f"{name}.py").write_text(source)
        (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}-package\nVersion: 2\n")
        (facts / "entry_points.txt").write_text(f"[{GROUPS[setting]}]\n{name} = {name}:It\n")
        monkeypatch.syspath_prepend(home)
        return name, f"{setting}={name}"

    return make


@pytest.mark.parametrize(
    ("setting", "source", "said"),
    [
        ("technique", DISPLACEMENT.format("return (1.0, 2.0)"), "gave (1.0, 2.0), not three numbers"),
        ("technique", DISPLACEMENT.format("return None"), "gave None, not three numbers"),
        ("technique", DISPLACEMENT.format("return 'abc'"), "gave 'abc', not three numbers"),
        ("technique", DISPLACEMENT.format("return (1.0, float('nan'), 0.0)"), "gave (1.0, nan, 0.0), which is not"),
        ("technique", DISPLACEMENT.format("return (1e999, 0, 0)"), "gave (inf, 0, 0), which is not finite"),
        ("technique", DISPLACEMENT.format("return (1e300, 1, 1)"), "gave (1e+300, 1, 1), which is farther than 1e+09"),
        ("technique", LEGS.format("return [(-2e9, 0, 0)]"), "which is farther than 1e+09 cells"),
        ("technique", DISPLACEMENT.format("return measured[3]"), "raised IndexError: tuple index out of range"),
        ("technique", "class It:\n    pass\n", "which has no displacement"),
        ("technique", "class It:\n    def __init__(self, needed):\n        1\n", "made without arguments raised"),
        ("technique", "import nowhere_to_be_found\n", "cannot be imported: raised ModuleNotFoundError"),
        ("technique", "It = 3\n", "made without arguments raised TypeError"),
        ("technique", "That = 3\n", "cannot be imported: raised AttributeError"),
        ("technique", LEGS.format("return ((1, 2), (3, 4))"), "legs((3, -1, 2), (2, 0.5, 2)) gave (1, 2)"),
        ("technique", LEGS.format("return ()"), "gave (), not one leg or more"),
        ("sensing.model", DRAW.format("None"), "a draw gave None, not a finite number"),
        ("sensing.model", DRAW.format("float('nan')"), "a draw gave nan, not a finite number"),
        ("sensing.model", DRAW.format("-1e300"), "a draw gave -1e+300, which is beyond 1e+09"),
        ("sensing.model", DRAW.format("1 / 0"), "a draw raised ZeroDivisionError"),
        ("sensing.model", "def It(share, accurate):\n    return 1.0\n", "gave 1.0, not a function of a generator"),
        ("sensing.model", "def It():\n    return 1.0\n", "raised TypeError"),
        ("thaw.policy", DELAY.format("pass", "return -1.0"), "delay_s gave -1.0, not None or seconds above 0"),
        ("thaw.policy", DELAY.format("pass", "return float('inf')"), "delay_s gave inf"),
        ("thaw.policy", DELAY.format("raise OSError('no\\nway')", "return 1.0"), "raised OSError: no way"),
        ("thaw.policy", "class It:\n    def __init__(self, *_):\n        pass\n", "gave what has no delay_s"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_before_a_run(package, setting, source, said):
    name, choice = package(setting, source)
    with pytest.raises(BadInput) as refused:
        make_plan(load_config(None, [*BASE, choice]))
    line = str(refused.value)
    assert line.startswith(f"{setting}: '{name}' of the package {name}-package 2: ")
    assert said in line
    assert "\n" not in line
    assert refused.value.exit_status == 2


@pytest.mark.parametrize("engine", ["virtual", "rounds"])
def test_what_grows_beyond_any_display_ends_the_run_and_not_with_a_traceback(package, tmp_path, engine):
    later = "class It:\n" + LATE.format("displacement", "(0.0, 0.0, 0.0)", 9, "(1e300, 1e300, 1e300)")
    name, choice = package("technique", later)
    base = [one for one in BASE if not one.startswith("engine")]
    outcome = perform(load_config(None, [*base, f"engine={engine}", choice]), tmp_path / "run")
    assert outcome.status == "failed"
    assert outcome.message.startswith(f"technique: '{name}' of the package {name}-package 2: ")
    assert "farther than 1e+09 cells" in outcome.message


def test_arrays_are_held_to_the_same():
    near = np.zeros((2, 3))
    assert like(near)(near).shape == (2, 3)
    with pytest.raises(ValueError, match="farther than"):
        like(near)(np.array([[0, 0, 0], [0, -1e300, 0]]))
    with pytest.raises(ValueError, match="farther than"):
        fixes_of(Fixes(np.full((1, 3), 2e9), np.full(1, FIXED), np.zeros(1)))


def test_a_name_that_two_packages_have_is_refused(package, tmp_path, monkeypatch):
    """Or it would be chance whose technique flies: a stranger's, under the name of ours."""
    package("technique", DISPLACEMENT.format("return measured"))
    facts = next(tmp_path.glob("*/*.dist-info/entry_points.txt"))
    facts.write_text("[swarmer.localizers]\nsignal_strength = elsewhere:It\n")
    _installed.cache_clear()
    with pytest.raises(
        BadInput, match=r"a single package has; strange\d+-package 2 and swarmer .* call one of theirs"
    ):
        make_plan(load_config(None, BASE))
    facts.write_text("")
    _installed.cache_clear()
    assert make_plan(load_config(None, BASE))


def test_a_policy_that_counts_reports_needs_epochs(package):
    _, choice = package("thaw.policy", SOON)
    with pytest.raises(BadInput, match="needs epochs: true"):
        make_plan(load_config(None, [*BASE, choice, "epochs=false"]))
    _, choice = package("thaw.policy", SOON + "    needs_epochs = False\n")
    assert make_plan(load_config(None, [*BASE, choice, "epochs=false"])).rules.thaw_policy.endswith(":It")


LATE = "    calls = 0\n    def {}(self, *_):\n        It.calls += 1\n        return {} if It.calls < {} else {}\n"


@pytest.mark.parametrize(
    ("setting", "source", "said"),
    [
        ("technique", "class It:\n" + LATE.format("displacement", "(0.0, 0.0, 0.0)", 9, "(1, float('nan'), 1)"), "nan"),
        ("technique", "class It:\n" + LATE.format("displacement", "(0.0, 0.0, 0.0)", 9, "1 / 0"), "ZeroDivisionError"),
        ("sensing.model", "class It:\n    def __init__(self, share, accurate):\n        pass\n"
         + LATE.format("__call__", "1.0", 25, "[]"), "a draw gave [], not a finite number"),
        ("thaw.policy", SOON + LATE.format("joined", "None", 5, "1 / 0"), "joined raised"),
        ("thaw.policy", SOON + LATE.format("begins", "None", 5, "1 / 0"), "begins raised"),
    ],
)  # fmt: skip
def test_what_goes_wrong_later_ends_the_run_and_says_whose_it_is(package, tmp_path, setting, source, said):
    name, choice = package(setting, source)
    outcome = perform(load_config(None, [*BASE, choice]), tmp_path / "run")
    assert outcome.status == "failed"
    assert outcome.message.startswith(f"{setting}: '{name}' of the package {name}-package 2: ")
    assert said in outcome.message
    assert outcome.summary["message"] == outcome.message


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("def displacement(self, d, g):\n        return d if (d, g) in TRIED else None", "displacement gave None, not"),
        ("def displacement(self, d, g):\n        return d\n"
         "    def displacements(self, d, g):\n        return d if len(d) == 3 else d[:, :2]",
         "displacements gave an array float64(1"),
        ("references = 3\n    asked = 0\n    def fix(self, d, g, dim):\n        It.asked += 1\n"
         "        return d[0] if It.asked < 3 else (1, 2)", "fix gave (1, 2), not three numbers"),
    ],
)  # fmt: skip
def test_the_rounds_engine_says_it_too(package, tmp_path, body, said):
    source = f"from swarmer.plugins.guard import TRIED\nclass It:\n    {body}\n"
    name, choice = package("technique", source)
    settings = ["shape=sphere", "points=20", "engine=rounds", "recording.enabled=false", choice]
    outcome = perform(load_config(None, settings), tmp_path / "run")
    assert outcome.status == "failed"
    assert outcome.message.startswith(f"technique: '{name}' of the package {name}-package 2: {said}")


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("def displacement(self, d, g):\n        return d\n"
         "    def displacements(self, d, g):\n        return d[:, :2]", "displacements gave an array float64(3, 2)"),
        ("def displacement(self, d, g):\n        return d\n"
         "    def displacements(self, d, g):\n        return d * float('nan')",
         "displacements gave vectors that are not"),
        ("references = 3\n    def fix(self, d, g, dim):\n        return (1, 2)", "fix gave (1, 2), not three numbers"),
        ("references = 3\n    def fix(self, d, g, dim):\n        return d[7]", "fix raised IndexError"),
        ("references = 3\n    def fix(self, d, g, dim):\n        return d[0]\n"
         "    def fixes(self, d, g, dim):\n        return d[0]", "fixes raised AttributeError"),
        ("references = 'many'\n    def fix(self, d, g, dim):\n        return d[0]",
         "made without arguments gave what has"),
        ("references = 3\n    def displacement(self, d, g):\n        return d", "references 3, and no fix"),
        ("def displacement(self, d, g):\n        raise SystemExit(7)", "raised SystemExit: 7"),
    ],
)  # fmt: skip
def test_what_only_the_rounds_engine_asks_is_refused_before_the_run_too(package, body, said):
    name, choice = package("technique", f"class It:\n    {body}\n")
    with pytest.raises(BadInput) as refused:
        make_plan(load_config(None, ["shape=sphere", "points=20", "engine=rounds", choice]))
    assert str(refused.value).startswith(f"technique: '{name}' of the package {name}-package 2: ")
    assert said in str(refused.value)


def test_no_fix_is_an_answer(package):
    source = (
        "from swarmer.plugins import NoFix\n"
        "class It:\n    references = 3\n    def fix(self, d, g, dim):\n        raise NoFix\n"
    )
    _, choice = package("technique", source)
    make_plan(load_config(None, ["shape=sphere", "points=20", "engine=rounds", choice]))


def test_what_needs_several_references_is_refused_where_there_is_one(package):
    _, choice = package(
        "technique", "class It:\n    references = 3\n    def fix(self, d, g, dim):\n        return d[0]\n"
    )
    with pytest.raises(BadInput, match="needs 3 references"):
        make_plan(load_config(None, [*BASE, choice]))


@pytest.mark.processes
def test_an_fls_process_says_it_before_it_ends(package, tmp_path):
    # Good while the run is planned, and not in an FLS process, which has no numpy.
    source = "import sys\n" + DISPLACEMENT.format(
        "return (0, 0, 0 if 'numpy' in sys.modules else float('nan'))"
    )
    name, choice = package("technique", source)
    code = f"import sys; sys.path[:0] = {sys.path!r}; from swarmer import cli; cli.main_run()"
    settings = [*(one for one in BASE if not one.startswith("engine")), choice]
    done = subprocess.run(
        [sys.executable, "-c", code, *(word for one in settings for word in ("--set", one)), "--out", "run"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert f"technique: '{name}' of the package {name}-package 2:" in " ".join(done.stderr.split()), (
        done.stderr
    )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["status"], "which is not finite" in summary["message"]) == ("failed", True)


HANGS = (
    "import os, time\nclass It:\n    calls = 0\n    def displacement(self, measured, ground_truth):\n"
    "        It.calls += 1\n        if It.calls > 9:\n            open('hangs', 'w').close()\n"
    "            while True:\n                time.sleep(1)\n        return measured\n"
)


@pytest.mark.parametrize("engine", ["virtual", "rounds"])
def test_a_run_whose_technique_hangs_ends_with_another_ctrl_c(package, tmp_path, engine):
    _, choice = package("technique", HANGS)
    code = f"import sys; sys.path[:0] = {sys.path!r}; from swarmer import cli; cli.main_run()"
    settings = ["shape=sphere", "points=12", f"engine={engine}", "recording.enabled=false", choice]
    process = subprocess.Popen(
        [sys.executable, "-c", code, *(word for one in settings for word in ("--set", one)), "--out", "run"],
        cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    try:
        while not (tmp_path / "hangs").exists():
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)  # noted; the technique has the processor
        time.sleep(PATIENCE_S + 0.5)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "interrupted"


def test_ours_are_not_guarded():
    rules = make_plan(load_config(None, BASE)).rules
    assert make_thaw_policy(rules, 1).__class__.__module__ == "swarmer.protocol.roster"
    assert make_sensor(rules).error(None) == 1.0


def test_what_numpy_gives_is_a_vector_too(package):
    import numpy as np

    assert vector_of(np.array([1.0, 2.0, 3.0])) == (1.0, 2.0, 3.0)
    assert all(type(part) is float for part in vector_of(np.arange(3)))
    with pytest.raises(ValueError, match="not three numbers"):
        vector_of(np.ones((3, 3)))
    name, _ = package("technique", DISPLACEMENT.format("return ground_truth"))
    assert GuardedLocalizer(f"{name}:It").displacement((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) == (0.0, 1.0, 0.0)
    assert not hasattr(GuardedLocalizer(f"{name}:It"), "legs")
    with pytest.raises(PluginFailed):
        GuardedLocalizer("nowhere_at_all:It")
