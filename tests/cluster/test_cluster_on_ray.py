"""Ray starts the hosts' agents: on two nodes of its own multi-node mode, in a network namespace made for it."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from namespaces import why_not

ALONE = ("unshare", "--net", "--pid", "--fork", "--kill-child", "--mount-proc")
pytestmark = [pytest.mark.processes, pytest.mark.slow, pytest.mark.namespaces]


@pytest.mark.timeout(240)
def test_a_run_on_two_nodes_of_ray(tmp_path):
    pytest.importorskip("ray")
    if why := why_not():
        assert not os.environ.get("SWARMER_NEEDS_NAMESPACES"), why
        pytest.skip(f"NO NETWORK NAMESPACES: {why}")
    script = Path(__file__).with_name("on_fake_nodes.py")
    process = subprocess.Popen(
        [*ALONE, sys.executable, str(script), str(tmp_path)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, cwd=tmp_path,
    )  # fmt: skip
    try:
        out, err = process.communicate(timeout=200)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)  # its namespace of processes ends with it
            process.communicate()
    assert out, err
    found = json.loads(out.splitlines()[-1])
    assert found["done"][0] == 0, found["done"][1]
    summary = json.loads((tmp_path / "done" / "summary.json").read_text())
    assert (summary["status"], summary["hosts"], summary["processes"]) == ("done", 2, 20)
    assert summary["relayed_datagrams"] > 0
    assert summary["hd_cells"] < 0.1
    assert found["too_many"] == [2, "error: cluster.nodes: 3 is not allowed; Ray has 2 with a core to give\n"]
    assert found["nobody"] == [
        2, "error: cluster.address: nothing answers at '127.0.0.1:1': Connection refused\n",
    ]  # fmt: skip
    status, line = found["strange"]
    assert status == 2
    assert re.fullmatch(
        r"error: cluster.address: node 127.0.0.1 \(\w+\) has other sources of swarmer [\d.]+ than this machine; "
        r"install the same there\n", line
    )  # fmt: skip
