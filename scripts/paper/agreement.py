"""Claims against runs: the value with its interval, and whether it agrees."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from paper.claims import Claim, Order
from paper.quantities import QUANTITIES, Row
from swarmer.experiments.results import RESULTS, RUN, STATUS, read_results
from swarmer.experiments.tables import bounded, figure
from swarmer.metrics import paired
from swarmer.metrics.intervals import median


class Found(NamedTuple):
    """What runs say of a claim."""

    ours: str
    agrees: bool
    low: float = math.nan  # of a number's interval
    high: float = math.nan


def judge(claim: Claim | Order, directory: Path) -> Found | None:
    """None where there are no such runs. directory: of the sweep. Raises OSError, ValueError."""
    path = directory / RESULTS
    if not path.is_file():
        return None
    _, rows = read_results(path)
    rows = [row for row in rows if row.get(STATUS) == "done" and fits(row, claim.where)]
    if isinstance(claim, Order):
        return _order(claim, rows, directory)
    values = list(_values(claim.quantity, rows, directory).values())
    return _number(claim, values) if values else None


def fits(row: Row, where: dict[str, str]) -> bool:
    """A setting that the table does not have varies nowhere, so it fits."""
    return all((row.get(name, value) or "null") == value for name, value in where.items())


def _values(quantity: str, rows: list[Row], directory: Path) -> dict[int, float]:
    values = {int(row["seed"]): QUANTITIES[quantity](row, directory / row[RUN]) for row in rows}
    return {seed: value for seed, value in values.items() if not math.isnan(value)}


def _number(claim: Claim, values: list[float]) -> Found:
    whole = all(map(math.isfinite, values))
    estimate = paired.bootstrap_mean(values) if whole else median(values)
    low, high = claim.band
    if estimate.low < 0 <= min(values):  # of what is never below 0
        estimate = estimate._replace(low=0.0)
    reached = "" if whole else f", {sum(map(math.isfinite, values))} of {len(values)} reach it"
    shown = f"{bounded(estimate, figure)} ({len(values)}{reached})"
    return Found(shown, low <= round(estimate.estimate, 6) <= high, estimate.low, estimate.high)


def _order(claim: Order, rows: list[Row], directory: Path) -> Found | None:
    less = _values(claim.quantity, [row for row in rows if fits(row, claim.less)], directory)
    more = _values(claim.quantity, [row for row in rows if fits(row, claim.more)], directory)
    seeds = sorted(set(less) & set(more))
    if not seeds:
        return None
    differences = paired.differences(
        [claim.factor * less[seed] for seed in seeds], [more[seed] for seed in seeds]
    )
    right = sum(value > 0 for value in differences)
    test = paired.sign_flips(differences)
    shown = test.p < paired.ALPHA or (right == len(seeds) and test.least_p >= paired.ALPHA)
    p = f", p {test.p:.2g}" if test.least_p < paired.ALPHA else ""
    means = f"{figure(_mean(less, seeds))} and {figure(_mean(more, seeds))}"
    return Found(f"{means}: on {right} of {len(seeds)} seeds{p}", shown and 2 * right > len(seeds))


def _mean(values: dict[int, float], seeds: list[int]) -> float:
    return sum(values[seed] for seed in seeds) / len(seeds)
