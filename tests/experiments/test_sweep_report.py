"""The report over a sweep: its figures say what the table says, lines where they can be followed, points elsewhere."""

import csv
import io

import pytest

from swarmer import cli
from swarmer.errors import BadInput
from swarmer.experiments.sweep_figures import axis_of, cells_of, measures_of, swept
from swarmer.experiments.sweep_report import is_sweep, write_sweep_report
from swarmer.observe import report_page

HEAD = "# The experiment mine, by swarmer 0.1.0; `swarmer sweep FILE` takes it\nbase: {}\nblocks: []\n"


@pytest.fixture
def sweep(tmp_path):
    """A sweep's directory with rows of (settings..., seed, status, HD, seconds to HD < 0.09)."""

    def make(names, rows):
        text = io.StringIO()
        table = csv.writer(text)
        table.writerow(
            [
                *names,
                "seed",
                "engine",
                "status",
                "emulated_s",
                "hd_cells",
                "time_to_hd_s.0.09",
                "message",
                "run",
            ]
        )
        for *settings, seed, status, hd, time_s in rows:
            message = "" if status == "done" else "the <reason>"
            table.writerow([*settings, seed, "virtual", status, 60, hd, time_s, message, f"x/seed-{seed}"])
        (tmp_path / "results.csv").write_text(text.getvalue())
        (tmp_path / "experiment.yaml").write_text(HEAD)
        return tmp_path

    return make


def grid(losses=(0, 0.1), lambdas=(100, 200, 500), seeds=6):
    return [
        (loss, ms, seed, "done", 0.001 * seed, ms / 100 + seed if loss == 0 else "")
        for loss in losses for ms in lambdas for seed in range(1, seeds + 1)
    ]  # fmt: skip


def test_the_page_has_a_figure_of_each_measure_the_table_and_the_experiment(sweep):
    out = sweep(["radio.loss", "lambda_ms"], [*grid(), (0.1, 500, 7, "failed", "", "")])
    assert is_sweep(out)
    path = write_sweep_report(out)
    assert path == out / "report.html"
    page = path.read_text()
    assert "The sweep mine" in page
    assert 'id="over-hd-cells"' in page
    assert 'id="over-time-to-hd-s-0-09"' in page
    assert "36 finished runs of 6 cells; swept: radio.loss, lambda_ms" in page
    assert "least seconds to HD &lt; 0.09: 4.5 (radio.loss=0, lambda_ms=100)" in page
    assert "Least HD at the end" in page
    assert "the &lt;reason&gt;" in page
    assert "radio.loss 0.1" in page  # a line's name
    assert "Above the dotted line: never." in page
    assert "swarmer sweep" in page
    assert page == (write_sweep_report(out), path.read_text())[1]  # a report is written over a report


def test_what_is_drawn_are_medians_of_times_and_means_of_the_rest_over_the_seeds(sweep):
    from swarmer.experiments.results import read_results

    out = sweep(["radio.loss", "lambda_ms"], grid())
    settings, rows = read_results(out / "results.csv")
    cells = cells_of(settings, rows, measures_of(rows))
    first = cells[0]
    assert first.key == ("0", "100")
    assert first.runs == 6
    assert first.values["hd_cells"].estimate == pytest.approx(0.0035)
    assert first.values["time_to_hd_s.0.09"].estimate == 4.5
    assert (first.values["time_to_hd_s.0.09"].low, first.values["time_to_hd_s.0.09"].high) == (2, 7)
    assert cells[-1].values["time_to_hd_s.0.09"].estimate == float("inf")
    assert [axis.name for axis in swept(settings, cells)] == ["radio.loss", "lambda_ms"]


def test_no_interval_that_is_drawn_begins_below_0(sweep):
    from swarmer.experiments.results import read_results

    settings, rows = read_results(
        sweep(["eta"], [(3, 1, "done", 0.01, 5), (3, 2, "done", 0.1, 5)]) / "results.csv"
    )
    [cell] = cells_of(settings, rows, measures_of(rows))
    assert cell.values["hd_cells"].low == 0


def test_many_combinations_are_points_with_their_data(sweep):
    rows = [(0.01 * at, 50 * 1.1**at, seed, "done", 0.1 * at, at) for at in range(40) for seed in (1, 2)]
    page = write_sweep_report(sweep(["radio.loss", "lambda_ms"], rows)).read_text()
    assert "lambda_ms 50" not in page  # no legend of 40 lines
    assert "26 of 40 rows" in page or "21 of 40 rows" in page


def test_a_median_is_drawn_where_several_cells_share_a_value_not_through_single_cells(sweep):
    def page_of(etas):
        rows = [(0.01 * at, 3 + at % etas, seed, "done", 0.1 * at, at) for at in range(12) for seed in (1, 2)]
        return write_sweep_report(sweep(["radio.loss", "eta"], rows)).read_text()

    words = "The red mark is the median of all cells at that value."
    assert words in page_of(etas=4)
    assert words not in page_of(etas=12)


def test_one_run_is_counted_as_one(sweep):
    page = write_sweep_report(sweep(["eta"], [(3, 1, "done", 0.1, 5)])).read_text()
    assert "1 finished run of 1 cell; swept: eta" in page


def test_axes_are_numbers_or_words_and_logarithmic_where_values_crowd_below():
    assert axis_of("x", [str(50 * 1.2**at) for at in range(20)]).logarithmic
    assert not axis_of("x", [str(0.01 * at) for at in range(1, 41)]).logarithmic
    assert not axis_of("x", ["0", "0.1"]).logarithmic
    words = axis_of("x", ["2", "inf"])
    assert words.words
    assert words.at == {"2": 0.0, "inf": 1.0}


def test_only_seeds_leave_out_the_figures(sweep):
    page = write_sweep_report(sweep([], [(seed, "done", 0.1, 5) for seed in range(1, 7)])).read_text()
    assert "only the seed varies" in page


def test_the_command_takes_a_sweep_as_it_takes_a_run(sweep, capsys):
    out = sweep(["radio.loss", "lambda_ms"], grid())
    cli.load("report").main([str(out)], standalone_mode=False)
    assert capsys.readouterr().out == f"{out / 'report.html'}\n"
    assert report_page.GENERATOR in (out / "report.html").read_text()


def test_bad_sweeps_are_refused_on_a_line(sweep, tmp_path):
    out = sweep(["eta"], [(3, 1, "failed", "", "")])
    with pytest.raises(BadInput, match="none is finished there"):
        write_sweep_report(out)
    (out / "results.csv").write_text("a,b\n1,2\n")
    with pytest.raises(BadInput, match="is not a table of runs: no column seed or run"):
        write_sweep_report(out)
    (tmp_path / "mine.html").write_text("mine")
    sweep(["eta"], [(3, 1, "done", 1, 1)])
    with pytest.raises(BadInput, match="a file is there that is no report of ours"):
        write_sweep_report(out, tmp_path / "mine.html")
