"""Localization techniques: how an FLS turns what it measures into a displacement (SwarMer, sections 3 and 5).

A technique is a class named in the entry point group `swarmer.localizers` of any installed package; the setting
`technique` picks it by that name. There are two kinds, told apart by `references`, the number of other FLSs whose
signals it needs at a time:

- `Localizer`, one (the attribute may be left out): the anchor's. Every engine has them.
- `Fixer`, three or more: the yardsticks of the paper, triangulation and trilateration. The engine rounds has them.

What else a technique may have, each for itself: `legs`, where the way is flown in pieces; `displacements` and `fixes`,
which do for many FLSs at once, as arrays, what `displacement` and `fix` do for one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from swarmer.entry_points import TECHNIQUES
from swarmer.messages import Vec3

ENTRY_POINTS = TECHNIQUES


class NoFix(Exception):
    """What was measured gives no position; the text is the reason, a word such as `no_intersection`."""


class Localizer(Protocol):
    """A technique that needs one reference, the anchor. Made without arguments, once for each FLS; keeps no state.

    It may also have

    - `references = 0`: it looks at nobody; the engine rounds then ends with the deployment;
    - `legs(measured, ground_truth) -> Sequence[Vec3]`: the flights that the localizing FLS itself makes one after the
      other instead of `displacement`, which its swarm flies;
    - `displacements(measured, ground_truth)`: the same as `displacement` for (n, 3) arrays, row by row.
    """

    def displacement(self, measured: Vec3, ground_truth: Vec3) -> Vec3:
        """The vector V to fly, display cells.

        measured: the vector from this FLS to its anchor as sensed. ground_truth: the same vector between their points.
        """


class Fixer(Protocol):
    """A technique that needs several references at a time. Made without arguments; keeps no state between calls.

    It may also have

    - `references_3d`: how many it needs in 3D, where that differs;
    - `fixes(measured, ground_truth, dim) -> plugins.fixing.Fixes`: the same for (n, references, 3) arrays.
    """

    references: int

    def fix(self, measured: Sequence[Vec3], ground_truth: Sequence[Vec3], dim: int) -> Vec3:
        """The vector to fly, display cells. Raises NoFix.

        measured: the vectors from this FLS to each reference, as sensed. ground_truth: the same between their points.
        dim: 2 in a flat display, where the third of each is 0, else 3.
        """


def references_of(technique: object, dim: int) -> int:
    """How many other FLSs a technique looks at in a display of 2 or 3 dimensions: 0, 1, or 3 and more."""
    needed = int(getattr(technique, "references", 1))
    return int(getattr(technique, "references_3d", needed)) if dim == 3 else needed
