"""`scripts/bench.py`: the quick table runs, and wrong names are refused."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def bench(*arguments):
    return subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "bench.py"), *arguments],
        capture_output=True,
        text=True,
        timeout=100,
    )


def test_the_micro_table_has_a_figure_in_every_row():
    done = bench("micro", "--repeat", "1")
    assert done.returncode == 0, done.stderr
    machine, _, title, *rows = done.stdout.splitlines()
    assert "cores" in machine
    assert "load" in machine
    assert title == "micro: µs per call"
    figures = {
        row[:24].strip(): float(row[24:].split()[0])
        for row in rows[2:]
        if row.startswith("  ") and row[24:30].strip()[:1].isdigit()
    }
    assert {
        "encode",
        "decode",
        "heard, yes",
        "publish",
        "tune",
        "handle INIT",
        "handle FOLLOW_MERGE",
    } <= figures.keys()
    assert all(0 < cost < 100_000 for cost in figures.values())


def test_a_run_in_virtual_time_is_measured_beside_the_reference_loop(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    from bench import virtual

    monkeypatch.setattr(virtual, "RUNS", (("sphere", 2),))
    monkeypatch.setattr(virtual, "SIZES", (20, 40, 80))
    monkeypatch.setattr(virtual, "SCALING_S", 3.0)
    virtual.run(1)
    table = capsys.readouterr().out
    assert "turns/event" in table
    rows = {row.split()[0]: row.split()[1:] for row in table.splitlines() if row.startswith("  ")}
    events, process_s, us = (float(rows["80"][at]) for at in (0, 1, 2))
    assert events > 1000
    assert us > 0
    assert process_s > 0
    assert "F^" in table


def test_the_recording_is_measured_on_and_off(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    from bench import recording

    monkeypatch.setattr(recording, "RUNS", (("sphere", 1),))
    monkeypatch.setattr(recording, "WORST", (("cube", 2),))
    recording.run(1)
    rows = {
        line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines() if line[:2] == "  "
    }
    for name, points in (("sphere", "100"), ("cube", "125")):
        assert rows[name][0] == points
        megabytes, per_minute, on, off = map(float, rows[name][2:])
        assert 0.1 < megabytes < per_minute
        assert on > off > 0


def test_a_table_that_is_not_there_is_refused():
    done = bench("nope")
    assert done.returncode == 2
    assert "micro" in done.stderr


def test_runs_in_rounds_are_measured_and_how_they_grow(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    from bench import rounds

    monkeypatch.setattr(rounds, "RUNS", (("cat", 5),))
    monkeypatch.setattr(rounds, "SIZES", (50, 100))
    monkeypatch.setattr(rounds, "ROUNDS", 12)
    rounds.run(1)
    table = capsys.readouterr().out
    rows = [row.split() for row in table.splitlines() if row.startswith("  torus")]
    assert [row[1:3] for row in rows] == [["50", "12"], ["100", "12"]]
    assert all(int(row[3]) >= 1 for row in rows), "formations"
    assert "cat, M 2" in table
    assert "grow as F^" in table


def test_all_ways_to_read_the_hd_agree(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    from bench import hausdorff

    monkeypatch.setattr(hausdorff, "SIZES", (60, 300))
    monkeypatch.setattr(hausdorff, "BLOCK", 50)
    monkeypatch.setattr(hausdorff, "NAIVE_MAX", 100)
    hausdorff.run(1)
    rows = [
        row.split() for row in capsys.readouterr().out.splitlines() if row.startswith(("  60 ", "  300 "))
    ]
    assert len(rows) == 6
    assert all((row[-2] == "-") == (row[0] == "300") for row in rows)


def test_a_sweep_is_measured_beside_its_runs_by_hand(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    from bench import sweep

    said = {"base": {"engine": "virtual", "shape": "sphere", "points": 12, "duration_s": 1}, "seeds": 2}
    for name, value in (("RUNS", 2), ("JOBS", 1), ("SAID", said)):
        monkeypatch.setattr(sweep, name, value)
    sweep.run(1)
    by_hand, in_sweep, more, busy = re.findall(r"[-+]?[\d.]+", capsys.readouterr().out.splitlines()[-1])
    assert 0 < float(by_hand) < float(in_sweep)
    assert float(more) > 0
    assert 0 < float(busy) <= 100
