import contextlib
import os
import re
import subprocess
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rrd_rows import blueprint, chunks, entities, rows, timelines

from swarmer.engines.result import Event, Lateness, Live, Localized, Snapshot
from swarmer.errors import RunFailed
from swarmer.next_shape import Standing
from swarmer.observe import recording as recording_module
from swarmer.observe.blueprint import ASPECT, HALF_VIEW, eye_for
from swarmer.observe.files import Stream
from swarmer.observe.palette import CALM, DARK, STATES
from swarmer.observe.progress import Progress
from swarmer.observe.recording import Recording
from swarmer.observe.scene import BLOCK_MIN
from swarmer.observe.viewer import rerun_command

AVAILABLE, ANCHOR = STATES.index("Available"), STATES.index("Busy Anchor")
NO_LIVE = Live(None, None, None, None, None, None)
LATE = Lateness(1.0, 8.0, 20.0)


class World:
    """A display of a few FLSs at rest, to be changed by hand from sample to sample."""

    def __init__(self, path, fake, count=6, **settings):
        import rerun as rr

        rr.set_strict_mode(True)
        cloud = fake.ball(count)
        self.truth, self.path, self.t_s = cloud.points, path, 0.0
        self.position = cloud.points.copy()
        self.swarm = np.arange(1, count + 1, dtype=np.int32)
        self.state = np.full(count, AVAILABLE, np.int8)
        self.lit = np.ones(count, np.bool_)
        self.counters, self.live = {"datagrams_sent": 0.0, "datagrams_delivered": 0.0}, NO_LIVE
        self.progress = Progress.of(self.truth)
        self.stream = Stream(path)
        self.recording = Recording(fake.plan(cloud, **settings), self.stream)

    def sample(self, step_s=0.1, localized=None):
        snapshot = Snapshot(
            self.t_s, self.position.copy(), self.swarm.copy(), self.state.copy(), self.lit.copy(), self.lit.copy(),
            dict(self.counters), self.live, None, localized=localized,
        )  # fmt: skip
        self.progress.update(snapshot)
        self.recording.sample(snapshot, self.progress)
        self.t_s += step_s

    def close(self):
        self.recording.close()
        self.stream.close()
        return self.path


@pytest.fixture
def world(tmp_path, fake):
    return lambda count=6, **settings: World(tmp_path / "recording.rrd", fake, count, **settings)


def test_without_a_file_to_be_had_the_run_has_failed_and_nothing_looks_whole(tmp_path, fake, monkeypatch):
    import rerun as rr

    def refused(path):
        raise RuntimeError(f"Failed to create file: Too many open files (os error 24), path: {path}")

    monkeypatch.setattr(rr, "FileSink", refused)
    stream = Stream(tmp_path / "recording.rrd")
    with pytest.raises(
        RunFailed, match=r"^the recording could not be begun: .*Too many open files \(os error 24\)$"
    ):
        Recording(fake.plan(), stream)
    stream.close()
    assert not (tmp_path / "recording.rrd").exists()


def test_every_frame_is_there_as_it_was(world):
    w = world()
    for _ in range(30):
        w.position += 0.25  # in place: the recording must have taken a copy
        w.sample()
    frames = rows(w.close(), "swarm", "Points3D:positions")
    assert [row.sample for row in frames] == list(range(30))
    np.testing.assert_allclose([row.t_s for row in frames], np.arange(30) / 10, atol=1e-6)
    np.testing.assert_allclose(frames[0].value, w.truth + 0.25, rtol=1e-5)
    np.testing.assert_allclose(frames[-1].value, w.truth + 30 * 0.25, rtol=1e-5)


def test_only_the_blocks_in_which_somebody_moved_are_written(world):
    w = world(BLOCK_MIN * 2 + 40)
    for step in range(10):
        if step == 4:
            w.position[BLOCK_MIN + 7] += 1.0
        w.sample()
    path = w.close()
    blocks = sorted(name for name in entities(path) if name.startswith("swarm/"))
    assert blocks == ["swarm/fls_1-128", "swarm/fls_129-256", "swarm/fls_257-296"]
    written = {name: [row.sample for row in rows(path, name, "Points3D:positions")] for name in blocks}
    assert written == {blocks[0]: [0], blocks[1]: [0, 4], blocks[2]: [0]}
    (fids,) = rows(path, blocks[1], "fid")
    assert fids.value == list(range(129, 257))


def test_colours_are_written_when_they_change_and_become_one_for_one_swarm(world):
    w = world()
    w.lit[0] = False
    w.sample()
    w.sample()
    w.lit[0] = True
    w.swarm[:] = 4
    w.sample()
    w.sample()
    path = w.close()
    many, one = rows(path, "swarm", "Points3D:colors")
    assert (many.sample, one.sample) == (0, 2)
    assert many.value[0] == int.from_bytes((*DARK, 255), "big")
    assert len(set(many.value)) == 6
    assert set(one.value) == {int.from_bytes((*CALM, 255), "big")}
    dark, light = (row.value for row in rows(path, "swarm", "Points3D:radii"))
    assert dark[0] < dark[1] == light[0]


def test_the_vector_of_a_localization_is_shown_for_a_while(world):
    w = world()
    flown = Localized(
        np.array([3], np.int32), np.array([5], np.int32), np.array([[1, 2, 3]], np.float32),
        np.array([[0.5, 0, -2]], np.float32),
    )  # fmt: skip
    for step in range(12):
        w.sample(localized=flown if step == 2 else None)
    path = w.close()
    shown, gone = rows(path, "localizations", "Arrows3D:vectors")
    assert (shown.sample, gone.sample, gone.value) == (2, 8, [])  # more than half a second later
    assert shown.value == [[0.5, 0, -2]]
    assert rows(path, "localizations", "Arrows3D:origins")[0].value == [[1, 2, 3]]
    told = [row.value[0] for row in rows(path, "events", "TextLog:text")]
    assert "FLS 3 localized by FLS 5: flies 2.06 cells" in told


def test_anchors_are_marked_where_they_are(world):
    w = world()
    w.sample()
    w.state[[1, 4]] = ANCHOR
    w.sample()
    w.sample()
    w.state[1] = AVAILABLE
    w.sample()
    two, one = rows(w.close(), "anchors", "Boxes3D:centers")
    assert (two.sample, one.sample) == (1, 3)
    np.testing.assert_allclose(two.value, w.truth[[1, 4]], rtol=1e-6)
    np.testing.assert_allclose(one.value, w.truth[[4]], rtol=1e-6)


def test_a_failure_flashes_where_it_was_and_ends(world):
    w = world()
    w.sample()
    w.recording.event(Event(0.05, "failure", 4, "went dark"))
    w.position[3] = 0.0  # its successor stands at the dispatcher
    for _ in range(20):
        w.sample()
    path = w.close()
    flashes = rows(path, "failures", "Points3D:positions")
    *shown, gone = flashes
    assert gone.value == []
    assert [row.sample for row in flashes] == list(range(1, len(flashes) + 1))
    assert 10 < len(flashes) < 15  # 1.2 s at 10 Hz, and the end
    np.testing.assert_allclose([row.value[0] for row in shown], [w.truth[3]] * len(shown), rtol=1e-6)
    sizes = [row.value[0] for row in rows(path, "failures", "Points3D:radii")[:-1]]
    assert all(a != b for a, b in pairwise(sizes))
    assert ["FLS 4: went dark"] in [row.value for row in rows(path, "events", "TextLog:text")]
    assert ["WARN"] in [row.value for row in rows(path, "events", "TextLog:level")]


def test_dispatchers_stand_where_they_are_if_there_are_any(world):
    w = world(deploy={"dispatchers": [(0, 0, 0), (5, 6, 7)]})
    (places,) = rows(w.close(), "dispatchers", "Boxes3D:centers")
    assert (places.t_s, places.value) == (None, [[0, 0, 0], [5, 6, 7]])


def test_without_dispatchers_none_is_drawn(world):
    w = world(deploy={"start": "random"})
    assert "dispatchers" not in entities(w.close())


def test_curves_over_time(world):
    w = world()
    for step in range(11):
        w.counters = {
            "datagrams_sent": 30.0 * step,
            "datagrams_delivered": 90.0 * step,
            "leases_expired": step // 10,
        }
        w.live = (
            NO_LIVE._replace(timer_late_ms=LATE, handled_late_ms=LATE._replace(p99=9.0)) if step else NO_LIVE
        )
        w.position[0] += 0.1
        w.sample()
    path = w.close()
    last = {
        name: rows(path, name, "Scalars:scalars")[-1]
        for name in ("hd_cells", "hd/log10", "swarms", "states", "datagrams", "lateness")
    }
    assert {row.sample for row in last.values()} == {10}
    assert last["hd_cells"].value[0] == pytest.approx(10 ** last["hd/log10"].value[0])
    assert last["swarms"].value == [6]
    assert last["states"].value == [0, 6, 0, 0, 0]
    assert last["datagrams"].value == pytest.approx([300, 900])
    assert last["lateness"].value == [8.0, 9.0]
    assert len(rows(path, "datagrams", "Scalars:scalars")) == 10, "a rate has two ends"
    assert len(rows(path, "lateness", "Scalars:scalars")) == 10
    told = [row.value[0] for row in rows(path, "events", "TextLog:text")]
    assert "1 lease expired: a localizer was not heard of in time" in told


def test_an_event_stands_at_its_sample(world):
    w = world()
    w.recording.event(Event(0.0, "thaw", 0, "before all"))
    w.sample()
    w.recording.event(Event(0.0, "thaw", 0, "found at the first"))
    w.recording.event(Event(0.05, "thaw", 0, "on the way"))
    w.sample()
    told = {row.value[0]: row.sample for row in rows(w.close(), "events", "TextLog:text")}
    assert (told["before all"], told["found at the first"], told["on the way"]) == (0, 0, 1)


def test_a_round_counts_as_a_second(world):
    w = world(1000, engine="rounds", recording={"rate_hz": 10, "positions_per_s": 1000})
    assert w.recording.every == 1
    w.close()


def test_two_timelines_and_no_other(world):
    w = world()
    w.sample()
    w.recording.event(Event(0.0, "thaw", 0, "thaw 1 began"))
    assert timelines(w.close()) == {"emulated_time", "sample"}


def test_the_blueprint_opens_it(world):
    w = world(duration_s=90.0)
    w.sample()
    shown = blueprint(w.close())
    names = [value[0] for value in shown["ViewBlueprint:display_name"]]
    assert len(names) == 8
    assert {"Display", "Swarms", "What happened", "Datagrams per emulated second"} <= set(names)
    assert shown["TimePanelBlueprint:timeline"] == [["emulated_time"]]
    assert shown["TimePanelBlueprint:playback_speed"] == [[3.0]]
    (eye,), (target,) = (shown[f"EyeControls3D:{name}"][0] for name in ("position", "look_target"))
    np.testing.assert_allclose(np.array([eye, target]), eye_for(w.truth), rtol=1e-5)


@pytest.mark.parametrize("shape", [(90, 60, 50), (5, 100, 5), (100, 5, 0), (1, 1, 1)])
def test_the_shape_fills_the_picture(shape):
    truth = np.random.default_rng(1).random((500, 3)) * shape + 7
    eye, target = eye_for(truth)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 1, 0]) / np.linalg.norm(np.cross(forward, [0, 1, 0]))
    seen = (truth - eye) @ np.stack([right, np.cross(right, forward), forward]).T
    assert (seen[:, 2] > 0).all()
    across, up = (np.abs(seen[:, axis] / seen[:, 2]).max() / HALF_VIEW for axis in (0, 1))
    assert 0.75 < max(across / ASPECT, up) < 0.95


def test_a_point_with_its_fls_before_it_is_not_drawn(world):
    w = world()
    w.position[2] += 40.0
    w.lit[4] = False
    w.sample()
    w.sample()
    w.position[2] = w.truth[2]
    w.sample()
    before, after = rows(w.close(), "ground_truth", "Points3D:radii")
    assert (before.sample, after.sample) == (0, 2)
    assert [radius > 0 for radius in before.value] == [False, False, True, False, True, False]
    assert [radius > 0 for radius in after.value] == [False, False, False, False, True, False]


def test_an_engine_without_a_network_has_no_curves_of_one(world):
    """As the rounds engine: no datagrams, nothing late, a round in the place of a second."""
    w = world()
    w.counters = {"localizations": 5.0}
    for _ in range(3):
        w.sample(step_s=1.0)
    path = w.close()
    assert rows(path, "datagrams", "Scalars:scalars") == rows(path, "lateness", "Scalars:scalars") == []
    assert [row.t_s for row in rows(path, "swarms", "Scalars:scalars")] == [0.0, 1.0, 2.0]
    assert {"datagrams", "lateness"}.isdisjoint(entities(path))
    names = [value[0] for value in blueprint(path)["ViewBlueprint:display_name"]]
    assert len(names) == 6
    assert not [name for name in names if "atagram" in name or "ateness" in name]


def test_many_flss_are_shown_at_some_samples_the_last_among_them(world):
    w = world(40, recording={"rate_hz": 10, "positions_per_s": 100})
    assert w.recording.every == 4
    for _ in range(10):
        w.position += 1.0
        w.sample()
    path = w.close()
    assert [row.sample for row in rows(path, "swarm", "Points3D:positions")] == [0, 4, 8, 9]
    assert len(rows(path, "hd_cells", "Scalars:scalars")) == 10


def test_a_flight_between_two_frames_that_are_far_apart_is_in_one(world):
    w = world(40, recording={"rate_hz": 10, "positions_per_s": 100})
    flown = Localized(np.array([3]), np.array([5]), np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
    for step in range(10):
        w.sample(step_s=1.0, localized=flown if step == 1 else None)
    assert [(row.sample, len(row.value)) for row in rows(w.close(), "localizations", "Arrows3D:vectors")] == [
        (4, 1),
        (8, 0),
    ]


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_killed_run_leaves_all_but_the_last_seconds(world, monkeypatch):
    """What was sent is in the partial file without anybody closing it."""
    monkeypatch.setattr(recording_module, "CHUNK_S", 1e9)
    w = world()
    for _ in range(50):
        w.position += 1.0
        w.sample()
    partial = w.path.with_name(w.path.name + ".partial")
    seen = 0
    for _ in range(100):  # rerun writes from a thread of its own
        with contextlib.suppress(RuntimeError, ValueError):  # it is being written
            seen = len(rows(partial, "swarm", "Points3D:positions"))
        if seen >= 41:
            break
        time.sleep(0.05)
    assert seen == 41  # the first, and two chunks of 20
    w.close()


def test_a_recording_cut_anywhere_shows_what_is_whole(world):
    """By the viewer's own reader; it ends with an error where the file does, after all that is whole."""
    w = world()
    for _ in range(200):
        w.position += 1.0
        w.sample()
    path = w.close()
    data, numbers = path.read_bytes(), []
    for share in (0.15, 0.25, 0.35, 0.45, 0.7, 1.0):
        path.write_bytes(data[: int(len(data) * share)])
        command = [*rerun_command(), "rrd", "print", str(path)]
        printed = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False).stdout
        numbers.append(len(re.findall(r"swarm.*Points3D:positions", printed)))
    assert numbers == sorted(numbers)
    assert numbers[-1] == 11  # the first sample, then 20 at a time, then the rest
    assert len(set(numbers)) > 4


def test_a_child_that_holds_the_pipe_open_does_not_hold_the_end_up(world):
    """An engine may fork while the recording is open; a forked child has all descriptors."""
    w = world()
    w.sample()
    held = [os.open(f"/dev/fd/{fd}", os.O_WRONLY) for fd in pipes_open_for_writing()]
    begun = time.monotonic()
    path = w.close()
    for fd in held:
        os.close(fd)
    assert held
    assert time.monotonic() - begun < 20
    assert len(chunks(path)) > 3


def pipes_open_for_writing():
    for link in Path("/proc/self/fd").iterdir():
        try:
            if str(link.readlink()).startswith("pipe:"):
                flags = Path(f"/proc/self/fdinfo/{link.name}").read_text().split("flags:")[1].split()[0]
                if int(flags, 8) & os.O_ACCMODE == os.O_WRONLY:
                    yield int(link.name)
        except OSError:  # the descriptor that lists them
            pass


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "a/b\\c", "ünï"])
def test_any_name_of_a_shape_will_do(tmp_path, fake, name):
    cloud = fake.ball(6)
    plan = fake.plan(cloud)
    plan.cloud = SimpleNamespace(points=cloud.points, name=name)
    stream = Stream(tmp_path / "recording.rrd")
    Recording(plan, stream).close()
    stream.close()
    (title,) = rows(tmp_path / "recording.rrd", "__properties", "RecordingInfo:name")
    assert title.value[0].startswith(name)


def test_the_points_of_the_shape_of_the_moment_are_shown(tmp_path, fake):
    """Six points, then four of them elsewhere: they move when the shape changes, and the other two are hidden."""
    cloud = fake.ball(6)
    plan, member = fake.plan(cloud), np.arange(6) < 4
    after = Standing(0.3, cloud.points + 1.0, member)
    first = plan.standings()[0]
    plan.standings = lambda: (first, after)
    stream = Stream(tmp_path / "recording.rrd")
    recording, progress = Recording(plan, stream), Progress.of(cloud.points)
    swarm = fake.swarm(cloud)
    for t_s in (0.0, 0.1, 0.2, 0.3, 0.4):
        snapshot = swarm.snapshot(t_s)
        progress.update(snapshot)
        recording.sample(snapshot, progress)
    recording.close()
    stream.close()
    places = rows(tmp_path / "recording.rrd", "ground_truth", "Points3D:positions")
    assert [len(row.value) for row in places] == [6, 6]
    assert np.allclose(np.array(places[1].value) - np.array(places[0].value), 1.0, atol=1e-4)
    radii = rows(tmp_path / "recording.rrd", "ground_truth", "Points3D:radii")
    assert list(radii[-1].value[4:]) == [0.0, 0.0]
