"""Broken sensors: what becomes of a measured vector before anybody computes with it; pure.

Besides the errors that every sensor has (`physics.sensing`), one may be off by a constant, tell wild things now and
then, or tell nothing. Whatever it tells is finite.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from random import Random
from typing import NamedTuple

from swarmer.physics.sensing import Vec3

NO_DIRECTION = 1e-12  # cells: what is measured so short has no direction to be off along


class SensorFault(NamedTuple):
    """One, from an emulated second on until another. As `faults.Fault` has it."""

    what: str  # bias | outliers | dead_sensor
    begins_s: float
    ends_s: float
    by: float
    p: float


def sensed(vector: Vec3, faults: Sequence[SensorFault], now: float, rng: Random) -> Vec3:
    """A measured vector, display cells, as the faults that last `now` leave it: right angles, and a wrong length.

    bias: longer by `by` cells, never below 0. outliers: with probability `p`, `by` times as long. dead_sensor: 0.
    """
    for fault in faults:
        if not fault.begins_s <= now < fault.ends_s:
            continue
        if fault.what == "dead_sensor":
            factor = 0.0
        elif fault.what == "bias":
            length = math.hypot(*vector)
            factor = max(0.0, length + fault.by) / length if length > NO_DIRECTION else 1.0
        else:
            factor = fault.by if rng.random() < fault.p else 1.0
        vector = (vector[0] * factor, vector[1] * factor, vector[2] * factor)
    return vector
