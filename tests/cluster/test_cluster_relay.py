"""The relay leaves at home what nobody elsewhere can take, and only that."""

import socket
import time

import pytest

from swarmer.engines.cluster.batches import What, pack, unpack
from swarmer.engines.cluster.relay import Lines, Relay, Setup, udp_socket
from swarmer.messages import NO_SWARM, ZERO, Kind, Message, Stamp, Swarm, To, decode, encode
from swarmer.telemetry import Clock, Phase, SharedMemory
from swarmer.udp_wrapper import ELSEWHERE, HOME, NEW_SWARM, Wires, address_of

KEY = b"r" * 16
RUN = 9
TRUTH = {1: (0, 0, 0), 2: (1, 0, 0), 3: (10, 0, 0), 4: (11, 0, 0), 5: (20, 0, 0), 6: (21, 0, 0)}
HOST_OF = [0, 0, 1, 1, 2, 2]
BOXES = {
    0: ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    1: ((10.0, 0.0, 0.0), (11.0, 0.0, 0.0)),
    2: ((20.0, 0.0, 0.0), (21.0, 0.0, 0.0)),
}


class Air:
    """Relays of three hosts with two FLSs each, on one machine; FLSs are plain sockets."""

    def __init__(self, **changed):
        self.relays, self.outside, self.inside, self.memories = [], [], [], []
        self.port = free_port()
        wires = Wires(self.port, "unicast")
        for host in range(3):
            memory = SharedMemory(6)
            Clock(memory).set(Phase.GO, 1.0, 0.0)
            here = [2 * host + 1, 2 * host + 2]
            directory = memory.directory()
            for fid in range(1, 7):
                directory[fid - 1] = fid if fid in here else ELSEWHERE
            outside, inside = udp_socket(HOME, 1 << 18), udp_socket(HOME, 1 << 18)
            setup = Setup(
                host, 6, KEY, b"", wires, True, here, [[list(TRUTH[fid])] for fid in here], 0.0, 0.0, 1
            )._replace(**changed)  # fmt: skip
            self.relays.append(Relay(setup, memory, outside, inside))
            self.outside.append(outside)
            self.inside.append(inside)
            self.memories.append(memory)
        self.introduce()
        self.flss = {fid: self.ear(fid) for fid in TRUTH}
        self.numbers = 0

    def introduce(self, gone=()):
        hosts = [host for host in range(3) if host not in gone]
        for host in hosts:
            others = [
                [other, *self.outside[other].getsockname(), BOXES[other]] for other in hosts if other != host
            ]
            self.relays[host].know(others, HOST_OF)

    def ear(self, fid):
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.setblocking(False)
        sock.bind((address_of(fid), self.port))
        return sock

    def close(self):
        for sock in (*self.outside, *self.inside, *self.flss.values()):
            sock.close()

    def datagram(self, sender, to, addressee=NO_SWARM, kind=Kind.SET_AVAILABLE, reach=1e9):
        self.numbers += 1
        truth = tuple(map(float, TRUTH[sender]))
        message = Message(
            kind, sender, 0, 0, Swarm(sender, 0), 1, truth, to, addressee, challenge=1, range=reach
        )
        return encode(message, Stamp(RUN, self.numbers, ZERO, 0.0))

    def say(self, host, data):
        """An FLS of that host has said it; all relays do what there is to do, until nothing moves."""
        self.relays[host].take(data)
        self.settle()

    def settle(self):
        for _ in range(4):
            for relay, outside in zip(self.relays, self.outside, strict=True):
                relay.flush()
                for packet in arrived(outside):
                    relay.hear(packet)

    def heard(self):
        """FID -> what came to it."""
        return {fid: found for fid, sock in self.flss.items() if (found := arrived(sock))}


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOME, 0))
        return sock.getsockname()[1]


def arrived(sock):
    found = []
    while True:
        try:
            found.append(sock.recv(65536))
        except BlockingIOError:
            return found


@pytest.fixture
def air():
    made = Air()
    made.settle()  # the first lists of swarms
    yield made
    made.close()


def test_to_one_fls_goes_to_its_host_alone(air):
    data = air.datagram(1, To.FLS, Swarm(4, 0))
    air.say(0, data)
    assert air.heard() == {4: [data]}
    assert [relay.counts["arrived"] for relay in air.relays] == [0, 1, 0]


@pytest.mark.parametrize(
    ("reach", "heard"),
    [(8.9, []), (9.0, [3]), (9.5, [3]), (10.0, [3, 4]), (19.0, [3, 4, 5]), (50.0, [3, 4, 5, 6])],
)
def test_a_challenge_goes_where_a_point_is_in_range(air, reach, heard):
    air.say(0, air.datagram(2, To.ALL, kind=Kind.CHALLENGE_INIT, reach=reach))
    assert sorted(air.heard()) == heard
    hosts = {HOST_OF[fid - 1] for fid in heard}
    assert [relay.counts["arrived"] for relay in air.relays[1:]] == [int(1 in hosts), int(2 in hosts)]


def test_where_ranges_are_between_positions_every_host_is_asked():
    air = Air(ranged=False)
    air.say(0, air.datagram(2, To.ALL, kind=Kind.CHALLENGE_INIT, reach=1.0))
    assert sorted(air.heard()) == [3, 4, 5, 6]
    air.close()


def test_the_dark_hear_no_challenge(air):
    air.memories[1].directory()[2] = 0
    air.say(0, air.datagram(2, To.ALL, kind=Kind.CHALLENGE_INIT, reach=15.0))
    assert sorted(air.heard()) == [4]


def test_to_all_goes_to_all(air):
    air.say(0, air.datagram(2, To.ALL, kind=Kind.THAW_ANNOUNCE))
    assert air.relays[0].counts["rejected"] == 1, (
        "THAW_ANNOUNCE names nobody: a broken datagram ends at the relay"
    )
    assert not air.heard()
    air.say(0, air.datagram(2, To.ALL, kind=Kind.LEAVE))
    assert sorted(air.heard()) == [3, 4, 5, 6]


def test_to_a_swarm_goes_where_it_has_members(air):
    air.say(0, air.datagram(1, To.SWARM, Swarm(5, 0)))
    assert sorted(air.heard()) == [5]
    air.say(0, air.datagram(1, To.SWARM, Swarm(1, 0)))
    assert not air.heard()
    assert air.relays[0].counts["crossed"] == 1, "all of swarm 1 are at home"


def test_who_joins_a_swarm_hears_what_was_said_to_it_since(air):
    """A host tells that a swarm has come to it after something was said to that swarm elsewhere."""
    data = air.datagram(1, To.SWARM, Swarm(1, 0))
    air.relays[0].take(data)
    air.relays[0].flush()
    air.memories[2].directory()[4] = 1  # FLS 5 has joined, and its host has not told yet
    air.relays[2].take(NEW_SWARM)
    air.settle()
    assert air.heard() == {5: [data]}
    later = air.datagram(1, To.SWARM, Swarm(1, 0))
    air.say(0, later)
    assert air.heard() == {5: [later]}


def test_what_was_said_long_before_is_not_said_again(air, monkeypatch):
    air.relays[0].take(air.datagram(1, To.SWARM, Swarm(1, 0)))
    air.settle()
    now = time.monotonic()
    monkeypatch.setattr("swarmer.engines.cluster.relay.monotonic", lambda: now + 1.0)
    air.settle()
    air.memories[2].directory()[4] = 1
    air.say(2, NEW_SWARM)
    assert not air.heard()


def test_a_swarm_that_has_left_a_host_is_forgotten(air, monkeypatch):
    air.memories[2].directory()[4] = 6
    now = time.monotonic()
    monkeypatch.setattr("swarmer.engines.cluster.relay.monotonic", lambda: now + 1.0)
    air.settle()
    air.say(0, air.datagram(1, To.SWARM, Swarm(5, 0)))
    assert air.relays[0].counts["crossed"] == 0


def test_a_list_that_was_overtaken_takes_nothing_away(air):
    """A packet with all Swarm-IDs that comes after a newer one with a new Swarm-ID."""
    peer = air.relays[0]._peers[2]
    one, other = [xi.to_bytes(4, "big") for xi in (5, 99)]
    air.relays[0].hear(pack(What.SWARMS, 2, peer.told + 9, [other], KEY))
    air.relays[0].hear(pack(What.ALL_SWARMS, 2, peer.told - 1, [one], KEY))
    assert 99 in peer.swarms


def test_all_that_waits_goes_in_few_packets(air):
    before = air.relays[0].counts["packets"]
    for _ in range(20):
        air.relays[0].take(air.datagram(1, To.FLS, Swarm(4, 0)))
    air.settle()
    assert len(air.heard()[4]) == 20
    assert air.relays[0].counts["packets"] - before <= 4


def test_loss_and_delay_between_hosts(monkeypatch):
    air = Air(loss=0.3)
    air.settle()
    for _ in range(400):
        air.relays[0].take(air.datagram(1, To.FLS, Swarm(4, 0)))
    assert air.relays[0].counts["lost"] == pytest.approx(120, abs=40)
    air.close()
    air = Air(delay_s=0.5)
    data = air.datagram(1, To.FLS, Swarm(4, 0))
    air.say(0, data)
    assert not air.heard()
    now = time.monotonic()
    assert air.relays[0].due_s() <= 0.5
    monkeypatch.setattr("swarmer.engines.cluster.relay.monotonic", lambda: now + 0.6)
    air.settle()
    assert air.heard() == {4: [data]}
    air.close()


def test_strangers_and_repetitions_are_refused_and_counted(air):
    relay = air.relays[1]
    data = air.datagram(1, To.FLS, Swarm(4, 0))
    good = pack(What.DATAGRAMS, 0, 1_000_000, [data], KEY)
    for packet in (b"", b"x" * 2000, good[:-1], pack(What.DATAGRAMS, 0, 5, [data], b"s" * 16)):
        relay.hear(packet)
    assert relay.counts["rejected"] == 4
    relay.hear(good)
    relay.hear(good)
    relay.hear(pack(What.DATAGRAMS, 7, 1_000_001, [data], KEY))
    assert relay.counts["repeated"] == 2, "once twice, and once from a host that is none"
    assert air.heard() == {4: [data]}
    relay.take(b"junk on the loopback interface")
    assert relay.counts["rejected"] == 5


def test_signed_datagrams_are_asked_for_their_signature():
    air = Air(mac=b"m" * 16)
    air.say(0, air.datagram(1, To.FLS, Swarm(4, 0)))
    assert air.relays[0].counts["rejected"] == 1
    message, stamp = decode(air.datagram(1, To.FLS, Swarm(4, 0)))
    data = encode(message, stamp, b"m" * 16)
    air.say(0, data)
    assert air.heard() == {4: [data]}
    air.close()


def test_what_is_for_a_host_that_is_gone_stays(air):
    air.introduce(gone=(2,))
    air.say(0, air.datagram(1, To.FLS, Swarm(5, 0)))
    air.say(0, air.datagram(1, To.ALL, kind=Kind.LEAVE))
    assert sorted(air.heard()) == [3, 4]


def test_how_long_the_way_took_is_counted(air):
    air.say(0, air.datagram(1, To.FLS, Swarm(4, 0)))
    assert sum(air.relays[1].histogram) == 1


def test_lines_come_whole():
    one, other = socket.socketpair()
    with one, other:
        lines = Lines(other)
        one.sendall(b"a\nb")
        assert lines.read() == [b"a"]
        one.sendall(b"c\n\n")
        assert lines.read() == [b"bc", b""]
        one.close()
        assert lines.read() == []
        assert lines.ended


def test_a_batch_is_what_was_said(air):
    data = air.datagram(1, To.FLS, Swarm(4, 0))
    air.relays[0].take(data)
    air.relays[0].flush()
    batches = [unpack(packet, KEY) for packet in arrived(air.outside[1])]
    assert [batch.parts for batch in batches if batch.what == What.DATAGRAMS] == [[data]]


def test_a_relay_knows_whom_it_has_heard():
    """Also hosts on which nobody listens to a swarm yet: that is how it is before a run."""
    air = Air()
    directory = air.memories[2].directory()
    for at in range(6):
        directory[at] = 0
    air.relays[0].know([[1, *air.outside[1].getsockname(), BOXES[1]]], HOST_OF)  # it cannot send to the third
    for relay in air.relays:
        relay.flush()
    for relay, outside in zip(air.relays, air.outside, strict=True):
        for packet in arrived(outside):
            relay.hear(packet)
    assert [relay.heard for relay in air.relays] == [{1}, {0, 2}, {1}]
    air.close()
