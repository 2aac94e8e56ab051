"""What the engine reads from outside its FLSs: counters by their names in the summary, and what the kernel dropped."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from swarmer.protocol.events import Count
from swarmer.telemetry import Wire

if TYPE_CHECKING:
    from swarmer.telemetry import Sample

BROADCAST_HEX = "FFFFFF7F"  # 127.255.255.255 as /proc/net/udp writes it

# Name in the summary -> places in an FLS's counters that add up to it.
NAMES: dict[str, tuple[int, ...]] = {
    "datagrams_sent": (Wire.SENT,),
    "datagrams_delivered": (Wire.DELIVERED,),
    "datagrams_lost": (Wire.LOST_SENDER, Wire.LOST_RECEIVER),
    "bytes_sent": (Wire.BYTES_SENT,),
    "bytes_delivered": (Wire.BYTES_DELIVERED,),
    "localizations": (Count.LOCALIZATIONS,),
    "anchorings": (Count.ANCHORINGS,),
    "leases_granted": (Count.LEASES_GRANTED,),
    "leases_expired": (Count.LEASES_EXPIRED,),
    "thawed_flss": (Count.THAWS_OBEYED,),
    "joins": (Count.JOINS,),
    "flights": (Wire.FLIGHTS,),
    "handled": (Count.HANDLED,),
    "ignored": (Count.IGNORED,),
    "stale": (Count.STALE,),
    "answered_at_once": (Wire.ANSWERED_AT_ONCE,),
    "rejected": (Wire.BAD, Wire.OTHER_RUN),
    "not_addressed": (Wire.NOT_ADDRESSED, Wire.OUT_OF_RANGE, Wire.OWN_SWARM),
    "replayed": (Wire.REPLAYED,),
    "send_failed": (Wire.SEND_FAILED,),
}


def counters_of(sample: Sample) -> dict[str, float]:
    """Totals over all FLSs since their processes began."""
    counts = sample.counters
    totals: dict[str, float] = {name: sum(int(counts[at]) for at in places) for name, places in NAMES.items()}
    totals["distance_cells"] = int(counts[Wire.DISTANCE_MICROCELLS]) / 1e6
    return totals


def kernel_drops(port: int) -> int:
    """Datagrams that the kernel dropped at the FLSs' unicast sockets because a buffer was full.

    The broadcast sockets are left out: there the kernel counts what the filter refuses, too.
    """
    wanted, broadcast, drops = f":{port:04X}", f"{BROADCAST_HEX}:{port:04X}", 0
    with contextlib.suppress(OSError), open("/proc/net/udp") as table:
        for line in table:
            fields = line.split()
            if len(fields) > 12 and fields[1].endswith(wanted) and fields[1] != broadcast:
                drops += int(fields[-1])
    return drops
