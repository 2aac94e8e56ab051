"""One FLS's two roles in this process, datagram by datagram."""

import os
import socket
from itertools import count

import pytest

from swarmer.config import load_config
from swarmer.fls import MEASURED, NEVER
from swarmer.fls_loops import BURST, Ear
from swarmer.fls_process import Fls, RunSpec
from swarmer.fls_spec import FlsSpec
from swarmer.messages import NO_SWARM, Kind, Message, Stamp, Swarm, To, decode, encode
from swarmer.plan import make_velocity
from swarmer.protocol.events import Due, Launch, Received, Timer
from swarmer.radio import ReplayWindow
from swarmer.rules import make_rules
from swarmer.state_machine import State
from swarmer.telemetry import NOTHING_LEFT, Began, Phase, Reader, SharedMemory, Thawed, Wire
from swarmer.udp_wrapper import HOME, Wires, address_of

RUN, SIZE = 5, 10
HOME_OF_3 = address_of(3)


@pytest.fixture
def dark():
    """FLS 3 of ten before its launch, whose sensor takes 60 ms."""
    config = load_config(None, **{"sensing.samples": 3, "sensing.sample_ms": 20})
    rules = make_rules(config, SIZE, 3, 100.0, "swarmer.plugins.signal_strength:SignalStrength")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HOME, 0))
        port = free.getsockname()[1]
    run = RunSpec(RUN, 1, b"", rules, Wires(port), 200.0, "single", ())
    point = (10.0, 0.0, 0.0)
    spec = FlsSpec(3, 0, point, (1, 2), 20.0, (1, 2), (5.0, 6.0), (0.0, 0.0, 0.0), 1e6, 0)
    shared = SharedMemory(SIZE)
    made = Fls(run, spec, shared)
    made.shared = shared
    made.clock.set(Phase.GO, 1.0, 0.0)
    yield made
    made.close()


@pytest.fixture
def fls(dark):
    """It has landed and is Available."""
    made, point = dark, dark.spec.truth
    made.feed(Launch(point))  # a flight of no length: it lands where it stands
    assert made.step()
    assert made.machine.state is State.AVAILABLE
    made.due = [NEVER] * len(made.due)
    return made


def say(
    fls,
    kind,
    sender,
    number,
    origin=(0.0, 0.0, 0.0),
    to=To.FLS,
    addressee=Swarm(3, 0),
    run=RUN,
    incarnation=0,
    **more,
):
    message = Message(
        kind, sender, incarnation, 0, Swarm(sender, 0), 1, (5.0, 0.0, 0.0), to, addressee, **more
    )
    fls.receive(encode(message, Stamp(run, number, origin, fls.clock.now())))


def test_it_measures_to_its_anchor_whoever_speaks_meanwhile(fls):
    say(fls, Kind.CHALLENGE_INIT, 1, 1, to=To.ALL, addressee=NO_SWARM, challenge=9, range=50.0)
    assert fls.step()
    say(fls, Kind.CHALLENGE_ACK, 1, 2, origin=(4.0, 1.0, 0.0), challenge=9, other=Swarm(3, 0))
    assert fls.step()
    assert fls.machine.state is State.BUSY_LOCALIZING
    say(fls, Kind.NEIGHBOUR, 2, 1, origin=(90.0, 90.0, 90.0))
    assert fls.step()
    x = fls.position()
    fls.due[MEASURED] = 0.0  # the samples are taken
    measured = []
    fls.machine.settings = fls.machine.settings._replace(localizer=Recorder(measured))
    assert fls.step()
    assert measured == [(4.0 - x[0], 1.0 - x[1], 0.0 - x[2])]


def test_a_relief_that_was_called_before_it_had_a_process_is_not_late(dark):
    """Its flight began then; but that nobody could look at its launch earlier says nothing of the machine."""
    middle = (8.0, 0.0, 0.0)
    dark.spec = dark.spec._replace(waits_at=middle, launch_at_s=dark.now() - 5.0)
    dark.flight = dark.flight._replace(start=middle)
    dark.begin()
    late = []
    dark.timer_taken_up = late.append
    assert dark.step()
    assert late[0] < 2.5, "seconds"
    assert dark.flight.begins_s == dark.spec.launch_at_s


class Recorder:
    def __init__(self, into):
        self.into = into

    def displacement(self, measured, ground_truth):
        self.into.append(measured)
        return (0.0, 0.0, 0.0)


def test_what_is_not_for_it_is_counted_and_dropped(fls):
    counts = fls.network_counts
    fls.receive(b"garbage")
    say(fls, Kind.NEIGHBOUR, 2, 1, run=RUN + 1)
    say(fls, Kind.NEIGHBOUR, 2, 2, addressee=Swarm(4, 0))
    say(fls, Kind.NEIGHBOUR, SIZE + 1, 1)
    say(fls, Kind.CHALLENGE_INIT, 2, 3, to=To.ALL, addressee=NO_SWARM, range=1.0)
    say(fls, Kind.NEIGHBOUR, 2, 4)
    say(fls, Kind.NEIGHBOUR, 2, 4)
    seen = {wire: counts[wire] for wire in (Wire.BAD, Wire.OTHER_RUN, Wire.NOT_ADDRESSED, Wire.OUT_OF_RANGE)}
    assert seen == {Wire.BAD: 2, Wire.OTHER_RUN: 1, Wire.NOT_ADDRESSED: 1, Wire.OUT_OF_RANGE: 1}
    assert counts[Wire.DELIVERED] == 1
    assert counts[Wire.REPLAYED] == 1
    assert fls.step()
    assert not fls.step()


def test_what_it_cannot_handle_in_time_stays_with_the_kernel(fls, monkeypatch):
    """A flood of what looks right: what waits in the process has an end."""
    monkeypatch.setattr("swarmer.fls_process.WAITING_MAX", 20)
    ear, wires = Ear(fls), (HOME_OF_3, fls.run.wires.port)

    def flood(first):
        for number in range(first, first + 100):
            message = Message(
                Kind.CHALLENGE_FIN, 2, 0, 0, Swarm(2, 0), 1, (5.0, 0.0, 0.0), To.FLS, Swarm(3, 0)
            )
            mouth.sendto(encode(message, Stamp(RUN, number, (0.0, 0.0, 0.0), 0.0)), wires)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth:
        for turn in range(5):
            flood(1 + 100 * turn)
            for _ in range(10):
                ear.drain(fls.udp.unicast)
        waiting = sum(map(len, fls.queues))
        assert 20 <= waiting < 20 + BURST
        assert fls.step()
        while fls.full:
            fls.step()
        ear.drain(fls.udp.unicast)
        assert fls.network_counts[Wire.DELIVERED] > waiting, "it reads on once there is room"


def test_numbers_wrap_and_none_is_lost_or_taken_twice(fls):
    fls._numbers = count(2**32 - 50)
    message = Message(Kind.NEIGHBOUR, 3, 0, 0, Swarm(3, 0), 1, (5.0, 0.0, 0.0), To.FLS, Swarm(2, 0))
    window, numbers = ReplayWindow(), []
    for _ in range(100):
        _, stamp = decode(encode(message, fls.stamp(message, 0.0)))
        numbers.append(stamp.number)
        assert window.fresh(3, 0, stamp.number)
        assert not window.fresh(3, 0, stamp.number)
    assert numbers == [*range(2**32 - 50, 2**32), *range(50)]


def thawed(fls):
    reader = Reader(SharedMemory(SIZE, os.dup(fls.shared.fd)), make_velocity(fls.rules))
    return Thawed(*reader.sample().thawed[2].tolist())


def test_it_shows_how_it_left_an_epoch(fls):
    assert thawed(fls) == NOTHING_LEFT
    at_s = fls.clock.now()
    fls.feed(Due(Timer.THAW))
    left = thawed(fls)
    assert left[:4] == (0, 3, 0, Began.CLOCK)
    assert at_s <= left.at_s <= fls.clock.now()
    fls.feed(Received(Message(Kind.THAW, 1, 0, 2, Swarm(1, 0), 1, (0.0, 0.0, 0.0), To.ALL, NO_SWARM)))
    assert thawed(fls)[:4] == (1, 3, 0, Began.ANOTHER)


def test_an_epoch_adopted_in_the_dark_was_not_left(dark):
    dark.feed(Received(Message(Kind.THAW, 1, 0, 2, Swarm(1, 0), 1, (0.0, 0.0, 0.0), To.ALL, NO_SWARM)))
    assert dark.machine.epoch == 2
    assert thawed(dark) == NOTHING_LEFT


def test_urgent_messages_go_first(fls):
    say(fls, Kind.CHALLENGE_INIT, 1, 1, to=To.ALL, addressee=NO_SWARM, challenge=9, range=50.0)
    say(fls, Kind.SET_WAITING, 1, 2, to=To.SWARM)
    handled = []
    take = fls.machine.receive
    fls.machine.receive = lambda message, *more: handled.append(Kind(message.kind)) or take(message, *more)
    while fls.step():
        pass
    assert handled == [Kind.SET_WAITING, Kind.CHALLENGE_INIT]


def test_who_was_replaced_while_its_message_waited_is_not_handled(fls):
    """The successor's message goes first by its priority, and then the predecessor's is a dead FLS's (rule 12)."""
    say(fls, Kind.CHALLENGE_INIT, 1, 1, to=To.ALL, addressee=NO_SWARM, challenge=9, range=50.0)
    say(fls, Kind.SET_WAITING, 1, 1, to=To.SWARM, incarnation=1)
    handled = []
    take = fls.machine.receive
    fls.machine.receive = lambda message, *more: handled.append(message.incarnation) or take(message, *more)
    while fls.step():
        pass
    assert handled == [1]
    assert fls.handler_counts[Wire.REPLAYED] == 1
