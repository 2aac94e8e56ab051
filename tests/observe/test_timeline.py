import os
import signal
import subprocess
import sys
import textwrap

import numpy as np

from swarmer.observe import timeline
from swarmer.observe.saved_run import load
from swarmer.observe.timeline import Frame, TimelineWriter


def frames(count, size=5):
    rng = np.random.default_rng(3)
    for k in range(count):
        lit = rng.random(size) < 0.7
        hd = float("nan") if k == 0 else float(rng.random())
        yield Frame(
            k / 10, rng.normal(size=(size, 3)), rng.integers(0, size, size), rng.integers(0, 5, size), lit, hd
        )


def test_what_was_taken_is_read_back(tmp_path, monkeypatch):
    monkeypatch.setattr(timeline, "CHUNK_SAMPLES", 4)
    truth = np.random.default_rng(0).random((5, 3))
    writer = TimelineWriter(tmp_path, truth)
    given = list(frames(11))
    for frame in given:
        writer.append(frame)
    writer.close()
    writer.close()
    with np.load(tmp_path / "timeline.npz") as data:
        assert set(data) == {"t_s", "fid", "truth", "position", "swarm", "state", "lit", "hd_cells"}
        assert data["position"].shape == (11, 5, 3)
        assert data["fid"].tolist() == [1, 2, 3, 4, 5]
        np.testing.assert_array_equal(data["truth"], truth)
        np.testing.assert_allclose(data["position"], np.stack([f.position for f in given]), rtol=1e-6)
        np.testing.assert_array_equal(data["lit"], np.stack([f.lit for f in given]))
        np.testing.assert_array_equal(data["hd_cells"], [f.hd_cells for f in given])
    assert [path.name for path in tmp_path.iterdir()] == ["timeline.npz"]


def test_arrays_changed_after_append_do_not_matter(tmp_path):
    writer = TimelineWriter(tmp_path, np.zeros((5, 3)))
    frame = next(frames(1))
    kept = frame.position.copy()
    writer.append(frame)
    frame.position[:] = 99
    writer.close()
    np.testing.assert_allclose(load(tmp_path).timeline.position[0], kept, rtol=1e-6)


def test_run_without_a_sample_has_an_empty_timeline(tmp_path):
    TimelineWriter(tmp_path, np.zeros((5, 3))).close()
    assert load(tmp_path).timeline.position.shape == (0, 5, 3)


def test_killed_run_leaves_its_chunks(tmp_path):
    program = f"""
        import os, signal, sys
        import numpy as np
        from pathlib import Path
        from swarmer.observe import timeline
        from swarmer.observe.timeline import Frame, TimelineWriter
        timeline.CHUNK_SAMPLES = 10
        writer = TimelineWriter(Path({str(tmp_path)!r}), np.zeros((3, 3)))
        for k in range(33):
            writer.append(Frame(k, np.full((3, 3), k), np.ones(3), np.ones(3), np.ones(3), 1.0))
        os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], check=False, env=dict(os.environ))
    assert done.returncode == -signal.SIGKILL
    run = load(tmp_path)
    assert run.timeline.t_s.tolist() == list(range(25))  # chunks of 5, 10 and 10
    assert any("timeline.npz: cut" in line for line in run.missing)


def test_series_and_distances_are_kept_beside_the_frames(tmp_path):
    writer = TimelineWriter(tmp_path, np.zeros((5, 3)))
    for k, frame in enumerate(frames(12)):
        writer.append(frame, {"a": k, "b": None} if k != 3 else {"b": 1.0, "later": 5.0})
    writer.flown = np.arange(10.0).reshape(5, 2)
    killed = load(tmp_path).timeline
    assert killed.series["a"][:3].tolist() == [0, 1, 2]
    assert (len(killed.series["a"]), killed.flown_cells) == (5, None), "the first chunk alone is on disk"
    writer.close()
    saved = load(tmp_path).timeline
    assert list(saved.series) == ["a", "b"]
    np.testing.assert_array_equal(saved.series["a"], [0, 1, 2, np.nan, *range(4, 12)])
    np.testing.assert_array_equal(saved.series["b"], [np.nan] * 3 + [1.0] + [np.nan] * 8)
    np.testing.assert_array_equal(saved.flown_cells, np.arange(10.0).reshape(5, 2))


def test_series_that_do_not_fit_are_refused(tmp_path):
    writer = TimelineWriter(tmp_path, np.zeros((5, 3)))
    for frame in frames(6):
        writer.append(frame, {"a": 1.0})
    writer.close()
    with np.load(tmp_path / "timeline.npz") as data:
        arrays = dict(data)
    for broken in (
        {"series": np.zeros((6, 3))},
        {"flown_cells": np.zeros((4, 2))},
        {"flown_cells": np.full((5, 2), np.nan)},
    ):
        np.savez(tmp_path / "timeline.npz", **(arrays | broken))
        run = load(tmp_path)
        assert run.timeline is None
        assert any("timeline.npz: cannot be read" in line for line in run.missing)
