"""Fault schedules on real processes: they die, stand still and come back, and the radio does what virtual time does."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest
from helpers import children, dispatcher_of, events, flss_of, gone, small, start, wait_for

OFF = ["--set", "thaw.policy=off"]


def with_faults(tmp_path, text, *more, **named):
    (tmp_path / "storm.yaml").write_text(text)
    return small(tmp_path, "--set", "faults.file=storm.yaml", "--set", "recording.rate_hz=20", *more, **named)


def frames(summary):
    with np.load(summary["dir"] / "timeline.npz") as data:
        return {name: data[name] for name in data}


def told(summary):
    return [(event["kind"], int(event["fid"])) for event in events(summary["dir"])]


def test_kill_region_and_swarm(tmp_path):
    summary = with_faults(
        tmp_path,
        """
faults:
- {at: 2, what: kill, where: [3, 5], for: 0}
- {at: 4, what: kill, where: {swarm_of: 3}, for: 1}
""",
        *OFF, duration=8,
    )  # fmt: skip
    happened = told(summary)
    assert {fid for kind, fid in happened if kind == "failure"} == set(range(1, 17))
    assert not [kind for kind, _ in happened if kind == "crash"]
    assert summary["failures"] == summary["replacements"] == 18
    assert summary["status"] == "done"
    data = frames(summary)
    dark = data["lit"][(data["t_s"] > 4.3) & (data["t_s"] < 4.9)]
    assert not dark.any()
    assert summary["lit_share"] == 1
    assert summary["swarms_last"] == 1


def test_a_partition_parts_and_heals(tmp_path):
    text = "faults:\n- {at: 0, for: 4, what: partition, axis: L}\n"
    summary = with_faults(tmp_path, text, *OFF, duration=7, points=20)
    data = frames(summary)
    parted = data["swarm"][(data["t_s"] > 3.5) & (data["t_s"] < 3.9)][-1]
    assert len(set(parted.tolist())) == 2
    assert summary["swarms_last"] == 1


def test_only_fins_are_lost(tmp_path):
    text = "faults:\n- {at: 0, what: loss, p: 1, way: in, where: all, kinds: [CHALLENGE_FIN]}\n"
    summary = with_faults(tmp_path, text, *OFF)
    assert summary["leases_expired"] > 5
    assert summary["datagrams_lost"] > 5
    assert summary["swarms_last"] == 1


def test_bursts_and_dead_links(tmp_path):
    settings = ["--set", "radio.loss=0.2", "--set", "radio.burst=10", "--set", "radio.dead_links=0.1"]
    summary = small(tmp_path, *settings, *OFF, duration=6)
    share = summary["datagrams_lost"] / (summary["datagrams_lost"] + summary["datagrams_delivered"])
    assert 0.15 < share < 0.75
    assert summary["first_single_swarm_s"] is not None


def test_a_hung_process_stands_still_and_goes_on(tmp_path):
    (tmp_path / "storm.yaml").write_text("faults:\n- {at: 2, for: 1.5, what: hang, where: [3]}\n")
    process = start(
        "--shape", "random", "--points", "16", "--duration", "6", "--no-recording", "--set", "faults.file=storm.yaml",
        *OFF, "--out", "run", cwd=tmp_path,
    )  # fmt: skip
    flss = flss_of(process, 16)
    stopped = wait_for(lambda: [pid for pid in flss if state(pid) == "T"], every=0.02)
    wait_for(lambda: not [pid for pid in flss if state(pid) == "T"])
    assert len(stopped) == 1
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["failures"] == 0
    assert summary["swarms_last"] == 1


def state(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return ""


def test_who_hangs_too_long_is_killed_and_replaced(tmp_path):
    text = "faults:\n- {at: 1.5, what: hang, where: [3, 4]}\n"
    summary = with_faults(tmp_path, text, *OFF, "--set", "failure.hang_s=1", duration=6)
    assert [(kind, fid) for kind, fid in told(summary) if kind in ("failure", "replacement")] in (
        [("failure", 3), ("replacement", 3), ("failure", 4), ("replacement", 4)],
        [("failure", 4), ("replacement", 4), ("failure", 3), ("replacement", 3)],
    )
    assert summary["lit_share"] == 1
    assert summary["swarms_last"] == 1


def test_slow_and_spoilt(tmp_path):
    text = """
faults:
- {at: 1, for: 3, what: slow, where: [3, 4], late: 0.05}
- {at: 0, what: bias, by: 1, where: all}
"""
    summary = with_faults(tmp_path, text, *OFF, duration=6)
    assert summary["failures"] == 0
    assert summary["swarms_last"] == 1
    assert 0.5 < summary["hd_cells"] < 20


@pytest.mark.parametrize("how", ["it ends", "ctrl-c", "killed"])
def test_stopped_processes_end_with_their_run(tmp_path, how):
    (tmp_path / "storm.yaml").write_text("faults:\n- {at: 0.5, what: hang, where: all}\n")
    process = start(
        "--shape", "random", "--points", "8", "--duration", "2" if how == "it ends" else "60", "--no-recording",
        "--set", "faults.file=storm.yaml", "--out", "run", cwd=tmp_path,
    )  # fmt: skip
    flss = flss_of(process, 8)
    dispatcher = dispatcher_of(process.pid)
    wait_for(lambda: all(state(pid) == "T" for pid in flss))
    if how == "ctrl-c":
        process.send_signal(signal.SIGINT)
    elif how == "killed":
        process.kill()
    process.communicate(timeout=30)
    wait_for(lambda: gone([*flss, dispatcher]))
    assert not children(process.pid)
