"""The memory that a run's processes share: a control page, one slot for each FLS, the radio's directory (section 6).

An FLS writes its own slot and nobody waits for anybody: whoever looks copies all slots and takes those again that were
being written (a sequence lock). Counters are single words that only grow, so they need no lock. A flight is published
as data, once, and the reader works out where it has got to; nothing is written while an FLS flies.

The memory is a memfd: it has no name, so it is gone with the last process that holds it, however that one ends.
"""

from __future__ import annotations

import mmap
import os
import struct
import time
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from swarmer.messages import Kind
from swarmer.metrics.lateness import BUCKETS, bucket
from swarmer.physics.flight import Flight, Vec3, Velocity
from swarmer.protocol.events import Count

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

PAGE = 4096
CONTROL = struct.Struct("=IIddd")  # sequence, phase, wall_ref, emulated_ref, scale
# After the sequence number; see Row, its Thawed and Localization last.
KINEMATICS = struct.Struct("=IIIHBBB3x3d3dddIIHBxdI3f3fd")
SEQUENCE = struct.Struct("=I")
LIFE_AT = 4  # one byte, written alone
BEAT_AT = 5  # one more
KINEMATICS_AT = 8
COUNTERS_AT = 160
ALIGNED = 256  # what the sequence lock guards fits in, so it never crosses a page: copies go page by page


class Phase(IntEnum):
    """What the engine asks of everybody, on the control page."""

    WAIT = 0
    GO = 1
    STOP = 2


class Life(IntEnum):
    """How far an FLS process has got."""

    NONE = 0
    READY = 1
    ENDED = 2
    FAILING = 3  # about to fail, as its failure rate has it


class Wire(IntEnum):
    """What an FLS counts besides the machine's `Count`, in places after it."""

    SENT = len(Count)
    DELIVERED = len(Count) + 1
    LOST_SENDER = len(Count) + 2
    LOST_RECEIVER = len(Count) + 3
    OUT_OF_RANGE = len(Count) + 4
    NOT_ADDRESSED = len(Count) + 5
    REPLAYED = len(Count) + 6
    BAD = len(Count) + 7
    OTHER_RUN = len(Count) + 8
    ANSWERED_AT_ONCE = len(Count) + 9
    DISTANCE_MICROCELLS = len(Count) + 10
    FLIGHTS = len(Count) + 11
    SEND_FAILED = len(Count) + 12
    OWN_SWARM = len(Count) + 13  # challenges from the own swarm that no kernel filter stopped
    WOKEN = len(Count) + 14  # by the engine
    LOCALIZING_MICROCELLS = len(Count) + 15  # of the distance: flown to localize
    FOLLOWING_MICROCELLS = len(Count) + 16  # because its swarm localizes; the place after


# Datagrams by kind: the place of a kind is that far behind its first.
KINDS = max(Kind) + 1
SENT_BY_KIND = len(Count) + len(Wire)
DELIVERED_BY_KIND = SENT_BY_KIND + KINDS
# Where it counts what the radio's rules refuse, by the words of `radio.heard`.
REFUSED = {
    "run": int(Wire.OTHER_RUN), "sender": int(Wire.BAD), "address": int(Wire.NOT_ADDRESSED),
    "range": int(Wire.OUT_OF_RANGE), "own": int(Wire.OWN_SWARM),
}  # fmt: skip
COUNTERS = DELIVERED_BY_KIND + KINDS
NETWORK_AT = (
    COUNTERS_AT + 8 * COUNTERS
)  # the network thread counts apart from the handler, so neither needs a lock
TIMER_LATE_AT = NETWORK_AT + 8 * COUNTERS
HANDLED_LATE_AT = TIMER_LATE_AT + 4 * BUCKETS
SLOT = -(-(HANDLED_LATE_AT + 4 * BUCKETS) // ALIGNED) * ALIGNED


class Began(IntEnum):
    """Who began the thaw that an FLS has obeyed."""

    ANOTHER = 0
    CLOCK = 1  # this FLS, by its timer
    KNOWING = 2  # this FLS, whose policy knows of one swarm


class Thawed(NamedTuple):
    """How an FLS left its last epoch: for an engine that does not see the moment."""

    epoch: int  # that ended
    xi: int  # the swarm it was in until then; 0: it was dark, or has not left any
    incarnation: int  # of that swarm
    began: Began
    at_s: float  # emulated


NOTHING_LEFT = Thawed(0, 0, 0, Began.ANOTHER, 0.0)


class Localization(NamedTuple):
    """The last flight by which an FLS localized: for an engine that does not see the moment."""

    anchor: int  # FID; 0: it has not localized
    start: Vec3  # cells, in single precision, as the two below
    vector: Vec3  # flown
    begins_s: float  # emulated


NEVER_LOCALIZED = Localization(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


class Row(NamedTuple):
    """What the sequence lock guards: who this is, its last flight, its last thaw and its last localization."""

    incarnation: int
    epoch: int
    xi: int
    swarm_incarnation: int
    state: int
    lit: bool
    flying: bool
    flight: Flight
    thawed: Thawed = NOTHING_LEFT
    localization: Localization = NEVER_LOCALIZED


_FLOWN = [Wire.LOCALIZING_MICROCELLS, Wire.FOLLOWING_MICROCELLS]


class SharedMemory:
    """The memfd and its mapping. Create one, or open the one whose descriptor was handed down."""

    def __init__(self, count: int, fd: int | None = None) -> None:
        """count: F. Raises OSError where there is not enough memory."""
        self.count = count
        self.directory_at = PAGE + count * SLOT
        self.size = self.directory_at + 4 * count
        self.fd = os.memfd_create("swarmer") if fd is None else fd
        if fd is None:
            os.ftruncate(self.fd, self.size)
        self.map = mmap.mmap(self.fd, self.size)

    def directory(self) -> memoryview:
        """(F,) unsigned ints: the Swarm-ID that each FLS listens to now, 0 for none. For the radio alone."""
        return memoryview(self.map)[self.directory_at :].cast("I")

    def close(self) -> None:
        """Give up this process's hold; the memory goes with the last."""
        try:
            self.map.close()
        except BufferError:  # a view is still alive somewhere; the process's end drops it
            pass
        os.close(self.fd)


class Clock:
    """Emulated time, from the control page: the same line for every process (docs/time.md).

    Between two changes of the scale, emulated = emulated_ref + scale * (wall - wall_ref).
    """

    __slots__ = ("_map", "_wall_ref", "emulated_ref", "phase", "scale", "sequence")

    def __init__(self, shared: SharedMemory) -> None:
        self._map = shared.map
        self.sequence = -1
        self.refresh()

    def refresh(self) -> None:
        """Look at the control page again."""
        while True:
            values = CONTROL.unpack_from(self._map, 0)
            if values[0] % 2 == 0 and SEQUENCE.unpack_from(self._map, 0)[0] == values[0]:
                break
            time.sleep(0)
        self.sequence, phase, self._wall_ref, self.emulated_ref, self.scale = values
        self.phase = Phase(phase)

    def now(self) -> float:
        """Emulated seconds since the go signal; below 0 before it."""
        if SEQUENCE.unpack_from(self._map, 0)[0] != self.sequence:
            self.refresh()
        return self.emulated_ref + self.scale * (time.monotonic() - self._wall_ref)

    def wall_until(self, emulated_s: float) -> float:
        """Wall seconds from now until an emulated moment."""
        return (emulated_s - self.now()) / self.scale

    def set(self, phase: Phase, scale: float, emulated_s: float | None = None) -> None:
        """Only the engine: another phase or scale, from this moment on (`emulated_s`: which it calls so)."""
        emulated = self.now() if emulated_s is None else emulated_s
        self.write(phase, time.monotonic(), emulated, scale)

    def write(self, phase: Phase, wall: float, emulated_s: float, scale: float) -> None:
        """Only the engine, or whoever acts for it on this host: as `set`, from a moment of the monotonic clock on."""
        sequence = SEQUENCE.unpack_from(self._map, 0)[0]
        SEQUENCE.pack_into(self._map, 0, sequence + 1)
        CONTROL.pack_into(self._map, 0, sequence + 1, phase, wall, emulated_s, scale)
        SEQUENCE.pack_into(self._map, 0, sequence + 2)
        self.refresh()


class Slot:
    """One FLS's own slot: it alone writes here."""

    def __init__(self, shared: SharedMemory, fid: int) -> None:
        self._map = shared.map
        self._at = PAGE + (fid - 1) * SLOT
        view = memoryview(shared.map)[self._at : self._at + SLOT]
        self.handler_counts = view[COUNTERS_AT:NETWORK_AT].cast("Q")
        self.network_counts = view[NETWORK_AT:TIMER_LATE_AT].cast("Q")
        self._timer_late = view[TIMER_LATE_AT:HANDLED_LATE_AT].cast("I")
        self._handled_late = view[HANDLED_LATE_AT : HANDLED_LATE_AT + 4 * BUCKETS].cast("I")

    def live(self, life: Life) -> None:
        self._map[self._at + LIFE_AT] = life

    def life(self) -> int:
        return self._map[self._at + LIFE_AT]

    def beat(self) -> None:
        """Show that the process still runs."""
        at = self._at + BEAT_AT
        self._map[at] = (self._map[at] + 1) & 0xFF

    def beats(self) -> int:
        """How often it has, modulo 256."""
        return self._map[self._at + BEAT_AT]

    def publish(self, row: Row) -> None:
        """Show `row` to whoever looks: odd while it is being written."""
        at = self._at
        sequence = SEQUENCE.unpack_from(self._map, at)[0]
        SEQUENCE.pack_into(self._map, at, (sequence + 1) & 0xFFFFFFFF)
        f, (anchor, start, vector, begins_s) = row.flight, row.localization
        KINEMATICS.pack_into(
            self._map, at + KINEMATICS_AT, row.incarnation, row.epoch, row.xi, row.swarm_incarnation, row.state,
            row.lit, row.flying, *f.start, *f.displacement, f.begins_s, f.length, *row.thawed,
            anchor, *start, *vector, begins_s,
        )  # fmt: skip
        SEQUENCE.pack_into(self._map, at, (sequence + 2) & 0xFFFFFFFF)

    def timer_late(self, ms: float) -> None:
        self._timer_late[bucket(ms)] += 1

    def handled_late(self, ms: float) -> None:
        self._handled_late[bucket(ms)] += 1


class Sample(NamedTuple):
    """All slots at one moment; row i is FID i + 1."""

    t_s: float
    position: NDArray[np.float64]  # (F, 3), display cells
    swarm: NDArray[np.int32]
    swarm_incarnation: NDArray[np.int32]
    epoch: NDArray[np.int64]
    incarnation: NDArray[np.int64]
    state: NDArray[np.int8]
    lit: NDArray[np.bool_]
    life: NDArray[np.int8]
    thawed: NDArray[np.void]  # (F,), with the names of `Thawed`
    localization: NDArray[np.void]  # (F,), with the names of `Localization`
    counters: NDArray[np.uint64]  # (COUNTERS,), summed over all FLSs
    flown: NDArray[np.float64]  # (F, 2), cells: localizing, following
    timer_late: NDArray[np.int64]  # (BUCKETS,), summed
    handled_late: NDArray[np.int64]


class Load(NamedTuple):
    """Totals over all FLSs since their processes began."""

    timer_late: NDArray[np.int64]  # (BUCKETS,)
    handled_late: NDArray[np.int64]  # (BUCKETS,)
    delivered: int  # datagrams
    epoch: int  # the newest


class Reader:
    """Looks at all slots; belongs to the engine, which has numpy."""

    RETRIES = (
        1000  # a writer that was stopped mid-write must not stop the reader: then the last good row stands
    )

    def __init__(self, shared: SharedMemory, velocity: Velocity) -> None:
        import numpy as np

        self._np = np
        self._velocity = velocity
        self._clock = Clock(shared)
        self._shared = shared
        self._slots = np.frombuffer(shared.map, dtype=_slot_dtype(), count=shared.count, offset=PAGE)
        self._last = self._slots.copy()

    def close(self) -> None:
        """Let go of the mapping."""
        del self._slots

    def life(self) -> NDArray[np.int8]:
        """(F,): how far each process has got."""
        return self._slots["life"].copy()

    def load(self) -> Load:
        """How much the FLSs have had to do, and how late they were; cheaper than `sample`."""
        np = self._np
        slots = self._slots
        return Load(
            timer_late=slots["timer_late"].sum(axis=0, dtype=np.int64),
            handled_late=slots["handled_late"].sum(axis=0, dtype=np.int64),
            delivered=int(slots["counters"][:, :, Wire.DELIVERED].sum()),
            epoch=int(slots["epoch"].max()),
        )

    def sample(self) -> Sample:
        """One look. The moment is that of the copy; every row is whole."""
        np = self._np
        t_s = self._clock.now()
        rows = self._copy()
        return Sample(
            t_s=t_s,
            position=self._positions(rows, t_s),
            swarm=rows["xi"].astype(np.int32),
            swarm_incarnation=rows["swarm_incarnation"].astype(np.int32),
            epoch=rows["epoch"].astype(np.int64),
            incarnation=rows["incarnation"].astype(np.int64),
            state=rows["state"].astype(np.int8),
            lit=rows["lit"] != 0,
            life=rows["life"].astype(np.int8),
            thawed=rows["thawed"],
            localization=rows["localization"],
            counters=rows["counters"].sum(axis=(0, 1), dtype=np.uint64),
            flown=rows["counters"][:, :, _FLOWN].sum(axis=1, dtype=np.uint64) / 1e6,
            timer_late=rows["timer_late"].sum(axis=0, dtype=np.int64),
            handled_late=rows["handled_late"].sum(axis=0, dtype=np.int64),
        )

    def _copy(self) -> NDArray[np.void]:
        np = self._np
        rows = self._slots.copy()
        torn = np.arange(len(rows))
        for _ in range(self.RETRIES):
            # A row is whole if its number was even and is still the same after the copy.
            now = self._slots["sequence"][torn]
            torn = torn[(rows["sequence"][torn] % 2 == 1) | (rows["sequence"][torn] != now)]
            if not len(torn):
                break
            rows[torn] = self._slots[torn]
        if len(torn):
            rows[torn] = self._last[torn]
        self._last = rows
        return rows

    def _positions(self, rows: NDArray[np.void], t_s: float) -> NDArray[np.float64]:
        """`physics.flight.position_at` for all rows at once."""
        np = self._np
        speed, a, b = self._velocity
        length = rows["length"]
        peak = np.minimum(speed, np.sqrt(2.0 * length * a * b / (a + b)))
        safe = np.where(peak > 0, peak, 1.0)
        duration = np.where(peak > 0, length / safe + peak / (2 * a) + peak / (2 * b), 0.0)
        t = np.clip(t_s - rows["begins_s"], 0.0, duration)
        left = duration - t
        way = np.where(
            t < peak / a,
            0.5 * a * t * t,
            np.where(left < peak / b, length - 0.5 * b * left * left, peak * (t - peak / (2 * a))),
        )
        share = np.where(left <= 0, 1.0, way / np.where(length > 0, length, 1.0))
        return rows["start"] + rows["displacement"] * share[:, None]


def _slot_dtype() -> np.dtype[np.void]:
    """The slot as numpy reads it; the same places as `Slot` writes."""
    import numpy as np

    thawed = np.dtype({
        "names": Thawed._fields, "formats": ["<u4", "<u4", "<u2", "u1", "<f8"], "offsets": [0, 4, 8, 10, 12],
    })  # fmt: skip
    localization = np.dtype({
        "names": Localization._fields, "formats": ["<u4", ("<f4", 3), ("<f4", 3), "<f8"], "offsets": [0, 4, 16, 28],
    })  # fmt: skip
    fields = [
        ("sequence", "<u4", 0), ("life", "u1", LIFE_AT),
        ("incarnation", "<u4", 8), ("epoch", "<u4", 12), ("xi", "<u4", 16), ("swarm_incarnation", "<u2", 20),
        ("state", "u1", 22), ("lit", "u1", 23), ("flying", "u1", 24),
        ("start", ("<f8", 3), 28), ("displacement", ("<f8", 3), 52), ("begins_s", "<f8", 76), ("length", "<f8", 84),
        ("thawed", thawed, 92), ("localization", localization, 112),
        ("counters", ("<u8", (2, COUNTERS)), COUNTERS_AT),
        ("timer_late", ("<u4", BUCKETS), TIMER_LATE_AT), ("handled_late", ("<u4", BUCKETS), HANDLED_LATE_AT),
    ]  # fmt: skip
    return np.dtype(
        {
            "names": [name for name, _, _ in fields],
            "formats": [form for _, form, _ in fields],
            "offsets": [offset for _, _, offset in fields],
            "itemsize": SLOT,
        }
    )
