"""Samples of settings, drawn at random or as a Latin hypercube: the same from the same seed on every machine.

A range is `{min: 50, max: 1000}`, with `scale: log` where each factor counts alike and `whole: true` where only whole
numbers are wanted (a setting that takes nothing else has that of itself); or a list of values, of which one is chosen.

Each setting draws from a stream of its own, made from the sample's seed and the setting's name. So a larger `n` of a
random sample only adds to it, and so does another setting. A Latin hypercube divides each range into `n` strips and
takes one value from each (McKay, Beckman and Conover, Technometrics 21, 1979); with another `n` it is another sample.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from random import Random  # its random() gives the same numbers in every version of Python
from typing import Any, NamedTuple

from swarmer.errors import BadInput, shown
from swarmer.settings import Refused, Setting, did_you_mean, is_number, unknown_line
from swarmer.settings_file import flatten

RANDOM, LATIN = "random", "latin_hypercube"
KINDS = (RANDOM, LATIN)
PARTS = ("n", "seed", "ranges")
BOUNDS = ("min", "max", "scale", "whole")
SCALES = ("linear", "log")
DRAWS_MAX = 1_000_000
SEED_MAX = 2**32 - 1
DIGITS = 6  # significant ones that a drawn number keeps: it stands in names and tables


class Range(NamedTuple):
    """What a setting's values are drawn from."""

    low: float = 0.0
    high: float = 0.0
    log: bool = False
    whole: bool = False
    choices: tuple[Any, ...] = ()  # in place of bounds

    def at(self, u: float) -> Any:
        """The value a share `u`, 0 to below 1, of the way through the range.

        >>> Range(0, 0.3).at(0.5), Range(1, 100, log=True).at(0.5), Range(3, 5, whole=True).at(0.999)
        (0.15, 10.0, 5)
        >>> Range(choices=("a", "b")).at(0.5)
        'b'
        """
        if self.choices:
            return self.choices[int(u * len(self.choices))]
        top = self.high + 1 if self.whole else self.high
        if self.log:
            value = math.exp(math.log(self.low) + u * (math.log(top) - math.log(self.low)))
        else:
            value = self.low + u * (top - self.low)
        if self.whole:
            return int(min(max(math.floor(value), self.low), self.high))
        return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)

    def plain(self) -> Any:
        """As a file says it."""
        if self.choices:
            return list(self.choices)
        scale = {"scale": "log"} if self.log else {}
        return {"min": self.low, "max": self.high} | scale | ({"whole": True} if self.whole else {})


class Sample(NamedTuple):
    """So many draws over the ranges of some settings."""

    kind: str
    n: int
    seed: int
    ranges: dict[str, Range]

    def draws(self) -> list[dict[str, Any]]:
        """Each draw's settings. Draws of whole numbers and choices may be alike."""
        columns = {name: [its.at(u) for u in self._shares(name)] for name, its in self.ranges.items()}
        return [{name: column[i] for name, column in columns.items()} for i in range(self.n)]

    def _shares(self, name: str) -> list[float]:
        """How far through its range each draw of a setting is."""
        rng = Random(f"{self.seed} {name}")
        if self.kind == RANDOM:
            return [rng.random() for _ in range(self.n)]
        strips = sorted(range(self.n), key=[rng.random() for _ in range(self.n)].__getitem__)
        return [(strip + rng.random()) / self.n for strip in strips]

    def plain(self) -> dict[str, Any]:
        """As a file says it."""
        ranges = {name: its.plain() for name, its in self.ranges.items()}
        return {"n": self.n, "seed": self.seed, "ranges": ranges}


def sample_of(kind: str, given: Any, facts: Mapping[str, Setting]) -> Sample:
    """The sample that a part of a file says; facts: the settings. Raises BadInput with a line for all that is wrong."""
    if not isinstance(given, dict):
        raise BadInput.saying(f"{kind}: {shown(given)} is not a mapping with {', '.join(PARTS)}")
    lines = [
        f"{kind}: {shown(name)[1:-1]}: no such part;{did_you_mean(str(name), PARTS)} there are {', '.join(PARTS)}"
        for name in given
        if name not in PARTS
    ]
    n: Any = given.get("n")
    seed: Any = given.get("seed", 1)
    if not _whole(n, 1, DRAWS_MAX):
        lines.append(f"{kind}: n: {shown(n)} is not a number of draws, 1 to {DRAWS_MAX}")
    if not _whole(seed, 0, SEED_MAX):
        lines.append(f"{kind}: seed: {shown(seed)} is not a whole number, 0 to {SEED_MAX} (default 1)")
    ranges, said = {}, given.get("ranges")
    if not isinstance(said, dict) or not said:
        lines.append(f"{kind}: ranges: {shown(said)} is not a mapping of settings to ranges")
        said = {}
    bounded = {
        name for name, its in said.items() if isinstance(its, dict) and not its.keys().isdisjoint(BOUNDS)
    }
    for name, entry in flatten(said, {*facts, *bounded}, kind).items():
        try:
            ranges[name] = _range(name, entry, facts)
        except BadInput as error:
            lines += [f"{kind}: ranges: {line}" for line in error.lines]
    if lines:
        raise BadInput.saying(*lines)
    return Sample(kind, n, seed, ranges)


def _whole(value: Any, low: int, high: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


def _range(name: str, entry: Any, facts: Mapping[str, Setting]) -> Range:
    if name not in facts:
        raise BadInput.saying(unknown_line(name, facts))
    fact = facts[name]
    if isinstance(entry, list) and entry:
        return Range(choices=tuple(_checked(fact, value) for value in entry))
    if not isinstance(entry, dict) or fact.kind not in ("number", "whole"):
        bounds = "a range {min: 1, max: 2}, or " if fact.kind in ("number", "whole") else ""
        raise BadInput.saying(f"{name}: {shown(entry)} is not {bounds}a list of values to choose from")
    for part in entry:
        if part not in BOUNDS:
            hint = did_you_mean(str(part), BOUNDS)
            raise BadInput.saying(
                f"{name}: {shown(part)[1:-1]}: no such part;{hint} there are {', '.join(BOUNDS)}"
            )
    low, high = (_bound(fact, entry, end) for end in ("min", "max"))
    scale, whole = entry.get("scale", "linear"), entry.get("whole", fact.kind == "whole")
    if scale not in SCALES:
        raise BadInput.saying(
            f"{name}: scale: {shown(scale)} is not one of {', '.join(SCALES)} (default linear)"
        )
    if not isinstance(whole, bool):
        raise BadInput.saying(f"{name}: whole: {shown(whole)} is not true or false")
    if low > high:
        raise BadInput.saying(f"{name}: min {low:g} is above max {high:g}")
    if scale == "log" and low <= 0:
        raise BadInput.saying(f"{name}: min {low:g} has no logarithm; with scale: log a range begins above 0")
    if whole and (low % 1 or high % 1):
        raise BadInput.saying(f"{name}: whole numbers have whole bounds, not {low:g} and {high:g}")
    return Range(low, high, scale == "log", whole or fact.kind == "whole")


def _bound(fact: Setting, entry: Mapping[str, Any], end: str) -> float:
    value = entry.get(end)
    if not is_number(value):
        raise BadInput.saying(f"{fact.name}: {end}: {shown(value)} is not a number")
    return float(_checked(fact, value))


def _checked(fact: Setting, value: Any) -> Any:
    try:
        return fact.checked(value)
    except Refused as refused:
        raise BadInput.saying(fact.line(value, str(refused))) from None
