"""The page on costs: made of what was measured, for every cell that the experiments have, and nothing else."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import experiment_costs as costs  # noqa: E402
from paper import storms  # noqa: E402

from swarmer.experiments.experiment import read_experiment  # noqa: E402
from swarmer.experiments.runs import expand  # noqa: E402


def test_the_page_is_made_of_what_was_measured():
    assert costs.PAGE.read_text() == costs.page()


def test_every_cell_of_both_versions_was_measured_and_none_besides():
    cells = {
        (costs.key_of(name, small), run.cell)
        for name in costs.EXPERIMENTS for small in (False, True)
        for run in expand(read_experiment(name, small=small))
    }  # fmt: skip
    assert set(costs.read_measured()) == cells


def test_a_cost_goes_on_as_it_went_and_with_the_number_of_flss():
    run = expand(read_experiment("speed", ["duration_s=60", "points=150"], "1,"))[0]
    assert costs.cost_of(run, (1.0, 2.5)) == pytest.approx(1 + 0.1 * 55)
    assert costs.cost_of(run, (2.0, 1.9)) == 2.0  # a busy machine: never less than was measured
    whole = expand(read_experiment("speed", ["duration_s=60"], "1,"))[0]
    assert costs.cost_of(whole, (1.0, 2.5)) == pytest.approx(6.5 * 760 / 200)


def test_the_law_holds_within_a_factor_of_two_where_all_flss_were_measured():
    ratios = costs.law_over_measured()
    assert len(ratios) >= 5
    assert 0.5 < ratios[0] <= ratios[-1] < 2


def test_each_lambda_of_table_2_was_measured_and_the_law_holds_where_more_was():
    runs = expand(read_experiment(storms.EXPERIMENT))
    law = storms.Storms(storms.read_pieces())
    assert {lambda_ms for lambda_ms, flss in law.pieces if flss == storms.FEW} == {
        round(run.config.lambda_ms) for run in runs
    }
    assert {(one.lambda_ms, one.flss) for one in law.pieces.values()} == {
        piece[:2] for piece in storms.PIECES
    }
    assert law.all == costs.fls_of(runs[0].config)
    ratios = law.over_measured()
    assert len(ratios) == 4
    assert 0.5 < ratios[0] <= ratios[-1] < 2
    assert law.minutes(1000, law.all, 120) == pytest.approx(
        (law.pieces[1000, law.all].cpu_s_at_from + 117 * law.pieces[1000, law.all].rate) / 60
    )


def test_a_piece_is_the_beginning_of_a_run():
    run = expand(read_experiment(storms.EXPERIMENT))[-1]
    piece = storms.piece_of(run, 20, 4.0)
    assert piece[:4] == ("skateboard", 1000, 20, storms.FROM_S)
    assert piece.to_s == 4.0
    assert 0 <= piece.cpu_s_at_from <= piece.cpu_s_at_to
    assert piece.events > 1000


def test_a_piece_that_takes_too_long_is_cut_off(monkeypatch):
    monkeypatch.setattr(storms, "CPU_S_MAX", 0.0)
    monkeypatch.setattr(storms, "FROM_S", 0.0)
    assert storms.piece_of(expand(read_experiment(storms.EXPERIMENT))[-1], 20, 4.0).to_s < 0.5


def test_the_small_versions_are_for_a_laptop():
    for name in costs.EXPERIMENTS:
        runs, minutes, _, memory = costs.totals(name, small=True)
        assert minutes / 2 < 10
        assert memory < 2000
        assert runs < costs.totals(name, small=False)[0]
