"""The wire format: what goes in comes out, the bytes stay where the kernel's filter looks, garbage has one error."""

import math
import struct

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from swarmer.messages import (
    ALL_FLAGS,
    LARGEST,
    LAYOUT,
    MAC_BYTES,
    MAX_SIZE,
    OFFSET,
    REASONS,
    SIZE,
    BadDatagram,
    Kind,
    Message,
    Stamp,
    Swarm,
    To,
    decode,
    encode,
)  # fmt: skip

KEY = b"of this run"
u32 = st.integers(0, 2**32 - 1)
fids = st.integers(1, 2**32 - 1)
u16 = st.integers(0, 2**16 - 1)
coordinates = st.floats(-1e8, 1e8)
points = st.tuples(coordinates, coordinates, coordinates)
swarms = st.builds(Swarm, fids, u16)
messages = st.builds(
    Message,
    kind=st.sampled_from([kind for kind in Kind if kind != Kind.CONTROL]),
    sender=fids,
    incarnation=u16,
    epoch=u32,
    swarm=swarms,
    size=u32,
    truth=points,
    to=st.sampled_from(To),
    addressee=swarms,
    flags=st.integers(0, ALL_FLAGS),
    challenge=u32,
    range=st.floats(0.0, LARGEST),
    other=swarms,
    vector=points,
)
stamps = st.builds(
    Stamp, u32, u32, points, st.floats(-LARGEST, LARGEST), st.tuples(u32, u32, u32), u32
)  # fmt: skip
EXAMPLE = (
    Message(
        kind=Kind.FOLLOW_MERGE, sender=7, incarnation=1, epoch=3, swarm=Swarm(4, 0), size=12, truth=(1.0, 2.0, 3.0),
        to=To.SWARM, addressee=Swarm(7, 1), flags=5, challenge=99, range=25.0, other=Swarm(4, 0),
        vector=(0.5, -0.25, 0.0),
    ),
    Stamp(run=0xABCD1234, number=17, origin=(1.5, 2.5, 3.5), sent_at=12.25, grid=(10, 20, 30), reach2=400),
)  # fmt: skip
GOLDEN = (
    "5357" "01" "09" "01" "05" "abcd1234" "00000007" "0001"  # magic, version, kind, to, flags, run, addressee
    "00000007" "0001" "00000003" "00000011"  # sender, incarnation, epoch, number
    "00000004" "0000" "0000000c" "00000063" "00000004" "0000"  # swarm, size, challenge, other
    "0000000a" "00000014" "0000001e" "00000190" "4039000000000000"  # grid, reach2, range
    "3ff0000000000000" "4000000000000000" "4008000000000000"  # ground truth
    "3ff8000000000000" "4004000000000000" "400c000000000000"  # origin
    "3fe0000000000000" "bfd0000000000000" "0000000000000000"  # vector
    "4028800000000000"  # sent at
)  # fmt: skip


def reason(data, key=b""):
    with pytest.raises(BadDatagram) as caught:
        decode(data, key)
    return caught.value.reason


def taken(data, key=b""):
    """The message and its stamp, or None where BadDatagram was raised, for a reason that has a counter."""
    try:
        return decode(data, key)
    except BadDatagram as error:
        known = error.reason in REASONS
    assert known
    return None


def with_bytes(offset, form, value):
    """The example with one field overwritten."""
    data = bytearray(encode(*EXAMPLE))
    struct.pack_into(form, data, offset, value)
    return bytes(data)


@given(messages, stamps, st.sampled_from([b"", KEY]))
def test_round_trip(message, stamp, key):
    data = encode(message, stamp, key)
    assert len(data) == (MAX_SIZE if key else SIZE)
    assert decode(data, key) == (message, stamp)


def test_every_field_is_on_the_wire():
    other = Message(
        Kind.MERGE, 8, 2, 4, Swarm(5, 1), 13, (9.0, 9.5, 9.75), To.FLS, Swarm(9, 0), 2, 100, 26.0, Swarm(6, 2),
        (7.0, 6.0, 5.0),
    )  # fmt: skip
    for name, value in other._asdict().items():
        changed = EXAMPLE[0]._replace(**{name: value})
        assert changed != EXAMPLE[0]
        assert encode(changed, EXAMPLE[1]) != encode(*EXAMPLE), name


def test_the_bytes_are_those_that_were_agreed():
    assert encode(*EXAMPLE).hex() == GOLDEN
    assert decode(bytes.fromhex(GOLDEN)) == EXAMPLE


def test_the_kernel_filter_finds_what_it_compares():
    data = encode(*EXAMPLE)

    def word(name, form="!I"):
        return struct.unpack_from(form, data, OFFSET[name])[0]

    message, stamp = EXAMPLE
    assert word("kind", "B") == message.kind
    assert word("to", "B") == message.to
    assert word("run") == stamp.run
    assert (word("addressee"), word("addressee_incarnation", "!H")) == message.addressee
    assert word("sender") == message.sender
    assert (word("swarm"), word("swarm_incarnation", "!H")) == message.swarm
    assert struct.unpack_from("!3I", data, OFFSET["grid"]) == stamp.grid
    assert word("reach2") == stamp.reach2


def test_a_datagram_is_small():
    assert MAX_SIZE < 200


@given(st.binary(max_size=2 * MAX_SIZE), st.sampled_from([b"", KEY]))
def test_any_bytes_give_a_message_or_one_named_error(data, key):
    assert taken(data, key) is None or len(data) >= SIZE


@given(st.binary(min_size=SIZE, max_size=SIZE))
def test_any_body_behind_a_right_head(data):
    data = EXAMPLE_HEAD + data[len(EXAMPLE_HEAD) :]
    result = taken(data)
    if result is not None:
        message, stamp = result
        numbers = (*message.truth, *message.vector, *stamp.origin, message.range, stamp.sent_at)
        assert all(map(math.isfinite, numbers))
        assert all(abs(number) <= LARGEST for number in numbers)


EXAMPLE_HEAD = encode(*EXAMPLE)[:4]


@given(messages, stamps, st.integers(0, 8 * SIZE - 1))
def test_a_flipped_bit_gives_another_datagram_or_the_error(message, stamp, bit):
    data = bytearray(encode(message, stamp))
    data[bit // 8] ^= 1 << bit % 8
    try:
        changed = decode(bytes(data))
    except BadDatagram:
        return
    assert encode(*changed) == bytes(data)


@pytest.mark.parametrize("size", [0, 1, 3, SIZE - 1, SIZE + 1, SIZE + MAC_BYTES, 201, 1472, 65507])
def test_the_size_is_right_or_nothing_is_looked_at(size):
    data = (encode(*EXAMPLE) * 500)[:size]
    assert reason(data) == "size"


NUMBERS_AT = SIZE - 11 * 8  # range, three vectors, sent_at: the doubles


@pytest.mark.parametrize("place", range(11))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e300])
def test_no_number_that_is_not_one(place, value):
    assert reason(with_bytes(NUMBERS_AT + 8 * place, "!d", value)) == "number"


def test_no_range_below_nothing():
    assert reason(with_bytes(NUMBERS_AT, "!d", -0.5)) == "number"


def test_heads_that_are_not_ours():
    assert reason(with_bytes(0, "!H", 0x5377)) == "magic"
    for version in (0, 2, 255):
        assert reason(with_bytes(2, "B", version)) == "version"
    for kind in (0, max(Kind) + 1, 255):
        assert reason(with_bytes(OFFSET["kind"], "B", kind)) == "kind"
    assert reason(with_bytes(OFFSET["to"], "B", 3)) == "address"
    assert reason(with_bytes(5, "B", ALL_FLAGS + 1)) == "flags"


def test_an_addressee_has_a_number_unless_it_is_all():
    message, stamp = EXAMPLE
    for to in (To.FLS, To.SWARM):
        assert reason(encode(message._replace(to=to, addressee=Swarm(0, 0)), stamp)) == "address"
    assert decode(encode(message._replace(to=To.ALL, addressee=Swarm(0, 0)), stamp))


@pytest.mark.parametrize("kind", Kind)
def test_fid_0_is_the_engine_and_says_no_more_than_it_may(kind):
    message, stamp = EXAMPLE
    by_engine = encode(message._replace(kind=kind, sender=0, swarm=Swarm(0, 0)), stamp)
    by_fls = encode(message._replace(kind=kind), stamp)
    if kind in (Kind.CONTROL, Kind.THAW):
        assert decode(by_engine)[0].kind == kind
    else:
        assert reason(by_engine) == "sender"
    if kind == Kind.CONTROL:
        assert reason(by_fls) == "sender"


def test_nobody_is_in_swarm_0_or_sent_there():
    message, stamp = EXAMPLE
    assert reason(encode(message._replace(swarm=Swarm(0, 0)), stamp)) == "swarm"
    for kind in (Kind.MERGE, Kind.FOLLOW_MERGE, Kind.THAW_ANNOUNCE, Kind.THAW_ABORT):
        assert reason(encode(message._replace(kind=kind, other=Swarm(0, 0)), stamp)) == "swarm"
    assert decode(encode(message._replace(kind=Kind.FOLLOW, other=Swarm(0, 0)), stamp))


def test_who_has_no_key_passes_nothing():
    signed, plain = encode(*EXAMPLE, KEY), encode(*EXAMPLE)
    assert decode(signed, KEY) == EXAMPLE
    assert reason(plain, KEY) == "size"
    assert reason(signed) == "size"
    assert reason(encode(*EXAMPLE, b"of another run"), KEY) == "mac"
    assert reason(plain + bytes(MAC_BYTES), KEY) == "mac"


@pytest.mark.parametrize("byte", range(MAX_SIZE))
def test_with_a_key_no_bit_may_change(byte):
    data = bytearray(encode(*EXAMPLE, KEY))
    for bit in range(8):
        data[byte] ^= 1 << bit
        assert reason(bytes(data), KEY) == "mac"
        data[byte] ^= 1 << bit


@given(messages, messages, stamps)
def test_a_signature_belongs_to_one_datagram(message, other, stamp):
    assume(message != other)
    forged = encode(message, stamp) + encode(other, stamp, KEY)[SIZE:]
    assert reason(forged, KEY) == "mac"


def test_any_buffer_will_do():
    data = encode(*EXAMPLE, KEY)
    assert decode(memoryview(data), KEY) == decode(bytearray(data), KEY) == EXAMPLE
    assert LAYOUT.size == SIZE
