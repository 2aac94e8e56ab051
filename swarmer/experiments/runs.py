"""An experiment becomes its runs: every combination of a block's values with every seed, each with a name that lasts.

A run is named by what its block says of it, `thaw.policy=census,lambda_ms=500/seed-3`, so more values, more seeds and
more blocks leave the names of the runs that are there already as they are.
"""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmer.config import RunConfig
from swarmer.errors import BadInput
from swarmer.experiments.experiment import SEED, Block, Experiment
from swarmer.experiments.needs import Needs, needs_of
from swarmer.settings import as_yaml

if TYPE_CHECKING:
    from swarmer.faults import Schedule
    from swarmer.rules import Rules

NAME_LENGTH = 120  # of a cell's folder; a longer name ends in a hash
DIGITS = 8
IDLE = ": no effect "  # in a note: names before it, a reason behind
STRANGE = re.compile(r"[^A-Za-z0-9._=,+-]+")
PLANNED_BY = (
    "engine", "shape", "points", "duplicates", "eta", "neighbours", "rounds.dim", "technique", "sensing.model",
    "thaw.policy", "epochs", "oracle.count", "transition.shape", "transition.points", "faults.schedule",
    "faults.file",
)  # fmt: skip
"""The settings that `make_plan` can refuse."""


NOTHING_SAID: Mapping[str, float] = {}


class Run(NamedTuple):
    """One run of an experiment."""

    cell: str  # the folder of its cell; empty in an experiment that varies nothing but the seed
    varied: dict[str, Any]  # what its block says of it: setting to value
    config: RunConfig  # all of it, with the seed
    said_needs: Mapping[str, float] = NOTHING_SAID  # of cores and memory

    @property
    def path(self) -> Path:
        """Its run directory, within the sweep's."""
        return Path(self.cell) / f"seed-{self.config.seed}"

    @property
    def whole_machine(self) -> bool:
        """True if nothing else may run beside it: its FLSs are processes that must not be late."""
        return self.needs.machine

    @property
    def needs(self) -> Needs:
        """What it needs of a machine."""
        return needs_of(self.config, self.said_needs)


def expand(experiment: Experiment) -> list[Run]:
    """All runs, cell by cell and in each by seed. A run that two blocks have is there once.

    Raises BadInput for settings that contradict each other.
    """
    runs: dict[tuple[str, ...], Run] = {}
    for block in experiment.blocks:
        for varied in combinations(block):
            config = _config(experiment, varied)
            for seed in block.seeds:
                seeded = config.model_copy(update={SEED: seed})
                run = Run(cell_name(varied), varied, seeded, block.needs)
                runs.setdefault(tuple(map(as_yaml, run.config.flat().values())), run)
    return list(runs.values())


def size(experiment: Experiment) -> int:
    """How many runs `expand` would give, those that two blocks have counted twice."""
    return sum(_cells(block) * len(block.seeds) for block in experiment.blocks)


def combinations(block: Block) -> Iterator[dict[str, Any]]:
    """What each cell of a block says, the last setting of its grid changing first."""
    listed, draws = block.listed or ({},), block.sample.draws() if block.sample else [{}]
    for one, draw in itertools.product(listed, draws):
        for values in itertools.product(*block.grid.values()):
            yield block.own | one | draw | dict(zip(block.grid, values, strict=True))


def _cells(block: Block) -> int:
    number = max(len(block.listed), 1) * (block.sample.n if block.sample else 1)
    for values in block.grid.values():
        number *= len(values)
    return number


def by_seed(runs: Iterable[Run]) -> list[Run]:
    """The order in which they are made: every cell once, then every cell with its next seed.

    So there is something of every cell early, and what is left can be told from what is done.
    """
    turn: dict[str, int] = {}
    order: list[tuple[int, int, Run]] = []
    for run in runs:
        turn[run.cell] = turn.get(run.cell, -1) + 1
        order.append((turn[run.cell], len(order), run))
    return [run for _, _, run in sorted(order, key=lambda entry: entry[:2])]


def varied_names(experiment: Experiment) -> list[str]:
    """Every setting that a block says something of, in the order of the file."""
    names = (name for block in experiment.blocks for name in (*block.own, *block.varied))
    return list(dict.fromkeys(names))


def asked_of(experiment: Experiment) -> dict[str, frozenset[str]]:
    """By cell the settings that the experiment itself says, and no preset."""
    asked: dict[str, frozenset[str]] = {}
    for block in experiment.blocks:
        for varied in combinations(block):
            asked.setdefault(cell_name(varied), block.asked)
    return asked


def check_plans(runs: Iterable[Run], file: str, asked: Mapping[str, frozenset[str]]) -> list[str]:
    """Plan each shape once as the runs will; the notes on their settings, each once, however many runs it is of.

    asked: by cell the settings that somebody asked for, which alone are noted.

    Raises BadInput for a shape, an η or a technique that cannot be.
    """
    from swarmer.engines.notes import notes_on
    from swarmer.plan import make_plan

    plans: dict[tuple[str, ...], tuple[Rules, Schedule]] = {}  # a whole one may be large
    looked_at: set[str] = set()  # cells
    notes: dict[str, None] = {}
    for run in runs:
        flat = run.config.flat()
        what = tuple(str(flat[name]) for name in PLANNED_BY)
        if what not in plans:
            try:
                plan = make_plan(run.config)
            except BadInput as error:
                raise BadInput.saying(f"{file}: {_of(run.varied)}{error}") from None
            plans[what] = plan.rules, plan.faults
        if run.cell not in looked_at:
            looked_at.add(run.cell)
            changed = asked[run.cell].intersection(run.config.unlike())
            notes |= dict.fromkeys(notes_on(run.config, *plans[what], changed))
    return merged(notes)


def merged(notes: Iterable[str]) -> list[str]:
    """One line for each reason for which settings have no effect, with all of these.

    >>> merged(["m: no effect with a", "m: no effect with b", "eta, m: no effect with a", "late"])
    ['m, eta: no effect with a', 'm: no effect with b', 'late']
    """
    idle: dict[str, dict[str, None]] = {}
    for note in notes:
        names, _, why = note.partition(IDLE)
        idle.setdefault(why, {}).update(dict.fromkeys(names.split(", ") if why else [note]))
    return [f"{', '.join(names)}{IDLE}{why}" for why, names in idle.items() if why] + list(idle.get("", {}))


def _config(experiment: Experiment, varied: dict[str, Any]) -> RunConfig:
    try:
        return RunConfig.from_flat(experiment.base | varied)
    except BadInput as error:
        raise BadInput.saying(*(f"{experiment.file}: {_of(varied)}{line}" for line in error.lines)) from None


def _of(varied: dict[str, Any]) -> str:
    return (
        f"with {', '.join(f'{name}={spelled(value)}' for name, value in varied.items())}: " if varied else ""
    )


def cell_name(varied: dict[str, Any]) -> str:
    """The folder of a cell: what it says, readable, the same on every machine, never two cells' the same.

    >>> cell_name({"thaw.policy": "census", "lambda_ms": 500.0})
    'thaw.policy=census,lambda_ms=500'
    >>> cell_name({"shape": "clouds/helix.xyz"})
    'shape=clouds-helix.xyz-96b8ae80'
    """
    exact = ",".join(f"{name}={spelled(value)}" for name, value in varied.items())
    name = STRANGE.sub("-", exact)
    if name == exact and len(name) <= NAME_LENGTH:
        return name
    return f"{name[: NAME_LENGTH - DIGITS - 1]}-{hashlib.sha256(exact.encode()).hexdigest()[:DIGITS]}"


def spelled(value: Any) -> str:
    """A value in a name, a table, a line: as a settings file has it, without quotes.

    >>> spelled("off"), spelled(500.0), spelled(None), spelled(True)
    ('off', '500', 'null', 'true')
    """
    return value if isinstance(value, str) else as_yaml(value)
