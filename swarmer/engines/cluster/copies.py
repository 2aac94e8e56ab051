"""The engine's copy of what FLSs on other hosts show: only what has changed in their slots is sent (decision 0008)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swarmer.telemetry import LIFE_AT, PAGE, SLOT, Life, Reader, SharedMemory

if TYPE_CHECKING:
    from numpy.typing import NDArray

WORDS = SLOT // 8  # of a slot
_PLACE, _VALUE = np.dtype("<u4"), np.dtype("<u8")
_LOW = np.uint64(0xFFFFFFFF)


class Copier:
    """Looks at the slots of this host's FLSs."""

    def __init__(self, shared: SharedMemory, fids: Sequence[int]) -> None:
        self._shared = shared
        self._words = np.frombuffer(shared.map, _VALUE, shared.count * WORDS, PAGE).reshape(-1, WORDS)
        self._fids = np.array(fids, np.int64)
        self._last = np.zeros((len(fids), WORDS), _VALUE)

    def changed(self) -> bytes:
        """What has changed since the last look: places among the words of all slots, then values."""
        rows = self._whole()
        row, word = np.nonzero(rows != self._last)
        self._last = rows
        places = ((self._fids[row] - 1) * WORDS + word).astype(_PLACE)
        return places.tobytes() + rows[row, word].tobytes()

    def _whole(self) -> NDArray[np.uint64]:
        """The slots, none of them half-written: by the sequence number in the low half of its first word."""
        at = self._fids - 1
        rows = self._words[at]
        torn = np.arange(len(at))
        for _ in range(Reader.RETRIES):
            first = rows[torn, 0]
            torn = torn[(first % 2 == 1) | (first & _LOW != self._words[at[torn], 0] & _LOW)]
            if not len(torn):
                return rows
            rows[torn] = self._words[at[torn]]
        rows[torn] = self._last[torn]  # whoever wrote them was stopped meanwhile
        return rows

    def take(self, fids: Sequence[int], slots: bytes) -> None:
        """Have these FLSs, too, from now on; what their slots held elsewhere is where they begin."""
        for fid, at in zip(fids, range(0, len(slots), SLOT), strict=True):
            begins = PAGE + (fid - 1) * SLOT
            self._shared.map[begins : begins + SLOT] = slots[at : at + SLOT]
        self._fids = np.concatenate([self._fids, np.array(fids, np.int64)])
        taken = np.frombuffer(slots, _VALUE).reshape(-1, WORDS)
        self._last = np.concatenate([self._last, taken])


class Copy:
    """The engine's own shared memory, in which nobody lives."""

    def __init__(self, shared: SharedMemory) -> None:
        self._words = np.frombuffer(shared.map, _VALUE, shared.count * WORDS, PAGE)

    def write(self, changed: bytes) -> None:
        """What `Copier.changed` gave on some host. Raises ValueError for what it cannot have given."""
        count, rest = divmod(len(changed), _PLACE.itemsize + _VALUE.itemsize)
        if rest:
            raise ValueError("a copy of a size that none has")
        places = np.frombuffer(changed, _PLACE, count)
        if count and int(places.max()) >= len(self._words):
            raise ValueError("a slot that is not there")
        self._words[places] = np.frombuffer(changed, _VALUE, count, count * _PLACE.itemsize)

    def slots(self, fids: NDArray[np.int64]) -> bytes:
        """The slots of some FLSs, one after the other."""
        return self._words.reshape(-1, WORDS)[fids - 1].tobytes()

    def end(self, fids: NDArray[np.int64]) -> None:
        """Nobody lives in these slots any more."""
        lives = self._words.view(np.uint8).reshape(-1, SLOT)
        lives[fids - 1, LIFE_AT] = Life.ENDED

    def close(self) -> None:
        """Let go of the mapping."""
        del self._words
