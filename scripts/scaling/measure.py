"""One formation of a sphere of F FLSs in virtual time, as numbers that the page is made from."""

from __future__ import annotations

import platform
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling.wire import Wire, formation
from swarmer.config import load_config
from swarmer.engines.cluster.shares import shares
from swarmer.messages import Kind
from swarmer.plan import make_plan

PER_HOST = (250, 1000, 4000, 16000)  # FLSs
LONGEST_S = 120.0  # emulated


def measure(points: int, seed: int = 1, **settings: Any) -> dict[str, Any]:
    """Run it, and give what the page needs. points: F."""
    config = load_config(
        engine="virtual", shape="sphere", points=points, seed=seed, duration_s=LONGEST_S,
        **{"recording.enabled": False}, **settings,
    )  # fmt: skip
    plan = make_plan(config)
    pers = [per for per in PER_HOST if points >= 2 * per]
    hosts = [by_fid(shares(plan.cloud.points, [1.0] * round(points / per))) for per in pers]
    began = time.process_time()
    wire = Wire(plan.size, hosts)
    observer, result = formation(plan, wire)
    cpu_s = time.process_time() - began
    if len(observer.thaws_s) < 2:
        raise SystemExit(f"sphere of {points}: no second thaw within {LONGEST_S:g} s")
    first, second = observer.thaws_s[:2]
    return {
        "points": points,
        "seed": seed,
        "python": platform.python_version(),
        "cpu_s": round(cpu_s, 1),
        "events": result.extra["events"],
        "first_single_swarm_s": round(result.first_single_swarm_s, 3),
        "thaws_s": [first, second],
        "handled_late_ms": [round(value, 2) for value in result.handled_late_ms],
        "kinds": {Kind(kind).name: vars(count) for kind, count in sorted(wire.counts.items())},
        "busiest_fls": int(wire.received.max()),
        "median_fls": float(np.median(wire.received[1:])),
        "busiest_bin": max(wire.bins.values()),
        "per_host": pers,
        "busiest_crossings": [max(one.values()) for one in wire.crossed],
    }


def by_fid(hosts: NDArray[np.int64]) -> NDArray[np.int32]:
    """(F + 1,): the host of each FID, from that of each row."""
    return np.concatenate(([-1], hosts)).astype(np.int32)
