"""A comparison in words and tables: nothing is called better than another unless a paired test says so."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable

from swarmer.experiments.comparison import Cell, Comparison, Key, Measure, Pair
from swarmer.experiments.tables import bounded, figure
from swarmer.metrics import paired
from swarmer.metrics.intervals import LEVEL, Interval

LEAST_P = 1e-4  # smaller ones are not told apart
PAIR_COLUMNS = (
    "measure", "condition", "one", "other", "pairs", "difference", "low", "high", "interval", "effect_rank_biserial",
    "other_less", "other_more", "p", "p_holm", "test", "better",
)  # fmt: skip


def named(key: Key, names: Key) -> str:
    """What a key says, in words: the values alone where one setting gives them.

    >>> named(("signal_strength",), ("technique",)), named(("dragon", "5"), ("shape", "epsilon_deg"))
    ('signal_strength', 'shape dragon, epsilon_deg 5')
    """
    if len(names) == 1:
        return key[0]
    return ", ".join(f"{name} {value}" for name, value in zip(names, key, strict=True))


def cell_figure(cell: Cell, measure: Measure) -> str:
    """`1.23 [1.1, 1.4]`, and how many have a figure or got there, if not all."""
    values = list(cell.values[measure.column].values())
    if not values:
        return "–"
    reached = sum(map(math.isfinite, values))
    there = "" if reached == cell.done else f" ({reached}/{cell.done})"
    if not reached:
        return "never" if len(values) == cell.done else f"never{there}"
    return bounded(cell.estimate(measure), figure) + there


def table_rows(comparison: Comparison) -> list[list[str]]:
    """Titles and a row for each contender in each condition."""
    titles = [*comparison.within, " + ".join(comparison.between), "runs"]
    rows = [[*titles, *(measure.title for measure in comparison.measures)]]
    for cell in comparison.cells:
        failed = f" ({cell.failed} failed)" if cell.failed else ""
        rows.append(
            [*cell.condition, named(cell.contender, comparison.between), f"{cell.done}{failed}",
             *(cell_figure(cell, measure) for measure in comparison.measures)]
        )  # fmt: skip
    return rows


def method_lines(comparison: Comparison) -> list[str]:
    """How the figures come about, so that nobody has to guess."""
    seeds = len(comparison.seeds)
    lines = [
        f"Paired by seed, {seeds} seed{'s' * (seeds != 1)}. Means with {_intervals(comparison)} intervals of 95 %; "
        f"what is timed as median between two ranks{_held(comparison)}, a run that never got there later than all "
        "others.",
        "Differences: permutation test by sign flips, p corrected by Holm for all pairs of a measure; effect: "
        "matched-pairs rank-biserial correlation, -1 to 1.",
    ]
    apart = {measure: comparison.combinations - comparison.family(measure) for measure in comparison.measures}
    lines += [
        f"{measure.title}: not compared, as no seed has it of both: {pairs} pair{'s' * (pairs != 1)}."
        for measure, pairs in apart.items()
        if pairs
    ]
    return lines


def limit_lines(comparison: Comparison) -> list[str]:
    """Of which measures so few seeds can show nothing, whatever the runs are like, and how many could.

    What stands below such a line is no difference shown, however large it is.
    """
    titles: dict[tuple[int, int], list[str]] = {}
    for measure in comparison.measures:
        seeds = max((pair.difference.n for pair in comparison.pairs if pair.measure == measure), default=0)
        tests = comparison.family(measure)
        if tests * paired.least_p(seeds) >= paired.ALPHA:
            titles.setdefault((tests, seeds), []).append(measure.title)
    return [
        f"{'; '.join(those)}: {tests} pair{'s' * (tests != 1)} on {seeds} seed{'s' * (seeds != 1)} cannot show a "
        f"difference, however large; {paired.pairs_needed(tests)} seeds could."
        for (tests, seeds), those in titles.items()
    ]


def _intervals(comparison: Comparison) -> str:
    plain = [measure for measure in comparison.measures if not measure.timed]
    methods = {
        cell.estimate(measure).method
        for measure in plain
        for cell in comparison.cells
        if cell.values[measure.column]
    }
    methods |= {pair.difference.method for pair in comparison.pairs} - {"ranks"}
    words = {"t": "Student's t", "bootstrap BCa": "bootstrap (BCa)"}
    return " or ".join(words[method] for method in sorted(methods)) or "bootstrap (BCa)"


def _held(comparison: Comparison) -> str:
    """What medians of few runs are held to, if there are such."""
    levels = [
        cell.estimate(measure)
        for measure in comparison.measures if measure.timed
        for cell in comparison.cells if cell.values[measure.column]
    ]  # fmt: skip
    few = ["of 5 runs with 93.75 %"] * any(interval.level < LEVEL for interval in levels)
    few += ["of fewer than 5 without an interval"] * any(math.isnan(interval.low) for interval in levels)
    return f" ({', '.join(few)})" if few else ""


def pair_line(pair: Pair, comparison: Comparison) -> str:
    """What is to be said of two contenders."""
    one, other = named(pair.one, comparison.between), named(pair.other, comparison.between)
    where = f"{named(pair.condition, comparison.within)}: " if pair.condition else ""
    less, more = ("earlier", "later") if pair.measure.timed else ("less", "more")
    n = pair.difference.n
    if not pair.less and not pair.more:
        return (
            f"{where}{other} against {one}: the same on {f'each of {n} seeds' if n > 1 else 'the one seed'}"
        )
    figures = f"(effect {pair.effect:+.2f}, p {_p(pair.p)})"
    if pair.better is None:
        return (
            f"{where}{other} against {one}: no difference shown, by {_amount(pair.difference)}, "
            f"{less} on {pair.less} of {n} seeds, {more} on {pair.more} {figures}"
        )
    falls = pair.better == pair.other
    word, seeds = (less, pair.less) if falls else (more, pair.more)
    amount = _turned(pair.difference) if falls else pair.difference
    return f"{where}{other} {word} than {one}, by {_amount(amount)}, on {seeds} of {n} seeds {figures}"


def _turned(difference: Interval) -> Interval:
    """The same, as the amount by which it is less."""
    return difference._replace(estimate=-difference.estimate, low=-difference.high, high=-difference.low)


def _amount(difference: Interval) -> str:
    """How much, always with its interval or that there is none; infinite where one of the two never got there."""
    how = " in the median" if difference.method == "ranks" else ""
    shown = [figure(value).replace("never", "∞") for value in difference[:3]]
    if math.isnan(difference.low):
        return f"{shown[0]}{how} (too few seeds for an interval)"
    return f"{shown[0]} [{shown[1]}, {shown[2]}]{how}"


def _p(p: float) -> str:
    return f"< {LEAST_P:g}" if p < LEAST_P else f"{p:.2g}"


def statements(comparison: Comparison, only_first: bool = False) -> list[str]:
    """A line for each pair, measure by measure. only_first: those with the first contender alone."""
    lines = []
    first = comparison.cells[0].contender if comparison.cells else ()
    for measure in comparison.measures:
        pairs = [pair for pair in comparison.pairs if pair.measure == measure]
        said = [
            pair_line(pair, comparison) for pair in pairs if not only_first or first in (pair.one, pair.other)
        ]
        if said:
            lines += [f"{measure.title}:", *(f"  {line}" for line in said)]
    return lines


def markdown(comparison: Comparison, title: str) -> str:
    """A page: the table, what it says, and how that was found."""
    rows = table_rows(comparison)
    lines = [f"# {title}", "", *_table(rows), "", *limit_lines(comparison), *method_lines(comparison), ""]
    for measure in comparison.measures:
        pairs = [pair for pair in comparison.pairs if pair.measure == measure]
        if pairs:
            lines += [f"## {measure.title}", "", *(f"- {pair_line(pair, comparison)}" for pair in pairs), ""]
    return "\n".join(lines)


def _table(rows: list[list[str]]) -> Iterable[str]:
    yield f"| {' | '.join(rows[0])} |"
    yield f"|{'---|' * len(rows[0])}"
    for row in rows[1:]:
        yield f"| {' | '.join(row)} |"


def pairs_csv(comparison: Comparison) -> str:
    """A row for each pair and measure; an infinite difference is `inf`."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(PAIR_COLUMNS)
    for pair in comparison.pairs:
        better = pair.better
        table.writerow(
            [pair.measure.column, named(pair.condition, comparison.within) if pair.condition else "",
             named(pair.one, comparison.between), named(pair.other, comparison.between), pair.difference.n,
             *(f"{value:.9g}" for value in pair.difference[:3]), pair.difference.method, f"{pair.effect:.4f}",
             pair.less, pair.more, f"{pair.test.p:.6g}", f"{pair.p:.6g}", pair.test.method,
             "" if better is None else named(better, comparison.between)]
        )  # fmt: skip
    return text.getvalue()
