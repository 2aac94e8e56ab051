"""What techniques with several references share: many fixes at once, each a vector or a reason why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.plugins import NoFix

if TYPE_CHECKING:
    from swarmer.messages import Vec3

Vectors = NDArray[np.float64]
FIXED = ""


class Fixes(NamedTuple):
    """The outcome for n FLSs."""

    vector: Vectors  # (n, 3), cells; NaN where there is none
    failure: NDArray[np.str_]  # (n,), why there is none; empty where there is one
    residual: NDArray[
        np.float64
    ]  # (n,), cells, by how much the measurements contradict the fix; NaN: not known


class ArrayFixer:
    """A technique that says `fixes`; `fix` follows from it."""

    references: int

    def fixes(self, measured: Vectors, ground_truth: Vectors, dim: int) -> Fixes:
        """For n FLSs at once; measured, ground_truth: (n, references, 3), as in `Fixer.fix`."""
        raise NotImplementedError

    def fix(self, measured: Sequence[Vec3], ground_truth: Sequence[Vec3], dim: int) -> Vec3:
        """See `Fixer.fix`."""
        found = self.fixes(np.array([measured]), np.array([ground_truth]), dim)
        if found.failure[0] != FIXED:
            raise NoFix(str(found.failure[0]))
        x, y, z = found.vector[0].tolist()
        return (x, y, z)
