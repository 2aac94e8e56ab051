"""Do two engines tell the same story? The same cell of an experiment in both, quantity by quantity, with intervals.

Two intervals of 95 % that overlap are the criterion. Where the truths are equal and the intervals about as wide, they
miss each other once in some 180 times; what a difference must be to be seen, its own interval tells.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.experiments.results import flat
from swarmer.metrics import intervals
from swarmer.metrics.intervals import Interval
from swarmer.metrics.swarms import swarm_sizes
from swarmer.observe.run_directory import SUMMARY
from swarmer.observe.timeline import NAME as TIMELINE

HD_AT_S = (2.0, 5.0, 10.0, 15.0)  # emulated seconds
SWARMS_AT_S = (2.0, 3.0, 5.0, 10.0, 15.0)
LEAST_HD = 1e-6  # cells: less counts as this, for its logarithm
COUNTED = (
    "thaws", "localizations", "anchorings", "leases_granted",
    "leases_expired", "datagrams_sent", "datagrams_delivered", "datagrams_lost", "handled", "ignored",
    "distance_cells_mean",
)  # fmt: skip

Figures = dict[str, float]  # by quantity; NaN where a run has none


class Comparison(NamedTuple):
    """A quantity in two engines. The intervals of HD are of its decadic logarithm."""

    quantity: str
    one: Interval
    other: Interval
    difference: Interval  # other - one

    @property
    def apart(self) -> bool:
        """The two intervals do not overlap, or one engine alone has any."""
        one, other = self.one, self.other
        return one.n + other.n > 0 and not (one.low <= other.high and other.low <= one.high)


def figures_of(directory: Path) -> Figures:
    """What is compared of a finished run: of its summary, and of its timeline at fixed seconds.

    Moments after the end of the run are left out. When there is one swarm first is taken from the samples, too: in
    virtual time the summary knows more than samples show, if FLSs thaw as soon as they know.

    Raises OSError, KeyError, ValueError.
    """
    summary = flat(json.loads((directory / SUMMARY).read_text(encoding="utf-8")))
    with np.load(directory / TIMELINE, allow_pickle=False) as file:
        t_s, hd, swarm, lit = (file[name] for name in ("t_s", "hd_cells", "swarm", "lit"))
    found: Figures = {}
    for at_s in HD_AT_S:
        if at_s <= summary["emulated_s"]:
            value = float(hd[_nearest(t_s, at_s)])  # NaN while fewer than 2 are lit
            found[f"HD at {at_s:g} s, cells"] = math.log10(max(value, LEAST_HD) if value >= 0 else value)
    for at_s in SWARMS_AT_S:
        if at_s <= summary["emulated_s"]:
            at = _nearest(t_s, at_s)
            sizes = swarm_sizes(swarm[at], lit[at])
            found[f"swarms at {at_s:g} s"] = float(len(sizes))
            found[f"largest swarm at {at_s:g} s"] = float(sizes.max(initial=0))
    single = lit.all(axis=1) & (swarm == swarm[:, :1]).all(axis=1)
    found["first sample with one swarm, s"] = float(t_s[single.argmax()]) if single.any() else math.nan
    for name in COUNTED:
        found[name] = math.nan if summary[name] is None else float(summary[name])
    return found


def _nearest(t_s: NDArray[np.float64], at_s: float) -> int:
    return int(np.abs(t_s - at_s).argmin())


def compare(
    one: Iterable[Figures], other: Iterable[Figures], level: float = intervals.LEVEL
) -> list[Comparison]:
    """Every quantity of the runs of two engines. A run that lacks one is left out there; the intervals say how many."""
    first, second = list(one), list(other)
    found = []
    for name in first[0]:
        a, b = ([run[name] for run in runs if not math.isnan(run[name])] for runs in (first, second))
        found.append(
            Comparison(
                name,
                intervals.mean(a, level),
                intervals.mean(b, level),
                intervals.difference_of_means(a, b, level),
            )
        )
    return found
