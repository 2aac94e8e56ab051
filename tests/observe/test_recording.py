import contextlib
import os
import time
from pathlib import Path

import numpy as np
import pytest

from swarmer.engines.result import Event
from swarmer.observe.files import Stream
from swarmer.observe.recording import Recording
from swarmer.observe.timeline import Frame

rrd = pytest.importorskip("rerun.chunk")
TRUTH = np.random.default_rng(0).random((6, 3)) * 10


def rows(path, entity):
    """Every row of every component that was logged for an entity, as (component, value), in the samples' order."""
    found = []
    for chunk in rrd.RrdReader(path).stream():
        if chunk.entity_path.strip("/") == entity:
            batch = chunk.to_record_batch()
            columns = dict(zip(batch.schema.names, batch.columns, strict=True))
            samples = columns["sample"].to_pylist() if "sample" in columns else [0] * batch.num_rows
            for name in filter(lambda name: ":" in name, columns):  # the others are indexes
                found += [
                    (at, name, value) for at, value in zip(samples, columns[name].to_pylist(), strict=True)
                ]
    return [
        (name, value) for _, name, value in sorted(found, key=lambda row: row[0] or 0) if value is not None
    ]


@pytest.fixture
def written(tmp_path):
    stream = Stream(tmp_path / "recording.rrd")
    recording = Recording(stream, TRUTH)
    position = TRUTH.copy()
    for k in range(20):
        position += 0.25  # in place: the recording must have taken a copy
        swarm = np.full(6, 1 if k >= 10 else 2, np.int32)
        frame = Frame(k / 10, position, swarm, np.ones(6), np.ones(6, bool), 0.5 if k else float("nan"))
        recording.frame(frame, 1, np.array([0, 6, 0, 0, 0]))
    recording.event(Event(1.5, "failure", 4, "died"))
    recording.close()
    stream.close()
    return tmp_path / "recording.rrd"


def test_every_frame_is_there_as_it_was(written):
    frames = [value for name, value in rows(written, "swarm") if name == "Points3D:positions"]
    assert len(frames) == 20
    np.testing.assert_allclose(frames[0], TRUTH + 0.25, rtol=1e-5)
    np.testing.assert_allclose(frames[-1], TRUTH + 5.0, rtol=1e-5)


def test_colours_are_written_when_they_change(written):
    assert len([1 for name, _ in rows(written, "swarm") if name == "Points3D:colors"]) == 2


def test_hd_states_and_events_are_there(written):
    assert len([1 for name, _ in rows(written, "hd_cells") if name == "Scalars:scalars"]) == 19
    assert len([1 for name, _ in rows(written, "states/available") if name == "Scalars:scalars"]) == 20
    assert ("TextLog:text", ["FLS 4: died"]) in rows(written, "events")


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_cut_recording_gives_what_is_whole(written):
    """The reader of a cut file ends early or refuses; it never hangs."""
    data = written.read_bytes()
    written.write_bytes(data[: int(len(data) * 0.9)])
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        rows(written, "swarm")


def test_live_without_a_display_warns_and_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr("swarmer.observe.recording.display_available", lambda: False)
    stream = Stream(tmp_path / "recording.rrd")
    recording = Recording(stream, TRUTH, live=True)
    assert "no display" in recording.warning
    recording.close()
    stream.close()
    assert (tmp_path / "recording.rrd").stat().st_size > 0


def test_a_child_that_holds_the_pipe_open_does_not_hold_the_end_up(tmp_path):
    """An engine may fork while the recording is open; a forked child has all descriptors."""
    stream = Stream(tmp_path / "recording.rrd")
    recording = Recording(stream, TRUTH)
    held = [os.open(f"/dev/fd/{fd}", os.O_WRONLY) for fd in pipes_open_for_writing()]
    begun = time.monotonic()
    recording.close()
    stream.close()
    for fd in held:
        os.close(fd)
    assert held
    assert time.monotonic() - begun < 5
    assert len(list(rrd.RrdReader(tmp_path / "recording.rrd").stream())) > 3


def pipes_open_for_writing():
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            if str(link.readlink()).startswith("pipe:"):
                flags = Path(f"/proc/self/fdinfo/{link.name}").read_text().split("flags:")[1].split()[0]
                if int(flags, 8) & os.O_ACCMODE == os.O_WRONLY:
                    yield int(link.name)
