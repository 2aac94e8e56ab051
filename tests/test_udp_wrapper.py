"""The radio on real sockets: who gets a datagram is the same with and without the kernel's filter."""

import random
import socket
import threading
import time
from array import array

import pytest

from swarmer.messages import NO_SWARM, Kind, Message, Stamp, Swarm, To, decode, encode
from swarmer.radio import Ears, Grid, heard
from swarmer.udp_wrapper import BROADCAST, HOME, UdpWrapper, Wires, address_of, lock_port, open_socket

RUN = 77
GRID = Grid.for_display(40.0)
COUNT = 6


@pytest.fixture
def port():
    with lock_port(0) as lock:
        yield lock.getsockname()[1]


def ears(fid, swarm, rng):
    truth = tuple(rng.uniform(-20, 20) for _ in range(3))
    neighbours = frozenset(rng.sample([n for n in range(1, COUNT + 1) if n != fid], 2))
    return Ears(RUN, fid, swarm, truth, neighbours)


def receiver(own, port, kernel_filter):
    return UdpWrapper(own, array("I", [0] * COUNT), Wires(port, kernel_filter=kernel_filter), GRID, [], [])


def random_message(rng):
    sender = rng.randint(1, COUNT)
    swarm = Swarm(rng.randint(1, 4), rng.randint(0, 1))
    kind = rng.choice(
        [Kind.CHALLENGE_INIT] * 3 + [Kind.SET_WAITING, Kind.THAW, Kind.CHALLENGE_ACK, Kind.FOLLOW_MERGE]
    )
    to = {Kind.CHALLENGE_INIT: To.ALL, Kind.THAW: To.ALL, Kind.CHALLENGE_ACK: To.FLS}.get(kind, To.SWARM)
    some_swarm = Swarm(rng.randint(1, 4), rng.randint(0, 1))
    addressee = {To.ALL: NO_SWARM, To.FLS: Swarm(rng.randint(1, COUNT), 0), To.SWARM: some_swarm}[to]
    truth = tuple(rng.uniform(-20, 20) for _ in range(3))
    return Message(
        kind, sender, 0, 0, swarm, 1, truth, to, addressee, range=rng.uniform(0, 60), other=Swarm(1, 0)
    )  # fmt: skip


def datagram(message, number, run=RUN):
    reach2 = GRID.reach2(message.range) if message.kind == Kind.CHALLENGE_INIT else 0xFFFFFFFF
    return encode(message, Stamp(run, number, message.truth, 0.0, GRID.of(message.truth), reach2))


def drain(sock):
    found = []
    while True:
        try:
            found.append(sock.recv(500))
        except BlockingIOError:
            return found


def taken(data, own):
    """The rules in Python, as every FLS asks them of whatever arrives."""
    message, stamp = decode(data)
    return heard(message, stamp, own, COUNT) is None


@pytest.mark.parametrize("seed", range(4))
def test_filter_and_python_take_the_same_datagrams(port, seed):
    rng = random.Random(seed)
    swarms = [NO_SWARM, Swarm(1, 0), Swarm(2, 1), Swarm(3, 0), Swarm(4, 1), Swarm(4, 0)]
    everyone = [ears(fid, swarm, rng) for fid, swarm in zip(range(1, COUNT + 1), swarms, strict=True)]
    filtered = [receiver(own, port, True) for own in everyone]
    unfiltered = [open_socket(BROADCAST, Wires(port), shared=True) for _ in everyone]
    assert all(one.wires.kernel_filter for one in filtered), (
        "this kernel has no socket filter: nothing was compared"
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        sent = [datagram(random_message(rng), n, RUN if rng.random() < 0.9 else RUN + 1) for n in range(200)]
        for data in sent:
            sender.sendto(data, (BROADCAST, port))
    time.sleep(0.05)
    passed = 0
    for own, with_filter, without in zip(everyone, filtered, unfiltered, strict=True):
        kernel, everything = drain(with_filter.broadcast), drain(without)
        assert everything == sent
        assert [data for data in kernel if taken(data, own)] == [
            data for data in everything if taken(data, own)
        ]
        passed += len(kernel)
        # The filter spares the wake-ups: what it passes is nearly what the rules take.
        wrong = [data for data in kernel if not taken(data, own)]
        assert len(wrong) <= 0.05 * len(sent)
    assert passed > 50
    for one in filtered + unfiltered:
        one.close()


def test_a_filter_follows_its_swarm(port):
    rng = random.Random(1)
    own = ears(2, Swarm(2, 0), rng)
    one = receiver(own, port, True)
    messages = [
        Message(Kind.SET_WAITING, 1, 0, 0, Swarm(1, 0), 1, own.truth, To.SWARM, Swarm(xi, inc))
        for xi in (2, 3) for inc in (0, 1)
    ]  # fmt: skip

    def heard_now():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            for number, message in enumerate(messages):
                sender.sendto(datagram(message, number), (BROADCAST, port))
        time.sleep(0.02)
        return [decode(data)[0].addressee for data in drain(one.broadcast)]

    assert heard_now() == [Swarm(2, 0)]
    one.tune(own._replace(swarm=Swarm(3, 1)))
    assert heard_now() == [Swarm(3, 1)]
    one.tune(own._replace(swarm=NO_SWARM))
    assert heard_now() == []
    one.close()


def test_a_challenge_from_the_own_swarm_wakes_only_planned_neighbours(port):
    own = Ears(RUN, 2, Swarm(9, 0), (0.0, 0.0, 0.0), frozenset((3,)))
    one = receiver(own, port, True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        for fid in (3, 4):
            message = Message(
                Kind.CHALLENGE_INIT, fid, 0, 0, Swarm(9, 0), 1, (1.0, 0.0, 0.0), To.ALL, range=5.0
            )
            sender.sendto(datagram(message, fid), (BROADCAST, port))
    time.sleep(0.02)
    assert [decode(data)[0].sender for data in drain(one.broadcast)] == [3]
    one.close()


@pytest.mark.parametrize("carrier", ["auto", "unicast", "broadcast"])
@pytest.mark.parametrize("kernel_filter", [True, False])
def test_every_carrier_reaches_the_same_flss(port, carrier, kernel_filter):
    rng = random.Random(3)
    points = [(float(i), 0.0, 0.0) for i in range(COUNT)]
    swarms = [Swarm(1, 0), Swarm(1, 0), Swarm(2, 0), Swarm(2, 0), Swarm(1, 0), NO_SWARM]
    directory = array("I", [0] * COUNT)
    wires = Wires(port, carrier, 2, kernel_filter)
    flss = []
    for i, swarm in enumerate(swarms):
        others = sorted((abs(i - j), j + 1) for j in range(COUNT) if j != i)
        own = Ears(RUN, i + 1, swarm, points[i], frozenset(fid for d, fid in others if d == 1))
        flss.append(
            UdpWrapper(own, directory, wires, GRID, [f for _, f in others], [float(d) for d, _ in others])
        )
    for number in range(1, 61):
        sender = rng.randrange(COUNT - 1)
        message = random_message(rng)._replace(
            sender=sender + 1, truth=points[sender], swarm=swarms[sender], range=rng.uniform(0.5, 6)
        )
        if message.to == To.SWARM:
            message = message._replace(addressee=rng.choice([Swarm(1, 0), Swarm(2, 0)]))
        data = datagram(message, number)
        expected = [fls.ears.fid for fls in flss if taken(data, fls.ears)]
        assert flss[sender].send(data, message)
        time.sleep(0.002)
        got = []
        for fls in flss:
            arrived = drain(fls.unicast) + drain(fls.broadcast)
            got += [fls.ears.fid for one in arrived if taken(one, fls.ears)]
        assert got == expected, message
    for fls in flss:
        fls.close()
    assert not any(directory)


def test_addresses_are_loopback_and_different():
    addresses = [address_of(fid) for fid in (1, 2, 255, 256, 65_535, 65_536, 1_000_000)]
    assert len(set(addresses)) == len(addresses)
    assert all(address.startswith("127.") and address not in (HOME, BROADCAST) for address in addresses)


def test_a_port_belongs_to_one_run():
    with lock_port(0) as first, lock_port(0) as second:
        assert first.getsockname()[1] != second.getsockname()[1]
        with pytest.raises(OSError, match="is taken"):
            lock_port(first.getsockname()[1])


def test_an_address_that_a_dying_fls_still_has_is_waited_for(monkeypatch):
    """The engine of another run was killed: its port is free at once, its FLSs are gone a moment later."""
    with lock_port(0) as lock:
        port = lock.getsockname()[1]
        dying = open_socket(address_of(3), Wires(port))
        end = threading.Timer(0.3, dying.close)
        end.start()
        with open_socket(address_of(3), Wires(port)):
            end.join()
            monkeypatch.setattr("swarmer.udp_wrapper.WAIT_FOR_THE_DEAD_S", 0.1)
            with pytest.raises(OSError, match="in use"):
                open_socket(address_of(3), Wires(port))
