"""The virtual-time engine: what it promises its observer, how it ends, and what faults it can be asked for."""

import gc
import json
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from virtual_runs import SMALL, Watcher, fly

from swarmer import fls_process
from swarmer.config import load_config
from swarmer.engines import virtual_fls
from swarmer.engines.virtual import VirtualEngine
from swarmer.errors import RunFailed
from swarmer.faults import Fault, Schedule
from swarmer.fls import BaseFls
from swarmer.fls_battery import ChargedFls
from swarmer.messages import MAX_SIZE, SIZE
from swarmer.observe.progress import Progress
from swarmer.plan import make_machine, make_plan
from swarmer.state_machine import State, StateMachine

RUN = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer-run'; cli.main_run()"
REPORT = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer'; cli.main()"


def test_a_small_sphere_becomes_one_swarm_and_stops_at_its_goal():
    result, watcher = fly(points=60, duration_s=100, until_hd_cells=0.1, **{"thaw.policy": "timer"})
    assert result.status == "done"
    assert result.emulated_s < 100
    assert watcher.progress.first_single_swarm_s is not None
    assert watcher.progress.hd < 0.1
    assert min(snapshot.t_s for snapshot in watcher.samples if snapshot.lit.all()) < 5


def test_the_observer_is_called_in_the_order_that_it_can_rely_on():
    result, watcher = fly(duration_s=2.05, **{"recording.rate_hz": 4})
    calls = [call for call in watcher.calls if call not in ("event", "beat")]
    assert calls == ["planned", "launching", "launching", "go"] + ["sample"] * 10
    assert watcher.ready == (40, 40)
    assert [snapshot.t_s for snapshot in watcher.samples] == [*(k / 4 for k in range(9)), 2.05]
    times = [event.t_s for event in watcher.events]
    assert times == sorted(times)
    assert (result.status, result.emulated_s, result.launch_s is not None) == ("done", 2.05, True)


def test_a_snapshot_shows_the_dark_flight_and_the_lit_swarm():
    _, watcher = fly()
    first, last = watcher.samples[0], watcher.samples[-1]
    assert not first.lit.any()
    assert not first.swarm.any()
    assert first.alive.all()
    assert (first.state == State.DEPLOYING).all()
    assert (first.position == 0).all()
    assert last.lit.all()
    assert (last.swarm > 0).all()
    assert last.position.shape == (40, 3)
    assert np.abs(last.position - watcher.plan.cloud.points).max() < 10
    before, after = (snapshot.counters["datagrams_sent"] for snapshot in (first, last))
    assert before == 0 < after
    for name, total in last.counters.items():
        assert total >= first.counters[name], name


def test_datagrams_are_counted_by_kind_and_distance_by_purpose():
    result, watcher = fly(**{"failure.rate": 0.02})
    counters, flown = result.counters, watcher.samples[-1].flown
    for way in ("sent", "delivered"):
        kinds = {name: total for name, total in counters.items() if name.startswith(f"{way}_")}
        assert sum(kinds.values()) == counters[f"datagrams_{way}"]
    assert counters["sent_challenge_init"] < counters["delivered_challenge_init"]
    assert counters["sent_control"] == counters["delivered_control"] == 0
    np.testing.assert_allclose(
        flown.sum(axis=0), [counters["localizing_cells"], counters["following_cells"]], rtol=1e-9
    )
    assert flown.shape == (40, 2)
    assert (flown.sum(axis=0) > 0).all()
    assert flown.sum() < counters["distance_cells"]
    assert (watcher.samples[5].flown <= flown).all()


def test_the_result_says_what_a_network_engine_says():
    result, watcher = fly()
    counters = result.counters
    assert counters["bytes_sent"] == counters["datagrams_sent"] * SIZE
    signed, _ = fly(**{"radio.mac": True})
    assert signed.counters["bytes_sent"] == counters["datagrams_sent"] * MAX_SIZE
    assert counters["datagrams_delivered"] > counters["datagrams_sent"]
    assert 0 < counters["localizations"] <= counters["leases_granted"]
    assert counters["thaws"] == len([event for event in watcher.events if event.kind == "thaw"]) > 0
    assert (result.processes, result.faithful, result.suggested_time_scale) == (1, True, None)
    assert result.time_scale == pytest.approx(result.emulated_s / result.wall_s)
    assert result.extra["events"] > counters["datagrams_delivered"]


def test_an_fls_is_the_one_that_a_process_has():
    """One base, made once: what a datagram, a timer, a landing does is nowhere written twice."""
    kinds = (fls_process.Fls, virtual_fls.VirtualFls)
    shared = (
        "arrive",
        "_receive",
        "feed",
        "work",
        "take_message",
        "perform",
        "take_due",
        "_fly_legs",
        "_measure",
        "send",
        "_send_by_chance",
    )
    for name in shared:
        places = {next(kind for kind in one.__mro__ if name in vars(kind)) for one in kinds}
        assert places <= {BaseFls, ChargedFls, fls_process.Fls}, name
    assert make_machine.__annotations__["return"] == StateMachine.__name__


# -- ends ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_with_what_there_is(number):
    before = signal.getsignal(number)
    result, watcher = fly(lambda snapshot: snapshot.t_s >= 3 and os.kill(os.getpid(), number))
    assert result.status == "interrupted"
    assert 3 <= result.emulated_s < 3.5
    assert result.counters["localizations"] > 0
    assert len(result.extra["trace_sha256"]) == 64
    assert signal.getsignal(number) is before
    assert len(watcher.samples) >= 31


def test_ctrl_c_during_the_launch_never_flies():
    class Impatient:
        def __init__(self):
            self.calls = []

        def planned(self, plan):
            self.calls.append("planned")

        def launching(self, ready, total):
            self.calls.append("launching")
            os.kill(os.getpid(), signal.SIGINT)

        def event(self, event):
            self.calls.append("event")

    observer = Impatient()
    result = VirtualEngine(make_plan(load_config(shape="sphere", points=30))).run(observer)
    assert (result.status, result.emulated_s) == ("interrupted", 0.0)
    assert set(observer.calls) == {"planned", "launching"}


def test_outside_the_main_thread_the_signals_are_left_alone():
    got = []
    thread = threading.Thread(target=lambda: got.append(fly(duration_s=1)[0].status))
    thread.start()
    thread.join()
    assert got == ["done"]


def test_an_observer_that_fails_or_is_interrupted_ends_the_run():
    before = gc.get_threshold()

    def fail(snapshot):
        if snapshot.t_s >= 1:
            raise RunFailed("the disk is full")

    def interrupt(snapshot):
        if snapshot.t_s >= 1:
            raise KeyboardInterrupt

    result, _ = fly(fail)
    assert (result.status, result.message, result.emulated_s) == ("failed", "the disk is full", 1.0)
    assert fly(interrupt)[0].status == "interrupted"
    assert gc.get_freeze_count() == 0
    assert gc.get_threshold() == before


# -- faults and settings ---------------------------------------------------------------------------------------------


def test_loss_loses_and_the_swarm_forms_all_the_same():
    result, watcher = fly(duration_s=40, **{"radio.loss": 0.1})
    sent, delivered, lost = (result.counters[f"datagrams_{name}"] for name in ("sent", "delivered", "lost"))
    assert 0.05 < lost / (sent + delivered) < 0.15
    assert watcher.progress.first_single_swarm_s is not None
    assert watcher.progress.hd_min < 1
    assert fly(**{"radio.loss": 1})[0].counters["datagrams_delivered"] == 0


def test_a_copy_never_acts_twice():
    result, watcher = fly(duration_s=20, **{"radio.duplicate": 0.5})
    assert result.counters["replayed"] > 0.5 * result.counters["datagrams_delivered"]
    assert watcher.progress.first_single_swarm_s is not None


@pytest.mark.parametrize(
    "radio",
    [
        {"radio.reorder": 0.3},
        {"radio.delay_ms": 20, "radio.jitter_ms": 20},
        {"virtual.latency_min_ms": 0, "virtual.latency_max_ms": 0},
        {"virtual.latency_min_ms": 5, "virtual.latency_max_ms": 40},
    ],
)
def test_a_slow_radio_that_mixes_up_the_order_delays_and_stops_nobody(radio):
    result, watcher = fly(duration_s=20, **radio)
    assert result.status == "done"
    assert watcher.progress.first_single_swarm_s is not None
    assert watcher.progress.hd_min < 1


def test_who_fails_goes_dark_and_is_replaced_from_the_dispatcher():
    result, watcher = fly(duration_s=30, **{"failure.rate": 0.02})
    counters = result.counters
    assert counters["failures"] == counters["replacements"] > 5
    assert counters["joins"] > 0
    assert {"failure", "replacement"} <= watcher.kinds()
    failures = [event for event in watcher.events if event.kind == "failure"]
    for event in failures:
        after = next(snapshot for snapshot in watcher.samples if snapshot.t_s > event.t_s)
        again = [e for e in failures if e.fid == event.fid and e.t_s > event.t_s]
        if after.t_s - event.t_s < 0.09 and not again:
            assert not after.lit[event.fid - 1]
    assert watcher.samples[-1].lit.mean() > 0.8


def test_a_successor_is_no_member_of_the_swarm_that_its_predecessor_began():
    """FLS 1 owns the only swarm. Its successor is of the same number until it has joined."""
    plan = make_plan(load_config(None, (), **{**SMALL, "thaw.policy": "off", "recording.rate_hz": 50}))
    watcher = Watcher()
    with VirtualEngine(plan, faults=Schedule((Fault(8.0, "kill", (1,), 0.01),))) as engine:
        engine.run(watcher)
    assert watcher.progress.first_single_swarm_s < 8
    shown = [one for one in watcher.samples if one.swarm_incarnation is not None and one.lit.all()]
    alone = [one for one in shown if one.swarm_incarnation[0] == 1 and not one.swarm_incarnation[1:].any()]
    assert alone, "lit, and in a swarm of its own"
    for one in alone:
        assert (one.swarm == 1).all()
        progress = Progress.of(plan.cloud.points)
        progress.update(one)
        assert progress.swarms.number == 2
        assert progress.first_single_swarm_s is None


def test_without_replacement_the_display_goes_dark_one_by_one():
    result, watcher = fly(duration_s=30, **{"failure.rate": 0.2, "failure.replace": False})
    assert result.counters["replacements"] == 0
    alive = [int(snapshot.alive.sum()) for snapshot in watcher.samples]
    assert alive == sorted(alive, reverse=True)
    assert alive[-1] == 40 - result.counters["failures"] < 5
    last = watcher.samples[-1]
    assert not last.lit[~last.alive].any()
    assert not last.swarm[~last.alive].any()


def test_all_may_fail_and_the_run_ends_well():
    result, watcher = fly(duration_s=20, **{"failure.rate": 5, "failure.replace": False})
    assert result.counters["failures"] == 40
    assert (result.status, result.emulated_s) == ("done", 20)
    assert not watcher.samples[-1].alive.any()


def test_who_runs_low_lands_leaves_and_is_replaced():
    result, watcher = fly(duration_s=20, **{"failure.battery_s": 8})
    assert result.counters["departures"] == result.counters["replacements"] == 80
    assert result.counters["failures"] == 0
    times = [event.t_s for event in watcher.events if event.kind == "departure"]
    assert min(times) >= 8
    assert watcher.samples[-1].lit.all()


def test_centralized_thaws_at_one_swarm():
    result, watcher = fly(**{"thaw.policy": "centralized"})
    texts = [event.text for event in watcher.events if event.kind == "thaw"]
    assert len(texts) == result.counters["thaws"] > 3
    assert "one swarm" in texts
    assert result.counters["thawed_flss"] > 40 * (len(texts) - 1)
    assert watcher.progress.hd_min < 0.1


def test_without_thaws_there_are_none():
    result, watcher = fly(**{"thaw.policy": "off"})
    assert result.counters["thaws"] == 0
    assert "thaw" not in watcher.kinds()


def test_a_random_start_is_lit_at_once():
    _, watcher = fly(**{"deploy.start": "random"})
    lit = [bool(snapshot.lit.all()) for snapshot in watcher.samples]
    assert lit[1]
    assert np.ptp(watcher.samples[0].position, axis=0).min() > 1
    assert watcher.progress.first_single_swarm_s is not None


def test_dispatchers_launch_at_their_rate():
    _, watcher = fly(duration_s=6, **{"deploy.rate_per_s": 10})
    moving = [int((snapshot.position != 0).any(axis=1).sum()) for snapshot in watcher.samples]
    assert [moving[k] for k in (10, 20, 30)] == [10, 20, 30]
    assert moving == sorted(moving)
    assert watcher.samples[-1].lit.all()


def test_sampling_takes_time_and_errors_cost_accuracy():
    good, bad = (
        fly(
            duration_s=20, **{"sensing.model": "uniform", "sensing.error_percent": e, "sensing.sample_ms": 5}
        )[1]
        for e in (0, 50)
    )
    assert good.progress.hd_min < bad.progress.hd_min


@pytest.mark.parametrize("preset", ["paper", "authors_code"])
def test_the_presets_run(preset):
    result, watcher = fly(preset=preset, duration_s=10)
    assert result.status == "done"
    assert result.counters["localizations"] > 20
    assert watcher.samples[-1].lit.all()


# -- the command -----------------------------------------------------------------------------------------------------


def command(code, *arguments, cwd):
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=cwd, capture_output=True, text=True, timeout=100
    )


def test_the_command_writes_a_run_that_report_reads(tmp_path):
    settings = ["--engine", "virtual", "--shape", "sphere", "--points", "30", "--duration", "8"]
    done = command(RUN, *settings, "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "run\n"
    files = {path.name for path in (tmp_path / "run").iterdir()}
    assert files == {
        "config.yaml", "manifest.json", "summary.json", "events.csv", "log.txt", "recording.rrd", "timeline.npz",
    }  # fmt: skip
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["engine"], summary["status"], summary["faithful"]) == ("virtual", "done", True)
    assert summary["events"] > 1000
    assert len(summary["trace_sha256"]) == 64
    assert command(REPORT, "report", "run", cwd=tmp_path).returncode == 0
    assert "virtual" in (tmp_path / "run" / "report.html").read_text()
    again = command(RUN, "--config", "run/config.yaml", "--json", "--no-recording", cwd=tmp_path)
    assert json.loads(again.stdout)["trace_sha256"] == summary["trace_sha256"]


def test_a_time_scale_is_refused_with_one_line(tmp_path):
    done = command(RUN, "--engine", "virtual", "--time-scale", "0.5", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: time_scale: 0.5 is not for the engine virtual")
    assert done.stderr.count("\n") == 1


# -- may it be trusted? ----------------------------------------------------------------------------------------------


def test_flss_that_cannot_keep_up_are_not_faithful_by_the_rule_of_all_engines():
    slow, watcher = fly(**{"virtual.handling_ms": 150, "lambda_ms": 100})
    assert slow.handled_late_ms.p99 > watcher.plan.config.lease_ms / 2
    assert slow.faithful is False
    assert watcher.samples[-1].live.faithful is False
    usual, watcher = fly()
    assert (usual.faithful, watcher.samples[-1].live.faithful) == (True, True)


def test_what_nobody_took_up_by_the_end_is_late():
    hopeless, _ = fly(points=20, duration_s=2, **{"virtual.handling_ms": 2000})
    late = hopeless.handled_late_ms
    waited = hopeless.counters["datagrams_delivered"] - hopeless.counters["handled"]
    assert waited >= 20
    assert hopeless.faithful is False
    assert 1000 < late.p99 <= late.max < 2000 * 1.12
    assert hopeless.timer_late_ms.max > 1000


def test_where_nothing_was_handled_nothing_is_known():
    result, watcher = fly(duration_s=0.05)
    assert result.counters["handled"] == 0
    assert result.faithful is None
    assert result.handled_late_ms is None
    assert watcher.samples[-1].live.faithful is None


def test_an_idle_handler_costs_no_lateness_and_a_handling_time_of_its_own():
    result, _ = fly()
    assert result.handled_late_ms.p50 == 0.05, "the smallest bucket: it was free"
    without, _ = fly(**{"virtual.handling_ms": 0})
    assert result.extra["trace_sha256"] != without.extra["trace_sha256"]
    assert without.handled_late_ms.max == without.timer_late_ms.max == 0
