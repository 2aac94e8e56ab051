"""A technique as the rounds engine calls it: for many FLSs at once, whatever the plugin offers, and checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmer.messages import Vec3
from swarmer.plan import make_localizer
from swarmer.plugins import NoFix, references_of
from swarmer.plugins.fixing import FIXED, Fixes
from swarmer.plugins.guarded import BrokenTechnique, broken, displacement_of, legs_of, vector_of, who_is

if TYPE_CHECKING:
    from swarmer.plan import Plan

Vectors = NDArray[np.float64]


class ArrayTechnique:
    """One technique for the whole display. Its methods raise BrokenTechnique, which names the plugin's package."""

    def __init__(self, plan: Plan) -> None:
        self._plugin: Any = make_localizer(plan.rules.technique)
        self._who = who_is(plan.config.technique)
        self.references = references_of(self._plugin, plan.rules.dim)

    @property
    def has_legs(self) -> bool:
        """Whether the localizing FLS flies another way than its swarm."""
        return hasattr(self._plugin, "legs")

    def displacements(self, measured: Vectors, ground_truth: Vectors) -> Vectors:
        """V of n localizing FLSs; arguments and result (n, 3), cells."""
        if hasattr(self._plugin, "displacements"):
            answer = self._called(self._plugin.displacements, measured, ground_truth)
            return self._array(answer, measured.shape)
        rows = zip(_tuples(measured), _tuples(ground_truth), strict=True)
        found = [displacement_of(self._plugin, self._who, d, g) for d, g in rows]
        return np.array(found).reshape(measured.shape)

    def legs(self, measured: Vectors, ground_truth: Vectors) -> list[Vectors]:
        """The flights of n localizing FLSs, each (n, 3); where one makes fewer than another, the rest of its are 0."""
        if hasattr(self._plugin, "legs_of_many"):
            answer = self._called(self._plugin.legs_of_many, measured, ground_truth)
            return [self._array(leg, measured.shape) for leg in answer]
        rows = zip(_tuples(measured), _tuples(ground_truth), strict=True)
        each = [legs_of(self._called(self._plugin.legs, d, g), self._who) for d, g in rows]
        legs = np.zeros((max(map(len, each), default=0), *measured.shape))
        for row, flights in enumerate(each):
            legs[: len(flights), row] = flights
        return list(legs)

    def fixes(self, measured: Vectors, ground_truth: Vectors, dim: int) -> Fixes:
        """Fixes of n FLSs; arguments (n, references, 3), cells."""
        if hasattr(self._plugin, "fixes"):
            found: Fixes = self._called(self._plugin.fixes, measured, ground_truth, dim)
        else:
            found = self._fixes_one_by_one(measured, ground_truth, dim)
        fixed = found.failure == FIXED
        if found.vector.shape != (len(measured), 3) or not np.isfinite(found.vector[fixed]).all():
            raise broken(self._who, "answered fixes that are not finite vectors")
        return found

    def _fixes_one_by_one(self, measured: Vectors, ground_truth: Vectors, dim: int) -> Fixes:
        vectors, reasons = np.full((len(measured), 3), np.nan), []
        for row, (d, g) in enumerate(zip(measured, ground_truth, strict=True)):
            try:
                vectors[row] = vector_of(self._plugin.fix(_tuples(d), _tuples(g), dim), self._who)
                reasons.append(FIXED)
            except NoFix as none:
                reasons.append(str(none) or "no_fix")
            except BrokenTechnique:
                raise
            except Exception as error:
                raise self._raised(error) from error
        return Fixes(vectors, np.array(reasons, dtype=np.str_), np.full(len(measured), np.nan))

    def _array(self, answer: Any, shape: tuple[int, ...]) -> Vectors:
        found = np.asarray(answer)
        if found.shape != shape or not np.issubdtype(found.dtype, np.number):
            raise broken(self._who, f"answered an array {found.dtype}{found.shape}, not numbers {shape}")
        if not np.isfinite(found).all():
            raise broken(self._who, "answered vectors that are not finite")
        return found.astype(np.float64, copy=False)

    def _called(self, call: Any, *arguments: Any) -> Any:
        try:
            return call(*arguments)
        except Exception as error:
            raise self._raised(error) from error

    def _raised(self, error: Exception) -> BrokenTechnique:
        return broken(self._who, f"raised {type(error).__name__}: {' '.join(str(error).split())}")


def _tuples(vectors: Vectors) -> list[Vec3]:
    return [(x, y, z) for x, y, z in vectors.tolist()]
