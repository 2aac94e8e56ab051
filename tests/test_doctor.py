"""`swarmer doctor`: what it looks at, what it makes of it, and how it ends."""

import json
import os
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from swarmer.commands import doctor as command
from swarmer.engines import control_groups, doctor, kernel_services
from swarmer.engines.control_groups import Grant
from swarmer.engines.limits import MEMORY_MB_PER_FLS
from swarmer.engines.trial import SHAPES, Trial, Watch, run_trial
from swarmer.errors import RunFailed

TRIAL = Trial(
    points=100, launch_s=0.5, fork_ms=3.0, memory_mb=3.0, wake_p99_ms=10.0, handled_p99_ms=8.0, cpu_ms=1.0,
    cores=2, lease_ms=250.0,
)  # fmt: skip


def run(*arguments):
    return CliRunner().invoke(command.command, arguments)


def test_quick_tells_what_it_found_and_that_a_run_is_possible():
    done = run("--quick")
    assert done.exit_code == 0, done.output
    for name in ("cores", "free memory", "processes", "UDP receive buffer", "kernel socket filter", "memfd"):
        assert name in done.output
    assert done.output.endswith(("is possible.\n", "warnings above.\n"))


def test_json_is_one_object_with_everything():
    done = run("--quick", "--json")
    found = json.loads(done.stdout)
    assert found["format"] == 1
    assert found["dragon"] is True
    assert found["engines"] == ["process", "virtual", "rounds", "cluster"]
    assert {check["mark"] for check in found["checks"]} <= {"ok", "warn", "fail", ""}
    assert found["trial"] is None


def test_it_tells_how_other_hosts_are_reached(monkeypatch):
    monkeypatch.setattr(doctor.shutil, "which", lambda name: f"/bin/{name}")
    assert doctor.other_hosts().found.startswith("ssh")

    def nothing(name):
        raise doctor.PackageNotFoundError(name)

    monkeypatch.setattr(doctor.shutil, "which", lambda _: None)
    monkeypatch.setattr(doctor, "version", nothing)
    assert doctor.other_hosts() == (
        "ways to other hosts", "none", "", "install ssh, or: pip install 'swarmer[cluster]'",
    )  # fmt: skip


def test_what_is_too_little_for_the_dragon_ends_it_with_what_to_do(monkeypatch):
    monkeypatch.setattr(doctor, "read_number", lambda path: 500 if path.endswith("pid_max") else None)
    done = run("--quick")
    assert isinstance(done.exception, RunFailed)
    assert done.exception.exit_status == 1
    assert str(done.exception) == (
        "no run of the dragon is possible here: kernel.pid_max: 500; sudo sysctl -w kernel.pid_max=4200"
    )


@pytest.mark.parametrize(
    ("found", "mark"), [(None, "ok"), (2000, "ok"), (1999, "warn"), (760, "warn"), (759, "fail")]
)
def test_a_number_is_measured_against_2000_flss_and_the_dragon(found, mark):
    check = doctor.verdict(found, "name", "do this")
    assert check.mark == mark
    assert check.advice == ("" if mark == "ok" else "do this")


def test_elsewhere_it_says_which_engines_are_possible(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    assert "process" not in doctor.possible_engines()
    done = run("--quick")
    assert isinstance(done.exception, RunFailed)
    assert "needs Linux" in str(done.exception)


def test_a_container_has_limits_of_its_own(monkeypatch):
    monkeypatch.setattr(control_groups, "cores", lambda: 0.5)
    monkeypatch.setattr(control_groups, "memory", lambda: Grant(1 << 30, 1 << 29))
    monkeypatch.setattr(control_groups, "processes", lambda: Grant(1000, 0))
    assert doctor.cores().mark == "warn"
    assert doctor.memory().mark == "fail"
    assert doctor.memory().found == f"512 MB, for {int(512 / MEMORY_MB_PER_FLS)} FLSs"
    pids = doctor.container_processes()
    assert (pids.mark, pids.found) == ("warn", "1000 of 1000 left")
    assert "3000" in pids.advice


def test_a_small_buffer_is_a_warning_with_the_command(monkeypatch):
    monkeypatch.setattr(kernel_services.socket.socket, "getsockopt", lambda *_: 212_992)
    check = kernel_services.receive_buffer()
    assert check.mark == "warn"
    assert check.advice == "sudo sysctl -w net.core.rmem_max=1048576"


def test_a_kernel_without_filters_is_slower_and_no_more(monkeypatch):
    def refuse(*_):
        raise OSError("Protocol not available")

    monkeypatch.setattr(kernel_services.Filter, "attach", refuse)
    assert kernel_services.socket_filter().mark == "warn"


def test_what_is_tried_leaves_nothing_behind():
    before = (len(list(Path("/proc/self/fd").iterdir())), os.sched_getscheduler(0))
    kernel_services.checks()
    assert (len(list(Path("/proc/self/fd").iterdir())), os.sched_getscheduler(0)) == before


def test_the_estimate_follows_the_figures():
    assert TRIAL.largest() == 625  # 125 ms of half a lease / (2 x 0.1 ms per FLS)
    assert TRIAL.scale_for(625) == 1.0
    assert TRIAL.scale_for(1250) == pytest.approx(0.5)
    assert TRIAL.largest(memory_mb=300.0) == 100


def test_many_flss_run_out_of_cores_before_they_are_late():
    busy = Trial(**{**TRIAL.__dict__, "cpu_ms": 10.0})
    assert busy.largest() == 160  # 80 % of 2 cores / 10 ms


def test_a_launch_is_timed_from_the_first_to_the_last():
    watch = Watch()
    watch.ready = [(0.0, 0), (1.0, 10), (2.0, 60), (3.0, 110)]
    assert watch.ms_per_fls() == pytest.approx(20.0)
    watch.ready = [(0.0, 0), (1.0, 100)]
    assert watch.ms_per_fls() is None


@pytest.mark.processes
def test_a_trial_measures_and_leaves_no_process():
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    before = children.read_text()  # other tests may have begun some
    trial = run_trial(points=12, run_s=1.0)
    assert trial.points == 12
    assert 0 < trial.launch_s < 60
    assert 0 < trial.memory_mb < 100
    assert trial.wake_p99_ms > 0
    assert 0 < trial.cpu_ms < 1000
    assert 0 < trial.scale_for(SHAPES[0]) <= 1
    assert children.read_text() == before


def test_the_whole_doctor_gives_an_estimate(monkeypatch):
    monkeypatch.setattr("swarmer.engines.trial.run_trial", lambda: TRIAL)
    done = run()
    lines = done.output.splitlines()
    assert (
        len(lines) - done.output.count("-> ") <= 24
    )  # besides what there is to raise it fits a small terminal
    assert "kernel.pid_max" in done.output
    assert "at time scale 1  up to some 620 FLSs" in done.output
    assert "1727 FLSs" in done.output
    assert json.loads(run("--json").stdout)["estimate"]["largest_at_time_scale_1"] == 625
