"""Where memory ends: a run is refused before, or fails and says so, in a real control group with a small limit."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import children, gone, start, wait_for

from swarmer.engines import control_groups

pytestmark = [pytest.mark.processes, pytest.mark.timeout(120)]

LIMIT_MB = 300
RUN = ["--shape", "random", "--no-recording", "--duration", "5", "--out", "run"]
ALL_FIT = "from swarmer import cli; from swarmer.engines import limits; limits.MEMORY_MB_PER_FLS = 0.01; "


@pytest.fixture
def group():
    """A control group with little memory; needs the privilege to make one."""
    first = control_groups.ROOT / "memory"
    root, limit = (first, "memory.limit_in_bytes") if first.is_dir() else (control_groups.ROOT, "memory.max")
    own = root / f"swarmer-test-{os.getpid()}"
    try:
        own.mkdir()
        (own / limit).write_text(str(LIMIT_MB << 20))
        for swap, most in (("memory.swap.max", 0), ("memory.memsw.limit_in_bytes", LIMIT_MB << 20)):
            with contextlib.suppress(OSError):  # where there is such a limit, nor may it swap
                (own / swap).write_text(str(most))
    except OSError as error:
        with contextlib.suppress(OSError):
            own.rmdir()
        pytest.skip(f"NOT TESTED: no control group can be made here ({error.strerror})")
    try:
        yield own
    finally:
        wait_for(lambda: (own / "cgroup.procs").read_text() == "", 30)
        own.rmdir()


def within(group, code, *arguments, cwd):
    """Run `swarmer-run` in the group."""
    program = f"{code}import sys; sys.argv[0] = 'swarmer-run'; cli.main_run()"
    return subprocess.run(
        ["sh", "-c", 'echo $$ > "$0"/cgroup.procs; exec "$@"', group, sys.executable, "-c", program, *arguments],
        cwd=cwd, text=True, capture_output=True, timeout=100,
    )  # fmt: skip


def test_what_the_group_does_not_grant_is_refused_before(group, tmp_path):
    done = within(group, "from swarmer import cli; ", *RUN, "--points", "200", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("error: points: 200 is not allowed; at most ")
    assert done.stderr.endswith(" MB of free memory\n")
    assert list(tmp_path.iterdir()) == []


def test_the_kernel_ends_flss_and_the_engine_lives_to_say_so(group, tmp_path):
    """Left alone it takes the largest process, which is the engine, and nothing is left of the run."""
    done = within(group, ALL_FIT, *RUN, "--points", "200", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["status"] == "failed"
    assert "by SIGKILL; is the machine, or its control group, out of memory?" in summary["message"]


def test_flss_are_the_first_to_go(tmp_path):
    process = start(*RUN, "--points", "5", "--duration", "600", cwd=tmp_path)
    try:
        [dispatcher] = wait_for(lambda: children(process.pid), 30)
        wait_for(lambda: len(children(dispatcher)) == 5, 30)
        flss = children(dispatcher)
        wait_for(lambda: {score(pid) for pid in flss} == {1000}, 30)
        assert score(dispatcher) == score(process.pid) == score(os.getpid())
    finally:
        process.terminate()
        process.communicate(timeout=30)
    wait_for(lambda: gone(flss))


def score(pid):
    return int(Path(f"/proc/{pid}/oom_score_adj").read_text())
