import json
import math

import numpy as np
import pytest

from swarmer.engines.result import Live, RunResult, Snapshot
from swarmer.observe.progress import Progress
from swarmer.observe.summary import make_summary

EVERY_ENGINE = {
    "format", "engine", "shape", "points", "seed", "status", "emulated_s", "wall_s", "hd_cells", "hd_min_cells",
    "hd_absolute_cells", "time_to_hd_s", "first_single_swarm_s", "single_swarm_count", "thaws", "swarms_last",
    "lit_share", "launch_s", "distance_cells_mean", "localizations", "anchorings", "leases_expired",
}  # fmt: skip
NETWORK = {
    "datagrams_sent", "datagrams_delivered", "datagrams_lost", "bytes_sent", "bytes_delivered", "failures",
    "replacements", "processes", "memory_mb_per_fls", "timer_late_ms", "handled_late_ms", "time_scale", "faithful",
    "suggested_time_scale",
}  # fmt: skip
VIRTUAL = {"events", "trace_sha256", "invariants_checked", "invariant_violations"}

TRUTH = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]])
LIVE = Live(None, None, None, None, None, None)


def snapshot(t_s, position=TRUTH, swarm=(1, 2, 3, 4), lit=(True,) * 4):
    ids, lights = np.array(swarm, np.int32), np.array(lit)
    return Snapshot(t_s, np.array(position), ids, lights.astype(np.int8), lights, np.ones(4, bool), {}, LIVE)


def test_summary_has_the_names_of_the_contract(fake, finished_run):
    summary = json.loads((finished_run / "summary.json").read_text())
    assert not (EVERY_ENGINE | NETWORK | VIRTUAL) - set(summary)
    assert {summary[name] for name in VIRTUAL} == {None}
    assert "NaN" not in (finished_run / "summary.json").read_text()
    assert (summary["format"], summary["status"], summary["points"], summary["seed"]) == (1, "done", 40, 7)
    assert set(summary["time_to_hd_s"]) == {"1", "0.1", "0.09", "0.01", "0.001"}
    times = [summary["time_to_hd_s"][name] for name in ("1", "0.1", "0.09", "0.01")]
    assert times == sorted(times)
    assert summary["distance_cells_mean"] == 40
    assert summary["timer_late_ms"] == {"p50": 12.0, "p99": 85.0, "max": 190.0}
    assert isinstance(summary["thaws"], int)


def test_everything_of_the_contract_is_in_the_directory(finished_run):
    names = {path.name for path in finished_run.iterdir()}
    assert names >= {
        "config.yaml",
        "manifest.json",
        "timeline.npz",
        "events.csv",
        "recording.rrd",
        "summary.json",
    }
    assert "log.txt" in names
    assert not [name for name in names if "partial" in name or "tmp" in name]


def test_hd_counts_only_once_every_fls_was_lit():
    progress = Progress.of(TRUTH)
    progress.update(snapshot(1.0, lit=(True, False, False, False)))
    assert math.isnan(progress.hd)  # moved to the centroid, one light is always perfect
    assert (progress.hd_min, progress.time_to_hd_s["1"], progress.reached(1.0)) == (None, None, False)
    progress.update(
        snapshot(2.0, lit=(False, True, True, True))
    )  # all have been lit once, though not at once
    assert (progress.all_lit_s, progress.hd_min, progress.time_to_hd_s["0.001"]) == (2.0, 0.0, 2.0)


def test_nobody_lit_has_no_hd():
    progress = Progress.of(TRUTH)
    progress.update(snapshot(0.0, lit=(False,) * 4))
    assert math.isnan(progress.hd)
    summary = make_summary(progress, RunResult("virtual", "done", 0.0, 0.0), "s", 4, 1)
    assert (summary["hd_cells"], summary["hd_absolute_cells"], summary["lit_share"]) == (None, None, 0)


def test_hd_is_of_the_lit_and_time_is_of_the_first_crossing():
    progress = Progress.of(TRUTH)
    moved = TRUTH.copy()
    for t_s, error in ((1, 4.0), (2, 0.05), (3, 4.0), (4, 0.05)):
        moved[0] = (-error, 0, 0)
        progress.update(snapshot(float(t_s), moved))
    assert progress.time_to_hd_s["0.1"] == 2.0
    progress.update(snapshot(5.0, moved * 0, lit=(False, True, True, False)))
    assert progress.hd == pytest.approx(50**0.5)  # both in one place, their points 10 and 10 cells away


def test_what_is_left_of_a_display_that_went_dark_is_no_success():
    """Failures without replacement: two lights of four still count, one of four has no HD."""
    crooked = TRUTH + [[0.0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0]]
    progress = Progress.of(TRUTH)
    progress.update(snapshot(1.0, crooked))
    assert progress.hd_min == progress.hd == pytest.approx(0.75)
    progress.update(snapshot(2.0, crooked, lit=(True, False, False, False)))
    assert not progress.reached(0.1)
    assert (progress.hd_min, progress.time_to_hd_s["0.1"]) == (pytest.approx(0.75), None)
    summary = make_summary(progress, RunResult("process", "done", 2.0, 2.0), "s", 4, 1)
    assert (summary["hd_cells"], summary["hd_absolute_cells"], summary["lit_share"]) == (None, None, 0.25)
    progress.update(snapshot(3.0, crooked, lit=(True, False, True, False)))
    assert progress.reached(0.1)
    assert (progress.hd_min, progress.time_to_hd_s["0.1"]) == (0.0, 3.0)


def test_fewer_than_half_of_the_lights_are_shown_but_do_not_count():
    truth = np.arange(15.0).reshape(5, 3) ** 2
    progress = Progress.of(truth)
    ids, lit, dark = np.ones(5, np.int32), np.ones(5, bool), np.array([True, True, False, False, False])
    far = truth + np.eye(5, 3)
    progress.update(Snapshot(1.0, far, ids, lit.astype(np.int8), lit, lit, {}, LIVE))
    before = progress.hd_min
    progress.update(Snapshot(2.0, truth, ids, dark.astype(np.int8), dark, dark, {}, LIVE))
    assert (progress.hd, progress.hd_absolute()) == (0.0, 0.0)
    assert (progress.hd_min, progress.reached(1.0)) == (before, False)


def test_single_swarms_are_counted_by_their_beginnings():
    progress = Progress.of(TRUTH)
    for t_s, ids in enumerate(((1, 2, 3, 4), (1,) * 4, (1,) * 4, (1, 2, 1, 1), (1,) * 4)):
        progress.update(snapshot(float(t_s), swarm=ids))
    assert (progress.single_swarm_count, progress.first_single_swarm_s) == (2, 1.0)
    progress.update(snapshot(9.0, swarm=(1, 1, 1, 0), lit=(True, True, True, False)))
    assert not progress.swarms.single


def test_run_stops_at_the_hd_that_was_asked_for(tmp_path, fake):
    _, summary = fake.record(tmp_path / "run", until_hd_cells=0.1, recording={"enabled": False})
    assert summary["hd_cells"] < 0.1
    assert summary["emulated_s"] == summary["time_to_hd_s"]["0.1"] < 8
    assert not (tmp_path / "run" / "recording.rrd").exists()


def test_extra_of_an_engine_comes_through():
    progress = Progress.of(TRUTH)
    result = RunResult("virtual", "done", 1.0, 0.1, counters={"thaws": 2.0})
    summary = make_summary(progress, result, "s", 4, 1)
    assert summary["thaws"] == 2
    assert summary["processes"] is None


@pytest.mark.slow
def test_a_sample_costs_less_than_ten_milliseconds(tmp_path, fake):
    """Of CPU, at 760 FLSs with recording: a tenth of a core at 10 Hz. Measured 4."""
    import time

    from swarmer.observe.collector import Collector
    from swarmer.observe.run_directory import RunDirectory

    cloud = fake.ball(760)
    swarm = fake.swarm(cloud)
    collector = Collector(RunDirectory.create(tmp_path / "run", "ball", 1, []))
    collector.planned(fake.plan(cloud))
    collector.go(0.0)
    snapshots = [swarm.snapshot(k / 10) for k in range(200)]
    begun = time.process_time()
    for each in snapshots:
        collector.sample(each)
    per_sample_ms = 1e3 * (time.process_time() - begun) / len(snapshots)
    collector.finish(RunResult("process", "done", 20.0, 20.0))
    print(f"{per_sample_ms:.2f} ms a sample")
    assert per_sample_ms < 10
