"""Runs over several agents on one machine, which share its loopback interface: nothing here needs a privilege."""

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import children, events, gone, run, running, start, wait_for

pytestmark = pytest.mark.processes

TWO = ["--engine", "cluster", "--set", "cluster.hosts=localhost,localhost", "--no-recording"]


def family(pid):
    """Every process below one."""
    found = []
    for child in children(pid):
        found += [child, *family(child)]
    return found


def test_a_run_on_two_hosts(tmp_path):
    out = tmp_path / "run"
    done = run(
        "--shape", "random", "--points", "24", "--duration", "6", "--set", "radio.mac=true", *TWO, "--out", str(out),
        cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "done"
    assert (summary["engine"], summary["hosts"], summary["hosts_lost"]) == ("cluster", 2, 0)
    assert summary["processes"] == 24
    assert summary["lit_share"] == 1
    assert summary["hd_cells"] < 0.1
    assert summary["failures"] == summary["relay_rejected"] == summary["rejected"] == 0
    assert 0 < summary["relayed_datagrams"] < summary["datagrams_delivered"]
    assert 1 < summary["memory_mb_per_fls"] < 50
    one, other = hosts(out)
    assert int(one["flss"]) + int(other["flss"]) == 24
    assert int(one["datagrams_in"]) + int(other["datagrams_in"]) == summary["relayed_datagrams"]
    assert int(one["packets"]) > int(one["packets_of_datagrams"]) > 0
    assert max(float(row["clock_bound_ms"]) for row in (one, other)) == pytest.approx(
        summary["clock_bound_ms"], abs=1e-4
    )
    assert one["lost_s"] == other["lost_s"] == ""
    again = run(
        "--config",
        str(out / "config.yaml"),
        "--duration",
        "0.5",
        "--out",
        str(tmp_path / "again"),
        cwd=tmp_path,
    )
    assert again.returncode == 0, again.stderr


def hosts(out):
    with (out / "hosts.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def begun(tmp_path):
    process = start(
        "--shape", "random", "--points", "10", "--duration", "60", *TWO, "--out", str(tmp_path / "run"), cwd=tmp_path
    )  # fmt: skip
    while not process.stderr.readline().startswith("go:"):
        assert process.poll() is None
    everybody = family(process.pid)
    assert len(everybody) == 16, "two agents, each with a dispatcher, a relay and five FLSs"
    yield process, everybody
    if process.poll() is None:
        process.kill()
        process.communicate()
    wait_for(lambda: gone(everybody))


def test_ctrl_c_leaves_nobody(begun, tmp_path):
    process, everybody = begun
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    wait_for(lambda: gone(everybody))
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "interrupted"
    assert summary["processes"] == 10


def test_a_killed_engine_leaves_nobody(begun):
    process, everybody = begun
    process.kill()
    process.communicate(timeout=60)
    wait_for(lambda: gone(everybody))


def agents_of(process):
    return [
        pid for pid in children(process.pid) if b"cluster.agent" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]


def test_all_hosts_gone_one_after_the_other(begun, tmp_path):
    """The first by its agent, the second by its relay: then nobody is left to go on."""
    process, _ = begun
    first, second = agents_of(process)
    os.kill(first, signal.SIGKILL)
    wait_for(lambda: any(event["kind"] == "host" for event in events(tmp_path / "run")))
    wait_for(lambda: sum(event["kind"] == "replacement" for event in events(tmp_path / "run")) == 5)
    [relay] = [
        pid for pid in children(second) if b"cluster.relay" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    os.kill(relay, signal.SIGKILL)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "failed"
    assert summary["message"].startswith("no host is left; localhost-2 is gone: ")
    assert "Traceback" not in err
    assert (summary["hosts_lost"], summary["failures"], summary["replacements"]) == (2, 5, 5)
    first, second = hosts(tmp_path / "run")
    assert (first["flss"], first["replaced_on"]) == ("0", "5 on localhost-2")
    assert 0 < float(first["lost_s"]) < float(second["lost_s"])
    assert second["replaced_on"] == ""


def test_an_agent_without_orders_says_what_it_is():
    done = subprocess.run(
        [sys.executable, "-m", "swarmer.engines.cluster.agent"], stdin=subprocess.DEVNULL, capture_output=True,
        text=True, timeout=30,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "swarmer's host agent: no orders on stdin; an engine starts it\n"


def test_an_agent_whose_engine_is_not_there_says_so():
    orders = json.dumps({"address": "127.0.0.1", "port": 9, "key": "00" * 32, "name": "a"})
    done = subprocess.run(
        [sys.executable, "-m", "swarmer.engines.cluster.agent"], input=orders + "\n", capture_output=True,
        text=True, timeout=30,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == "the engine was not reached: Connection refused\n"
    assert running(os.getpid())
