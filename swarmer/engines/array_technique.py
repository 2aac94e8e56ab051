"""A technique as the rounds engine calls it: for many FLSs at once, whatever the plugin offers, and checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmer.entry_points import TECHNIQUES
from swarmer.plan import make_technique
from swarmer.plugins import references_of
from swarmer.plugins.arrays import fix_of, fix_or_reason, fixes_of, like, many_like, tuples
from swarmer.plugins.fixing import FIXED, Fixes
from swarmer.plugins.guard import Watched, legs_of, vector_of

if TYPE_CHECKING:
    from swarmer.plan import Plan

Vectors = NDArray[np.float64]


class ArrayTechnique:
    """One technique for the whole display. Its methods raise PluginFailed, which names the plugin and its package."""

    def __init__(self, plan: Plan) -> None:
        self._plugin: Any = make_technique(plan.rules.technique)
        self._watched = Watched(TECHNIQUES, plan.rules.technique)
        self.references = references_of(self._plugin, plan.rules.dim)

    @property
    def has_legs(self) -> bool:
        """Whether the localizing FLS flies another way than its swarm."""
        return hasattr(self._plugin, "legs")

    def displacements(self, measured: Vectors, ground_truth: Vectors) -> Vectors:
        """V of n localizing FLSs; arguments and result (n, 3), cells."""
        plugin, call = self._plugin, self._watched.call
        if hasattr(plugin, "displacements"):
            many: Vectors = call(
                "displacements", like(measured), plugin.displacements, measured, ground_truth
            )
            return many
        rows = zip(tuples(measured), tuples(ground_truth), strict=True)
        found = [call("displacement", vector_of, plugin.displacement, d, g) for d, g in rows]
        return np.array(found).reshape(measured.shape)

    def legs(self, measured: Vectors, ground_truth: Vectors) -> list[Vectors]:
        """The flights of n localizing FLSs, each (n, 3); where one makes fewer than another, the rest of its are 0."""
        plugin, call = self._plugin, self._watched.call
        if hasattr(plugin, "legs_of_many"):
            many: list[Vectors] = call(
                "legs_of_many", many_like(measured), plugin.legs_of_many, measured, ground_truth
            )
            return many
        rows = zip(tuples(measured), tuples(ground_truth), strict=True)
        each = [call("legs", legs_of, plugin.legs, d, g) for d, g in rows]
        legs = np.zeros((max(map(len, each), default=0), *measured.shape))
        for row, flights in enumerate(each):
            legs[: len(flights), row] = flights
        return list(legs)

    def fixes(self, measured: Vectors, ground_truth: Vectors, dim: int) -> Fixes:
        """Fixes of n FLSs; arguments (n, references, 3), cells."""
        if hasattr(self._plugin, "fixes"):
            found: Fixes = self._watched.call(
                "fixes", fixes_of, self._plugin.fixes, measured, ground_truth, dim
            )
        else:
            found = self._fixes_one_by_one(measured, ground_truth, dim)
        if len(found.vector) != len(measured):
            self._watched.fail(f"fixes gave {len(found.vector)} vectors for {len(measured)} FLSs")
        return found

    def _fixes_one_by_one(self, measured: Vectors, ground_truth: Vectors, dim: int) -> Fixes:
        vectors, reasons = np.full((len(measured), 3), np.nan), []
        for row, (d, g) in enumerate(zip(measured, ground_truth, strict=True)):
            found = self._watched.call("fix", fix_of, fix_or_reason, self._plugin, tuples(d), tuples(g), dim)
            if isinstance(found, str):
                reasons.append(found)
            else:
                vectors[row] = found
                reasons.append(FIXED)
        return Fixes(vectors, np.array(reasons, dtype=np.str_), np.full(len(measured), np.nan))
