"""Recordings that were cut, foreign, or written by another rerun: mended, or refused with a line that helps."""

import random
import sys
import warnings

import pytest
from rerun.chunk import RrdReader

from swarmer.errors import BadInput
from swarmer.observe import recording_file
from swarmer.observe.recording_file import installed, is_whole, readable


def frames(path):
    """How many rows a recording holds, and how many blueprints."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # rerun warns of a recording without a footer
        reader = RrdReader(path)
        rows = sum(chunk.num_rows for chunk in reader.stream())
        return rows, len(reader.blueprints())


def pieces(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return len(list(RrdReader(path).stream()))


def test_a_whole_recording_is_put_together_and_loses_nothing(finished_run):
    recording = finished_run / "recording.rrd"
    assert is_whole(recording)
    with readable(recording) as path:
        assert is_whole(path)
        assert frames(path) == frames(recording)
        assert pieces(path) <= pieces(recording)
    assert not path.parent.exists()


def test_a_large_one_is_played_as_it_is(finished_run, monkeypatch):
    monkeypatch.setattr(recording_file, "COMPACTED_BYTES", 1000)
    with readable(finished_run / "recording.rrd") as path:
        assert path == finished_run / "recording.rrd"


def test_where_it_cannot_be_put_together_a_whole_one_is_played_as_it_is(finished_run, monkeypatch):
    monkeypatch.setattr(
        recording_file, "rerun_command", lambda: [sys.executable, "-c", "import sys; sys.exit(3)"]
    )
    with readable(finished_run / "recording.rrd") as path:
        assert path == finished_run / "recording.rrd"


@pytest.mark.parametrize("name", ["recording.rrd.partial", "recording.rrd"])
def test_a_cut_recording_gets_its_footer(finished_run, tmp_path, name):
    data = (finished_run / "recording.rrd").read_bytes()
    cut = tmp_path / name
    cut.write_bytes(data[: len(data) * 2 // 5])
    assert not is_whole(cut)
    with readable(cut) as path:
        assert path.name == "recording.rrd"
        assert is_whole(path)
        rows, blueprints = frames(path)
        assert 0 < rows < frames(finished_run / "recording.rrd")[0]
        assert blueprints == 1
    assert not path.parent.exists()
    assert cut.read_bytes() == data[: len(data) * 2 // 5]


def test_cut_anywhere_it_is_mended_or_refused(finished_run, tmp_path):
    data = (finished_run / "recording.rrd").read_bytes()
    rng, cut = random.Random(3), tmp_path / "recording.rrd.partial"
    for length in (0, 1, 7, 8, 9, 100, *(rng.randrange(20_000, len(data)) for _ in range(5)), len(data)):
        cut.write_bytes(data[:length])
        if length <= 300:
            with pytest.raises(BadInput, match="--terminal"), readable(cut):
                pass
        else:
            with readable(cut) as path:
                assert frames(path)[0] >= 0


def changed(finished_run, tmp_path, at, value):
    data = bytearray((finished_run / "recording.rrd").read_bytes())
    data[at] = value
    path = tmp_path / "recording.rrd"
    path.write_bytes(data)
    return path


def test_a_recording_of_a_later_rerun_says_what_to_install(finished_run, tmp_path):
    with pytest.raises(BadInput, match=r"written by rerun 9\.\d+, .*pip install 'rerun-sdk>=9"):  # noqa: SIM117
        with readable(changed(finished_run, tmp_path, 4, 9)):
            pass


@pytest.mark.parametrize("kind", [b"1", b"3"])
def test_a_recording_of_another_format_is_told(finished_run, tmp_path, kind):
    with pytest.raises(BadInput, match=rf"RRF{kind.decode()}, is not the one that rerun {installed()}"):  # noqa: SIM117
        with readable(changed(finished_run, tmp_path, 3, kind[0])):
            pass


def test_what_is_no_recording_is_refused(tmp_path):
    path = tmp_path / "recording.rrd"
    for content in (b"", b"hello, world", bytes(5000)):
        path.write_bytes(content)
        with pytest.raises(BadInput, match="not a recording of rerun"), readable(path):
            pass
