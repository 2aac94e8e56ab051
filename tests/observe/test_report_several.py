import re
import shutil

import numpy as np
import pytest

from swarmer.metrics import intervals
from swarmer.observe import report
from swarmer.observe.report import make_report, write_report
from swarmer.observe.report_several import OVERLAYS, band, groups_of, labels, overlay, verdict
from swarmer.observe.report_table_2 import ROWS, cell, expired_share
from swarmer.observe.saved_run import load


@pytest.fixture(scope="module")
def six(tmp_path_factory, fake):
    """Two values of λ, three seeds each."""
    root, paths = tmp_path_factory.mktemp("six"), []
    for lambda_ms in (500, 200):
        for seed in (1, 2, 3):
            paths.append(root / f"run-{lambda_ms}-{seed}")
            fake.record(
                paths[-1], lambda_ms=lambda_ms, seed=seed, duration_s=8.0, recording={"enabled": False}
            )
    return paths


def test_seeds_are_grouped_by_what_else_differs(six):
    groups, differing = groups_of([load(path) for path in six])
    assert [(group.name, len(group.runs), len(group.data)) for group in groups] == [
        ("lambda_ms 500 (3 seeds)", 3, 3),
        ("lambda_ms 200 (3 seeds)", 3, 3),
    ]
    assert set(differing) == {"lambda_ms", "seed"}


def test_names_of_groups_are_short_and_told_apart(six):
    runs = [load(path) for path in six[:3]]
    for i, run in enumerate(runs):
        run.config |= {
            "lambda_ms": i // 2,
            "technique": "x" * 50 + str(i // 2),
            "eta": i,
            "deploy": {"a": "y" * 39 + str(i)},
        }
    groups, differing = groups_of(runs)
    assert [group.label for group in groups] == [
        "lambda_ms 0, eta 0",
        "lambda_ms 0, eta 1",
        "lambda_ms 1, eta 2",
    ]
    assert len(differing) == 5
    for run in runs:
        run.config = {"z" * 70: run.config["eta"], "shape": "ball"}
    names = [group.label for group in groups_of(runs)[0]]
    assert len(set(names)) == 3
    assert max(map(len, names)) <= 60
    assert "…" in names[0]


def test_a_group_of_all_points_of_a_shape_says_how_many(six):
    runs = [load(path) for path in six[:3]]
    runs[0].config["points"], runs[1].config["points"], runs[2].config["points"] = 20, None, None
    assert [group.label for group in groups_of(runs)[0]] == [
        "points 20",
        f"points {runs[1].summary['points']}",
    ]
    runs[1].summary = {}
    assert groups_of(runs)[0][1].label == "points all"


def test_the_engine_is_named_where_it_differs_whatever_else_tells_runs_apart(six):
    runs = [load(path) for path in six[:2]]
    runs[0].config |= {"points": 60, "engine": "virtual"}
    runs[1].config |= {"points": 100, "engine": "rounds"}
    assert list(runs[0].config).index("points") < list(runs[0].config).index("engine")
    assert [group.label for group in groups_of(runs)[0]] == [
        "engine virtual, points 60",
        "engine rounds, points 100",
    ]


def test_several_runs_are_compared(six, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = write_report(six).read_text()
    assert (tmp_path / "report.html").exists()
    assert "6 runs compared" in text
    assert "Table 2" in text
    assert re.search(r"lambda_ms</code></td><td>500</td><td>500</td><td>500</td><td>200</td>", text)
    assert "95 % interval" in text
    keys = re.findall(r'<figure id="([^"]+)"', text)
    without = {"dark"}  # nobody failed
    assert keys == [one.key for one in OVERLAYS if one.key not in without] + ["clouds-1", "clouds-2"]
    assert "Dark after a failure: no run has data for it" in text
    assert text.count("swarmer-run --config") == 6


def test_a_figure_of_groups_holds_mean_and_interval(six):
    runs = [load(path) for path in six]
    for i, run in enumerate(runs):
        run.timeline.series["localizations"] = run.timeline.t_s * (10 + i % 3)
    groups, _ = groups_of(runs)
    figure = overlay(next(one for one in OVERLAYS if one.key == "localizations"), groups)
    assert figure.columns == ["group", "t", "mean", "low_95", "high_95"]
    expected = intervals.mean([80.0, 88.0, 96.0])
    last = [row for row in figure.rows if row[0] == "lambda_ms 500"][-1]
    np.testing.assert_allclose(last[1:], [8.0, *expected[:3]], rtol=1e-5)
    assert figure.svg.count("fill-opacity") >= 2, "a band for each group"


def test_of_hd_the_geometric_mean_is_drawn():
    t = np.linspace(0, 1, 5)
    _, middle, low, high = band([(t, np.full(5, 0.1)), (t, np.full(5, 0.001))], logarithm=True)
    np.testing.assert_allclose(middle, 0.01)
    assert (low < 0.001).all()
    assert (high > 0.1).all()


def test_a_single_run_has_no_interval():
    t = np.linspace(0, 1, 5)
    _, middle, low, _ = band([(t, t)])
    np.testing.assert_array_equal(middle, t)
    assert np.isnan(low).all()


def test_means_are_taken_as_far_as_every_run_goes():
    t, values, *_ = band([(np.arange(5.0), np.ones(5)), (np.arange(3.0), 3 * np.ones(3))])
    assert (t[0], t[-1]) == (0, 2)
    np.testing.assert_array_equal(values, 2)


def test_the_verdict_names_the_groups_best_first(six):
    runs = [load(path) for path in six]
    for run, t in zip(runs, (9.0, 8.0, 9.5, 5.0, 6.0, None), strict=True):
        run.summary["time_to_hd_s"] = {"1": 1.0, "0.1": t}
    said = verdict(groups_of(runs)[0])
    assert said == (
        "lambda_ms 200 (3 seeds): HD below 0.1 after 6.0 s in 2 of 3; "
        "lambda_ms 500 (3 seeds): HD below 0.1 after 9.0 s (medians)."
    )


def test_the_verdict_compares_at_one_threshold(six):
    """Who came nearer came there later; where both came, the other was the first."""
    runs = [load(path) for path in six]
    for i, run in enumerate(runs):
        run.summary["time_to_hd_s"] = {"1": 1.0, "0.1": 6.0, "0.01": 8.0} if i < 3 else {"1": 2.0, "0.1": 4.0}
    assert verdict(groups_of(runs)[0]) == (
        "lambda_ms 500 (3 seeds): HD below 0.1 after 6.0 s, below 0.01 after 8.0 s; "
        "lambda_ms 200 (3 seeds): HD below 0.1 after 4.0 s (medians)."
    )


def test_a_run_counts_once(six, tmp_path, quick):
    from swarmer.errors import BadInput

    again = shutil.copytree(six[0], tmp_path / "again")
    with pytest.raises(BadInput, match="named twice"):
        write_report([six[0], six[1], six[0].parent / "." / six[0].name], tmp_path / "report.html")
    runs = [load(path) for path in (*six[:2], again)]
    assert [group.name for group in groups_of(runs)[0]] == ["all runs (3 runs, 2 seeds)"]
    for engine, told in (("process", False), ("virtual", True)):
        for run in runs:
            run.summary["engine"] = engine
        assert ("run-500-1, again: the same run more than once" in make_report(runs)) == told


def test_shapes_and_engines_are_not_mixed_without_a_word(six, quick):
    runs = [load(path) for path in six[:2]]
    runs[1].summary["shape"] = runs[1].config["shape"] = "<b>hat</b>"
    runs[1].summary["engine"] = runs[1].config["engine"] = "rounds"
    runs[0].summary["faithful"] = False
    text = make_report(runs)
    assert "They are of different shapes (ball, &lt;b&gt;hat&lt;/b&gt;)" in text
    assert "a round is no second" in text
    assert "Not faithful" in text
    assert "<b>hat" not in text


def test_runs_of_which_little_is_left_are_reported_with_the_others(six, tmp_path, quick):
    cut = shutil.copytree(six[0], tmp_path / "cut")
    for name in ("summary.json", "timeline.npz"):
        (cut / name).unlink()
    bare = shutil.copytree(six[0], tmp_path / "bare")
    for path in bare.iterdir():
        if path.name != "manifest.json":
            path.unlink()
    text = make_report([load(six[0]), load(cut), load(bare)])
    assert "cut: timeline.npz: none" in text
    assert "3 runs compared" in text


def test_names_are_told_apart(six, tmp_path):
    again = shutil.copytree(six[0], tmp_path / six[0].name)
    assert labels([load(six[0]), load(again)]) == ["run-500-1 (1)", "run-500-1 (2)"]


def test_too_many_runs_are_refused(six):
    from swarmer.errors import BadInput

    with pytest.raises(BadInput, match="at most 24"):
        write_report([six[0]] * (report.RUNS_MAX + 1))


def test_table_2_has_the_paper_s_rows():
    titles = [row.title for row in ROWS]
    for title in ("Bytes sent, MB", "Localizations", "Anchors", "Thawed swarms", "Leases expired"):
        assert title in titles
    rows = {row.title: row for row in ROWS}
    assert cell(rows["Bytes sent, MB"], [{"bytes_sent": 1.5e6}, {"bytes_sent": 2.5e6}]) == "2.0 [0.0, 8.4]"
    assert cell(rows["Localizations"], [{"localizations": 5}]) == "5"
    assert cell(rows["Localizations"], [{"localizations": None}, {}]) == "–"
    assert cell(rows["Localizations"], [{"localizations": 5}, {}]) == "5 (1/2)"
    rounds = {"points": 40, "distance_localizing_cells": 80.0, "localizing_cells_mean": None}
    assert cell(rows["of it localizing"], [rounds]) == "2.00"
    assert expired_share({"leases_expired": 3, "leases_granted": 60}) == 5.0
    assert expired_share({"leases_expired": 0, "leases_granted": 0}) is None
