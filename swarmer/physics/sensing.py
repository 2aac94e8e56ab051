"""What a sensor makes of the true vector to a sender (SwarMer, section 2): errors of the measured distance."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import NamedTuple

Vec3 = tuple[float, float, float]
SensorErrorModel = Callable[[Random], float]
"""Draws by what factor one sample of the distance is off; 1.0 is exact."""


class Sensor(NamedTuple):
    """An error model, and how many samples it takes to one measurement, each costing `sample_s` emulated seconds."""

    error: SensorErrorModel
    samples: int
    average: str  # mean | median
    sample_s: float

    @property
    def delay_s(self) -> float:
        return self.samples * self.sample_s

    def measure(self, vector: Vec3, rng: Random) -> Vec3:
        """The vector as sensed, display cells: the angles are right, the length is off."""
        factors = [self.error(rng) for _ in range(self.samples)]
        factor = sum(factors) / len(factors) if self.average == "mean" else _median(factors)
        return (vector[0] * factor, vector[1] * factor, vector[2] * factor)


def _median(values: list[float]) -> float:
    # Not statistics.median: that module costs every FLS process half a megabyte.
    ordered, half = sorted(values), len(values) // 2
    return ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / 2


def none(share: float, accurate_probability: float) -> SensorErrorModel:
    """Exact."""
    return lambda rng: 1.0


def uniform(share: float, accurate_probability: float) -> SensorErrorModel:
    """Off by a share uniform in [-share, share]."""
    return lambda rng: 1.0 + rng.uniform(-share, share)


def mixed(share: float, accurate_probability: float) -> SensorErrorModel:
    """Exact with a probability, else as `uniform`. Draws the same number of times either way."""

    def draw(rng: Random) -> float:
        accurate = rng.random() < accurate_probability
        error = rng.uniform(-share, share)
        return 1.0 if accurate else 1.0 + error

    return draw


MODELS = {model.__name__: model for model in (none, uniform, mixed)}
