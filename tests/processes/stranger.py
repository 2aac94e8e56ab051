"""A stranger on the machine: hears what all may hear of a run, and sends its FLSs what it likes."""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import time
from collections.abc import Iterator
from random import Random

from swarmer.messages import LAYOUT, MAC_BYTES, SIZE, Kind, Message, Stamp, Swarm, To, encode
from swarmer.udp_wrapper import BROADCAST, Wires, address_of, open_socket

MAGIC_NUMBERS = (math.nan, math.inf, -math.inf, 1e300, -1e300)
NUMBERS_AT = SIZE - 11 * 8  # the first of eleven doubles that end a datagram
RUN_AT = LAYOUT.unpack_from(bytes(SIZE)).index(0, 5)  # the place of the run's id among the fields


def free_port() -> int:
    """One that no run takes by itself."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class Stranger:
    """Two sockets: a mouth, and an ear where the run broadcasts."""

    def __init__(self, port: int) -> None:
        self.port, self.sent = port, 0
        self.mouth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.ear = open_socket(BROADCAST, Wires(port), shared=True)

    def close(self) -> None:
        self.mouth.close()
        self.ear.close()

    def heard(self) -> Iterator[bytes]:
        """What has come since."""
        with contextlib.suppress(BlockingIOError):
            while True:
                yield self.ear.recv(500)

    def wait_for_a_word(self, seconds: float = 60.0) -> bytes:
        """The first broadcast: the engine wakes all, who are ready by then."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for data in self.heard():
                return data
            time.sleep(0.01)
        raise AssertionError(f"nothing was broadcast in {seconds:g} s")

    def say(self, fid: int, data: bytes) -> None:
        self.mouth.sendto(data, (address_of(fid), self.port))
        self.sent += 1


def run_of(data: bytes) -> int:
    """The id of the run that a datagram is of."""
    return LAYOUT.unpack_from(data)[RUN_AT]


def lie(rng: Random, run: int, count: int, number: int, key: bytes = b"") -> bytes:
    """A datagram as the run would make it, of somebody who is not there to everybody: a thaw, a swarm, a challenge."""
    sender = rng.randint(1, count)
    swarm = Swarm(rng.randint(1, count), rng.choice((0, 0, 7)))
    kind = rng.choice(
        (Kind.THAW, Kind.FOLLOW_MERGE, Kind.CHALLENGE_INIT, Kind.CHALLENGE_FIN, Kind.LEASE_CANCEL)
    )
    to = To.SWARM if kind == Kind.FOLLOW_MERGE else To.ALL
    message = Message(
        int(kind), sender, rng.choice((0, 0, 0, 65535)), rng.choice((0, 1, 2, 2**32 - 1)), swarm, 2, (1.0, 2.0, 3.0),
        int(to), swarm if to == To.SWARM else Swarm(0, 0), challenge=rng.getrandbits(32), other=Swarm(1, 0),
        vector=(40.0, 0.0, 0.0),
    )  # fmt: skip
    return encode(message, Stamp(run, number, (1.0, 2.0, 3.0), 1.0), key)


def broken(rng: Random, data: bytes) -> bytes:
    """The same cut, lengthened, empty, of another version or run, or with a number that is none."""
    how, changed = rng.randrange(6), bytearray(data)
    if how == 0:
        return data[: rng.randrange(len(data))]
    if how == 1:
        return data + rng.randbytes(rng.choice((1, 8, 50, 60_000)))
    if how == 2:
        changed[2] ^= 1 << rng.randrange(8)
    elif how == 3:
        changed[6 + rng.randrange(4)] ^= 0xFF
    elif how == 4:
        struct.pack_into("!d", changed, NUMBERS_AT + 8 * rng.randrange(11), rng.choice(MAGIC_NUMBERS))
    else:
        changed[0:2] = rng.randbytes(2)
    return bytes(changed) if changed != data else b""


def forged(rng: Random, run: int, count: int, number: int, true: bytes) -> bytes:
    """What somebody without the key can make: unsigned, signed with another key, with a signature cut out elsewhere."""
    plain = lie(rng, run, count, number)
    return rng.choice((
        plain, plain + bytes(MAC_BYTES), plain + true[SIZE:], plain + rng.randbytes(MAC_BYTES),
        lie(rng, run, count, number, b"another run's key"), broken(rng, true), flipped(rng, true),
    ))  # fmt: skip


def flipped(rng: Random, data: bytes) -> bytes:
    """The same with one bit turned."""
    at = rng.randrange(8 * len(data))
    changed = bytearray(data)
    changed[at // 8] ^= 1 << at % 8
    return bytes(changed)
