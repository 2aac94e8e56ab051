"""Many small processes that each listen as an FLS does, on every carrier there is, so that these can be compared."""

from __future__ import annotations

import ctypes
import mmap
import os
import select
import signal
import socket
import time
from typing import NamedTuple, Self

from swarmer.engines.measured import cpu_seconds
from swarmer.messages import MAX_SIZE, SIZE, Kind, Message, Stamp, Swarm, To, decode, encode
from swarmer.radio import Ears, Grid, heard
from swarmer.udp_wrapper import BROADCAST, Filter, Wires, address_of, lock_port, open_socket

RUN = 7
HOME = "127.0.0.1"
IP_MULTICAST_ALL = 49  # off: only groups this socket joined
PR_SET_PDEATHSIG = 1
GRID = Grid(256.0)
LAUNCH_PATIENCE_S = 60.0
HEAR_PATIENCE_S = 5.0


class Cost(NamedTuple):
    """What one message cost, µs of processor time: the sender's, and that of all receivers together."""

    sender_us: float
    receivers_us: float

    @property
    def total_us(self) -> float:
        return self.sender_us + self.receivers_us


def group_of(swarm: int) -> str:
    """The multicast group of a swarm."""
    return f"239.1.{swarm >> 8 & 255}.{swarm & 255}"


def membership(swarm: int) -> bytes:
    return socket.inet_aton(group_of(swarm)) + socket.inet_aton(HOME)


def multicast_socket(port: int) -> socket.socket:
    """A socket for any group, in none yet."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(HOME))
    sock.bind(("", port))
    return sock


class Receivers:
    """`count` processes in swarms of `members`; FID 1 to `members` are swarm 1. A context: all are gone after it."""

    def __init__(self, count: int, members: int) -> None:
        self.count, self.members = count, members
        self._locks = [lock_port(0) for _ in range(3)]
        filtered, plain, multicast = (Wires(lock.getsockname()[1]) for lock in self._locks)
        self.filtered, self.plain, self.multicast = filtered, plain, multicast
        self._locks.pop().close()  # a socket for any group needs the port at every address
        self._map = mmap.mmap(-1, 8 * 2 * (count + 1))
        self.heard = memoryview(self._map).cast("Q")  # per FID: datagrams read; then, ready or not
        self.pids: list[int] = []
        self.mouth = open_socket(address_of(count + 1), filtered)
        self.group_mouth = multicast_socket(multicast.port)
        self._numbers = 0

    def __enter__(self) -> Self:
        try:
            for fid in range(1, self.count + 1):
                self._fork(fid)
            deadline = time.monotonic() + LAUNCH_PATIENCE_S
            while sum(self.heard[self.count + 1 :]) < self.count:
                if time.monotonic() > deadline:
                    raise RuntimeError("the receivers did not get ready")
                time.sleep(0.01)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for pid in self.pids:
            os.kill(pid, signal.SIGKILL)
        for pid in self.pids:
            os.waitpid(pid, 0)
        self.pids.clear()
        for sock in (self.mouth, self.group_mouth, *self._locks):
            sock.close()

    def swarm_of(self, fid: int) -> int:
        return (fid - 1) // self.members + 1

    def ears(self, fid: int) -> Ears:
        return Ears(RUN, fid, Swarm(self.swarm_of(fid), 0), (float(fid), 0.0, 0.0), frozenset())

    def _fork(self, fid: int) -> None:
        pid = os.fork()
        if pid:
            self.pids.append(pid)
            return
        try:
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            self._listen(fid)
        finally:
            os._exit(1)

    def _listen(self, fid: int) -> None:
        """Read, decode, ask the rule, for ever."""
        ears = self.ears(fid)
        socks = [
            open_socket(address_of(fid), self.filtered),
            open_socket(BROADCAST, self.filtered, shared=True),
            open_socket(BROADCAST, self.plain, shared=True),
            multicast_socket(self.multicast.port),
        ]
        rule = Filter(ears, GRID, True)
        for sock in socks[:2]:
            rule.attach(sock)
        socks[3].setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership(ears.swarm.xi))
        poll = select.poll()
        by_fd = {sock.fileno(): sock for sock in socks}
        for fd in by_fd:
            poll.register(fd, select.POLLIN)
        buffer = bytearray(MAX_SIZE)
        self.heard[self.count + 1 + fid - 1] = 1
        while True:
            for fd, _ in poll.poll():
                try:
                    size = by_fd[fd].recv_into(buffer)
                except BlockingIOError:
                    continue
                message, stamp = decode(memoryview(buffer)[:size])
                heard(message, stamp, ears, self.count)
                self.heard[fid - 1] += 1

    # -- sending -------------------------------------------------------------------------------------------------

    def datagram(self, to: To, addressee: int) -> bytes:
        """A small message of the last FLS."""
        self._numbers += 1
        sender = self.count
        message = Message(
            Kind.SET_WAITING,
            sender,
            0,
            0,
            Swarm(self.swarm_of(sender), 0),
            1,
            (1.0, 1.0, 1.0),
            to,
            Swarm(addressee, 0),
        )
        data = encode(message, Stamp(RUN, self._numbers, (1.0, 1.0, 1.0), 0.0))
        assert len(data) == SIZE
        return data

    def to_one(self) -> int:
        self.mouth.sendto(self.datagram(To.FLS, 1), (address_of(1), self.filtered.port))
        return 1

    def to_members(self) -> int:
        data = self.datagram(To.SWARM, 1)
        for fid in range(1, self.members + 1):
            self.mouth.sendto(data, (address_of(fid), self.filtered.port))
        return self.members

    def broadcast_filtered(self) -> int:
        self.mouth.sendto(self.datagram(To.SWARM, 1), (BROADCAST, self.filtered.port))
        return self.members

    def broadcast_plain(self) -> int:
        self.mouth.sendto(self.datagram(To.SWARM, 1), (BROADCAST, self.plain.port))
        return self.count

    def multicast_group(self) -> int:
        self.group_mouth.sendto(self.datagram(To.SWARM, 1), (group_of(1), self.multicast.port))
        return self.members

    def cost(self, send: object, times: int) -> Cost:
        """µs per message of one of the ways above, sent `times` times, each when all have heard the one before."""
        assert callable(send)
        before = sum(map(cpu_seconds, self.pids))
        spent = 0.0
        for _ in range(times):
            heard_before = sum(self.heard[: self.count])
            began = time.process_time()
            expected = send()
            spent += time.process_time() - began
            self._await(heard_before + expected)
        after = sum(map(cpu_seconds, self.pids))
        return Cost(1e6 * spent / times, 1e6 * (after - before) / times)

    def _await(self, count: int) -> None:
        deadline = time.monotonic() + HEAR_PATIENCE_S
        while sum(self.heard[: self.count]) < count:
            if time.monotonic() > deadline:
                raise RuntimeError("a datagram did not reach all it was for")
            time.sleep(0.0005)
        time.sleep(0.0005)  # and let them fall asleep
