"""Statistics of swarms: a swarm is all lit FLSs with the same Swarm-ID, of the same incarnation of its owner."""

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


def swarm_names(swarm: NDArray[np.int32], incarnation: NDArray[np.int32] | None = None) -> NDArray[np.int64]:
    """(F,): one number for each swarm, from Swarm-IDs and the incarnations of their owners; None: 0."""
    names: NDArray[np.int64] = swarm.astype(np.int64)
    return names if incarnation is None else names << 32 | incarnation


def swarm_sizes(
    swarm: NDArray[np.int32], lit: NDArray[np.bool_], incarnation: NDArray[np.int32] | None = None
) -> NDArray[np.int64]:
    """Size of each swarm, in the order of the Swarm-IDs.

    swarm: (F,) Swarm-IDs, lit: (F,), incarnation: (F,) of the Swarm-IDs' owners; None: 0. Result: (number of swarms,).

    >>> swarm_sizes(np.array([1, 1, 9, 4], np.int32), np.array([True, True, True, False])).tolist()
    [2, 1]
    >>> swarm_sizes(np.array([1, 1, 1], np.int32), np.ones(3, np.bool_), np.array([1, 0, 0], np.int32)).tolist()
    [2, 1]
    """
    sizes: NDArray[np.int64] = np.unique(swarm_names(swarm, incarnation)[lit], return_counts=True)[1]
    return sizes


def swarm_statistics(
    swarm: NDArray[np.int32], lit: NDArray[np.bool_], incarnation: NDArray[np.int32] | None = None
) -> SwarmStatistics:
    """Number and sizes of the swarms; arguments as `swarm_sizes`."""
    sizes = swarm_sizes(swarm, lit, incarnation)
    if not len(sizes):
        return SwarmStatistics(0, 0, 0, False)
    return SwarmStatistics(
        len(sizes), int(sizes.min()), int(sizes.max()), len(sizes) == 1 and bool(lit.all())
    )
