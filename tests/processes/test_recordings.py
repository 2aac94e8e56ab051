"""The recording of real processes is that of virtual time: the same entities, components and timelines."""

import pytest
from helpers import run
from rerun.chunk import RrdReader

pytestmark = pytest.mark.processes


def content(path):
    """(entity, component) of all that changes, how often each was written, and the timelines."""
    found, timelines = {}, set()
    for chunk in RrdReader(path).stream():
        timelines |= set(chunk.timeline_names)
        names = [name for name in chunk.to_record_batch().schema.names if ":" in name]
        for name in names:
            key = (chunk.entity_path.strip("/"), name)
            found[key] = found.get(key, 0) + chunk.num_rows
    return found, timelines


def recorded(tmp_path, engine, *more):
    out = tmp_path / engine
    done = run(
        "--shape", "random", "--points", "16", "--duration", "4", "--engine", engine, "--out", str(out),
        "--set", "failure.rate=0.02", *more, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return content(out / "recording.rrd")


def test_processes_and_virtual_time_make_the_same_recording(tmp_path):
    processes, timelines = recorded(tmp_path, "process")
    virtual, others = recorded(tmp_path, "virtual")
    assert timelines == others == {"emulated_time", "sample"}
    assert set(processes) == set(virtual)
    for wanted in (
        "localizations",
        "anchors",
        "failures",
        "datagrams",
        "lateness",
        "states",
        "events",
        "swarm/fls_1-16",
    ):
        assert any(entity == wanted for entity, _ in processes), wanted
    assert processes["localizations", "Arrows3D:vectors"] > 5
