"""What the engine and its host agents say to each other, over TCP: frames that only holders of the run's key can make.

Each side begins with a number that it draws. Both numbers and the run's key give the key of the connection; every frame
carries a MAC over it, its direction and its place in the order. So a stranger's frame, one of another run, and one that
was heard before are all the same: the connection ends. Nothing is hidden by this, and nothing secret is said.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import struct
from hashlib import blake2s
from hmac import compare_digest
from typing import Any

MAGIC = b"SWC1"
NONCE_BYTES = 16
MAC_BYTES = 16
LENGTHS = struct.Struct("!II")
HEAD_MAX, BLOB_MAX = 1 << 28, 1 << 28  # bytes
HANDSHAKE_S = 10.0  # wall


class NotOurs(ConnectionError):
    """The other side does not know the run's key, or does not speak this language."""


class Channel:
    """One connection: JSON objects, each with bytes if need be, in order."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, key: bytes, engine: bool
    ) -> None:
        """key: of the connection. engine: which side this is."""
        self._reader, self._writer, self._key = reader, writer, key
        self._mine, self._theirs = (b"E", b"H") if engine else (b"H", b"E")
        self._sent = self._heard = 0
        self.bytes_heard = 0

    @property
    def own_address(self) -> str:
        """This side's address on the way to the other."""
        return str(self._writer.get_extra_info("sockname")[0])

    def say(self, head: dict[str, Any], blob: bytes = b"") -> None:
        """Send; what cannot be sent any more is seen by who hears."""
        if self._writer.is_closing():
            return
        data = json.dumps(head).encode()
        self._writer.write(LENGTHS.pack(len(data), len(blob)) + data + blob)
        self._writer.write(self._mac(self._mine, self._sent, data, blob))
        self._sent += 1

    async def drain(self) -> None:
        """Wait until what was said is on its way. Raises ConnectionError."""
        await self._writer.drain()

    async def hear(self) -> tuple[dict[str, Any], bytes]:
        """The next frame. Raises NotOurs for one that the other side cannot have said, ConnectionError at the end."""
        try:
            lengths = LENGTHS.unpack(await self._reader.readexactly(LENGTHS.size))
            if lengths[0] > HEAD_MAX or lengths[1] > BLOB_MAX:
                raise NotOurs("a frame of a length that none has")
            data, blob = [await self._reader.readexactly(length) for length in lengths]
            mac = await self._reader.readexactly(MAC_BYTES)
        except (asyncio.IncompleteReadError, ConnectionResetError, BrokenPipeError):
            raise ConnectionError("the connection has ended") from None
        if not compare_digest(mac, self._mac(self._theirs, self._heard, data, blob)):
            raise NotOurs("a frame that was not signed with the key of this run")
        self._heard += 1
        self.bytes_heard += LENGTHS.size + len(data) + len(blob) + MAC_BYTES
        return json.loads(data), blob

    def close(self) -> None:
        self._writer.close()

    def _mac(self, side: bytes, number: int, data: bytes, blob: bytes) -> bytes:
        mac = blake2s(side + struct.pack("!QI", number, len(data)), key=self._key, digest_size=MAC_BYTES)
        mac.update(data)
        mac.update(blob)
        return mac.digest()


async def shake_hands(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, key: bytes, engine: bool
) -> Channel:
    """Agree on the connection's key. Raises NotOurs, or ConnectionError.

    Whether the other side has the run's key shows with its first frame.
    """
    mine = secrets.token_bytes(NONCE_BYTES)
    writer.write(MAGIC + mine)
    try:
        greeting = await asyncio.wait_for(reader.readexactly(len(MAGIC) + NONCE_BYTES), HANDSHAKE_S)
    except (asyncio.IncompleteReadError, TimeoutError):
        raise NotOurs("nobody of ours answers there") from None
    if not greeting.startswith(MAGIC):
        raise NotOurs("nobody of ours answers there")
    theirs = greeting[len(MAGIC) :]
    both = mine + theirs if engine else theirs + mine
    return Channel(reader, writer, blake2s(both, key=key).digest(), engine)
