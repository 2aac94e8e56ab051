"""An FLS whose swarm is on several hosts: what may concern another host goes to the relay, once."""

import socket
from array import array

import pytest

from swarmer.messages import NO_SWARM, Kind, Message, Swarm, To
from swarmer.radio import Ears, Grid
from swarmer.udp_wrapper import ELSEWHERE, HOME, NEW_SWARM, RelayedUdpWrapper, Wires, address_of

GRID = Grid(256.0)
NEAR, DISTANCES = (2, 3, 4), (1.0, 2.0, 9.0)  # of FLS 1; 4 and 5 are elsewhere


class Host:
    def __init__(self, carrier="auto"):
        self.relay = bound((HOME, 0))
        wires = Wires(free_port(), carrier, relay_port=self.relay.getsockname()[1])
        self.others = {fid: bound((address_of(fid), wires.port)) for fid in (2, 3)}
        self.directory = array("I", [0, 2, 7, ELSEWHERE, ELSEWHERE])
        ears = Ears(1, 1, Swarm(1, 0), (0.0, 0.0, 0.0), frozenset({2}))
        self.wrapper = RelayedUdpWrapper(ears, self.directory, wires, GRID, NEAR, DISTANCES)
        assert self.said() == {"relay": [NEW_SWARM]}

    def send(self, to, addressee=NO_SWARM, kind=Kind.SET_AVAILABLE, reach=1e9):
        message = Message(
            kind, 1, 0, 0, Swarm(1, 0), 1, (0.0, 0.0, 0.0), to, addressee, challenge=1, range=reach
        )
        assert self.wrapper.send(b"data", message)
        return {who: len(found) for who, found in self.said().items()}

    def said(self):
        ears = {"relay": self.relay, **self.others}
        return {who: found for who, sock in ears.items() if (found := arrived(sock))}

    def close(self):
        self.wrapper.close()
        for sock in (self.relay, *self.others.values()):
            sock.close()


def bound(address):
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    sock.bind(address)
    return sock


def free_port():
    with bound((HOME, 0)) as sock:
        return sock.getsockname()[1]


def arrived(sock):
    found = []
    while True:
        try:
            found.append(sock.recv(4096))
        except BlockingIOError:
            return found


@pytest.fixture
def host():
    made = Host()
    yield made
    made.close()


def test_to_one_here_and_to_one_elsewhere(host):
    assert host.send(To.FLS, Swarm(2, 0)) == {2: 1}
    assert host.send(To.FLS, Swarm(4, 0)) == {"relay": 1}
    assert host.send(To.FLS, Swarm(99, 0)) == {}, "nobody has that FID"


def test_to_a_swarm_its_members_here_and_the_relay(host):
    assert host.send(To.SWARM, Swarm(7, 0)) == {3: 1, "relay": 1}
    assert host.send(To.SWARM, Swarm(8, 0)) == {"relay": 1}


def test_a_challenge_that_reaches_no_other_host_stays(host):
    assert host.send(To.ALL, kind=Kind.CHALLENGE_INIT, reach=1.5) == {2: 1}
    assert host.send(To.ALL, kind=Kind.CHALLENGE_INIT, reach=8.9) == {2: 1, 3: 1}
    assert host.send(To.ALL, kind=Kind.CHALLENGE_INIT, reach=9.0)["relay"] == 1


def test_to_all_one_copy_to_the_relay(host):
    assert host.send(To.ALL, kind=Kind.LEAVE)["relay"] == 1


def test_by_unicast_nothing_is_sent_to_who_is_elsewhere():
    host = Host("unicast")
    assert host.send(To.ALL, kind=Kind.LEAVE) == {2: 1, 3: 1, "relay": 1}
    host.close()


def test_who_comes_to_this_host_is_spoken_to_directly(host):
    host.directory[3] = 0
    with bound((address_of(4), host.wrapper.wires.port)) as fourth:
        host.send(To.FLS, Swarm(4, 0))
        assert len(arrived(fourth)) == 1


def test_the_relay_is_told_of_another_swarm(host):
    host.wrapper.tune(host.wrapper.ears._replace(swarm=Swarm(7, 0)))
    assert host.said() == {"relay": [NEW_SWARM]}
