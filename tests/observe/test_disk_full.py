"""The n-th write fails, for n = 1, 2, ... until none does: one line, exit status 1, and nothing half-written whole."""

import errno
import json
import os

import numpy as np
import pytest

from swarmer.errors import RunFailed
from swarmer.observe import files, timeline
from swarmer.observe.saved_run import load


class Disk:
    """Full from the n-th write on, or for that one only; counts the writes."""

    def __init__(self, fails_at, for_good=True):
        self.fails_at, self.for_good, self.writes = fails_at, for_good, 0

    def write(self, fd, data):
        self.writes += 1
        if self.writes == self.fails_at or (self.for_good and self.writes > self.fails_at):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return os.write(fd, data)


def one_line(text):
    assert "No space left" in text
    assert "\n" not in text


def whole(path):
    """Fails if a file under a final name is not whole."""
    for name in ("summary.json", "manifest.json"):
        if (path / name).exists():
            json.loads((path / name).read_text())
    if (path / "timeline.npz").exists():
        with np.load(path / "timeline.npz") as data:
            assert all(len(data[name]) for name in data)
    if (path / "events.csv").exists():
        assert (path / "events.csv").read_text().endswith("\n")
    assert not list(path.glob("*.tmp"))


@pytest.mark.parametrize("for_good", [True, False])
def test_every_write_may_fail(tmp_path, monkeypatch, fake, for_good):
    monkeypatch.setattr(timeline, "CHUNK_SAMPLES", 7)
    for n in range(1, 1000):
        disk = Disk(n, for_good)
        monkeypatch.setattr(files, "write_bytes", disk.write)
        path = tmp_path / str(n)
        try:
            collector, summary = fake.record(path, seconds=2.5, recording={"enabled": False})
        except RunFailed as failure:  # before anything had started
            one_line(str(failure))
            continue
        finally:
            whole(path)
        if collector.failure is None:
            assert disk.writes < n
            assert summary["status"] == "done"
            assert load(path).missing == []  # no recording was asked for
            return
        one_line(str(collector.failure))
        assert (summary["status"], summary["message"]) == ("failed", str(collector.failure))
        load(path)
    pytest.fail("writes without end")


def test_recorder_that_cannot_write_neither_hangs_nor_keeps_its_name(tmp_path, monkeypatch, fake):
    real = files.Stream.write

    def write(stream, data):
        if stream.path.name == "recording.rrd" and len(data) > 100:
            stream.abandon()
            raise RunFailed(f"cannot write {stream.path}: No space left on device")
        real(stream, data)

    monkeypatch.setattr(files.Stream, "write", write)
    collector, summary = fake.record(tmp_path / "run", seconds=2.5)
    assert "recording.rrd" in str(collector.failure)
    assert summary["status"] == "failed"
    assert not (tmp_path / "run" / "recording.rrd").exists()
    assert load(tmp_path / "run").timeline is not None
