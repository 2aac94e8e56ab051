"""Localization techniques: how an FLS turns one measurement into a displacement (SwarMer, sections 3 and 5).

A technique is a class with the one method of `Localizer`, named in the entry point group `swarmer.localizers` of any
installed package; the setting `technique` picks it by that name.
"""

from __future__ import annotations

from typing import Protocol

from swarmer.messages import Vec3

ENTRY_POINTS = "swarmer.localizers"


class Localizer(Protocol):
    """One localization technique. Made without arguments, once for each FLS; keeps no state between calls."""

    def displacement(self, measured: Vec3, ground_truth: Vec3) -> Vec3:
        """The vector V to fly, display cells.

        measured: the vector from this FLS to its anchor as sensed. ground_truth: the same vector between their points.
        """
