"""What a comparison says of a table, by hand; and `swarmer compare` from its options to its pages."""

import contextlib
import csv
import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
import termios

import pytest

from swarmer import cli
from swarmer.config import RunConfig
from swarmer.errors import BadInput
from swarmer.experiments import contest as contests
from swarmer.experiments.comparison import Measure, check_measures, chosen, compare
from swarmer.experiments.contest import contest, default_engine
from swarmer.experiments.experiment import FACTS
from swarmer.experiments.one_run import perform
from swarmer.experiments.results import flat
from swarmer.experiments.runs import asked_of, check_plans, expand
from swarmer.experiments.verdicts import (
    limit_lines,
    markdown,
    method_lines,
    pairs_csv,
    statements,
    table_rows,
)

pytestmark = pytest.mark.timeout(300)  # whole commands, on a busy machine
HEAD = "shape,technique,seed,status,hd_cells,time_to_hd_s.0.09,distance_cells_mean,message,run\n"
COMPARE = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer'; cli.main()"


def table(write, rows, head=HEAD):
    return write(head + "\n".join(",".join(map(str, row)) for row in rows) + "\n", "results.csv")


def rows_of(shape, technique, hds, times=None, status="done"):
    times = times or [4.0] * len(hds)
    return [
        (shape, technique, seed, status, hd, time, 10 + seed, "", f"{shape}-{technique}/seed-{seed}")
        for seed, (hd, time) in enumerate(zip(hds, times, strict=True), 1)
    ]


BASE = [1.0, 1.2, 0.9, 1.1, 1.3, 1.0, 0.8, 1.15]
WORSE = [value + 0.1 + 0.01 * at for at, value in enumerate(BASE)]


def test_a_small_difference_is_seen_where_it_is_the_same_on_every_seed(write):
    """Of two heaps of values nobody would tell: the spread of the seeds is larger than what they differ by."""
    path = table(write, rows_of("cat", "a", BASE) + rows_of("cat", "b", WORSE))
    comparison = compare(path)
    assert (comparison.between, comparison.within) == (("technique",), ())
    [hd] = [pair for pair in comparison.pairs if pair.measure.column == "hd_cells"]
    assert (hd.better, hd.effect, hd.less, hd.more) == (("a",), 1.0, 0, 8)
    assert hd.difference.estimate == pytest.approx(0.135)
    assert hd.test.p == hd.p == 2 / 2**8
    [line] = [line for line in statements(comparison) if "b more than a" in line]
    assert "by 0.135 [" in line
    assert "on 8 of 8 seeds (effect +1.00, p 0.0078)" in line


def test_what_is_not_shown_is_not_called_better(write):
    mixed = [value + (0.3 if at % 2 else -0.25) for at, value in enumerate(BASE)]
    comparison = compare(table(write, rows_of("cat", "a", BASE) + rows_of("cat", "b", mixed)))
    hd = next(pair for pair in comparison.pairs if pair.measure.column == "hd_cells")
    assert hd.better is None
    line = next(line for line in statements(comparison) if "hd" not in line and "b against a" in line)
    assert "no difference shown" in line
    assert "less on 4 of 8 seeds, more on 4" in line


def test_runs_of_one_seed_are_compared_and_others_left_out(write):
    """Seed 1 of b failed: its partner counts for a alone."""
    rows = rows_of("cat", "a", BASE) + rows_of("cat", "b", WORSE)
    rows[8] = (*rows[8][:3], "failed", "", "", "", "out of memory", rows[8][-1])
    comparison = compare(table(write, rows))
    hd = next(pair for pair in comparison.pairs if pair.measure.column == "hd_cells")
    assert (hd.difference.n, hd.more) == (7, 7)
    assert [row[1] for row in table_rows(comparison)] == ["runs", "8", "7 (1 failed)"]


def test_conditions_are_compared_each_for_itself_and_p_is_of_all_of_them(write):
    rows = [
        *rows_of("cat", "a", BASE), *rows_of("cat", "b", WORSE),
        *rows_of("hat", "a", WORSE), *rows_of("hat", "b", BASE),
    ]  # fmt: skip
    comparison = compare(table(write, rows))
    assert comparison.within == ("shape",)
    pairs = [pair for pair in comparison.pairs if pair.measure.column == "hd_cells"]
    assert [(pair.condition, pair.better) for pair in pairs] == [(("cat",), ("a",)), (("hat",), ("b",))]
    assert [pair.p for pair in pairs] == [2 * 2 / 2**8] * 2
    other = compare(table(write, rows), between=["shape"])
    assert other.within == ("technique",)
    assert {pair.better for pair in other.pairs if pair.measure.column == "hd_cells"} == {("cat",), ("hat",)}
    both = compare(table(write, rows), between=["shape", "technique"])
    assert both.within == ()
    assert len([pair for pair in both.pairs if pair.measure.column == "hd_cells"]) == 6


def test_shapes_compete_only_where_nothing_else_does():
    assert chosen([], ["shape", "oracle.count", "m"]) == ("oracle.count",)
    assert chosen([], ["shape", "m", "engine"]) == ("engine",)
    assert chosen([], ["shape"]) == ("shape",)


def test_the_absolute_hd_is_looked_at_where_oracles_are(write):
    """Who has none has not failed to come to stand right: nobody has looked."""
    head = "oracle.count,seed,status,rounds,hd_absolute_cells,rounds_to_hd_absolute.1,rounds_to_hd_absolute.0.09,run\n"
    rows = [(0, seed, "done", 9, 1.5, "", "", f"n{seed}") for seed in range(1, 4)]
    plain = compare(table(write, [(1, 1, "done", 9, 1.5, "", "", "x"), *rows], head))
    assert plain.measures == ()
    rows += [(1, seed, "done", 9, 0.1, 2, "" if seed == 1 else 5, f"o{seed}") for seed in range(1, 4)]
    [absolute] = compare(table(write, rows, head)).measures
    assert absolute.column == "hd_absolute_cells"
    timed = compare(table(write, rows, head), measures=["rounds_to_hd_absolute.0.09"])
    assert [row[-1] for row in table_rows(timed)[1:]] == ["–", "5 (2/3)"]


def test_who_never_got_there(write):
    times = [5.0, 5.5, 6.0, 5.2, 5.1, 5.9, 6.1, 5.3]
    rows = rows_of("cat", "a", BASE, times) + rows_of("cat", "b", BASE, [*times[:1], *[""] * 7])
    comparison = compare(table(write, rows))
    [time] = [pair for pair in comparison.pairs if pair.measure.timed]
    assert (time.better, time.less, time.more) == (("a",), 0, 7)
    text = " ".join(statements(comparison))
    assert "b later than a, by ∞ [0, ∞] in the median, on 7 of 8 seeds" in text
    assert [row[-2] for row in table_rows(comparison)][1:] == ["5.4 [5, 6.1]", "never [5, never] (1/8)"]


def test_it_is_the_test_that_says_who_is_better_where_the_median_of_differences_is_0(write):
    """Neither gets there on most seeds, and on all others a alone does."""
    some = [*[""] * 8, *[5.0] * 6]
    hds = [1.0] * 14
    comparison = compare(table(write, rows_of("cat", "a", hds, some) + rows_of("cat", "b", hds, [""] * 14)))
    [time] = [pair for pair in comparison.pairs if pair.measure.timed]
    assert (time.difference.estimate, time.better) == (0.0, ("a",))
    assert "b later than a, by 0 [0, ∞] in the median, on 6 of 14 seeds" in " ".join(statements(comparison))


def test_without_enough_seeds_for_an_interval_the_line_says_so(write):
    comparison = compare(table(write, rows_of("cat", "a", [1.0]) + rows_of("cat", "b", [2.0])))
    assert "by 1 (too few seeds for an interval), less on 0 of 1 seeds" in " ".join(statements(comparison))
    assert "median between two ranks (of fewer than 5 without an interval)" in method_lines(comparison)[0]


@pytest.mark.parametrize("odd", ["nan", "inf", ""])
def test_a_figure_that_is_none_is_left_out_with_its_partner_and_counted(write, odd):
    rows = rows_of("cat", "a", BASE) + rows_of("cat", "b", [odd, *WORSE[1:]])
    comparison = compare(table(write, rows))
    hd = next(pair for pair in comparison.pairs if pair.measure.column == "hd_cells")
    assert (hd.difference.n, hd.better) == (7, ("a",))
    assert table_rows(comparison)[2][2].endswith(" (7/8)")


def test_an_engine_that_does_not_count_rounds_is_not_said_to_need_more_of_them(write):
    """Rounds have no seconds, and seconds no rounds: what neither can have is not something that it never reached."""
    head = "engine,seed,status,emulated_s,rounds,time_to_hd_s.0.09,rounds_to_hd.0.09,run\n"
    rows = [("rounds", seed, "done", "", 9, "", "" if seed == 1 else 5, f"r{seed}") for seed in range(1, 9)]
    rows += [("virtual", seed, "done", 20, "", 4, "", f"v{seed}") for seed in range(1, 9)]
    comparison = compare(table(write, rows, head))
    assert comparison.pairs == []
    assert [row[2:] for row in table_rows(comparison)[1:]] == [["5 [5, never] (7/8)", "–"], ["–", "4"]]
    assert "rounds to HD < 0.09: not compared, as no seed has it of both: 1 pair." in method_lines(comparison)


def test_too_few_seeds_say_so_and_how_many_would_do(write):
    rows = rows_of("cat", "a", BASE[:4]) + rows_of("cat", "b", WORSE[:4])
    comparison = compare(table(write, rows))
    assert all(pair.better is None for pair in comparison.pairs)
    assert limit_lines(comparison) == [
        "HD at the end, cells; seconds to HD < 0.09; cells flown by an FLS: 1 pair on 4 seeds cannot show a "
        "difference, however large; 6 seeds could."
    ]
    page = markdown(comparison, "mine")
    assert page.index("cannot show") < page.index("no difference shown")
    assert "Student's t" in " ".join(method_lines(comparison))


def test_what_is_never_negative_has_no_interval_below_0_but_its_differences_do(write):
    comparison = compare(table(write, rows_of("cat", "a", [0.01, 0.1]) + rows_of("cat", "b", [0.02, 0.08])))
    assert [row[2] for row in table_rows(comparison)[1:]] == ["0.055 [0, 0.627]", "0.05 [0, 0.431]"]
    hd = next(pair for pair in comparison.pairs if pair.measure.column == "hd_cells")
    assert hd.difference.low < 0


def test_seeds_on_which_both_are_equal_are_seeds_that_could_have_shown_something(write):
    comparison = compare(table(write, rows_of("cat", "a", BASE) + rows_of("cat", "b", BASE)))
    assert limit_lines(comparison) == []
    said = [line for line in statements(comparison) if "against" in line]
    assert said == ["  b against a: the same on each of 8 seeds"] * 3


def test_seeds_that_failed_cannot_show_anything(write):
    """Of 8 seeds 5 have both: too few, and it is these that are counted."""
    rows = rows_of("cat", "a", BASE) + rows_of("cat", "b", WORSE)
    rows[8:11] = [(*row[:3], "failed", "", "", "", "out of memory", row[-1]) for row in rows[8:11]]
    [line] = limit_lines(compare(table(write, rows)))
    assert "1 pair on 5 seeds cannot show a difference, however large; 6 seeds could." in line


def test_the_pages_say_the_same(write):
    comparison = compare(table(write, rows_of("cat", "a", BASE) + rows_of("cat", "b", WORSE)))
    page = markdown(comparison, "mine")
    assert "| a | 8 |" in page
    assert "b more than a" in page
    rows = list(csv.DictReader(pairs_csv(comparison).splitlines()))
    assert [row["measure"] for row in rows] == ["hd_cells", "time_to_hd_s.0.09", "distance_cells_mean"]
    assert rows[0]["better"] == "a"
    assert rows[2]["better"] == ""
    assert float(rows[0]["difference"]) == pytest.approx(0.135)


@pytest.mark.parametrize(
    ("between", "measures", "said"),
    [
        (["techniqe"], [], "between: 'techniqe' does not vary here; did you mean 'technique'?"),
        (["lambda_ms"], [], "between: 'lambda_ms' does not vary here; what varies: technique"),
        (
            [],
            ["hd_cell"],
            "measure: 'hd_cell' is no column of numbers in results.csv; did you mean 'hd_cells'?",
        ),
        (
            [],
            ["x"],
            "measure: 'x' is no column of numbers in results.csv; such are hd_cells, time_to_hd_s.0.09, ",
        ),
        ([], ["message"], "measure: 'message' is no column of numbers"),
    ],
)
def test_names_that_the_table_does_not_have(write, between, measures, said):
    rows = rows_of("cat", "a", BASE) + rows_of("cat", "b", WORSE)
    rows[0] = (*rows[0][:7], "said something", rows[0][-1])
    path = table(write, rows)
    with pytest.raises(BadInput) as refused:
        compare(path, between, measures)
    assert str(refused.value).startswith(said)


def test_any_column_of_numbers_is_a_measure(write):
    path = table(write, rows_of("cat", "a", BASE) + rows_of("cat", "b", WORSE))
    assert compare(path, measures=["distance_cells_mean"]).measures == (
        Measure("distance_cells_mean", "cells flown by an FLS"),
    )


@pytest.mark.parametrize(
    "settings",
    [{"engine": "virtual", "duration_s": 3}, {"engine": "rounds", "technique": "trilateration"}],
)
def test_every_column_of_numbers_may_be_asked_for_and_no_other(tmp_path, settings):
    config = RunConfig.from_flat({"shape": "sphere", "points": 12, **settings})
    outcome = perform(config, tmp_path / "run")
    assert outcome.status == "done", outcome.message
    for name, value in flat(outcome.summary).items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            check_measures([name])
        elif value is not None:
            with pytest.raises(BadInput):
                check_measures([name])


# -- what is asked for -------------------------------------------------------------------------------------------------


def test_techniques_shapes_and_settings_make_every_combination():
    experiment = contest(
        ["signal_strength", "physical_movement"], ["cat", "hat"], ["virtual"], ["epsilon_deg=1,5", "m=inf,2"],
        seeds="3", overrides=["duration_s=5"],
    )  # fmt: skip
    runs = expand(experiment)
    assert len(runs) == 2 * 2 * 2 * 2 * 3
    assert {(run.config.technique, run.config.shape, run.config.m) for run in runs} == {
        (t, s, m) for t in ("signal_strength", "physical_movement") for s in ("cat", "hat") for m in ("inf", 2)
    }  # fmt: skip
    assert {run.config.duration_s for run in runs} == {5.0}
    assert experiment.name == "compare-technique-epsilon_deg-m-cat-hat"


def test_without_any_wish_the_techniques_of_the_engine_compete():
    experiment = contest([], [], [], [])
    [block] = experiment.blocks
    engine = default_engine()
    assert experiment.base["engine"] == engine
    assert block.grid["technique"] == contests.TECHNIQUES[engine]
    assert block.grid["shape"] == ("dragon",)
    assert len(block.seeds) == contests.SEEDS
    assert engine in FACTS["engine"].words


def test_one_technique_competes_with_those_that_the_engine_has():
    alone = contest(["physical_movement"], [], ["rounds"], [], seeds="1")
    names = [run.config.technique for run in expand(alone)]
    assert names == [*contests.TECHNIQUES["rounds"], "physical_movement"]
    varied = contest(["physical_movement"], [], ["rounds"], ["epsilon_deg=1,5"], seeds="1")
    assert {run.config.technique for run in expand(varied)} == {"physical_movement"}


def test_what_an_engine_cannot_do_is_refused_before_anything_runs():
    """The other engine that is planned first has nothing against it."""
    experiment = contest(["signal_strength", "triangulation"], ["cat"], ["rounds", "virtual"], [], seeds="1")
    with pytest.raises(
        BadInput, match="engine=virtual: technique: 'triangulation' is not allowed; it needs 3"
    ):
        check_plans(expand(experiment), experiment.file, asked_of(experiment))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"vary": ["epsilon_deg"]}, "--vary: 'epsilon_deg' is not NAME=VALUE,VALUE"),
        ({"vary": ["epsilon_deg="]}, "--vary: 'epsilon_deg=' is not NAME=VALUE"),
        ({"vary": ["epsilon=1,2"]}, "--vary: epsilon: no such setting"),
        ({"vary": ["epsilon_deg=1,99"]}, "options: grid: epsilon_deg: 99 is out of range"),
        ({"vary": ["epsilon_deg=1,1"]}, "options: grid: epsilon_deg: 1 is given twice"),
        ({"vary": ["seed=1,2"]}, "options: grid: seed: is not given here"),
        ({"techniques": ["a", "b"], "vary": ["technique=c,d"]}, "--vary: technique: is given twice"),
        ({"engines": ["warp"]}, "options: base: engine: 'warp' is not a choice"),
        ({"seeds": "0"}, "--seeds: 0 is neither a count"),
        ({"config": "papr"}, "options: config: no file 'papr'; did you mean 'paper'?"),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_refused(options, said):
    given = {"techniques": [], "shapes": [], "engines": [], "vary": [], **options}
    with pytest.raises(BadInput) as refused:
        contest(**given)
    assert str(refused.value).startswith(said)


# -- the command -------------------------------------------------------------------------------------------------------


def compared(*arguments, cwd, status=0):
    process = subprocess.run(
        [sys.executable, "-c", COMPARE, "compare", *map(str, arguments)],
        cwd=cwd, capture_output=True, text=True, timeout=250,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert process.returncode == status, process.stderr
    assert "Traceback" not in process.stderr
    return process.stdout.splitlines(), process.stderr


SMALL = ["--engine", "virtual", "--shape", "sphere", "--points", "12", "--duration", "3", "--jobs", "1"]


def test_a_comparison_from_its_options_to_its_pages(tmp_path):
    asked = [*SMALL, "--technique", "signal_strength,physical_movement", "--seeds", "6", "--out", "o"]
    out, _ = compared(*asked, cwd=tmp_path)
    assert out[-1] == "o"
    text = "\n".join(out)
    assert "physical_movement more than signal_strength" in text
    assert "on 6 of 6 seeds" in text
    found = {path.name for path in (tmp_path / "o").iterdir()}
    assert {"results.csv", "pairs.csv", "comparison.md", "experiment.yaml", "figures"} <= found
    figures = {path.name for path in (tmp_path / "o" / "figures").iterdir()}
    assert {"hd_cells.svg", "hd_over_time.svg", "distance_cells_mean.svg"} <= figures
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "o").glob("*/*/summary.json")}
    assert len(times) == 12
    before = (
        (tmp_path / "o" / "pairs.csv").read_text(),
        (tmp_path / "o" / "figures" / "hd_cells.svg").read_text(),
    )
    again, err = compared(*asked, cwd=tmp_path)
    assert "nothing is missing" in err
    assert again == out
    assert {path: path.stat().st_mtime_ns for path in times} == times
    assert before == (
        (tmp_path / "o" / "pairs.csv").read_text(), (tmp_path / "o" / "figures" / "hd_cells.svg").read_text(),
    )  # fmt: skip


def test_that_there_are_too_few_seeds_stands_before_what_they_do_not_show(tmp_path):
    asked = ["--shape", "sphere", "--points", "12", "--engine", "rounds", "--seeds", "2", "--jobs", "1"]
    out, _ = compared(*asked, "--vary", "epsilon_deg=1,5", "--out", "o", cwd=tmp_path)
    text = " ".join(" ".join(out).split())
    assert text.count("1 pair on 2 seeds cannot show a difference, however large; 6 seeds could.") == 1
    assert text.index("cannot show") < text.index("no difference shown")


def test_what_is_said_fits_the_terminal(write, tmp_path):
    """A table keeps its columns; sentences are broken between words."""
    terminal, ours = os.openpty()
    fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 60, 0, 0))
    file = write("base: {engine: rounds, shape: butterfly}\ngrid: {epsilon_deg: [1, 5]}\nseeds: 6\n")
    asked = ["compare", str(file), "--out", "o", "--jobs", "1", "--measure", "hd_cells"]
    process = subprocess.run(
        [sys.executable, "-c", COMPARE, *asked],
        cwd=tmp_path,
        stdout=ours,
        stderr=subprocess.PIPE,
        timeout=250,
    )
    os.close(ours)
    said = b""
    with contextlib.suppress(OSError):  # the terminal has gone
        while part := os.read(terminal, 65536):
            said += part
    os.close(terminal)
    assert process.returncode == 0, process.stderr
    lines = said.decode().replace("\r", "").splitlines()
    assert max(map(len, lines)) <= 60
    assert "  5 more than 1, by" in "\n".join(lines)


def test_an_experiment_file_can_be_compared(write, tmp_path):
    file = write(
        "base: {engine: virtual, shape: sphere, points: 12, duration_s: 2}\ngrid: {radio.loss: [0, 0.3]}\nseeds: 6\n"
    )
    out, _ = compared(file, "--out", "o", "--measure", "datagrams_lost", "--jobs", "1", cwd=tmp_path)
    assert any("datagrams_lost" in line for line in out)
    assert any("0.3 more than 0, by" in line for line in out)
    listed, _ = compared(file, "--dry-run", "--seeds", "2", cwd=tmp_path)
    assert len(listed) == 4


def test_a_technique_that_fails_on_some_runs_is_told_and_the_rest_compared(tmp_path):
    """The plugin raises late, and on some seeds: those runs have failed, status 1; what is there is compared."""
    home = tmp_path / "site"
    facts = home / "odd-1.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-package\nVersion: 1\n")
    (facts / "entry_points.txt").write_text("[swarmer.localizers]\nodd = odd:Odd\n")
    (home / "odd.py").write_text(
        "class Odd:\n    calls = 0\n    def displacement(self, measured, truth):\n        Odd.calls += 1\n"
        "        return None if Odd.calls > 30 else tuple(d - g for d, g in zip(measured, truth))\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(home)!r}); {COMPARE}", "compare", *SMALL,
         "--technique", "signal_strength", "--technique", "odd", "--seeds", "2", "--out", "o"],
        cwd=tmp_path, capture_output=True, text=True, timeout=250,
    )  # fmt: skip
    assert process.returncode == 1, process.stderr
    assert "Traceback" not in process.stderr
    assert "technique: 'odd' of the package odd-package 1: displacement(" in process.stderr
    assert process.stdout.splitlines()[-1] == "o"
    rows = list(csv.DictReader((tmp_path / "o" / "results.csv").open()))
    assert {row["technique"]: row["status"] for row in rows if row["seed"] == "2"}["odd"] == "failed"


def test_settings_that_nothing_heeds_are_told_once(capsys):
    arguments = ["--technique", "triangulation,trilateration", "--shape", "sphere", "--set", "radio.loss=0.1"]
    cli.load("compare").main([*arguments, "--points", "20", "--dry-run"], standalone_mode=False)
    assert capsys.readouterr().err == (
        "note: radio.loss: no effect with the engine rounds, which plays no protocol\n"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--vary", "epsilon_deg=5"], "between: nothing varies but the seed"),
        (["--technique", "signal_strength,nonsense"], "technique: 'nonsense' is not allowed"),
        (["--shape", "dragn"], "no 'dragn'; did you mean 'dragon'?"),
        (["--between", "lambda_ms"], "between: 'lambda_ms' does not vary here"),
        (
            ["--measure", "status"],
            "measure: 'status' is no column of numbers in results.csv; such are hd_cells, ",
        ),
        (
            ["--measure", "hd_cells,time_to_hd"],
            "'time_to_hd' is no column of numbers in results.csv; did you mean '",
        ),
        (["loss_and_lambda", "--shape", "cat"], "--shape: not beside FILE"),
        (["nowhere.yaml"], "experiment: no file 'nowhere.yaml'"),
        (["--seeds", "100000"], "compare: these are 200,000 runs; more than 3,000 need --yes"),
        (["--out", ""], "out: '' is not allowed"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, arguments, said):
    engine = [] if arguments[0].islower() and not arguments[0].startswith("-") else ["--engine", "virtual"]
    out, err = compared(*engine, *arguments, cwd=tmp_path, status=2)
    assert out == []
    assert said in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
    json.dumps(err)
