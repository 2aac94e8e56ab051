import base64
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from swarmer.observe import timeline as timeline_frame
from swarmer.observe.report_data import RunData
from swarmer.observe.report_scene import BYTES_MAX, FRAMES_MIN, pack, scene_part
from swarmer.observe.saved_run import SavedRun, load
from swarmer.observe.saved_timeline import SavedTimeline


def unpack(packed, points):
    """As the page's script does it: (frames, 4, F)."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(packed.data)), np.uint8)
    low, high = raw.reshape(2, -1).astype(np.uint16)
    return np.cumsum((low | high << 8).reshape(-1, 4, points), axis=0, dtype=np.uint16)


def moving(frames, points, seed=1):
    """Everybody moves in every frame, in many swarms: what deflates worst."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0, 80, (points, 3))
    position = (truth + rng.normal(size=(frames, points, 3))).astype(np.float32)
    swarm = rng.integers(1, points + 1, (frames, points)).astype(np.int32)
    lit = rng.random((frames, points)) < 0.95
    t_s = np.arange(frames) / 10
    return SavedTimeline(t_s, truth, position, swarm, lit.astype(np.int8), lit, rng.random(frames))


def test_what_was_packed_is_unpacked(finished_run):
    timeline = load(finished_run).timeline
    packed = pack(timeline)
    values = unpack(packed, 40)
    assert packed.at.tolist() == list(range(len(timeline.t_s)))
    place = packed.low[:, None] + packed.step * values[:, :3]
    np.testing.assert_allclose(place[0].T, timeline.truth, atol=packed.step)
    np.testing.assert_allclose(place[1:].transpose(0, 2, 1), timeline.position, atol=packed.step)
    np.testing.assert_array_equal(values[1:, 3], np.where(timeline.lit, timeline.swarm, 0))
    assert packed.step < 0.02


def test_who_rests_costs_next_to_nothing():
    timeline = moving(200, 500)
    timeline.position[20:], timeline.swarm[20:], timeline.lit[20:] = (
        timeline.position[20], timeline.swarm[20], timeline.lit[20],
    )  # fmt: skip
    beginning = {name: getattr(timeline, name)[:21] for name in timeline_frame.Frame._fields}
    first = pack(SavedTimeline(truth=timeline.truth, **beginning))
    assert len(pack(timeline).data) < 1.1 * len(first.data)


def test_frames_are_left_out_until_it_fits_and_first_and_last_stay():
    timeline = moving(120, 300)
    packed = pack(timeline, bytes_max=60_000)
    assert len(packed.data) <= 60_000 * 4 / 3 + 4
    assert FRAMES_MIN <= len(packed.at) < 120
    assert (packed.at[0], packed.at[-1]) == (0, 119)


def test_points_are_left_out_where_frames_alone_do_not_help():
    timeline = moving(14, 6000)
    packed = pack(timeline, bytes_max=200_000)
    assert len(packed.data) <= 200_000 * 4 / 3 + 4
    assert len(packed.rows) < 6000
    unpack(packed, len(packed.rows))


def test_more_swarms_than_fit_in_two_bytes_keep_their_light():
    timeline = moving(3, 4)
    timeline.swarm[:] = 65_536
    timeline.lit[:] = True
    assert unpack(pack(timeline), 4)[1:, 3].all()


def test_a_run_of_two_shapes_has_the_points_of_both():
    timeline = moving(6, 5)
    timeline.truth_at_s = np.array([0.0, 0.3])
    timeline.truths = np.stack([timeline.truth, timeline.truth + 7.0])
    timeline.truths[1, 4] = np.nan  # it has no point in the second
    packed = pack(timeline)
    values = unpack(packed, 5)
    assert len(values) == 2 + 6
    assert values[:2, 3].tolist() == [[1] * 5, [1] * 4 + [0]]
    place = packed.low[:, None] + packed.step * values[:2, :3]
    np.testing.assert_allclose(place[1].T[:4], timeline.truth[:4] + 7.0, atol=packed.step)
    facts = re.search(
        r'id="scene-facts">(.*?)</script>', scene_part(SavedRun(Path(), timeline=timeline)).html
    )
    both = np.concatenate([timeline.truth, timeline.truth[:4] + 7.0])
    centre = (both.min(axis=0) + both.max(axis=0)) / 2
    np.testing.assert_allclose(json.loads(facts[1])["centre"], centre, err_msg="the view holds both")
    moments, absolute = RunData(SavedRun(Path(), timeline=timeline), timeline).hd_absolute
    assert moments.tolist() == timeline.t_s.tolist()
    assert absolute[:3].max() < 6 < absolute[3:].min(), "nobody has flown to the second shape"


@pytest.mark.parametrize("points", [1, 2])
def test_the_smallest_displays_have_a_view(tmp_path, points):
    assert "scene-data" in scene_part(SavedRun(tmp_path, timeline=moving(1, points))).html


def test_a_run_without_samples_has_no_view(tmp_path):
    assert scene_part(SavedRun(tmp_path)) is None
    assert BYTES_MAX * 4 / 3 < 3_000_000
