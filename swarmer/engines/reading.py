"""What the engine reads from outside its FLSs: counters by their names in the summary, and what the kernel dropped."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from swarmer.messages import MAX_SIZE, SIZE, Kind
from swarmer.protocol.events import Count
from swarmer.telemetry import DELIVERED_BY_KIND, SENT_BY_KIND, Wire

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

BROADCAST_HEX = "FFFFFF7F"  # 127.255.255.255 as /proc/net/udp writes it

# Name in the summary -> places in an FLS's counters that add up to it.
NAMES: dict[str, tuple[int, ...]] = {
    "datagrams_sent": (Wire.SENT,),
    "datagrams_delivered": (Wire.DELIVERED,),
    "datagrams_lost": (Wire.LOST_SENDER, Wire.LOST_RECEIVER),
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
    **{f"sent_{kind.name.lower()}": (SENT_BY_KIND + kind,) for kind in Kind},
    **{f"delivered_{kind.name.lower()}": (DELIVERED_BY_KIND + kind,) for kind in Kind},
}


def totals_of(counts: Sequence[int] | NDArray[np.uint64], signed: bool) -> dict[str, float]:
    """What all FLSs together have counted, by name. signed: every datagram carries a MAC."""
    totals: dict[str, float] = {name: sum(int(counts[at]) for at in places) for name, places in NAMES.items()}
    size = MAX_SIZE if signed else SIZE  # of every datagram
    return totals | {
        "bytes_sent": totals["datagrams_sent"] * size,
        "bytes_delivered": totals["datagrams_delivered"] * size,
        "distance_cells": int(counts[Wire.DISTANCE_MICROCELLS]) / 1e6,
        "localizing_cells": int(counts[Wire.LOCALIZING_MICROCELLS]) / 1e6,
        "following_cells": int(counts[Wire.FOLLOWING_MICROCELLS]) / 1e6,
    }


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
