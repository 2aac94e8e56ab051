"""A timeline that a stranger wrote: nothing in it takes memory before it is judged, or ends a command."""

import io
import os
import shutil
import struct
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from swarmer.observe import strange_npz
from swarmer.observe.report import make_report
from swarmer.observe.saved_run import load

LITTLE = 200 << 20  # bytes that may be filled; the bomb below would fill more
SAMPLES, FLSS = 3, 4


def arrays(**others):
    """A small timeline, and what stands in place of parts of it; None leaves one out."""
    one = {
        "truth": np.arange(12.0).reshape(FLSS, 3),
        "t_s": np.arange(float(SAMPLES)),
        "position": np.ones((SAMPLES, FLSS, 3), np.float32),
        "swarm": np.ones((SAMPLES, FLSS), np.int32),
        "state": np.ones((SAMPLES, FLSS), np.int8),
        "lit": np.ones((SAMPLES, FLSS), np.bool_),
        "hd_cells": np.ones(SAMPLES),
        "series_name": np.array(["a"]),
        "series": np.ones((SAMPLES, 1)),
    } | others
    return {name: array for name, array in one.items() if array is not None}


def member(array):
    file = io.BytesIO()
    np.lib.format.write_array(file, np.asarray(array), allow_pickle=True)
    return file.getvalue()


def header(shape, descr="'<f4'"):
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (63 - (len(text) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def written(path, given, **raw):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in {**{name: member(array) for name, array in given.items()}, **raw}.items():
            archive.writestr(f"{name}.npy", data)
    return path


def strange(finished_run, tmp_path, given, **raw):
    """The finished run with such a timeline, read."""
    shutil.copytree(finished_run, tmp_path / "run")
    written(tmp_path / "run" / "timeline.npz", given, **raw)
    return load(tmp_path / "run")


def test_a_timeline_as_we_write_it_is_read(finished_run, tmp_path):
    run = strange(finished_run, tmp_path, arrays(swarm=np.ones((SAMPLES, FLSS), np.int64)))
    assert run.missing == []
    assert (run.timeline.swarm.dtype, list(run.timeline.series)) == (np.int32, ["a"])


PROMISES = {
    "a petabyte": (header((10**12, 114, 3)), "its header does not go with its size"),
    "more than numbers count": (header((2**62, 2**62, 4)), "its header does not go with its size"),
    "a negative length": (header((-5, 4, 3)), "its header does not go with its size"),
    "too few bytes": (header((SAMPLES, FLSS, 3)) + bytes(7), "its header does not go with its size"),
    "nothing, very often": (header((10**15, 0, 3)), "its arrays do not fit"),
    "a bomb of brackets": (b"\x93NUMPY\x01\x00" + struct.pack("<H", 60_001) + b"(" * 60_000 + b"\n", ""),
    "a bomb of signs": (b"\x93NUMPY\x01\x00" + struct.pack("<H", 9_002) + b"-" * 9_000 + b"1\n", ""),
    "no array": (b"\x80\x04\x95", ""),
    "a version that is none": (b"\x93NUMPY\x09\x00" + bytes(90), "of version 9.0"),
}


@pytest.mark.parametrize("name", PROMISES)
def test_what_a_header_promises_is_judged_first(finished_run, tmp_path, name):
    data, why = PROMISES[name]
    run = strange(finished_run, tmp_path, arrays(position=None), position=data)
    assert run.timeline is None
    assert any("timeline.npz: cannot be read" in line and why in line for line in run.missing)


WHOLE = np.ones((SAMPLES, FLSS))
WRONG = {
    "pickled objects": {"swarm": np.full((SAMPLES, FLSS), {}, dtype=object)},
    "texts for times": {"t_s": np.array(["0", "1", "2"])},
    "dates for times": {"t_s": np.arange(SAMPLES).astype("M8[s]")},
    "spans for HD": {"hd_cells": np.arange(SAMPLES).astype("m8[s]")},
    "records for Swarm-IDs": {"swarm": np.zeros((SAMPLES, FLSS), [("a", "i4"), ("b", "i4")])},
    "fractions for Swarm-IDs": {"swarm": WHOLE / 2},
    "Swarm-IDs below 0": {"swarm": -WHOLE.astype(np.int32)},
    "numbers for lit": {"lit": WHOLE},
    "complex positions": {"position": np.ones((SAMPLES, FLSS, 3), complex)},
    "positions beyond all": {"position": np.full((SAMPLES, FLSS, 3), 3e38, np.float32)},
    "points nowhere": {"truth": np.full((FLSS, 3), np.nan)},
    "points beyond all": {"truth": np.full((FLSS, 3), 1e300)},
    "times beyond all": {"t_s": np.array([0.0, 1.0, 1e300])},
    "a name that is no text": {"series_name": np.array(["\ud800"])},
    "a name, and no values": {"series": None},
    "nobody": {
        name: array[:, :0] if array.ndim > 1 else array
        for name, array in arrays(truth=None, series=None, series_name=None).items()
    }
    | {"truth": np.zeros((0, 3)), "series": None, "series_name": None},
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_is_named_and_the_rest_shown(finished_run, tmp_path, name, quick):
    run = strange(finished_run, tmp_path, arrays(**WRONG[name]))
    assert run.timeline is None
    assert any("timeline.npz: cannot be read" in line for line in run.missing)
    assert "Not everything is there" in make_report([run])


def bomb(path, megabytes, shape):
    """A timeline whose `position` unpacks to so much."""
    written(path, arrays(position=None))
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("position.npy", "w", force_zip64=True) as file,
    ):
        file.write(header(shape))
        for _ in range(megabytes):
            file.write(bytes(1 << 20))


def test_a_bomb_takes_no_memory(tmp_path):
    """In a process of its own, which may have little; the whole command, as a user runs it."""
    run = tmp_path / "run"
    run.mkdir()
    bomb(run / "timeline.npz", 1 << 10, ((1 << 30) // 48, FLSS, 3))
    assert (run / "timeline.npz").stat().st_size < 8 << 20
    program = f"""
        import resource
        from swarmer.observe import saved_run, strange_npz
        strange_npz.largest = lambda: {LITTLE}
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        read = saved_run.load(saved_run.Path({str(run)!r}))
        assert read.timeline is None
        assert any("it would fill more than the" in line for line in read.missing), read.missing
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        assert grown < 50_000, grown  # kB
    """
    lines = "\n".join(line.strip() for line in program.splitlines())
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_list_that_lies_about_sizes_is_seen(tmp_path):
    path = written(tmp_path / "a.npz", {}, position=header((10**9, 3, 4)) + bytes(1000))
    data, size = bytearray(path.read_bytes()), 48 * 10**9 // 16
    at = data.index(b"PK\x01\x02")
    struct.pack_into("<I", data, at + 24, size)  # what it unpacks to, as the archive's list has it
    path.write_bytes(data)
    with pytest.raises(strange_npz.BROKEN):
        strange_npz.arrays(path, {"position": np.float32}, {})


def test_half_of_the_memory_is_the_most(tmp_path):
    path = written(tmp_path / "a.npz", {"a": np.zeros(1000)})
    assert strange_npz.arrays(path, {"a": np.float64}, {})["a"].nbytes == 8000
    assert strange_npz.largest() * 2 == os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with pytest.raises(ValueError, match="would fill more"):
        strange_npz.arrays(path, {"a": np.float64}, {}, room=7999)
    with pytest.raises(ValueError, match="would fill more"):
        strange_npz.arrays(path, {"a": np.float32}, {}, room=11_999)  # both copies count


def test_chunks_of_a_killed_run_fill_no_more_together_than_one_file_may(tmp_path, monkeypatch):
    directory = tmp_path / "timeline.npz.partial"
    directory.mkdir()
    given = arrays()
    written(directory / "truth.npz", {"truth": given.pop("truth")})
    for number in range(5):
        written(directory / f"{number:05d}.npz", given)
    assert len(load(tmp_path).timeline.t_s) == 5 * SAMPLES
    monkeypatch.setattr(strange_npz, "largest", lambda: 3 * sum(array.nbytes for array in given.values()))
    run = load(tmp_path)
    assert len(run.timeline.t_s) == 3 * SAMPLES
    assert "timeline.npz.partial: a part cannot be read (ValueError)" in run.missing
