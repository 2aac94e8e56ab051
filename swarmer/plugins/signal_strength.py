"""Signal Strength: length and angles of one radio signal give the vector to the anchor (SwarMer, section 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmer.messages import Vec3

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class SignalStrength:
    """V = d - D: once flown, the anchor stands where the ground truth wants it to be seen."""

    def displacement(self, measured: Vec3, ground_truth: Vec3) -> Vec3:
        """See `Localizer.displacement`.

        >>> SignalStrength().displacement((3.0, 0.0, 0.0), (1.0, 0.0, 0.0))
        (2.0, 0.0, 0.0)
        """
        return (
            measured[0] - ground_truth[0],
            measured[1] - ground_truth[1],
            measured[2] - ground_truth[2],
        )

    def displacements(
        self, measured: NDArray[np.float64], ground_truth: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The same for (n, 3) vectors."""
        return measured - ground_truth
