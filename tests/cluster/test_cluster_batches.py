"""What relays send each other: only what a relay of this run has packed is taken."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.engines.cluster.batches import (
    HEAD,
    LARGEST,
    MAC_BYTES,
    OVERHEAD,
    REASONS,
    BadBatch,
    Batch,
    What,
    _mac,
    fits,
    pack,
    unpack,
)
from swarmer.messages import MAX_SIZE, SIZE

KEY = bytes(range(16))
PARTS = [bytes([n]) * SIZE for n in range(5)]


def test_there_and_back():
    assert unpack(pack(What.DATAGRAMS, 3, 77, PARTS, KEY), KEY) == Batch(What.DATAGRAMS, 3, 77, PARTS)
    assert unpack(pack(What.ALL_SWARMS, 65535, 2**63, [], KEY, 4), KEY) == Batch(3, 65535, 2**63, [])


@pytest.mark.parametrize("size", [SIZE, MAX_SIZE, 4])
def test_as_many_as_fit_are_no_larger_than_an_ethernet_takes(size):
    assert len(pack(What.DATAGRAMS, 1, 1, [bytes(size)] * fits(size), KEY)) <= LARGEST
    assert fits(size) >= 8


def reason(data, key=KEY):
    with pytest.raises(BadBatch) as caught:
        unpack(data, key)
    assert caught.value.reason in REASONS
    return caught.value.reason


def test_another_key_is_a_stranger():
    assert reason(pack(What.DATAGRAMS, 3, 77, PARTS, bytes(16))) == "mac"


def test_every_bit_counts():
    packet = pack(What.SWARMS, 3, 77, [b"\0\0\0\7", b"\0\0\1\0"], KEY)
    for at in range(8 * len(packet)):
        hurt = bytearray(packet)
        hurt[at // 8] ^= 1 << at % 8
        reason(bytes(hurt))


def test_every_length_counts():
    packet = pack(What.DATAGRAMS, 3, 77, PARTS, KEY)
    for length in range(len(packet)):
        reason(packet[:length])
    assert reason(packet + b"\0") == "size"


@pytest.mark.parametrize(("what", "spare"), [(0, 0), (9, 0), (1, 1)])
def test_what_is_signed_and_means_nothing_is_refused(what, spare):
    body = HEAD.pack(b"SR", 1, what, 1, 0, spare, SIZE, 1)
    assert reason(body + _mac(body, KEY)) == "what"


@given(st.binary(max_size=300))
def test_any_bytes(data):
    reason(data)


@given(st.binary(max_size=80), st.integers(0, 255), st.integers(0, 65535))
def test_any_bytes_behind_a_head_that_is_right(body, count, size):
    data = HEAD.pack(b"SR", 1, 1, 1, count, 0, size, 1) + body
    reason(data if len(data) >= OVERHEAD else data + bytes(MAC_BYTES))
