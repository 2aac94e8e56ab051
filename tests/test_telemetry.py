"""The shared memory: no half-written row is ever seen, clocks do not jump, and nothing stays behind."""

import gc
import os
import subprocess
import sys
import time
from pathlib import Path
from random import Random

import numpy as np
import pytest

from swarmer.messages import Kind
from swarmer.metrics.lateness import bucket
from swarmer.physics.flight import Flight, Velocity, plan_flight, position_at
from swarmer.protocol.events import Count
from swarmer.telemetry import (
    COUNTERS,
    DELIVERED_BY_KIND,
    PAGE,
    SENT_BY_KIND,
    SEQUENCE,
    SLOT,
    Began,
    Clock,
    Life,
    Localization,
    Phase,
    Reader,
    Row,
    SharedMemory,
    Slot,
    Thawed,
    Wire,
)

VELOCITY = Velocity(200.0, 200.0, 100.0)
AT_REST = Flight((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


def row(number, flight=AT_REST):
    return Row(number, number, number, number % 65536, 1, True, False, flight)


@pytest.fixture
def shared():
    memory = SharedMemory(8)
    yield memory
    gc.collect()
    memory.close()


def test_a_slot_reads_as_it_was_written(shared):
    slot, reader = Slot(shared, 3), Reader(shared, VELOCITY)
    flight, thawed = (
        Flight((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 5.0, 0.0, 0.0),
        Thawed(6, 2**31, 3, Began.CLOCK, 4.5),
    )
    localization = Localization(9, (1.5, 2.0, 3.0), (0.5, 0.25, -4.0), 4.25)
    slot.publish(Row(2, 7, 11, 1, 4, True, True, flight, thawed, localization))
    slot.live(Life.READY)
    slot.handler_counts[Count.LOCALIZATIONS] += 3
    slot.network_counts[Count.LOCALIZATIONS] += 2
    slot.handler_counts[Wire.SENT] += 1
    slot.handler_counts[Wire.LOCALIZING_MICROCELLS] += 2_500_000
    slot.handler_counts[Wire.FOLLOWING_MICROCELLS] += 500_000
    slot.timer_late(5.0)
    slot.handled_late(50.0)
    sample = reader.sample()
    i = 2
    assert (sample.incarnation[i], sample.epoch[i], sample.swarm[i], sample.swarm_incarnation[i]) == (
        2,
        7,
        11,
        1,
    )
    assert (sample.state[i], bool(sample.lit[i]), sample.life[i]) == (4, True, Life.READY)
    assert sample.position[i].tolist() == [1.0, 2.0, 3.0]
    assert Thawed(*sample.thawed[i].tolist()) == thawed
    anchor, start, vector, begins_s = sample.localization[i].tolist()
    assert (anchor, tuple(start), tuple(vector), begins_s) == localization
    assert not sample.lit[[0, 1, 3, 4, 5, 6, 7]].any(), "each FLS has a slot of its own"
    assert (sample.counters[Count.LOCALIZATIONS], sample.counters[Wire.SENT]) == (5, 1)
    assert sample.counters.sum() == 6 + 3_000_000
    assert sample.flown.tolist() == [[0.0, 0.0], [0.0, 0.0], [2.5, 0.5], *[[0.0, 0.0]] * 5]
    assert (sample.timer_late[bucket(5.0)], sample.timer_late.sum()) == (1, 1)
    assert (sample.handled_late[bucket(50.0)], sample.handled_late.sum()) == (1, 1)
    reader.close()


def test_every_counter_has_a_place_of_its_own():
    by_kind = [first + kind for first in (SENT_BY_KIND, DELIVERED_BY_KIND) for kind in Kind]
    places = [int(count) for count in (*Count, *Wire)] + by_kind
    assert len(set(places)) == len(places)
    assert set(places) <= set(range(COUNTERS))
    assert set(range(COUNTERS)) - set(places) == {SENT_BY_KIND, DELIVERED_BY_KIND}, "no kind is 0"


def test_positions_of_all_are_those_of_each(shared):
    rng, reader = Random(1), Reader(shared, VELOCITY)
    clock = Clock(shared)
    for turn in range(40):
        clock.set(Phase.GO, 1e-9, 10.0)
        flights = []
        for fid in range(1, 9):
            far = rng.choice([0.0, 1e-6, 1.0, 300.0])
            start, displacement = ([rng.uniform(-1, 1) * scale for _ in range(3)] for scale in (50.0, far))
            flight = plan_flight(tuple(start), tuple(displacement), 10.0 - rng.uniform(-0.1, 2.5), VELOCITY)
            Slot(shared, fid).publish(row(turn, flight))
            flights.append(flight)
        sample = reader.sample()
        expected = [position_at(flight, sample.t_s, VELOCITY) for flight in flights]
        assert np.allclose(sample.position, expected, rtol=0.0, atol=1e-9)
    reader.close()


WRITER = """
import sys
from itertools import count
from swarmer.physics.flight import Flight
from swarmer.telemetry import Localization, Row, SharedMemory, Slot, Thawed
shared = SharedMemory(8, int(sys.argv[1]))
slots = [Slot(shared, fid) for fid in range(1, 9)]
print("ready", flush=True)
for n in count(1):
    f = float(n)
    flight = Flight((f, f, f), (0.0, 0.0, 0.0), f, 0.0, 0.0)
    small = float(n % 65536)
    localization = Localization(n, (small,) * 3, (small,) * 3, f)
    row = Row(n, n, n, n % 65536, n % 5, n % 2, n % 2, flight, Thawed(n, n, n % 65536, 0, f), localization)
    for slot in slots:
        slot.publish(row)
"""


def test_no_torn_row_is_seen_while_another_process_writes(shared):
    reader = Reader(shared, VELOCITY)
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(shared.fd)], pass_fds=[shared.fd], stdout=subprocess.PIPE
    )
    try:
        assert writer.stdout.readline() == b"ready\n"
        seen, until = set(), time.monotonic() + 0.7
        while time.monotonic() < until or len(seen) < 20:
            sample = reader.sample()
            n = sample.incarnation
            assert (sample.epoch == n).all()
            assert (sample.thawed["epoch"] == n).all()
            assert (sample.thawed["at_s"] == n).all()
            assert (sample.swarm == n).all()
            assert (sample.swarm_incarnation == n % 65536).all()
            assert (sample.state == n % 5).all()
            assert (sample.lit == n % 2).all()
            assert (sample.position == n[:, None]).all()
            seen.update(n.tolist())
    finally:
        writer.kill()
        writer.wait()
        writer.stdout.close()
    reader.close()


def test_a_writer_that_stopped_half_way_does_not_stop_the_reader(shared):
    slots, reader = [Slot(shared, fid) for fid in (1, 2)], Reader(shared, VELOCITY)
    for slot in slots:
        slot.publish(row(1))
    reader.sample()
    at = PAGE  # FID 1 dies while it writes
    SEQUENCE.pack_into(shared.map, at, SEQUENCE.unpack_from(shared.map, at)[0] + 1)
    shared.map[at + 8] = 99
    slots[1].publish(row(2))
    assert reader.sample().incarnation[:2].tolist() == [1, 2], "the last whole row stands"
    SEQUENCE.pack_into(shared.map, at, SEQUENCE.unpack_from(shared.map, at)[0] + 1)
    slots[0].publish(row(3))
    assert reader.sample().incarnation[:2].tolist() == [3, 2]
    reader.close()


# -- the clock ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def wall(monkeypatch):
    """A wall clock to set by hand: wall[0] is now."""
    now = [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    return now


def test_emulated_time_goes_by_the_scale_and_never_jumps(shared, wall):
    engine, fls = Clock(shared), Clock(shared)
    engine.set(Phase.GO, 1.0, 0.0)
    expected = 0.0
    rng = Random(2)
    for _ in range(200):
        scale, elapsed = rng.choice([0.02, 0.3, 1.0]), rng.uniform(0.0, 3.0)
        before = fls.now()
        engine.set(Phase.GO, scale)
        assert fls.now() == pytest.approx(before, abs=1e-9), "another scale, the same moment"
        wall[0] += elapsed
        expected += scale * elapsed
        assert fls.now() == pytest.approx(expected)
        assert fls.wall_until(expected + 0.5) == pytest.approx(0.5 / scale)
    assert fls.now() == pytest.approx(engine.now())


def test_the_phase_reaches_everybody(shared, wall):
    engine, fls = Clock(shared), Clock(shared)
    assert fls.phase == Phase.WAIT
    for phase in (Phase.GO, Phase.STOP):
        engine.set(phase, 1.0)
        fls.now()
        assert fls.phase == phase


def test_before_the_go_signal_time_is_negative(shared, wall):
    engine = Clock(shared)
    engine.set(Phase.GO, 0.5, -1.0)
    assert engine.now() == -1.0
    wall[0] += 4.0
    assert engine.now() == 1.0


# -- what stays behind -----------------------------------------------------------------------------------------------


def mapped():
    return sum("memfd:swarmer" in line for line in Path("/proc/self/maps").read_text().splitlines())


def test_the_memory_is_gone_with_its_last_holder():
    before = mapped()
    memory = SharedMemory(50)
    assert memory.size >= PAGE + 50 * SLOT
    assert mapped() == before + 1
    fd = memory.fd
    slot, reader, directory = Slot(memory, 7), Reader(memory, VELOCITY), memory.directory()
    directory[6] = 3
    assert len(directory) == 50
    reader.close()
    memory.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(fd)
    del slot, reader, directory, memory
    gc.collect()
    assert mapped() == before
    assert not list(Path("/dev/shm").glob("*swarmer*"))


def test_who_is_handed_the_descriptor_sees_the_same_memory(shared):
    other = SharedMemory(8, os.dup(shared.fd))
    Slot(shared, 8).publish(row(5))
    reader = Reader(other, VELOCITY)
    assert reader.sample().incarnation[7] == 5
    reader.close()
    del reader
    gc.collect()
    other.close()
