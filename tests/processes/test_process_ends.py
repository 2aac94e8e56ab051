"""However a run ends, nothing of it is left: no process, no shared memory, no half-written file under a final name."""

import contextlib
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from endings import segments_of
from helpers import RUN, children, dispatcher_of, events, flss_of, gone, run, start, wait_for

from swarmer.udp_wrapper import address_of

ARGUMENTS = ["--shape", "random", "--points", "20", "--duration", "60", "--no-recording"]


def begun(tmp_path, *more):
    process = start(*ARGUMENTS, *more, "--out", str(tmp_path / "run"), cwd=tmp_path)
    return process, flss_of(process, 20)


@pytest.mark.parametrize("delay_s", [0.0, 2.0])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted(tmp_path, delay_s, number):
    process, flss = begun(tmp_path)
    dispatcher = dispatcher_of(process.pid)
    time.sleep(delay_s)
    segments = set().union(*map(segments_of, [process.pid, dispatcher, *flss]))
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    wait_for(lambda: gone([*flss, dispatcher]))
    assert not [name for name in segments if Path(name).exists()], "of this run's own processes"
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "interrupted"
    assert not list((tmp_path / "run").glob("*.partial"))
    assert out.splitlines()[-1] == str(tmp_path / "run")


@pytest.mark.parametrize("after_s", [0.05, 0.4, 0.8])
def test_interrupted_before_the_launch(tmp_path, after_s):
    process = start(*ARGUMENTS, "--out", str(tmp_path / "run"), cwd=tmp_path)
    time.sleep(after_s)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode in (130, -signal.SIGINT)
    assert not children(process.pid)


def test_nohup_stays_nohup(tmp_path):
    """Whoever starts a run deaf to hanging up means it."""
    process = start(
        *ARGUMENTS, "--duration", "3", "--out", str(tmp_path / "run"), cwd=tmp_path, deaf_to=signal.SIGHUP
    )
    flss_of(process, 20)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=30)
    assert process.returncode == 0
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "done"


def test_a_process_that_cannot_begin_ends_the_run_at_once(tmp_path):
    """No port for FLS 3: nobody waits a minute for it."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind((address_of(3), 0))
        port = taken.getsockname()[1]
        began = time.monotonic()
        done = run(*ARGUMENTS, "--set", f"radio.port={port}", "--out", str(tmp_path / "run"), cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "failed"
    assert summary["message"].startswith("FLS 3 could not begin: its process ended with status 1")
    assert "Traceback" not in done.stderr
    assert time.monotonic() - began < 40, "of the minute that a launch may take"


def test_interrupted_again_and_again(tmp_path):
    process, flss = begun(tmp_path)
    time.sleep(1)
    for _ in range(4):
        process.send_signal(signal.SIGINT)
        time.sleep(0.15)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    wait_for(lambda: gone(flss))
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "interrupted"


@pytest.mark.parametrize(
    "streams", ["2>&-", "2>/dev/full", ">&-", "<&- >&- 2>&-", "2>&1 >/dev/null | head -n 1"]
)
def test_a_run_outlives_its_listeners(tmp_path, streams):
    """A pager that was left, a terminal that went away, closed descriptors: the run is finished all the same."""
    command = [
        sys.executable,
        "-c",
        RUN,
        "--shape",
        "random",
        "--points",
        "5",
        "--duration",
        "1",
        "--no-recording",
    ]
    line = " ".join([*map(shlex.quote, command), "--out", "run", streams])
    subprocess.run(["bash", "-c", line], cwd=tmp_path, timeout=60)
    wait_for((tmp_path / "run" / "summary.json").exists)
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "done"


def test_a_killed_engine_leaves_nobody(tmp_path):
    process, flss = begun(tmp_path)
    dispatcher = dispatcher_of(process.pid)
    process.kill()
    process.communicate(timeout=60)
    wait_for(lambda: gone([*flss, dispatcher]))


ORPHAN = """
import ctypes, os, types
from swarmer.engines.dispatcher import Dispatcher

class Control:
    def close(self):
        print("it went on", flush=True)

if os.fork():
    os._exit(os.waitstatus_to_exitcode(os.wait()[1]))
dispatcher = types.SimpleNamespace(_libc=ctypes.CDLL(None), _pid=os.getpid(), control=Control())
if os.fork():
    os._exit(0)
while os.getppid() == dispatcher._pid:
    pass
Dispatcher._become(dispatcher, None)
"""


def test_an_fls_forked_while_its_dispatcher_dies_ends_with_it():
    """The kernel tells a child of the death of its parent only if that was alive when the child asked for it."""
    done = subprocess.run([sys.executable, "-c", ORPHAN], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_killed_dispatcher_fails_the_run(tmp_path):
    process, flss = begun(tmp_path)
    os.kill(dispatcher_of(process.pid), signal.SIGKILL)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "the dispatcher process died" in err
    wait_for(lambda: gone(flss))
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "failed"


def test_a_killed_fls_is_seen_and_replaced(tmp_path):
    process, flss = begun(tmp_path)
    wait_for(lambda: (tmp_path / "run" / "timeline.npz.partial").exists())
    time.sleep(2)
    os.kill(flss[3], signal.SIGKILL)
    wait_for(lambda: "replacement" in [event["kind"] for event in events(tmp_path / "run")])
    time.sleep(2.5)  # the newcomer flies in
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["failures"] == summary["replacements"] == 1
    assert summary["lit_share"] == 1
    crash = next(event for event in events(tmp_path / "run") if event["kind"] == "crash")
    assert "SIGKILL" in crash["text"]


def test_too_many_crashes_end_the_run(tmp_path):
    """A technique that ends the process of every FLS that localizes: the run says so, and does not go on for ever."""
    plugin = tmp_path / "broken.py"
    plugin.write_text(
        "import os, sys\nclass Broken:\n    def displacement(self, measured, ground_truth):\n"
        "        if 'numpy' not in sys.modules:  # it is an FLS, and nobody who tries a plugin first\n"
        "            print('lights out', file=sys.stderr, flush=True)\n            os._exit(3)\n"
        "        return measured\n"
    )
    metadata = tmp_path / "broken-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text("[swarmer.localizers]\nbroken = broken:Broken\n")
    os.environ["PYTHONPATH"] = str(tmp_path)
    try:
        done = run(*ARGUMENTS, "--set", "technique=broken", "--out", str(tmp_path / "run"), cwd=tmp_path)
    finally:
        del os.environ["PYTHONPATH"]
    assert done.returncode == 1
    assert "died unexpectedly" in done.stderr
    assert any("lights out" in event["text"] for event in events(tmp_path / "run"))


def test_a_taken_port_is_refused_and_nothing_written(tmp_path):
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        done = run(*ARGUMENTS, "--set", f"radio.port={port}", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"error: radio.port: {port} is not allowed; UDP port {port} is taken")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--shape", "dragn"], "shape: no 'dragn'; did you mean 'dragon'?"),
        (["--shape", "nowhere.xyz"], "shape: "),
        (["--lambda", "0"], "lambda_ms: 0 is out of range"),
        (["--lambda", "-5"], "lambda_ms: -5 is out of range"),
        (["--set", "epsilon_deg=46"], "epsilon_deg: 46 is out of range"),
        (["--set", "radio.loss=1.5"], "radio.loss: 1.5 is out of range"),
        (["--shape", "random", "--points", "5", "--set", "eta=5"], "eta: 5 is not allowed; 1 to 4"),
        (["--set", "radio.los=0.1"], "radio.los: no such setting; did you mean 'radio.loss'?"),
        (["--set", "technique=signal_strenght"], "technique: "),
        (["--engine", "clustr"], "engine: "),
        (
            ["--engine", "cluster", "--set", "cluster.hosts=a,,b"],
            "cluster.hosts: 'a,,b' is not allowed; names",
        ),
        (["--points", "1"], "points: 1 is out of range"),
        (["--time-scale", "0"], "time_scale: 0 is out of range"),
        (["--out", ""], "out: '' is not allowed"),
        (["--out", "two\nlines"], "out: "),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path, arguments, said):
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"error: {said}")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "shape: "),
        ("1,2,3\n", "shape: "),
        ("1,2,3\nnan,2,3\n", "shape: "),
        ("1,2,3\n4,inf,3\n", "shape: "),
        ("1,2,3\n4,5,6\n1,2,3\n", "shape: "),
        ("1,2,3\n1,2,3\n", "shape: "),
        ("1,2\nx,y\n", "shape: "),
    ],
)
def test_bad_clouds(tmp_path, text, said):
    cloud = tmp_path / "cloud.csv"
    cloud.write_text(text)
    done = run("--shape", str(cloud), cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"error: {said}")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == [cloud]


def test_a_finished_run_is_not_overwritten(tmp_path):
    arguments = ["--shape", "random", "--points", "5", "--duration", "0.5", "--no-recording", "--out", "mine"]
    assert run(*arguments, cwd=tmp_path).returncode == 0
    before = (tmp_path / "mine" / "summary.json").read_bytes()
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("error: out: ")
    assert (tmp_path / "mine" / "summary.json").read_bytes() == before


def test_duplicates_are_dropped_when_asked(tmp_path):
    cloud = tmp_path / "cloud.csv"
    cloud.write_text("1,2,3\n4,5,6\n1,2,3\n7,8,9\n")
    done = run("--shape", str(cloud), "--dedupe", "--duration", "1", "--no-recording", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["points"] == 3


def test_a_low_limit_on_processes_is_named(tmp_path):
    import resource

    from swarmer.engines import limits
    from swarmer.errors import BadInput

    soft, hard = resource.getrlimit(resource.RLIMIT_NPROC)
    with pytest.raises(BadInput, match=r"free memory|hard limit|pid_max|threads-max"):
        limits.check_limits(10_000_000)
    assert resource.getrlimit(resource.RLIMIT_NPROC)[1] == hard
    resource.setrlimit(resource.RLIMIT_NPROC, (soft, hard))


SWALLOWED = """
import os, signal, sys
from swarmer import cli
from swarmer.observe.collector import Collector
class Swallows:
    def __del__(self): os.kill(os.getpid(), signal.SIGINT)
planned = Collector.planned
def swallowing(self, plan):
    planned(self, plan)
    swallows = Swallows(); del swallows
Collector.planned = swallowing
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv[0] = 'swarmer-run'
cli.main_run()
"""


@pytest.mark.parametrize("engine", ["process", "virtual"])
def test_an_ending_that_was_swallowed_before_the_launch_ends_the_run(tmp_path, engine):
    more = ["--shape", "random", "--points", "5", "--duration", "100000", "--no-recording", "--out", "run"]
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWED, "--engine", engine, *more],
        cwd=tmp_path, capture_output=True, text=True, timeout=90,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "interrupted"
