"""`make paper`: every claim is asked of runs that the quick version makes, and judged by rules that can say no."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

import paper_page
from paper.agreement import fits, judge
from paper.claims import CLAIMS, QUICK, TEXT, Claim, Order
from paper.quantities import QUANTITIES

from swarmer.experiments.experiment import experiment_names
from swarmer.experiments.runs import expand, spelled

RUNS = {name: expand(paper_page.quick(name, paper_page.PROGRAM)) for name in QUICK}
FIGURES = "1 5-7 8-10 13 14 18 19 20 21 25 26 27 28 29 31 32 33 6 4.2.1 4.2.2"


def settings(run):
    return {name: spelled(value) for name, value in run.config.flat().items()}


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: f"{claim.figure} {claim.words} {claim.where}")
def test_the_quick_version_has_runs_for_every_claim(claim):
    assert claim.quantity in QUANTITIES
    sides = (
        [claim.where] if isinstance(claim, Claim) else [claim.where | claim.less, claim.where | claim.more]
    )
    for where in sides:
        there = [run for run in RUNS[claim.experiment] if where.items() <= settings(run).items()]
        assert there, where
        assert len(there) == len({run.config.seed for run in there}), "one cell, and no mixture of several"


def test_every_figure_of_the_paper_is_on_the_page_and_what_was_reduced_beside_it():
    assert {claim.figure for claim in CLAIMS} == {*FIGURES.split(), "Table 1", "Table 2", "beyond 20"}
    page = paper_page.page(Path("nowhere"))
    of_the_paper = {name for name in experiment_names() if name.startswith(("fig", "table"))}
    assert (
        of_the_paper | {"anchors", "speed", "scale_million"}
        == set(QUICK)
        == {one.experiment for one in CLAIMS}
    )
    assert set(TEXT) <= set(QUICK) <= set(experiment_names())
    for name, (seeds, _, overrides) in QUICK.items():
        [row] = [line for line in page.splitlines() if line.startswith(f"| `{name}` | {seeds} |")]
        assert all(f"`{one}`" in row for one in overrides)


def test_the_quick_version_is_as_the_file_but_for_seeds_and_values():
    runs = RUNS["fig13_localizing"]
    assert len(runs) == 18
    by_the_text = expand(paper_page.quick("fig13_localizing", paper_page.THE_TEXT))
    assert {run.config.rounds.dead_reckoning for run in runs} == {"one_sided"}
    assert {(run.config.rounds.dead_reckoning, run.config.flight.dead_reckoning) for run in by_the_text} == {
        ("flight", "full")
    }
    assert {run.config.shape for run in RUNS["fig31_loss"]} == {"dragon"}


HEAD = "shape,technique,seed,status,hd_cells,rounds,converged,run\n"


@pytest.fixture
def sweep(tmp_path):
    def make(*rows):
        (tmp_path / "results.csv").write_text(HEAD + "".join(",".join(map(str, row)) + "\n" for row in rows))
        return tmp_path

    return make


def rows(technique, hds, rounds=20, converged="true"):
    return [("cat", technique, n, "done", hd, rounds, converged, f"r{n}") for n, hd in enumerate(hds, 1)]


def test_a_number_agrees_within_its_band_alone(sweep):
    out = sweep(*rows("a", [1.0, 2.0, 3.0]))
    claim = Claim("9", "x", {"shape": "cat"}, "hd", "HD", 2.0, (1.9, 2.1))
    assert judge(claim, out).agrees
    assert judge(claim, out).ours == "2 [0, 4.48] (3)"
    assert not judge(claim._replace(band=(2.1, 3.0)), out).agrees
    assert judge(claim._replace(where={"shape": "hat"}), out) is None


def test_who_never_gets_there_is_said(sweep):
    out = sweep(
        *rows("a", [1, 1, 1, 1], 20), *[(*row[:2], 5, *row[3:]) for row in rows("a", [1], 9, "false")]
    )
    found = judge(Claim("9", "x", {}, "rounds", "rounds", 20, (10, 30)), out)
    assert found.agrees
    assert found.ours == "20 [20, never] (5, 4 of 5 reach it)"


def test_an_order_is_judged_seed_by_seed(sweep):
    order = Order("9", "x", {}, {"technique": "a"}, {"technique": "b"}, "hd", "a < b")
    base = [1.0, 5.0, 2.0, 9.0, 3.0, 4.0]
    assert judge(order, sweep(*rows("a", base), *rows("b", [value + 0.1 for value in base]))).agrees
    mixed = [value + (0.5 if at % 2 else -0.4) for at, value in enumerate(base)]
    found = judge(order, sweep(*rows("a", base), *rows("b", mixed)))
    assert not found.agrees
    assert "on 3 of 6 seeds" in found.ours
    twice = order._replace(factor=2.0)
    assert not judge(twice, sweep(*rows("a", base), *rows("b", [1.5 * value for value in base]))).agrees
    assert judge(twice, sweep(*rows("a", base), *rows("b", [2.5 * value for value in base]))).agrees
    assert judge(order, sweep(*rows("a", base[:2]), *rows("b", [2.0, 6.0]))).agrees, (
        "too few for a test: every seed"
    )
    assert not judge(order, sweep(*rows("a", base[:2]), *rows("b", [2.0, 4.0]))).agrees


def test_failed_runs_count_nowhere(sweep):
    out = sweep(*rows("a", [1.0, 1.0]), ("cat", "a", 3, "failed", "", "", "", "r3"))
    assert judge(Claim("9", "x", {}, "hd", "HD", 1, (1, 1)), out).ours == "1 (2)"
    assert fits({"m": ""}, {"m": "null"})


def test_the_page_says_what_it_cannot_explain(sweep, monkeypatch):
    out = sweep(*rows("a", [1.0, 2.0, 3.0]))
    claims = [
        Claim("9", "x", {}, "hd", "HD", 2, (1, 3)),
        Claim("10", "x", {}, "hd", "HD", 5, (4, 6), "because"),
    ]
    monkeypatch.setattr(paper_page, "CLAIMS", claims)
    monkeypatch.setattr(paper_page, "SMALL", claims)
    monkeypatch.setattr(paper_page, "home", lambda *_: out)
    page = paper_page.page(out)
    assert "1 of 2 figures, orders and numbers" in page
    assert "| 10 | – | HD | 5 | 4 to 6 | 2 [0, 4.48] (3) | **no** |" in page
    assert "because" in page
