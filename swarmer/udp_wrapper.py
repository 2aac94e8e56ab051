"""The radio on real UDP over the loopback interface (section 5): sockets, the kernel's filter, unicast or broadcast.

Every FLS listens on two sockets: a unicast one on an address of its own in 127.0.0.0/8, made from its FID, and a
broadcast one on 127.255.255.255; both on the run's port, which is what keeps two runs on one machine apart. A classic
BPF program on the broadcast socket drops, before the process wakes, what `radio.heard` would drop; it is attached anew
whenever the Swarm-ID changes. `radio.heard` is asked again for whatever arrives.
"""

from __future__ import annotations

import ctypes
import errno
import socket
import struct
import time
from array import array
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, NamedTuple

from swarmer.messages import CHALLENGE_INIT, NO_SWARM, OFFSET, TO_FLS, TO_SWARM, Kind, Message, Swarm, To
from swarmer.radio import Ears, Grid

BROADCAST = "127.255.255.255"
HOME = "127.0.0.1"  # the engine's own address; an FLS's begins at 127.1.0.0
SO_ATTACH_FILTER = 26
SO_RCVBUFFORCE = 33
LARGEST_FID = (1 << 24) - (1 << 16) - 1

# Classic BPF (linux/filter.h): load word, half, byte at an absolute offset; jump; arithmetic; return.
LD_W, LD_H, LD_B = 0x20, 0x28, 0x30
LD_MEM, ST, TAX = 0x60, 0x02, 0x07
SUB_K, MUL_X, ADD_X = 0x14, 0x2C, 0x0C
JEQ, JGE_X = 0x15, 0x3D
RET = 0x06
UDP_HEADER = 8  # a filter on a UDP socket sees the header first
WHOLE = 0xFFFF
ACCEPT, DROP = "accept", "drop"


class Wires(NamedTuple):
    """How the datagrams of one run travel."""

    port: int
    carrier: str = "auto"  # auto | unicast | broadcast
    unicast_max: int = 32
    kernel_filter: bool = True
    receive_buffer: int = 1 << 20
    relay_port: int = 0  # of HOME, where the way to other hosts begins; 0: there are none


def address_of(fid: int) -> str:
    """The loopback address of an FLS's unicast socket."""
    n = (1 << 16) + fid
    return f"127.{n >> 16 & 255}.{n >> 8 & 255}.{n & 255}"


class UdpWrapper:
    """One FLS's sockets, and the ways out of them."""

    def __init__(
        self, ears: Ears, directory: memoryview[int] | array[int], wires: Wires, grid: Grid, near: Sequence[int],
        distances: Sequence[float], ranged: bool = True,
    ) -> None:  # fmt: skip
        """directory: (F,), which Swarm-ID each FLS listens to, 0 for none; shared by all. near, distances: the FIDs
        nearest in ground truth, nearest first, and how far, display cells. ranged: ranges are between points.

        Raises OSError: the port is taken, or no socket is to be had.
        """
        self.ears, self.wires = ears, wires
        self._directory, self._count = directory, len(directory)
        self._grid, self._ranged = grid, ranged
        self._know(near, distances)
        self._everyone = (BROADCAST, wires.port)
        self._filter: Filter | None = None
        self.unicast = open_socket(address_of(ears.fid), wires)
        self.broadcast = open_socket(BROADCAST, wires, shared=True)
        self.tune(ears)

    def close(self) -> None:
        """Leave the air."""
        self._directory[self.ears.fid - 1] = 0
        self.unicast.close()
        self.broadcast.close()

    def _know(self, near: Sequence[int], distances: Sequence[float]) -> None:
        self._near, self._distances = tuple(near), tuple(distances)
        self._sees_all = len(self._near) >= self._count - 1

    def move(self, ears: Ears, near: Sequence[int], distances: Sequence[float]) -> None:
        """Send and listen as an FLS that has another point from now on; near, distances: as of that point."""
        self._know(near, distances)
        self.tune(ears)

    def tune(self, ears: Ears) -> None:
        """Listen as `ears` from now on; the kernel passes only what they may take."""
        self.ears = ears
        self._directory[ears.fid - 1] = ears.swarm.xi
        if not self.wires.kernel_filter:
            return
        if self._filter is None or not self._filter.fits(ears):
            self._filter = Filter(ears, self._grid, self._ranged)
        try:
            self._filter.patch(ears.swarm)
            self._filter.attach(self.broadcast)
        except OSError:  # a kernel without filters: the same rules run in Python, where they run anyway
            self.wires = self.wires._replace(kernel_filter=False)

    def send(self, data: bytes, message: Message) -> bool:
        """Send one datagram to whom it is for; False if the system had no room for it."""
        try:
            if message.to == TO_FLS:
                self.unicast.sendto(data, (address_of(message.addressee.xi), self.wires.port))
                return True
            few = self._few(message)
            if few is None:
                self.unicast.sendto(data, self._everyone)
            else:
                port, send = self.wires.port, self.unicast.sendto
                for fid in few:
                    send(data, (address_of(fid), port))
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            return False
        return True

    def _few(self, message: Message) -> Sequence[int] | None:
        """The addressees, if they are few enough for a datagram each; None: broadcast.

        The directory is the air's knowledge, not the sender's: it picks the cheaper carrier, and who is reached by
        either is the same, for a filter and the directory change together.
        """
        carrier = self.wires.carrier
        if carrier == "broadcast":
            return None
        if message.to == TO_SWARM:
            most = self._count if carrier == "unicast" else self.wires.unicast_max
            return self._members(message.addressee.xi, most)
        if carrier == "unicast":
            return [fid for fid in range(1, self._count + 1) if fid != self.ears.fid]
        if message.kind == CHALLENGE_INIT and self._ranged:
            return self._in_range(message)
        return None

    def _members(self, xi: int, most: int) -> list[int] | None:
        """Who listens to a Swarm-ID, this FLS left out; None if more than `most`."""
        me, found = self.ears.fid, []
        wanted, data = struct.pack("=I", xi), bytes(self._directory)
        at = data.find(wanted)
        while at >= 0:
            if at % 4 == 0 and (fid := at // 4 + 1) != me:
                found.append(fid)
                if len(found) > most:
                    return None
            at = data.find(wanted, at + 1)
        return found

    def _in_range(self, message: Message) -> list[int] | None:
        """Whom a challenge reaches: in range, on the air, and not of the own swarm but for planned neighbours."""
        within = bisect_right(self._distances, message.range)
        if within >= len(self._near) and not self._sees_all:
            return None
        directory, own, neighbours = self._directory, message.swarm.xi, self.ears.neighbours
        few = [
            fid
            for fid in self._near[:within]
            if (xi := directory[fid - 1]) and (xi != own or fid in neighbours)
        ]
        return few if len(few) <= self.wires.unicast_max else None


class RelayedUdpWrapper(UdpWrapper):
    """As `UdpWrapper`, of a run that other hosts have a part in: what may concern them goes to the relay, too.

    In the directory stands ELSEWHERE for every FLS of another host. The relay decides which hosts get it.
    """

    def _know(self, near: Sequence[int], distances: Sequence[float]) -> None:
        super()._know(near, distances)
        directory = self._directory
        abroad = (far for fid, far in zip(near, distances, strict=True) if directory[fid - 1] == ELSEWHERE)
        # The nearest FLS of another host is no nearer than this, cells.
        self._beyond = next(abroad, float("inf") if self._sees_all else self._distances[-1])
        self._relay = (HOME, self.wires.relay_port)

    def tune(self, ears: Ears) -> None:
        """As everywhere; the relay tells the other hosts whom to send what is for this swarm."""
        super().tune(ears)
        self._to_relay(NEW_SWARM)

    def send(self, data: bytes, message: Message) -> bool:
        """As everywhere."""
        if message.to == TO_FLS:
            fid = message.addressee.xi
            if fid > self._count or self._directory[fid - 1] != ELSEWHERE:
                return super().send(data, message)
            return self._to_relay(data)
        sent = super().send(data, message)
        if message.kind == CHALLENGE_INIT and self._ranged and message.range < self._beyond:
            return sent
        return self._to_relay(data) and sent

    def _few(self, message: Message) -> Sequence[int] | None:
        few = super()._few(message)
        return few and [fid for fid in few if self._directory[fid - 1] != ELSEWHERE]

    def _to_relay(self, data: bytes) -> bool:
        try:
            self.unicast.sendto(data, self._relay)
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise
            return False
        return True


ELSEWHERE = 0xFFFFFFFF  # in the directory, in place of a Swarm-ID
PORT_ALLOWED = "a free port, or 0 for the first free one"
NEW_SWARM = b"T"  # to the relay
NO_ROOM = frozenset((errno.ENOMEM, errno.ENOBUFS, errno.EAGAIN, errno.ECONNREFUSED, errno.EPERM))


WAIT_FOR_THE_DEAD_S = 2.0


def open_socket(address: str, wires: Wires, shared: bool = False) -> socket.socket:
    """A non-blocking UDP socket at `address` and the run's port; `shared`: others listen there too."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    try:
        if shared:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wires.receive_buffer)
        _bind(sock, (address, wires.port))
    except OSError:
        sock.close()
        raise
    return sock


def _bind(sock: socket.socket, address: tuple[str, int]) -> None:
    """Bind it. An address that is taken is tried for a while: the port is ours alone, but FLSs of a run that was
    killed are gone only some moments after its engine, and after its claim to the port.
    """
    end = time.monotonic() + WAIT_FOR_THE_DEAD_S
    while True:
        try:
            return sock.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRINUSE or time.monotonic() > end:
                raise
        time.sleep(0.05)


def lock_port(wanted: int) -> socket.socket:
    """Take a port for one run, by a socket that nobody else can bind: `wanted`, or the first free one from 20000 on.

    Raises OSError if `wanted` is taken, or nothing is free.
    """
    ports = [wanted] if wanted else range(20_000, 30_000)
    for port in ports:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        try:
            sock.bind((HOME, port))
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            return sock
        except OSError:
            sock.close()
    raise OSError(f"UDP port {wanted} is taken" if wanted else "no free UDP port from 20000 to 29999")


class Filter:
    """A program for one FLS that stays as it is but for the Swarm-ID, which is patched in: merges come in bursts."""

    def __init__(self, ears: Ears, grid: Grid, ranged: bool) -> None:
        self._for = ears
        program, self._xi_at, self._incarnation_at = filter_program(ears, grid, ranged)
        self._buffer = ctypes.create_string_buffer(program, len(program))
        self._fprog = struct.pack("HL", len(program) // 8, ctypes.addressof(self._buffer))

    def fits(self, ears: Ears) -> bool:
        """True if the program differs at most in the Swarm-ID; one for the dark has no place for it."""
        mine = self._for
        return (mine.swarm == NO_SWARM) == (ears.swarm == NO_SWARM) and ears._replace(
            swarm=mine.swarm
        ) == mine

    def attach(self, sock: socket.socket) -> None:
        """Put the filter on a socket, in place of the one it has. Raises OSError."""
        sock.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, self._fprog)

    def patch(self, swarm: Swarm) -> None:
        """Let it pass what is for another swarm from now on."""
        for at in self._xi_at:
            _PATCH.pack_into(self._buffer, at, swarm.xi)
        for at in self._incarnation_at:
            _PATCH.pack_into(self._buffer, at, swarm.incarnation)


_PATCH = struct.Struct("=I")
NEIGHBOURS_MAX = 128  # a jump reaches 255 instructions; with more neighbours the rule is left to Python
OWN_XI, OWN_INCARNATION = object(), object()


def filter_program(ears: Ears, grid: Grid, ranged: bool = True) -> tuple[bytes, list[int], list[int]]:
    """`radio.heard` as classic BPF, never stricter: the range is compared on the grid, rounded up.

    Gives the program, and the places in it where the own Swarm-ID and its incarnation stand.
    """
    code: list[tuple[Any, ...]] = [
        (LD_W, "run"), (JEQ, ears.run, None, DROP),
        (LD_W, "sender"), (JEQ, ears.fid, DROP, None),
        (LD_B, "to"), (JEQ, To.ALL, "all", None), (JEQ, To.SWARM, None, "fls"),
        (LD_W, "addressee"), (JEQ, OWN_XI, None, DROP),
        (LD_H, "addressee_incarnation"), (JEQ, OWN_INCARNATION, ACCEPT if ears.swarm.xi else DROP, DROP),
        ("label", "fls"), (LD_W, "addressee"), (JEQ, ears.fid, ACCEPT, DROP),
        ("label", "all"), (LD_B, "kind"), (JEQ, Kind.CHALLENGE_INIT, None if ears.swarm.xi else DROP, ACCEPT),
    ]  # fmt: skip
    if ears.swarm.xi:
        code += _own_swarm(ears) + (_in_range(grid.of(ears.truth)) if ranged else [(RET, WHOLE)])
    code += [("label", ACCEPT), (RET, WHOLE), ("label", DROP), (RET, 0)]
    return _assemble(code, ears.swarm)


def _own_swarm(ears: Ears) -> list[tuple[Any, ...]]:
    """Drop a challenge from the own swarm that is not a planned neighbour's."""
    if len(ears.neighbours) > NEIGHBOURS_MAX:
        return []
    code: list[tuple[Any, ...]] = [
        (LD_W, "swarm"), (JEQ, OWN_XI, None, "other"),
        (LD_H, "swarm_incarnation"), (JEQ, OWN_INCARNATION, None, "other"),
        (LD_W, "sender"),
    ]  # fmt: skip
    code += [(JEQ, neighbour, "other", None) for neighbour in sorted(ears.neighbours)]
    return [*code, (RET, 0), ("label", "other")]


def _in_range(g: tuple[int, int, int]) -> list[tuple[Any, ...]]:
    """Accept if the squared distance on the grid is within the squared reach, else drop."""
    code: list[tuple[Any, ...]] = []
    for axis in range(3):
        code += [(LD_W, ("grid", 4 * axis)), (SUB_K, g[axis]), (TAX,), (MUL_X,)]
        if axis:
            code += [(TAX,), (LD_MEM, 0), (ADD_X,)]
        code += [(ST, 0)]
    return [*code, (LD_MEM, 0), (TAX,), (LD_W, "reach2"), (JGE_X, 0, ACCEPT, DROP)]


def _assemble(code: list[tuple[Any, ...]], swarm: Swarm) -> tuple[bytes, list[int], list[int]]:
    places: dict[str, int] = {}
    lines: list[tuple[Any, ...]] = []
    for line in code:
        if line[0] == "label":
            places[line[1]] = len(lines)
        else:
            lines.append(line)
    constants: dict[object, list[int]] = {OWN_XI: [], OWN_INCARNATION: []}
    values = {OWN_XI: swarm.xi, OWN_INCARNATION: swarm.incarnation}
    program = b""
    for at, line in enumerate(lines):
        if len(line) > 1 and line[1] in constants:
            constants[line[1]].append(8 * at + 4)
            line = (line[0], values[line[1]], *line[2:])
        program += _instruction(line, at, places)
    return program, constants[OWN_XI], constants[OWN_INCARNATION]


def _instruction(line: tuple[Any, ...], at: int, places: dict[str, int]) -> bytes:
    op = line[0]
    if op in (JEQ, JGE_X):
        _, k, yes, no = line
        jumps = [0 if label is None else places[label] - at - 1 for label in (yes, no)]
        return struct.pack("=HBBI", op, *jumps, k)
    k = line[1] if len(line) > 1 else 0
    if op in (LD_W, LD_H, LD_B):
        name, extra = k if isinstance(k, tuple) else (k, 0)
        k = UDP_HEADER + OFFSET[name] + extra
    return struct.pack("=HBBI", op, 0, 0, k)
