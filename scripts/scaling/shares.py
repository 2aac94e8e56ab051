"""Which host gets which points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def share(points: NDArray[np.float64], hosts: int) -> NDArray[np.int64]:
    """(F,): host of each point; halves across the longest extent, until there are so many."""
    of = np.zeros(len(points), np.int64)

    def halve(rows: NDArray[np.int64], count: int, first: int) -> None:
        if count == 1:
            of[rows] = first
            return
        axis = np.argmax(np.ptp(points[rows], axis=0))
        order = rows[np.argsort(points[rows, axis], kind="stable")]
        left = count // 2
        cut = round(len(order) * left / count)
        halve(order[:cut], left, first)
        halve(order[cut:], count - left, first + left)

    halve(np.arange(len(points)), hosts, 0)
    return of
