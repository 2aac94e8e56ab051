"""The engine's copy of slots on other hosts is what those show, and a slot goes on where it left off."""

import numpy as np
import pytest

from swarmer.engines.cluster.copies import Copier, Copy
from swarmer.messages import ZERO
from swarmer.physics.flight import Flight, Velocity
from swarmer.telemetry import PAGE, SEQUENCE, SLOT, Life, Phase, Reader, Row, SharedMemory, Slot

VELOCITY = Velocity(4.0, 8.0, 8.0)


@pytest.fixture
def memories():
    made = [SharedMemory(6) for _ in range(3)]
    yield made
    for memory in made:
        memory.close()


def show(memory, fid, incarnation, at, sent=0):
    slot = Slot(memory, fid)
    slot.publish(Row(incarnation, 0, fid, 0, 1, True, False, Flight(at, ZERO, 0.0, 0.0, 0.0)))
    slot.live(Life.READY)
    slot.network_counts[3] += sent
    slot.handled_late(5.0)


def seen(memory):
    """What a reader makes of it, at the same emulated moment always."""
    from swarmer.telemetry import Clock

    Clock(memory).write(Phase.GO, 0.0, 0.0, 1e-12)
    reader = Reader(memory, VELOCITY)
    sample = reader.sample()
    reader.close()
    return sample


def test_a_copy_of_two_hosts_is_as_one_memory(memories):
    one, other, engine = memories
    copy = Copy(engine)
    copiers = [Copier(one, [1, 4]), Copier(other, [2, 3, 6])]
    for round_number in range(3):
        for memory, fids in ((one, [1, 4]), (other, [2, 6])):
            for fid in fids:
                show(memory, fid, round_number, (fid, round_number, 0.5), sent=fid)
        for copier in copiers:
            copy.write(copier.changed())
    sample = seen(engine)
    assert sample.position.tolist()[0] == [1, 2, 0.5]
    assert sample.life.tolist() == [1, 1, 0, 1, 0, 1]
    assert sample.swarm.tolist() == [1, 2, 0, 4, 0, 6]
    assert sample.incarnation.tolist() == [2, 2, 0, 2, 0, 2]
    assert sample.handled_late.sum() == 12
    copy.close()


def test_what_has_not_changed_is_not_sent(memories):
    one = memories[0]
    copier = Copier(one, [1, 4])
    show(one, 1, 0, ZERO)
    assert copier.changed()
    assert copier.changed() == b""
    Slot(one, 4).handler_counts[0] += 1
    assert len(copier.changed()) == 12, "one word, and where it is"


def test_a_slot_goes_on_on_another_host(memories):
    one, other, engine = memories
    copy = Copy(engine)
    gone, stays = Copier(one, [1, 4]), Copier(other, [2])
    for _ in range(5):
        show(one, 4, 0, (1.0, 2.0, 3.0), sent=100)
    copy.write(gone.changed())
    copy.end(np.array([1, 4]))
    assert seen(engine).life.tolist()[3] == Life.ENDED
    stays.take([1, 4], copy.slots(np.array([1, 4])))
    assert stays.changed() == b"", "the engine has it"
    show(other, 4, 1, (1.0, 2.0, 4.0), sent=1)
    copy.write(stays.changed())
    sample = seen(engine)
    assert sample.incarnation[3] == 1
    assert sample.counters[3] == 501, "counters only grow"
    assert sample.handled_late.sum() == 6
    copy.close()


def test_a_slot_that_is_being_written_is_the_last_whole_one(memories):
    one, _, engine = memories
    copy, copier = Copy(engine), Copier(one, [1, 4])
    show(one, 1, 0, (1.0, 1.0, 1.0))
    show(one, 4, 0, (4.0, 4.0, 4.0))
    copy.write(copier.changed())
    begins = PAGE + 3 * SLOT
    show(one, 4, 7, (5.0, 5.0, 5.0))
    SEQUENCE.pack_into(one.map, begins, SEQUENCE.unpack_from(one.map, begins)[0] + 1)
    show(one, 1, 1, (2.0, 1.0, 1.0))
    copy.write(copier.changed())
    sample = seen(engine)
    assert sample.incarnation.tolist()[0] == 1
    assert sample.incarnation.tolist()[3] == 0
    assert sample.position.tolist()[3] == [4, 4, 4]
    copy.close()


@pytest.mark.parametrize("changed", [b"x", b"\0" * 13, b"\xff" * 12])
def test_what_no_host_has_sent_is_refused(memories, changed):
    copy = Copy(memories[2])
    with pytest.raises(ValueError, match="that "):
        copy.write(changed)
    copy.close()
    assert SLOT % 8 == 0
