"""Only who has the run's key is heard, and what it said only once, in order."""

import asyncio
import socket

import pytest

from swarmer.engines.cluster.channel import MAGIC, NotOurs, shake_hands

KEY = b"k" * 32


async def streams():
    one, other = socket.socketpair()
    return [await asyncio.open_connection(sock=sock) for sock in (one, other)]


async def pair(key=KEY, other_key=KEY):
    (engine, host) = await streams()
    return await asyncio.gather(
        shake_hands(*engine, key, engine=True), shake_hands(*host, other_key, engine=False)
    )


def test_frames_with_and_without_bytes_both_ways():
    async def talk():
        engine, host = await pair()
        for number in range(3):
            engine.say({"do": number}, b"x" * number)
            host.say({"is": -number})
        assert [await host.hear() for _ in range(3)] == [({"do": n}, b"x" * n) for n in range(3)]
        assert [await engine.hear() for _ in range(3)] == [({"is": -n}, b"") for n in range(3)]
        engine.close()
        with pytest.raises(ConnectionError):
            await host.hear()
        engine.say({"do": "nothing"})  # to nobody, and no error
        host.close()

    asyncio.run(talk())


def test_another_key_is_a_stranger():
    async def talk():
        engine, host = await pair(other_key=b"q" * 32)
        host.say({"is": "hello"})
        with pytest.raises(NotOurs, match="not signed"):
            await engine.hear()
        engine.close()
        host.close()

    asyncio.run(talk())


def test_what_was_said_before_and_what_was_changed_is_not_heard():
    async def talk(change):
        (engine_ends, (reader, writer)) = await streams()
        meet = asyncio.create_task(shake_hands(*engine_ends, KEY, engine=True))
        host = await shake_hands(reader, writer, KEY, engine=False)
        engine = await meet
        sent = []
        host._writer = type("Kept", (), {"write": sent.append, "is_closing": lambda *_: False})()
        host.say({"is": "event", "t": 1}, b"blob")
        frame = b"".join(sent)
        writer.write(frame)
        assert (await engine.hear())[1] == b"blob"
        writer.write(change(frame))
        writer.write_eof()
        with pytest.raises(ConnectionError) as caught:
            await engine.hear()
        engine.close()
        writer.close()
        return caught.value

    assert isinstance(asyncio.run(talk(lambda frame: frame)), NotOurs), "a replay"
    assert isinstance(asyncio.run(talk(lambda frame: b"\xff" * 8 + frame)), NotOurs), "a length that none has"
    assert isinstance(asyncio.run(talk(lambda frame: frame[:-1] + b"\0")), NotOurs)
    assert not isinstance(asyncio.run(talk(lambda frame: frame[:-1])), NotOurs), "a connection that was cut"


@pytest.mark.parametrize("greeting", [b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"", MAGIC, b"\0" * 100])
def test_a_stranger_is_seen_by_its_greeting(greeting):
    async def talk():
        (engine_ends, (_, writer)) = await streams()
        writer.write(greeting)
        writer.write_eof()
        with pytest.raises(NotOurs, match="nobody of ours"):
            await shake_hands(*engine_ends, KEY, engine=True)
        writer.close()
        engine_ends[1].close()

    asyncio.run(talk())
