"""What goes from relay to relay: several datagrams of the radio, or Swarm-IDs, in one UDP packet, signed by the run.

Fixed binary layout, versioned, no pickling. `unpack` takes any bytes apart and raises `BadBatch`, and nothing else, for
those that no relay of this run has packed.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from hashlib import blake2s
from hmac import compare_digest
from typing import NamedTuple

VERSION = 1
MAGIC = b"SR"
MAC_BYTES = 16
LARGEST = 1400  # bytes of a packet: it passes an Ethernet, also one with a tunnel in it, in one piece

HEAD = struct.Struct("!2sBBHBBHQ")  # magic, version, what, host, count, spare, size, number
OVERHEAD = HEAD.size + MAC_BYTES


class What(IntEnum):
    """What a packet holds."""

    DATAGRAMS = 1  # as FLSs have sent them
    SWARMS = 2  # Swarm-IDs that somebody on the sender's host listens to, besides those told before
    ALL_SWARMS = 3  # as SWARMS; those told before with a lower number count no more


class Batch(NamedTuple):
    """One packet."""

    what: int
    host: int  # of the sender
    number: int  # rises with every packet from one host to another
    parts: list[bytes]  # all of one size


class BadBatch(ValueError):
    """These bytes are no packet of a relay of this run; `reason` is one of REASONS."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


REASONS = ("size", "magic", "version", "mac", "what")


def fits(size: int) -> int:
    """How many parts of so many bytes go into one packet."""
    return min(255, max(1, (LARGEST - OVERHEAD) // size))


def pack(
    what: int, host: int, number: int, parts: Sequence[bytes], key: bytes, size: int | None = None
) -> bytes:
    """One packet. parts: 0 to 255 of one size in bytes; size: of each, where there may be none."""
    size = len(parts[0]) if size is None else size
    data = HEAD.pack(MAGIC, VERSION, what, host, len(parts), 0, size, number) + b"".join(parts)
    return data + _mac(data, key)


def unpack(data: bytes, key: bytes) -> Batch:
    """Take one packet apart.

    Raises BadBatch, and nothing else, for bytes that `pack` with the same key cannot have made.
    """
    if len(data) < OVERHEAD:
        raise BadBatch("size")
    magic, version, what, host, count, spare, size, number = HEAD.unpack_from(data)
    if magic != MAGIC:
        raise BadBatch("magic")
    if version != VERSION:
        raise BadBatch("version")
    if len(data) != OVERHEAD + count * size:
        raise BadBatch("size")
    body = data[:-MAC_BYTES]
    if not compare_digest(data[-MAC_BYTES:], _mac(body, key)):
        raise BadBatch("mac")
    if what not in _WHATS or spare:
        raise BadBatch("what")
    at = HEAD.size
    return Batch(what, host, number, [body[at + n * size : at + (n + 1) * size] for n in range(count)])


_WHATS = frozenset(map(int, What))


def _mac(data: bytes, key: bytes) -> bytes:
    return blake2s(data, key=key, digest_size=MAC_BYTES).digest()
