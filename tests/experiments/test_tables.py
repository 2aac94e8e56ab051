"""The table of a sweep: cells, medians, means, and runs that never got there or failed."""

import pytest

from swarmer.experiments.tables import lines_of, markdown_of, table_of, unfaithful

HEAD = "thaw.policy,radio.loss,seed,status,time_to_hd_s.1,time_to_hd_s.0.001,thaws,datagrams_sent,run\n"


@pytest.fixture
def results(tmp_path):
    rows = []
    for seed in range(1, 11):
        late = "" if seed > 6 else f"{20 + seed}"
        rows.append(f"census,0,{seed},done,{seed},{late},{seed % 2},{1000 * seed},a/seed-{seed}\n")
    rows.append("timer,0.1,1,done,7.25,,2,1234567,b/seed-1\n")
    rows.append("timer,0.1,2,failed,,,,,b/seed-2\n")
    path = tmp_path / "results.csv"
    path.write_text(HEAD + "".join(rows))
    return path


def test_each_cell_has_its_figures_with_their_intervals(results):
    table = table_of(results)
    assert table.titles == [
        "thaw.policy",
        "radio.loss",
        "runs",
        "HD < 1, s",
        "< 0.001, s",
        "thaws",
        "datagrams sent",
    ]
    first, second = table.rows
    # Of 1..10 the median and the 2nd and 9th; of 21..26 and four that never got there the 22nd to never.
    assert first == [
        "census", "0", "10", "5.5 [2.0, 9.0]", "25.5 [22.0, never] (6/10)", "0.5 [0.1, 0.9]", "5,500 [3,334, 7,666]",
    ]  # fmt: skip
    assert second == ["timer", "0.1", "1", "7.2", "never", "2.0", "1.23 M"]


def test_lines_and_markdown_have_the_same_cells(results):
    table = table_of(results)
    lines = lines_of(results)
    assert len(lines) == 3
    assert all(
        cell in line for line, row in zip(lines, [table.titles, *table.rows], strict=True) for cell in row
    )
    assert markdown_of(results).splitlines()[1] == "|" + " --- |" * len(table.titles)
    assert markdown_of(results).splitlines()[3] == f"| {' | '.join(table.rows[1])} |"


def test_no_finished_run_no_table(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text("seed,status,message,run\n1,failed,why,seed-1\n")
    assert lines_of(path) == []


def test_another_table_is_refused(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="is not a table of runs"):
        table_of(path)


def test_runs_that_the_machine_was_too_slow_for_are_counted(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text("seed,status,faithful,run\n1,done,false,a\n2,done,true,b\n3,failed,false,c\n4,done,,d\n")
    assert unfaithful(path) == 1


ROUNDS_HEAD = (
    "engine,seed,status,emulated_s,hd_cells,time_to_hd_s.1,thaws,distance_cells_mean,wrong_thaws,datagrams_sent,"
    "rounds,rounds_to_hd.0.09,run\n"
)


def test_a_sweep_in_rounds_has_rounds_and_no_column_of_dashes(tmp_path):
    path = tmp_path / "results.csv"
    rows = [f"rounds,{seed},done,,0.0{seed},,0,21.5,,,9,{3 + seed},r{seed}\n" for seed in (1, 2)]
    path.write_text(ROUNDS_HEAD + "".join(rows))
    table = table_of(path)
    assert dict(zip(table.titles, table.rows[0], strict=True)) == {
        "engine": "rounds", "runs": "2", "rounds to HD < 0.09": "4.5", "HD at the end, cells": "0.015 [0, 0.0785]",
        "cells flown by an FLS": "21.5", "thaws": "0.0",
    }  # fmt: skip


def test_what_one_engine_cannot_have_is_a_dash_beside_what_another_has(tmp_path):
    """Rounds never take seconds, which is not that they never got there."""
    path = tmp_path / "results.csv"
    path.write_text(
        ROUNDS_HEAD + "rounds,1,done,,0.5,,0,21.5,,,9,,a\nvirtual,1,done,30,0.25,7,2,22,,500,,,b\n"
    )
    table = table_of(path)
    assert table.titles == [
        "engine", "runs", "HD < 1, s", "rounds to HD < 0.09", "HD at the end, cells", "cells flown by an FLS",
        "thaws", "datagrams sent",
    ]  # fmt: skip
    assert table.rows == [
        ["rounds", "1", "–", "never", "0.5", "21.5", "0.0", "–"],
        ["virtual", "1", "7.0", "–", "0.25", "22", "2.0", "500"],
    ]
