"""Statistics of swarms: a swarm is all lit FLSs with the same Swarm-ID."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class SwarmStatistics(NamedTuple):
    """The swarms at one moment; all 0 while nobody is lit."""

    number: int
    smallest: int  # FLSs
    largest: int
    single: bool  # every FLS is lit and all are one swarm


def swarm_sizes(swarm: NDArray[np.int32], lit: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Size of each swarm, in the order of the Swarm-IDs.

    swarm: (F,) Swarm-IDs, lit: (F,). Result: (number of swarms,).

    >>> swarm_sizes(np.array([1, 1, 9, 4], np.int32), np.array([True, True, True, False])).tolist()
    [2, 1]
    """
    sizes: NDArray[np.int64] = np.unique(swarm[lit], return_counts=True)[1]
    return sizes


def swarm_statistics(swarm: NDArray[np.int32], lit: NDArray[np.bool_]) -> SwarmStatistics:
    """Number and sizes of the swarms; arguments as `swarm_sizes`."""
    sizes = swarm_sizes(swarm, lit)
    if not len(sizes):
        return SwarmStatistics(0, 0, 0, False)
    return SwarmStatistics(
        len(sizes), int(sizes.min()), int(sizes.max()), len(sizes) == 1 and bool(lit.all())
    )
