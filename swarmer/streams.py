"""Random streams: one root seed per run, and for every FLS and purpose a stream of its own split from it.

So turning one fault on does not change the other draws, and a replacement does not repeat its predecessor's.
"""

from __future__ import annotations

from hashlib import blake2b
from random import Random


def stream(seed: int, purpose: str, fid: int = 0, incarnation: int = 0) -> Random:
    """The generator of one purpose of one FLS (fid 0: of the run) under a root seed.

    A hash splits the root here and not numpy's SeedSequence, because FLS processes do without numpy.

    >>> stream(1, "flight", 17).random() == stream(1, "flight", 17).random()
    True
    >>> stream(1, "flight", 17).random() == stream(1, "timers", 17).random()
    False
    """
    text = f"{seed}/{purpose}/{fid}/{incarnation}".encode()
    return Random(int.from_bytes(blake2b(text, digest_size=16).digest(), "big"))
