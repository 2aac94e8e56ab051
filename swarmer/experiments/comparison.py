"""What a table of runs says of its contenders: how good each is, and which of two is better, seed by seed.

Some settings of the table are *between*: their values are the contenders. All others that vary are *conditions*: within
one, contenders are compared on the seeds that they share. A measure is a column of results.csv; of all of them less is
better. One that says when something was reached is infinite for a run that never reached it.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmer.errors import BadInput, shown
from swarmer.experiments.results import STATUS, read_results
from swarmer.metrics import paired
from swarmer.metrics.intervals import NEVER, Interval, median
from swarmer.metrics.paired import SignTest
from swarmer.settings import did_you_mean

Key = tuple[str, ...]
Row = dict[str, str]
IN_ROUNDS = ("rounds_to_hd", "rounds_to_hd_absolute", "first_single_swarm_round")
IN_SECONDS = ("time_to_hd_s", "time_to_hd_absolute_s", "first_single_swarm_s", "all_lit_s")
ABSOLUTE = ("rounds_to_hd_absolute", "time_to_hd_absolute_s")  # columns of runs with oracles
CLOCKS = ("rounds", "emulated_s")  # a run that has no such column filled cannot say when, which is not never
FREE = "fixes_failed."  # of a yardstick; the rest of the name is its own
FIRST_CHOICES = ("technique", "engine")  # of what is compared, where nobody says


class Measure(NamedTuple):
    """A column, and what it is called."""

    column: str
    title: str

    @property
    def timed(self) -> bool:
        """It says when something was reached; empty is never."""
        return self.column.startswith(IN_ROUNDS + IN_SECONDS)

    @property
    def clock(self) -> str:
        """The column of a run that measures time as this one does."""
        return CLOCKS[0] if self.column.startswith(IN_ROUNDS) else CLOCKS[1]

    def of(self, row: Row) -> float | None:
        """What a run has of it: None if it has none, infinite for what it never reached."""
        text = row.get(self.column) or ""
        if _number(text):
            return float(text)
        if not self.timed or text or row.get(self.clock) == "":
            return None
        # Without oracles nobody looks when the absolute HD was low, which is not never.
        group = self.column.partition(".")[0]
        return NEVER if group not in ABSOLUTE or row.get(f"{group}.1") else None


MEASURES = (
    Measure("hd_cells", "HD at the end, cells"),
    Measure("rounds_to_hd.0.09", "rounds to HD < 0.09"),
    Measure("time_to_hd_s.0.09", "seconds to HD < 0.09"),
    Measure("hd_absolute_cells", "absolute HD at the end, cells"),
    Measure("distance_cells_mean", "cells flown by an FLS"),
    Measure("datagrams_sent", "datagrams sent"),
)
"""Those that are looked at unless others are named; of each only where the runs have it."""


class Cell(NamedTuple):
    """A contender in a condition."""

    condition: Key
    contender: Key
    values: dict[str, dict[int, float]]  # by column of a measure, by seed
    done: int  # runs; of a measure some may have no value
    failed: int  # runs that are not done

    def estimate(self, measure: Measure) -> Interval:
        """Its mean with a bootstrap interval, cut at 0; of what is timed the median, between two ranks."""
        values = list(self.values[measure.column].values())
        estimate = median(values) if measure.timed else paired.bootstrap_mean(values)
        return estimate if min(values, default=0.0) < 0 else estimate.cut()


class Pair(NamedTuple):
    """Two contenders in a condition, by one measure."""

    measure: Measure
    condition: Key
    one: Key
    other: Key
    difference: Interval  # other - one
    effect: float  # matched-pairs rank-biserial correlation; below 0 the other is better
    less: int  # seeds on which the other is less,
    more: int  # or more; on the rest both are the same
    test: SignTest
    p: float  # corrected for all pairs of the measure

    @property
    def shown(self) -> bool:
        """There is a difference, as far as ALPHA goes."""
        return self.p < paired.ALPHA

    @property
    def better(self) -> Key | None:
        """Which one is, if that is shown."""
        if not self.shown:
            return None
        return self.other if self.test.direction < 0 else self.one


class Comparison(NamedTuple):
    """All that a table says."""

    between: Key  # settings whose values are the contenders
    within: Key  # settings whose values are the conditions
    measures: tuple[Measure, ...]
    cells: list[Cell]
    pairs: list[Pair]
    seeds: list[int]

    @property
    def combinations(self) -> int:
        """How many pairs of contenders share a condition."""
        return sum(math.comb(many, 2) for many in Counter(cell.condition for cell in self.cells).values())

    def family(self, measure: Measure) -> int:
        """How many pairs are tested by a measure."""
        return sum(pair.measure == measure for pair in self.pairs)


def compare(path: Path, between: Iterable[str] = (), measures: Iterable[str] = ()) -> Comparison:
    """Compare the runs of a results.csv. between, measures: names of settings, of columns; none: what fits.

    Raises BadInput for a name that the table does not have, OSError, ValueError.
    """
    settings, rows = read_results(path)
    varied = [name for name in settings if len({row[name] for row in rows}) > 1]
    competing = chosen(list(between), varied)
    within = tuple(name for name in varied if name not in competing)
    done = [row for row in rows if row.get(STATUS) == "done"]
    looked = _measures(list(measures), rows, done)
    there: dict[tuple[Key, Key], list[Row]] = {}
    for row in rows:
        there.setdefault((_key(row, within), _key(row, competing)), []).append(row)
    cells = [
        _cell(condition, contender, there[condition, contender], looked)
        for condition in _keys(rows, within)
        for contender in _keys(rows, competing)
        if (condition, contender) in there
    ]
    seeds = sorted({int(row["seed"]) for row in rows})
    return Comparison(competing, within, looked, cells, _pairs(cells, looked), seeds)


def _key(row: Row, names: Key) -> Key:
    return tuple(row[name] or "null" for name in names)


def _keys(rows: Iterable[Row], names: Key) -> list[Key]:
    """In the order of the table."""
    return list(dict.fromkeys(_key(row, names) for row in rows))


def chosen(asked: list[str], varied: list[str]) -> Key:
    """The settings whose values compete, of those that vary. Raises BadInput."""
    for name in asked:
        if name not in varied:
            raise BadInput.saying(
                f"between: {shown(name)} does not vary here;{did_you_mean(name, varied)} "
                f"what varies: {', '.join(varied) or 'the seed alone'}"
            )
    if asked:
        return tuple(asked)
    rest = sorted(varied, key="shape".__eq__)  # shapes are what others compete on
    first = [name for name in (*FIRST_CHOICES, *rest) if name in varied]
    if not first:
        raise BadInput.saying("between: nothing varies but the seed; two values of a setting can be compared")
    return (first[0],)


def _measures(asked: list[str], rows: list[Row], done: list[Row]) -> tuple[Measure, ...]:
    known = {measure.column: measure for measure in MEASURES}
    if not asked:
        oracles = any(row.get(f"{name}.1") for row in done for name in ABSOLUTE)
        return tuple(
            measure
            for measure in MEASURES
            if any(_number(row.get(measure.column)) for row in done)
            and (oracles or "absolute" not in measure.column)
        )
    columns = list(rows[0]) if rows else []
    numbers = [name for name in columns if all(_number(row[name]) for row in done if row[name])]
    for name in asked:
        if name not in numbers:
            raise _no_measure(name, numbers)
    return tuple(known.get(name, Measure(name, name)) for name in asked)


def check_measures(asked: Iterable[str]) -> None:
    """Raises BadInput, before anything runs, for what no run has a number of."""
    from swarmer.observe.summary import number_names

    names = number_names()
    for name in asked:
        if name not in names and not name.startswith(FREE):
            raise _no_measure(name, names)


def _no_measure(name: str, numbers: list[str]) -> BadInput:
    usual = ", ".join(measure.column for measure in MEASURES if measure.column in numbers)
    hint = did_you_mean(name, numbers) or f" such are {usual or ', '.join(numbers)}"
    return BadInput.saying(f"measure: {shown(name)} is no column of numbers in results.csv;{hint}")


def _number(text: str | None) -> bool:
    try:
        return bool(text) and math.isfinite(float(text or ""))
    except ValueError:
        return False


def _cell(condition: Key, contender: Key, rows: list[Row], measures: Sequence[Measure]) -> Cell:
    done = [row for row in rows if row.get(STATUS) == "done"]
    values = {
        measure.column: {
            int(row["seed"]): value for row in done if (value := measure.of(row)) is not None
        } for measure in measures
    }  # fmt: skip
    return Cell(condition, contender, values, len(done), len(rows) - len(done))


def _pairs(cells: list[Cell], measures: Sequence[Measure]) -> list[Pair]:
    found: list[Pair] = []
    for measure in measures:
        tested = [
            _pair(measure, one, other)
            for _, there in itertools.groupby(cells, key=_condition)
            for one, other in itertools.combinations(list(there), 2)
            if set(one.values[measure.column]) & set(other.values[measure.column])
        ]
        corrected = paired.holm([pair.test.p for pair in tested])
        found += [pair._replace(p=p) for pair, p in zip(tested, corrected, strict=True)]
    return found


_condition: Callable[[Cell], Key] = lambda cell: cell.condition  # noqa: E731


def _pair(measure: Measure, one: Cell, other: Cell) -> Pair:
    mine, theirs = one.values[measure.column], other.values[measure.column]
    seeds = sorted(set(mine) & set(theirs))
    values = paired.differences([mine[seed] for seed in seeds], [theirs[seed] for seed in seeds])
    test = paired.sign_flips(values)
    return Pair(
        measure, one.condition, one.contender, other.contender, paired.difference(values), paired.effect(values),
        sum(value < 0 for value in values), sum(value > 0 for value in values), test, test.p,
    )  # fmt: skip
