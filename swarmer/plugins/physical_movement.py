"""Physical Movement: fly to the anchor, and from there to where the ground truth wants to be (SwarMer, section 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmer.messages import Vec3
from swarmer.plugins.signal_strength import SignalStrength

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class PhysicalMovement(SignalStrength):
    """Two legs, d and -D. Their sum is the V of Signal Strength, which the swarm flies; the distance flown is not."""

    def legs(self, measured: Vec3, ground_truth: Vec3) -> tuple[Vec3, Vec3]:
        """See `Localizer`.

        >>> PhysicalMovement().legs((3.0, 0.0, 0.0), (1.0, 2.0, 3.0))
        ((3.0, 0.0, 0.0), (-1.0, -2.0, -3.0))
        """
        return measured, (-ground_truth[0], -ground_truth[1], -ground_truth[2])

    def legs_of_many(
        self, measured: NDArray[np.float64], ground_truth: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same for (n, 3) vectors."""
        return measured, -ground_truth
