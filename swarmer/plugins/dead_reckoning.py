"""Dead reckoning alone: the yardstick below all others. Nobody measures anything, nobody corrects anything."""

from __future__ import annotations

from swarmer.messages import Vec3


class DeadReckoning:
    """V = 0: an FLS stays where dead reckoning brought it."""

    references = 0

    def displacement(self, measured: Vec3, ground_truth: Vec3) -> Vec3:
        """See `Localizer.displacement`."""
        return (0.0, 0.0, 0.0)
