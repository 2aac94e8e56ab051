"""The relay of one host: carries the radio's datagrams to other hosts, and theirs to the FLSs here.

It is started as `python -m swarmer.engines.cluster.relay CONTROL_FD MEMORY_FD` and reads lines of JSON: who it is, then
who the others are, whenever that changes. FLSs send it whatever may concern another host. It looks whom that is for,
puts it into a packet for each host that somebody in question may be on, and sends that as soon as there is nothing more
to read: so a packet is small while there is little to do, and nothing waits for another. What comes from other hosts it
hands to the FLSs here, by unicast or broadcast as they would (`udp_wrapper`).

The radio's rules are asked where they always are, at the sender and at every receiver. What the relay leaves out it
leaves out because nobody there can take it: no FLS of that FID, no point in range, no member of the swarm.
"""

from __future__ import annotations

import heapq
import json
import select
import socket
import sys
from collections import deque
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from swarmer.engines.cluster.batches import BadBatch, What, fits, pack, unpack
from swarmer.engines.cluster.shares import Box, out_of_box
from swarmer.messages import (
    CHALLENGE_INIT,
    MAX_SIZE,
    SIZE,
    TO_FLS,
    TO_SWARM,
    BadDatagram,
    Message,
    decode,
)
from swarmer.metrics.lateness import BUCKETS, bucket
from swarmer.radio import ReplayWindow
from swarmer.streams import stream
from swarmer.telemetry import Clock, SharedMemory
from swarmer.udp_wrapper import BROADCAST, NEW_SWARM, NO_ROOM, Wires, address_of

BURST = 256  # datagrams read before what they became is sent
TELL_S = 0.25  # wall seconds from one list of all Swarm-IDs here to the next
REMEMBERED_S = (
    0.1  # wall seconds: what was for a swarm goes also to a host that it turns out to be on so much later
)
WINDOW = 4096  # packets of a host that may overtake each other
XI_BYTES = 4
COUNTS = (
    "crossed",
    "packets",
    "packets_of_datagrams",
    "packet_bytes",
    "lost",
    "arrived",
    "handed_on",
    "rejected",
    "repeated",
    "send_failed",
)


class Peer:
    """Another host, as its packets are made."""

    def __init__(self, host: int, address: tuple[str, int], box: Box) -> None:
        self.host, self.address, self.box = host, address, box
        self.number = 0
        self.waiting: list[bytes] = []
        self.swarms: set[int] = set()  # that somebody there listens to
        self.told = 0  # number of the packet that said so last


class Setup(NamedTuple):
    """What a relay is told first."""

    host: int
    flss: int  # F, on all hosts
    key: bytes  # of packets
    mac: bytes  # of datagrams; empty: they have none
    wires: Wires
    ranged: bool  # ranges are between points
    here: list[int]  # FIDs
    truth: list[list[list[float]]]  # of each the points that it may have, one for each shape
    loss: float
    delay_s: float  # emulated
    seed: int


class Relay:
    """Reads, looks whom it is for, sends."""

    def __init__(
        self, setup: Setup, shared: SharedMemory, outside: socket.socket, inside: socket.socket
    ) -> None:
        self.setup = setup
        self.clock = Clock(shared)
        self._directory = np.frombuffer(shared.map, np.uint32, setup.flss, shared.directory_at)
        self._outside, self._inside = outside, inside
        self._size = MAX_SIZE if setup.mac else SIZE
        self._full = fits(self._size)
        self._peers: dict[int, Peer] = {}
        self._host_of: list[int] = []
        self._window = ReplayWindow(WINDOW)
        self._rng = stream(setup.seed, "relay", setup.host)
        self._late: list[tuple[float, int, int, bytes]] = []  # to whom later: wall, order, host
        self._order = 0
        self._said: deque[tuple[float, int, frozenset[int], bytes]] = (
            deque()
        )  # for swarms: wall, ξ, hosts, datagram
        self._swarms: set[int] = set()  # as told to the others
        self._retuned, self._tell_at = False, 0.0
        self.counts = dict.fromkeys(COUNTS, 0)
        self.heard: set[int] = set()  # hosts from which a packet has come
        self.histogram = [0] * BUCKETS  # how long a datagram took from its FLS to this host, emulated ms
        self.have(setup.here, setup.truth)

    def have(self, fids: list[int], truth: list[list[list[float]]]) -> None:
        """These FLSs are here."""
        self._here = np.array(fids, np.int64)
        self._truth = np.array(truth, np.float64).reshape(len(fids), -1, 3)

    def know(self, peers: list[list[Any]], host_of: list[int]) -> None:
        """These are the other hosts. peers: host, its relay's address and port, its box. host_of: (F,)."""
        self._host_of = host_of
        known, self._peers = self._peers, {}
        for host, address, port, box in peers:
            peer = known.get(host) or Peer(host, (address, port), box)
            peer.box = box
            self._peers[host] = peer
        self._tell_at = 0.0

    # -- to other hosts ------------------------------------------------------------------------------------------

    def take(self, data: bytes) -> None:
        """What an FLS of this host has sent."""
        if data == NEW_SWARM:
            self._retuned = True
            return
        try:
            message = decode(data, self.setup.mac)[0]
        except BadDatagram:
            self.counts["rejected"] += 1
            return
        hosts = self.hosts_for(message)
        if message.to == TO_SWARM:
            self._said.append((monotonic(), message.addressee.xi, frozenset(hosts), data))
        for host in hosts:
            self._cross(host, data)

    def hosts_for(self, message: Message) -> list[int]:
        """Where somebody may be whom it is for."""
        if message.to == TO_FLS:
            fid = message.addressee.xi
            host = self._host_of[fid - 1] if fid <= len(self._host_of) else -1
            return [host] if host in self._peers else []
        if message.to == TO_SWARM:
            xi = message.addressee.xi
            return [peer.host for peer in self._peers.values() if xi in peer.swarms]
        if message.kind == CHALLENGE_INIT and self.setup.ranged:
            truth, reach = message.truth, message.range
            reach *= 1 + 1e-9
            return [peer.host for peer in self._peers.values() if out_of_box(truth, peer.box) <= reach]
        return list(self._peers)

    def _cross(self, host: int, data: bytes) -> None:
        setup = self.setup
        if setup.loss and self._rng.random() < setup.loss:
            self.counts["lost"] += 1
        elif setup.delay_s:
            self._order += 1
            due = monotonic() + setup.delay_s / self.clock.scale
            heapq.heappush(self._late, (due, self._order, host, data))
        else:
            peer = self._peers[host]
            peer.waiting.append(data)
            if len(peer.waiting) >= self._full:  # on its way while the next ones are looked at
                self._send_waiting(peer)

    def _send_waiting(self, peer: Peer) -> None:
        self.counts["crossed"] += len(peer.waiting)
        self._send(peer, What.DATAGRAMS, peer.waiting, self._size)
        peer.waiting = []

    def flush(self) -> None:
        """Send what waits."""
        late, said, now = self._late, self._said, monotonic()
        while said and said[0][0] < now - REMEMBERED_S:
            said.popleft()
        while late and late[0][0] <= now:
            _, _, host, data = heapq.heappop(late)
            if host in self._peers:  # it may be gone by now
                self._peers[host].waiting.append(data)
        if self._retuned or now >= self._tell_at:
            self._tell_swarms(now)
        for peer in self._peers.values():
            if peer.waiting:
                self._send_waiting(peer)

    def due_s(self) -> float:
        """Wall seconds until something is due by itself."""
        due = min(self._tell_at, self._late[0][0] if self._late else self._tell_at)
        return max(0.0, due - monotonic())

    def _send(self, peer: Peer, what: What, parts: list[bytes], size: int) -> None:
        most = fits(size)
        for at in range(0, max(1, len(parts)), most):
            peer.number += 1
            packet = pack(what, self.setup.host, peer.number, parts[at : at + most], self.setup.key, size)
            self.counts["packets"] += 1
            self.counts["packets_of_datagrams"] += what == What.DATAGRAMS
            self.counts["packet_bytes"] += len(packet)
            try:
                self._outside.sendto(packet, peer.address)
            except OSError:  # no room, or no way there just now: it is lost as on any network
                self.counts["send_failed"] += 1

    def _tell_swarms(self, now: float) -> None:
        """The Swarm-IDs that are listened to here: new ones at once, all of them now and then."""
        self._retuned = False
        here = set(np.unique(self._directory[self._here - 1]).tolist()) - {0}
        if now >= self._tell_at:
            what, told = What.ALL_SWARMS, here
            self._tell_at = now + TELL_S
        else:
            what, told = What.SWARMS, here - self._swarms
            here |= self._swarms
        if told or what == What.ALL_SWARMS:  # a list of none as well: it shows that packets get there
            parts = [xi.to_bytes(XI_BYTES, "big") for xi in sorted(told)]
            for peer in self._peers.values():
                self._send(peer, what, parts, XI_BYTES)
        self._swarms = here

    # -- from other hosts ----------------------------------------------------------------------------------------

    def hear(self, packet: bytes) -> None:
        """What came over the network."""
        try:
            batch = unpack(packet, self.setup.key)
        except BadBatch:
            self.counts["rejected"] += 1
            return
        peer = self._peers.get(batch.host)
        if peer is None or not self._window.fresh(batch.host, 0, batch.number):
            self.counts["repeated"] += 1
            return
        self.heard.add(batch.host)
        if batch.what == What.DATAGRAMS:
            for data in batch.parts:
                self._hand_on(data)
        else:
            self._note_swarms(peer, batch.what, batch.number, batch.parts)

    def _note_swarms(self, peer: Peer, what: int, number: int, parts: list[bytes]) -> None:
        told = {int.from_bytes(part, "big") for part in parts}
        new = told - peer.swarms
        if what == What.SWARMS or number < peer.told or len(parts) == fits(XI_BYTES):
            peer.swarms |= told  # a list that overtook another, or goes on in the next packet
        else:
            peer.swarms = told
        peer.told = max(peer.told, number)
        if new:  # somebody joined a swarm over there, and has not been sent what was said to it just now
            for _, xi, hosts, data in self._said:
                if xi in new and peer.host not in hosts:
                    self._cross(peer.host, data)

    def _hand_on(self, data: bytes) -> None:
        """To whom it is for on this host."""
        try:
            message, stamp = decode(data, self.setup.mac)
        except BadDatagram:
            self.counts["rejected"] += 1
            return
        self.counts["arrived"] += 1
        self.histogram[bucket((self.clock.now() - stamp.sent_at) * 1e3)] += 1
        fids, wires = self.addressees(message), self.setup.wires
        many = len(fids) > wires.unicast_max and wires.carrier != "unicast"
        try:
            if message.to != TO_FLS and (many or wires.carrier == "broadcast"):
                self._inside.sendto(data, (BROADCAST, wires.port))
            else:
                for fid in fids:
                    self._inside.sendto(data, (address_of(fid), wires.port))
            self.counts["handed_on"] += 1
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            self.counts["send_failed"] += 1

    def addressees(self, message: Message) -> list[int]:
        """FIDs on this host that it may be for; each of them asks the radio's rules."""
        here = self._here
        if message.to == TO_FLS:
            fid = message.addressee.xi
            return [fid] if fid in here else []
        listens = self._directory[here - 1]
        if message.to == TO_SWARM:
            return here[listens == message.addressee.xi].tolist()
        if message.kind == CHALLENGE_INIT and self.setup.ranged:
            far = np.linalg.norm(self._truth - np.array(message.truth), axis=2).min(axis=1)
            return here[(listens > 0) & (far <= message.range * (1 + 1e-9))].tolist()
        return here.tolist()


def serve(
    relay: Relay, outside: socket.socket, inside: socket.socket, control: socket.socket, lines: Lines
) -> None:
    """Until the agent is gone."""
    poll = select.poll()
    for sock in (outside, inside, control):
        poll.register(sock, select.POLLIN)
    while True:
        for fd, _ in poll.poll(relay.due_s() * 1e3):
            if fd == control.fileno():
                for line in lines.read():
                    obey(relay, json.loads(line), control)
                if lines.ended:
                    return
            else:
                sock, do = (inside, relay.take) if fd == inside.fileno() else (outside, relay.hear)
                drain(sock, do)
        relay.flush()


def drain(sock: socket.socket, do: Any) -> None:
    """Have `do` take what is there, at most a burst of it."""
    try:
        for _ in range(BURST):
            do(sock.recv(65536))
    except BlockingIOError:
        pass


def obey(relay: Relay, said: dict[str, Any], control: socket.socket) -> None:
    """One line from the agent."""
    if "peers" in said:
        relay.have(said["here"], said["truth"])
        relay.know(said["peers"], said["host_of"])
    answer = {"counts": relay.counts, "late": relay.histogram, "heard": sorted(relay.heard)}
    control.sendall(json.dumps(answer).encode() + b"\n")


class Lines:
    """Whole lines from a socket."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock, self._rest, self.ended = sock, b"", False

    def read(self) -> list[bytes]:
        """Those that are there; `ended` says whether there will be more."""
        try:
            data = self._sock.recv(1 << 20)
        except BlockingIOError:
            return []
        except ConnectionError:
            data = b""
        self.ended = not data
        *lines, self._rest = (self._rest + data).split(b"\n")
        return lines


def udp_socket(address: str, buffer: int) -> socket.socket:
    """A non-blocking one at a free port."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
    sock.bind((address, 0))
    return sock


def main() -> None:
    control_fd, memory_fd, outside_fd, inside_fd = map(int, sys.argv[1:5])
    control, outside, inside = (socket.socket(fileno=fd) for fd in (control_fd, outside_fd, inside_fd))
    lines = Lines(control)
    first: list[bytes] = []
    while not first:
        first = lines.read()
        if lines.ended:
            return
    said = json.loads(first[0])
    said |= {
        "key": bytes.fromhex(said["key"]),
        "mac": bytes.fromhex(said["mac"]),
        "wires": Wires(**said["wires"]),
    }
    setup = Setup(**said)
    relay = Relay(setup, SharedMemory(setup.flss, memory_fd), outside, inside)
    for line in first[1:]:
        obey(relay, json.loads(line), control)
    control.setblocking(False)
    serve(relay, outside, inside, control, lines)


if __name__ == "__main__":
    main()
