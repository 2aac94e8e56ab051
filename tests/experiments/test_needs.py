"""What runs need, and that no more of them are begun than a machine carries."""

from pathlib import Path

import pytest

from swarmer.config import load_config
from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.needs import Needs, Room, needs_of
from swarmer.experiments.one_run import Outcome
from swarmer.experiments.pool import Pool
from swarmer.experiments.runs import expand
from swarmer.experiments.sweep import ThisMachine

MEASURED = [  # peak memory in MB of a run with these settings, measured on Linux with Python 3.11
    ({"engine": "virtual", "shape": "sphere", "points": 100, "duration_s": 10}, 86),
    ({"engine": "virtual", "shape": "dragon", "duration_s": 20}, 108),
    ({"engine": "virtual", "shape": "skateboard", "duration_s": 4}, 133),
    ({"engine": "virtual", "shape": "sphere", "points": 5000, "duration_s": 1}, 216),
    ({"engine": "rounds", "shape": "statue"}, 113),
    ({"engine": "rounds", "shape": "sphere", "points": 200_000}, 320),
]


@pytest.mark.parametrize(("settings", "measured_mb"), MEASURED)
def test_an_estimate_is_above_what_was_measured_and_not_far(settings, measured_mb):
    needs = needs_of(load_config(None, [], **settings, **{"recording.enabled": False}))
    assert measured_mb <= needs.memory_mb <= 2 * measured_mb
    assert (needs.cores, needs.machine) == (1, False)


def test_processes_need_the_machine_and_a_file_of_points_is_counted(tmp_path):
    assert needs_of(load_config(None, [], shape="dragon")).machine
    (tmp_path / "mine.xyz").write_text("".join(f"{at} {at % 7} {at % 5}\n" for at in range(2000)))
    small, large = (
        needs_of(
            load_config(None, [], engine="process", shape=shape, **{"recording.enabled": False})
        ).memory_mb
        for shape in ("butterfly", str(tmp_path / "mine.xyz"))
    )
    assert large > small + 1800 * 4


def test_an_experiment_says_otherwise(write):
    file = write(
        "base: {engine: virtual, shape: sphere}\nneeds: {cores: 2, memory_mb: 900}\n"
        "blocks: [{}, {base: {eta: 4}, needs: {memory_mb: 50}}]"
    )
    assert [run.needs for run in expand(read_experiment(str(file)))] == [Needs(2, 900), Needs(2, 50)]


def test_no_more_stand_side_by_side_than_there_is_room_for():
    room = Room(4, 1000)
    small, wide, large, process = Needs(1, 100), Needs(3, 100), Needs(1, 950), Needs(1, 100, machine=True)
    assert room.fits(large, [])
    assert room.fits(Needs(9, 5000), [])  # alone, it is as good as it gets
    assert not room.fits(small, [large])
    assert room.fits(small, [wide])
    assert not room.fits(small, [wide, small])
    assert not room.fits(small, [process])
    assert not room.fits(process, [small])
    assert room.at_once([small] * 9) == 4
    assert room.at_once([large] * 3 + [small]) == 1
    assert Room(4, None).at_once([large] * 9) == 4
    assert room.at_once([]) == 0


def test_a_run_waits_until_it_fits(tmp_path):
    most, running = 0, []

    def started(job):
        nonlocal most
        running.append(job)
        most = max(most, len(running))

    jobs = [1, 2, 3, 4]
    with Pool(3, tmp_path, work=idle) as pool:
        for job, _ in pool.outcomes(jobs, started, lambda: None, lambda job, beside: len(beside) < 2):
            running.remove(job)
    assert most == 2


def idle(job, out: Path):
    return Outcome("done")


def test_a_run_that_is_larger_than_the_machine_is_told(write):
    file = write("base: {engine: virtual, shape: sphere}\nneeds: {memory_mb: 900}\nseeds: 2")
    runs = expand(read_experiment(str(file)))
    assert ThisMachine(2, 800).notes(runs) == [
        "2 runs need up to 900 MB, and 800 are free: each is made alone"
    ]
    assert ThisMachine(2, 2000).notes(runs) == []
    assert ThisMachine(2, 1000).at_once(runs) == 1
