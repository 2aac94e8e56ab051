"""Sweeps on a real Ray: two nodes on this machine, in a network namespace of their own, which needs the privilege."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from helpers import wait_for

from swarmer.experiments.errand import DESK

SWEEP = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer'; cli.main()"
TINY = "base: {engine: virtual, shape: sphere, points: 30, duration_s: 20, lambda_ms: 60}\nseeds: 8\n"


def may_have_a_network() -> bool:
    tool = shutil.which("unshare")
    return tool is not None and subprocess.run([tool, "-n", "true"], capture_output=True).returncode == 0


pytestmark = [
    pytest.mark.slow,
    pytest.mark.processes,
    pytest.mark.timeout(300),
    pytest.mark.skipif(find_spec("ray") is None, reason="needs the extra `cluster`"),
    pytest.mark.skipif(
        not may_have_a_network(), reason="NOT TESTED: `unshare -n` needs the privilege (CAP_SYS_ADMIN)"
    ),
]


class Cluster:
    """The nodes, and commands run beside them."""

    def __init__(self, process, address):
        self.process, self.address = process, address

    def obey(self, line):
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline() == "done\n"

    def sweep(self, *arguments, cwd, ray=True, **environment):
        """Start `swarmer sweep` in their network."""
        more = ["--ray", self.address] if ray else []
        return subprocess.Popen(
            ["nsenter", "-t", str(self.process.pid), "-n", sys.executable, "-c", SWEEP, "sweep", *map(str, arguments),
             *more],
            cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler), start_new_session=True,
            env={**os.environ, **environment},
        )  # fmt: skip

    def swept(self, *arguments, cwd, status=0, **more):
        process = self.sweep(*arguments, cwd=cwd, **more)
        out, err = process.communicate(timeout=200)
        assert process.returncode == status, err
        assert "Traceback" not in err
        return out, err


@pytest.fixture(scope="module")
def cluster():
    script = Path(__file__).parent / "ray_cluster.py"
    process = subprocess.Popen(
        ["unshare", "-n", sys.executable, str(script)],
        text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        address = process.stdout.readline().strip()
        assert address, "the cluster did not start"
        yield Cluster(process, address)
        process.stdin.write("end\n")
        process.stdin.close()
        process.wait(60)
    finally:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()


def until(condition, process, seconds=120):
    """Wait for it while the sweep lives; what that said, if it ends or the time is over."""
    try:
        wait_for(lambda: condition() or process.poll() is not None, seconds, 0.02)
        assert condition()
    except AssertionError:
        process.kill()
        raise AssertionError(process.communicate()[1]) from None


def summaries(out):
    return {path: path.stat().st_mtime_ns for path in out.glob("**/summary.json")}


def rows(out):
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def desks(place):
    return list(place.glob(f"{DESK}*"))


def test_killed_and_resumed_it_repeats_nothing_and_a_node_that_dies_costs_no_run(cluster, write, tmp_path):
    file, out = write(TINY), tmp_path / "o"
    process = cluster.sweep(file, "--out", out, cwd=tmp_path)
    until(lambda: len(summaries(out)) >= 2, process, 60)
    process.kill()
    process.communicate()
    there = summaries(out)
    assert 2 <= len(there) < 8
    process = cluster.sweep(file, "--out", out, cwd=tmp_path)
    until(lambda: len(summaries(out)) > len(there), process)
    cluster.obey("lose")
    _, err = process.communicate(timeout=200)
    cluster.obey("add")
    assert process.returncode == 0, err
    assert "it is made anew" in err
    assert f"8 runs, {len(there)} of them finished already, 2 at a time" in err
    assert "Ray has 2 nodes with 2 cores" in err
    assert there.items() <= summaries(out).items()
    assert [(row["seed"], row["status"]) for row in rows(out)] == [
        (str(seed), "done") for seed in range(1, 9)
    ]
    cluster.swept(file, "--out", tmp_path / "here", "--seeds", "2", "--jobs", "1", cwd=tmp_path, ray=False)
    for seed in (1, 2):
        traces = [json.loads((at / f"seed-{seed}" / "summary.json").read_text())["trace_sha256"]
                  for at in (out, tmp_path / "here")]  # fmt: skip
        assert traces[0] == traces[1]


def test_runs_of_processes_have_a_node_each_and_what_fits_nowhere_is_refused(cluster, write, tmp_path):
    file = write("base: {engine: process, shape: sphere, points: 6, duration_s: 1}\nseeds: 2")
    cluster.swept(file, "--out", tmp_path / "o", cwd=tmp_path)
    assert [row["status"] for row in rows(tmp_path / "o")] == ["done"] * 2
    large = write("base: {engine: virtual, shape: sphere}\nneeds: {cores: 5}", "large.yaml")
    _, err = cluster.swept(large, "--out", tmp_path / "l", cwd=tmp_path, status=2)
    assert err.startswith("error: --ray: too few slots: seed-1 needs 5 cores and ")
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "l" / "experiment.yaml").exists()


@pytest.fixture
def short():
    """A temporary directory whose name leaves room for the sockets in it."""
    with tempfile.TemporaryDirectory(prefix="sw-", dir="/tmp") as place:
        yield Path(place)


def test_ctrl_c_ends_the_runs_and_a_ray_of_our_own(cluster, write, tmp_path, short):
    file = write(TINY.replace("duration_s: 20", "duration_s: 100000"))
    process = cluster.sweep(file, "--out", tmp_path / "o", "--jobs", "2", "--ray", cwd=tmp_path, ray=False,
                            TMPDIR=str(short))  # fmt: skip
    until(lambda: desks(short), process)
    workers = [
        pid
        for pid in (int(one.name) for one in Path("/proc").iterdir() if one.name.isdigit())
        if is_of(pid, process.pid)
    ]
    assert workers
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "the same command goes on with the rest" in err
    assert out == f"{tmp_path / 'o'}\n"
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers), 30)
    assert desks(short) == []


def is_of(pid, ancestor):
    """Is a process a descendant?"""
    while pid > 1 and pid != ancestor:
        try:
            pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError):
            return False
    return pid == ancestor
