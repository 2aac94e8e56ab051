"""Real hosts, as far as a machine can have several: network namespaces with cables between them (`namespaces`).

The relays make loss and delay between hosts, for not every kernel has netem. Skipped, in capitals, without the
privilege to make namespaces; CI has it, and there a skip is a failure.
"""

import json
import os
import time

import pytest
from helpers import events, start, wait_for
from namespaces import Namespaces, left, why_not

pytestmark = [pytest.mark.processes, pytest.mark.namespaces]

NOT = why_not()


@pytest.fixture(autouse=True)
def needs_namespaces():
    if NOT:
        assert not os.environ.get("SWARMER_NEEDS_NAMESPACES"), NOT
        pytest.skip(f"NO NETWORK NAMESPACES: {NOT}")


class ClusterRun:
    """`swarmer-run` in the engine's namespace."""

    def __init__(self, net, tmp_path, *arguments):
        self.net, self.out = net, tmp_path / "run"
        self.process = start(
            "--no-recording", "--out", str(self.out), *net.settings(), *arguments, cwd=tmp_path,
            before=net.inside(net.engine),
        )  # fmt: skip

    def at(self, second):
        """Wait until that emulated second, by the samples' line in the log."""
        while True:
            line = self.process.stderr.readline()
            assert line, "the run has ended"
            if line[0].isdigit() and float(line.split()[0]) >= second:
                return

    def gone_live(self):
        while not (line := self.process.stderr.readline()).startswith("go:"):
            assert line, "the run has ended"

    def finish(self):
        _, self.last_words = self.process.communicate(timeout=100)
        assert self.process.returncode == 0, self.last_words
        return json.loads((self.out / "summary.json").read_text())


@pytest.fixture
def net():
    with Namespaces(3) as made:
        yield made
        processes = [pid for name in (made.engine, *made.hosts) for pid in made.pids(name)]
    assert processes == [], "whoever ended a run has left nobody"
    assert left(made.prefix) == []


def test_three_hosts_of_50_with_loss_and_delay_and_one_that_is_killed(net, tmp_path):
    """One host loses power in the middle: its FLSs are replaced on the others, and the run comes to its end."""
    run = ClusterRun(
        net, tmp_path, "--shape", "sphere", "--points", "150", "--duration", "11", "--set", "radio.mac=true",
        "--set", "cluster.relay_loss=0.1", "--set", "cluster.relay_delay_ms=5",
    )  # fmt: skip
    run.gone_live()
    assert [len(net.pids(host)) for host in net.hosts] == [53] * 3, "agent, dispatcher, relay and 50 FLSs"
    run.at(2.0)
    assert len(net.kill(net.hosts[1])) == 53
    summary = run.finish()
    assert summary["status"] == "done"
    assert (summary["hosts"], summary["hosts_lost"]) == (3, 1)
    assert (summary["failures"], summary["replacements"]) == (50, 50)
    assert summary["processes"] == 150
    assert summary["lit_share"] == 1, "those who replace them are there"
    assert summary["hd_cells"] < 0.1, "and have localized"
    assert 0.05 < summary["relay_lost"] / (summary["relay_lost"] + summary["relayed_datagrams"]) < 0.2
    assert summary["relay_late_ms"]["p50"] > 5, "as asked"
    assert summary["relay_rejected"] == summary["rejected"] == 0
    [told] = [event for event in events(run.out) if event["kind"] == "host"]
    gone, *others = net.hosts[1], net.hosts[0], net.hosts[2]
    assert told["text"].startswith(f"{gone} is gone (the connection has ended); its 50 FLSs are replaced on ")
    assert all(name in told["text"] for name in others)
    assert "1 of 3 hosts lost, 50 FLSs replaced: see events.csv" in run.last_words


SHIFTED = """#!/bin/bash
host=$1; shift
day=()
if [ "$host" = {host} ]; then day=(unshare --time --monotonic 86400 --fork --kill-child); fi
exec nsenter "--net=/run/netns/$host" -- "${day[@]}" "$@"
"""


def test_a_clock_that_began_a_day_before_and_a_cable_that_is_pulled(net, tmp_path):
    """The second host's monotonic clock is a day ahead: its FLSs live on the engine's time all the same.

    The third host is cut off: nobody ends there, nothing is said. It is taken for gone, and has ended itself by then,
    for others have its FLSs now.
    """
    shifted = tmp_path / "shifted"
    shifted.write_text(SHIFTED.replace("{host}", net.hosts[1]))
    shifted.chmod(0o755)
    run = ClusterRun(
        net, tmp_path, "--shape", "sphere", "--points", "30", "--duration", "10",
        "--set", f"cluster.launch={shifted} {{host}}", "--set", "cluster.wall_patience_s=2",
    )  # fmt: skip
    run.gone_live()
    time.sleep(1)
    net.unplug(net.hosts[2])
    wait_for(lambda: any(event["kind"] == "host" for event in events(run.out)), 30)
    assert not net.pids(net.hosts[2])
    summary = run.finish()
    assert summary["status"] == "done"
    assert (summary["hosts_lost"], summary["failures"], summary["replacements"]) == (1, 10, 10)
    assert summary["lit_share"] == 1
    assert summary["hd_cells"] < 0.1
    assert summary["clock_bound_ms"] < 10
    assert summary["relay_late_ms"]["max"] < 10_000, "not a day"
    [told] = [event for event in events(run.out) if event["kind"] == "host"]
    assert "nothing was heard from it for " in told["text"]


def test_hosts_that_do_not_reach_each_other_are_told_before_anything_flies(net, tmp_path):
    """Their agents reach the engine, as on a cluster whose firewall knows TCP alone."""
    net.part(*net.hosts[1:])
    run = ClusterRun(net, tmp_path, "--shape", "sphere", "--points", "9", "--duration", "5")
    _, err = run.process.communicate(timeout=60)
    assert run.process.returncode == 1
    summary = json.loads((run.out / "summary.json").read_text())
    assert (summary["status"], summary["emulated_s"]) == ("failed", 0)
    one, other = net.hosts[1:]
    assert summary["message"].startswith(
        f"{one} hears nothing from {other}: UDP from 10.77.0.4 does not get to 10.77.0.3"
    )
    assert "Traceback" not in err
