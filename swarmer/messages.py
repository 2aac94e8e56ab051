"""The protocol's messages and their one binary layout (SwarMer, section 4; layout ours).

A `Message` is what an FLS says; a `Stamp` is what the radio adds to it on the way out. `encode` packs both into
one datagram of fixed size, `decode` takes any bytes apart and raises `BadDatagram`, and nothing else, for those
that are not ours. Nothing here opens a socket or reads a clock.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from hashlib import blake2s
from hmac import compare_digest
from typing import NamedTuple

VERSION = 1
MAGIC = b"SW"
MAC_BYTES = 8
LARGEST = 1e9  # no coordinate, range or time of a run comes near it; an FLS believes nothing beyond

Vec3 = tuple[float, float, float]
ZERO: Vec3 = (0.0, 0.0, 0.0)


class Kind(IntEnum):
    """What a datagram says. The first eleven are the paper's, THAW too; the rest is ours (or the paper's idea)."""

    CHALLENGE_INIT = 1
    CHALLENGE_ACCEPT = 2
    CHALLENGE_ACK = 3
    CHALLENGE_FIN = 4
    SET_WAITING = 5
    SET_AVAILABLE = 6
    FOLLOW = 7
    MERGE = 8
    FOLLOW_MERGE = 9
    LEASE_RENEW = 10
    LEASE_CANCEL = 11
    THAW = 12
    NEIGHBOUR = 13
    LEAVE = 14
    CONTROL = 15  # from the engine (FID 0): look at the control page
    COUNT = 16  # to the owner of the sender's swarm: I am in it
    ROLL_CALL = 17  # from the owner: are you in my swarm?
    THAW_ANNOUNCE = 18  # a corner believes that there is one swarm, and those who agree repeat it
    THAW_ABORT = 19  # there is another swarm


# The same as plain numbers, as `decode` gives them: these stand in the hottest lines, where an attribute of an enum
# class costs a slow look-up, and its members slow comparisons.
CHALLENGE_INIT = int(Kind.CHALLENGE_INIT)
CHALLENGE_ACCEPT = int(Kind.CHALLENGE_ACCEPT)
CHALLENGE_ACK = int(Kind.CHALLENGE_ACK)
CHALLENGE_FIN = int(Kind.CHALLENGE_FIN)
SET_WAITING = int(Kind.SET_WAITING)
SET_AVAILABLE = int(Kind.SET_AVAILABLE)
FOLLOW = int(Kind.FOLLOW)
MERGE = int(Kind.MERGE)
FOLLOW_MERGE = int(Kind.FOLLOW_MERGE)
LEASE_RENEW = int(Kind.LEASE_RENEW)
LEASE_CANCEL = int(Kind.LEASE_CANCEL)
THAW = int(Kind.THAW)
NEIGHBOUR = int(Kind.NEIGHBOUR)
LEAVE = int(Kind.LEAVE)
CONTROL = int(Kind.CONTROL)
COUNT = int(Kind.COUNT)
ROLL_CALL = int(Kind.ROLL_CALL)
THAW_ANNOUNCE = int(Kind.THAW_ANNOUNCE)
THAW_ABORT = int(Kind.THAW_ABORT)


class To(IntEnum):
    """Whom a datagram is for."""

    FLS = 0
    SWARM = 1
    ALL = 2


TO_FLS, TO_SWARM, TO_ALL = map(int, To)


class Swarm(NamedTuple):
    """A Swarm-ID and the incarnation of the FLS it names: ξ of a replaced owner is another swarm (rule 12)."""

    xi: int
    incarnation: int


NO_SWARM = Swarm(0, 0)

JOIN = 1  # the sender is a newcomer that has not merged yet (rule 10)
BUSY = 2  # an acceptor that is anchoring already; where all may join a busy swarm, it stays the anchor
ANCHORING = 4  # SET_WAITING: the swarm anchors; without it, it localizes
ABSOLUTE = (
    8  # the sender's swarm stands where it should, for an oracle is in it; MERGE, FOLLOW_MERGE: the new one
)
ALL_FLAGS = JOIN | BUSY | ANCHORING | ABSOLUTE

SWARM_KINDS = frozenset((SET_WAITING, SET_AVAILABLE, FOLLOW, MERGE, FOLLOW_MERGE))
ENGINE_FID = 0
FROM_ENGINE = frozenset((Kind.CONTROL, Kind.THAW))


class Message(NamedTuple):
    """What one FLS says to one other, to a swarm or to all."""

    kind: int
    sender: int  # FID
    incarnation: int  # how often the sender has been replaced
    epoch: int  # how many thaws the sender has obeyed; THAW: the epoch it begins
    swarm: Swarm  # the sender's
    size: int  # the sender's estimate of its swarm's size; FIN: of the swarm it brings
    truth: Vec3  # the sender's ground truth, display cells
    to: int  # To
    addressee: Swarm = NO_SWARM  # To.FLS: (FID, 0)
    flags: int = 0
    challenge: int = 0  # id of the challenge this belongs to
    range: float = LARGEST  # display cells
    # ACK: the acceptor's swarm as it said; MERGE, FOLLOW_MERGE: the new swarm; THAW_ANNOUNCE: FID and incarnation of
    # the corner that began it; THAW_ABORT: the swarm that was announced.
    other: Swarm = NO_SWARM
    vector: Vec3 = (
        ZERO  # FOLLOW, FOLLOW_MERGE: V, display cells; COUNT: the length of the longest one flown, 0, 0
    )


class Stamp(NamedTuple):
    """What the radio adds: who else is on the air must not matter, and the sensor needs an origin."""

    run: int
    number: int  # rises with every datagram of this sender and incarnation
    origin: Vec3  # where the sender really is, display cells: for the sensor emulation only
    sent_at: float  # emulated seconds
    grid: tuple[int, int, int] = (0, 0, 0)  # the sender's ground truth as the kernel filter computes with it
    reach2: int = 0xFFFFFFFF  # range squared on that grid, rounded up


class BadDatagram(ValueError):
    """These bytes are not a datagram of ours; `reason` is one of REASONS."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


REASONS = ("size", "magic", "version", "mac", "kind", "address", "sender", "swarm", "flags", "number")

# magic, version, kind, to, flags, run, addressee xi and incarnation, sender, incarnation, epoch, number, swarm xi
# and incarnation, size, challenge, other xi and incarnation, grid (3), reach2, range, truth (3), origin (3),
# vector (3), sent_at. Network byte order, because the kernel's filter loads words that way.
LAYOUT = struct.Struct("!2sBBBBIIHIHIIIHIIIH3IId3d3d3dd")
SIZE = LAYOUT.size
MAX_SIZE = SIZE + MAC_BYTES

# Where the kernel's filter looks (bytes from the start of the datagram).
OFFSET = {
    "kind": 3,
    "to": 4,
    "run": 6,
    "addressee": 10,
    "addressee_incarnation": 14,
    "sender": 16,
    "swarm": 30,
    "swarm_incarnation": 34,
    "grid": 50,
    "reach2": 62,
}
_KINDS = frozenset(int(kind) for kind in Kind)
_NAMING = frozenset((MERGE, FOLLOW_MERGE, THAW_ANNOUNCE, THAW_ABORT))  # these say nothing without `other`


def encode(message: Message, stamp: Stamp, key: bytes = b"") -> bytes:
    """One datagram: SIZE bytes, and MAC_BYTES more when a `key` is given."""
    m, s = message, stamp
    data = LAYOUT.pack(
        MAGIC, VERSION, m.kind, m.to, m.flags, s.run, *m.addressee, m.sender, m.incarnation, m.epoch, s.number,
        *m.swarm, m.size, m.challenge, *m.other, *s.grid, s.reach2, m.range, *m.truth, *s.origin, *m.vector, s.sent_at,
    )  # fmt: skip
    return data + _mac(data, key) if key else data


def decode(data: bytes | bytearray | memoryview, key: bytes = b"") -> tuple[Message, Stamp]:
    """Take one datagram apart.

    Raises BadDatagram, and nothing else, for bytes that `encode` with the same key cannot have made.
    """
    if len(data) != (MAX_SIZE if key else SIZE):
        raise BadDatagram("size")
    if key and not compare_digest(bytes(data[SIZE:]), _mac(bytes(data[:SIZE]), key)):
        raise BadDatagram("mac")
    (
        magic, version, kind, to, flags, run, to_id, to_incarnation, sender, incarnation, epoch, number,
        xi, xi_incarnation, size, challenge, other, other_incarnation, gl, gh, gd, reach2,
        radius, tl, th, td, ol, oh, od, vl, vh, vd, sent_at,
    ) = LAYOUT.unpack_from(data)  # fmt: skip
    if magic != MAGIC:
        raise BadDatagram("magic")
    if version != VERSION:
        raise BadDatagram("version")
    if kind not in _KINDS:
        raise BadDatagram("kind")
    if to > TO_ALL or (to != TO_ALL and to_id == 0):
        raise BadDatagram("address")
    if (sender == ENGINE_FID) != (kind == CONTROL) and not (sender == ENGINE_FID and kind in FROM_ENGINE):
        raise BadDatagram("sender")
    if (sender != ENGINE_FID and xi == 0) or (other == 0 and kind in _NAMING):
        raise BadDatagram("swarm")
    if flags & ~ALL_FLAGS:
        raise BadDatagram("flags")
    # NaN fails every comparison and a sum with it is NaN, so one line holds for all eleven numbers.
    total = abs(tl) + abs(th) + abs(td) + abs(ol) + abs(oh) + abs(od) + abs(vl) + abs(vh) + abs(vd)
    if not (total <= LARGEST and 0.0 <= radius <= LARGEST and -LARGEST <= sent_at <= LARGEST):
        raise BadDatagram("number")
    return (
        Message(
            kind, sender, incarnation, epoch, Swarm(xi, xi_incarnation), size, (tl, th, td), to,
            Swarm(to_id, to_incarnation), flags, challenge, radius, Swarm(other, other_incarnation), (vl, vh, vd),
        ),
        Stamp(run, number, (ol, oh, od), sent_at, (gl, gh, gd), reach2),
    )  # fmt: skip


def _mac(data: bytes, key: bytes) -> bytes:
    return blake2s(data, key=key, digest_size=MAC_BYTES).digest()
