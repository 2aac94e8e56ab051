"""An experiment as its file has it: settings to stand on, settings to vary, seeds; and where such files are found.

A file holds `base` (settings), `grid` (setting: list of values), `list` (combinations one by one), `random` or
`latin_hypercube` (samples over ranges), `seeds` (a count or a list), `needs` (cores and memory of a run), and, where
that does not say it all, `blocks`: a list of entries with the same, each of which adds to what the file says for all.
Everything wrong is refused here, with the line that the settings themselves have for it, before anything runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from swarmer.config import setting_facts
from swarmer.errors import BadInput, shown
from swarmer.experiments.needs import needs_said
from swarmer.experiments.samples import KINDS, Sample, sample_of
from swarmer.settings import Refused, Setting, did_you_mean, unknown_line
from swarmer.settings_file import flat_layers, flatten, preset_dir, preset_names
from swarmer.yaml_file import read_mapping

LIST, NEEDS = "list", "needs"
PARTS = ("base", "grid", LIST, *KINDS, "seeds", NEEDS)
BLOCKS, SMALL = "blocks", "small"
SMALL_PARTS = ("base", "grid", "seeds", BLOCKS)
SEED = "seed"
EXPERIMENT = "experiment.yaml"  # the experiment as a sweep keeps it in its directory
SEEDS_MAX = 100_000  # in one block
QUIET = {
    "recording.enabled": False
}  # a recording for each of hundreds of runs is asked for, not made unasked
FACTS: dict[str, Setting] = {fact.name: fact for fact in setting_facts()}


@dataclass(frozen=True)
class Block:
    """Every combination of a grid's values, with each entry of a list, each draw of a sample, and every seed."""

    own: dict[str, Any]  # settings that this block has and the file's base has not, or otherwise
    grid: dict[str, tuple[Any, ...]]
    seeds: tuple[int, ...]
    listed: tuple[dict[str, Any], ...] = ()  # combinations given one by one
    sample: Sample | None = None
    needs: dict[str, float] = field(default_factory=dict)  # what is said of cores and memory
    asked: frozenset[str] = field(default=frozenset(), compare=False)  # settings that are said, by no preset

    @property
    def varied(self) -> list[str]:
        """The settings that have several values, or may have."""
        listed = [name for entry in self.listed for name in entry]
        return list(dict.fromkeys([*listed, *(self.sample.ranges if self.sample else ()), *self.grid]))


@dataclass(frozen=True)
class Experiment:
    """An experiment, every value checked by itself; what contradicts what is found when it is expanded."""

    name: str
    base: dict[str, Any]  # settings of all runs; what is not named has its default
    blocks: tuple[Block, ...]
    file: str = field(default="", compare=False)  # as the user named it, for error lines


def experiment_dir() -> Path:
    """The folder of the experiments that ship."""
    return preset_dir() / "experiments"


def experiment_names() -> list[str]:
    """The names that `swarmer sweep` takes besides a path."""
    return sorted(path.stem for path in experiment_dir().glob("*.yaml"))


def find_experiment(name: str) -> Path:
    """The file meant by the name of a shipped experiment or a path. Raises BadInput."""
    if name in experiment_names():
        return experiment_dir() / f"{name}.yaml"
    path = Path(name)
    try:
        if path.is_dir():
            own = path / EXPERIMENT
            hint = f"; that of the sweep in it is {own}" if own.is_file() else ""
            raise BadInput.saying(f"experiment: {shown(name)} is a directory, not a file{hint}")
        if path.exists():
            return path
    except (OSError, ValueError):  # too long, NUL
        pass
    names = experiment_names()
    raise BadInput.saying(
        f"experiment: no file {shown(name)};{did_you_mean(name, names)} experiments that ship: {', '.join(names)}"
    )


def read_experiment(
    name: str, overrides: Iterable[str] = (), seeds: str | None = None, small: bool = False
) -> Experiment:
    """Read an experiment by name or path.

    small: the version that the file's part `small` makes of it, for a laptop. overrides: texts `a.b=value` that every
    run gets in place of what the file has. seeds: a count, or numbers with commas between, in place of the file's.
    Raises BadInput with a line for each thing that is wrong.
    """
    path = find_experiment(name)
    reader = _Reader(path, name if path == Path(name) else path.name)
    whole = read_mapping(path)
    if small:
        whole = made_small(whole, reader.file)
    experiment = reader.experiment(whole, list(overrides), seeds_asked(seeds))
    return replace(experiment, name=f"{experiment.name}-{SMALL}") if small else experiment


def made_small(whole: Mapping[str, Any], file: str) -> dict[str, Any]:
    """An experiment with what its part `small` says: settings and values of its own, other seeds, other blocks.

    Raises BadInput where there is no such part.
    """
    less, parts = whole.get(SMALL), ", ".join(SMALL_PARTS)
    if not isinstance(less, dict):
        raise BadInput.saying(f"{file}: {SMALL}: {shown(less)} is not a mapping with {parts}")
    for name in less:
        if name not in SMALL_PARTS:
            hint = did_you_mean(str(name), SMALL_PARTS)
            raise BadInput.saying(
                f"{file}: {SMALL}: {shown(name)[1:-1]}: no such part;{hint} there are {parts}"
            )
    merged = dict(whole) | {name: less[name] for name in ("seeds", BLOCKS) if name in less}
    for part in ("base", "grid"):
        if isinstance(less.get(part), dict) and isinstance(whole.get(part) or {}, dict):
            merged[part] = (whole.get(part) or {}) | less[part]
    return merged


def experiment_of(
    whole: Mapping[str, Any], name: str, file: str, overrides: Iterable[str] = (), seeds: str | None = None
) -> Experiment:
    """The experiment that a mapping says, as a file would. name: its own. file: who is to blame, in error lines.

    A path in `extends` is relative to where this process is. Raises BadInput as `read_experiment` does.
    """
    return _Reader(Path(name), file).experiment(dict(whole), list(overrides), seeds_asked(seeds))


def seeds_asked(seeds: str | None) -> tuple[int, ...] | None:
    """The seeds that an option names; None for none."""
    return None if seeds is None else seeds_of(_as_list(seeds), "--seeds")


def seeds_of(given: Any, where: str) -> tuple[int, ...]:
    """A count N stands for the seeds 1 to N; a list for itself. Raises BadInput."""
    if isinstance(given, list):
        fact, seeds = FACTS[SEED], []
        for value in given:
            try:
                seed = fact.checked(value)
            except Refused as refused:
                raise BadInput.saying(f"{where}: {fact.line(value, str(refused))}") from None
            if seed in seeds:
                raise BadInput.saying(f"{where}: {seed} is given twice")
            seeds.append(seed)
    elif isinstance(given, int) and not isinstance(given, bool) and 1 <= given <= SEEDS_MAX:
        seeds = list(range(1, given + 1))
    else:
        seeds = []
    if not seeds:
        raise BadInput.saying(
            f"{where}: {shown(given)} is neither a count, 1 to {SEEDS_MAX}, nor a list of seeds"
        )
    return tuple(seeds)


def _as_list(text: str) -> Any:
    """`10` is a count; `1,5,9` and `7,` are lists."""
    try:
        return [int(part) for part in text.split(",") if part.strip()] if "," in text else int(text)
    except ValueError:
        return text


def _others(extended: Mapping[str, Any], base: Mapping[str, Any], kept: set[str]) -> dict[str, Any]:
    """What makes a block that extends a preset another one: the settings that are not as in the file's base.

    kept: what the file itself says for all its blocks, and no preset changes.
    """
    before = {name: base.get(name, fact.default) for name, fact in FACTS.items()}
    return {name: value for name, value in extended.items() if name not in kept and value != before[name]}


class _Common(NamedTuple):
    """What a file says for all its blocks."""

    grid: dict[str, tuple[Any, ...]]
    listed: tuple[dict[str, Any], ...]
    sample: Sample | None
    needs: dict[str, float]


class _Reader:
    """Reads one file, and collects all that is wrong with it."""

    def __init__(self, path: Path, shown_as: str) -> None:
        self.path, self.file = path, shown(shown_as, 200)[1:-1]
        self.lines: list[str] = []

    def experiment(
        self, whole: dict[str, Any], overrides: list[str], seeds: tuple[int, ...] | None
    ) -> Experiment:
        if all(value is None for value in whole.values()):
            raise BadInput.saying(f"{self.file}: is empty; an experiment has {', '.join((*PARTS, BLOCKS))}")
        entries = self._blocks(whole.pop(BLOCKS, None))
        self._check_parts(whole, "", (*PARTS, BLOCKS, SMALL))
        below, all_say = self._base(whole.get("base"), "base")
        base = below | QUIET | all_say
        common = _Common(
            self._grid(whole.get("grid"), "grid"),
            *self._varied(whole, "", (), None),
            self._needs(whole, "", {}),
        )
        self._check_apart(common.grid, common.listed, common.sample, all_say, "base")
        seeds_of_all = self._seeds(whole.get("seeds", 1), "seeds")
        forced = self._check_values(flat_layers(None, overrides, {}, FACTS.values()), "--set")
        blocks = []
        for number, entry in enumerate(entries, 1):
            where = f"block {number}: "
            self._check_parts(entry, where, PARTS)
            extended, said = self._base(entry.get("base"), f"{where}base")
            grid = common.grid | self._grid(entry.get("grid"), f"{where}grid")
            listed, sample = self._varied(entry, where, common.listed, common.sample)
            self._check_apart(grid, listed, sample, said, f"{where}base")
            self._check_apart(grid, listed, sample, forced, "--set")
            its = self._seeds(entry["seeds"], f"{where}seeds") if "seeds" in entry else seeds_of_all
            block = Block({}, grid, seeds or its, listed, sample, self._needs(entry, where, common.needs))
            own = _others(extended, base, {*QUIET, *all_say}) | said
            own = {name: value for name, value in own.items() if name not in {*forced, *block.varied}}
            blocks.append(replace(block, own=own, asked=frozenset((*all_say, *said, *forced, *block.varied))))
        if self.lines:
            raise BadInput.saying(*dict.fromkeys(self.lines))
        return Experiment(self.path.stem, base | forced, tuple(blocks), self.file)

    def _blocks(self, given: Any) -> list[dict[str, Any]]:
        """The entries of `blocks`; where there are none, the file itself is the only one, and adds nothing."""
        if given is None:
            return [{}]
        if isinstance(given, list) and given and all(isinstance(entry, dict) for entry in given):
            return given
        self._say(BLOCKS, f"{shown(given)} is not a list of entries with {', '.join(PARTS)}")
        return []

    def _check_parts(self, mapping: Mapping[str, Any], where: str, parts: tuple[str, ...]) -> None:
        for name in mapping:
            if name not in parts:
                hint = did_you_mean(name, parts)
                self._say(f"{where}{shown(name)[1:-1]}", f"no such part;{hint} there are {', '.join(parts)}")

    def _base(self, given: Any, where: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """The settings of the preset or file that a base extends, and those that it has itself."""
        said = dict(self._mapping(given, where))
        extends = said.pop("extends", None)
        extended: dict[str, Any] = {}
        try:
            if extends is not None and not isinstance(extends, str):
                self._say(where, f"extends: {shown(extends)} is not a preset's name or a path")
            elif extends is not None:
                file = extends if extends in preset_names() else self.path.parent / extends
                layers = flat_layers(file, (), {}, FACTS.values())
                layers.pop(SEED, None)  # a preset has one, and an experiment has seeds
                extended = self._check_values(layers, where)
            return extended, self._check_values(flatten(said, FACTS, where), where)
        except BadInput as error:
            self.lines += [f"{self.file}: {line}" for line in error.lines]
            return {}, {}

    def _grid(self, given: Any, where: str) -> dict[str, tuple[Any, ...]]:
        """Each setting's values as the settings keep them."""
        try:
            flat = flatten(self._mapping(given, where), FACTS, where)
        except BadInput as error:
            self._say(where, *error.lines)
            return {}
        return {name: self._values(name, values, where) for name, values in flat.items()}

    def _values(self, name: str, values: Any, where: str) -> tuple[Any, ...]:
        if name not in FACTS or name == SEED:
            self._check_values({name: None}, where)
            return ()
        if not isinstance(values, list) or not values:
            self._say(where, f"{name}: {shown(values)} is not a list of values, such as [1, 2]")
            return ()
        checked: list[Any] = []
        for value in values:
            good = self._check_values({name: value}, where)
            if name in good and good[name] in checked:
                self._say(where, f"{name}: {shown(value)} is given twice")
            checked += good.values()
        return tuple(checked)

    def _check_values(self, flat: Mapping[str, Any], where: str) -> dict[str, Any]:
        """Those that are right, as the settings keep them; a line for each that is not."""
        good: dict[str, Any] = {}
        for name, value in flat.items():
            if name == SEED:
                self._say(where, "seed: is not given here; give seeds, a count or a list")
            elif name not in FACTS:
                self._say(where, unknown_line(name, FACTS))
            else:
                try:
                    good[name] = FACTS[name].checked(value)
                except Refused as refused:
                    self._say(where, FACTS[name].line(value, str(refused)))
        return good

    def _varied(
        self, entry: Mapping[str, Any], where: str, listed: tuple[dict[str, Any], ...], sample: Sample | None
    ) -> tuple[tuple[dict[str, Any], ...], Sample | None]:
        """The list and the sample of the file or a block; those given where it says none of its own."""
        if LIST in entry:
            listed = self._list(entry[LIST], f"{where}{LIST}")
        kinds = [kind for kind in KINDS if kind in entry]
        if len(kinds) > 1:
            self._say(f"{where}{kinds[1]}", f"stands beside {kinds[0]}; give one of them, or two blocks")
        elif kinds:
            try:
                sample = sample_of(kinds[0], entry[kinds[0]], FACTS)
                self._check_values({name: None for name in sample.ranges if name == SEED}, where + kinds[0])
            except BadInput as error:
                self.lines += [f"{self.file}: {where}{line}" for line in error.lines]
        return listed, sample

    def _list(self, given: Any, where: str) -> tuple[dict[str, Any], ...]:
        """Combinations, each a mapping of settings."""
        if not isinstance(given, list) or not given or not all(isinstance(entry, dict) for entry in given):
            self._say(where, f"{shown(given)} is not a list of settings, such as [{{eta: 3}}, {{eta: 4}}]")
            return ()
        entries: list[dict[str, Any]] = []
        for number, entry in enumerate(given, 1):
            place = f"{where} entry {number}"
            try:
                checked = self._check_values(flatten(entry, FACTS, place), place)
            except BadInput as error:
                self._say(place, *error.lines)
                continue
            if checked in entries:
                self._say(place, "is given twice")
            entries.append(checked)
        return tuple(entries)

    def _needs(self, entry: Mapping[str, Any], where: str, common: dict[str, float]) -> dict[str, float]:
        try:
            return common | needs_said(entry[NEEDS]) if NEEDS in entry else common
        except BadInput as error:
            self.lines += [f"{self.file}: {where}{line}" for line in error.lines]
            return common

    def _check_apart(
        self,
        grid: Mapping[str, Any],
        listed: tuple[dict[str, Any], ...],
        sample: Sample | None,
        base: Mapping[str, Any],
        where: str,
    ) -> None:
        """A setting is given in one place."""
        places = [("grid", set(grid)), (LIST, {name for entry in listed for name in entry})]
        places += [(sample.kind, set(sample.ranges))] if sample else []
        for at, (place, names) in enumerate(places):
            for name in names:
                if name in base:
                    self._say(where, f"{name}: stands in {place}, too; give it once")
                for other, others in places[at + 1 :]:
                    if name in others:
                        self._say(other, f"{name}: stands in {place}, too; give it once")

    def _seeds(self, given: Any, where: str) -> tuple[int, ...]:
        try:
            return seeds_of(given, where)
        except BadInput as error:
            self.lines += [f"{self.file}: {line}" for line in error.lines]
            return ()

    def _mapping(self, given: Any, where: str) -> Mapping[str, Any]:
        if given is None:
            return {}
        if isinstance(given, dict):
            return given
        self._say(where, f"{shown(given)} must be a mapping, `name: value` lines")
        return {}

    def _say(self, where: str, *problems: str) -> None:
        lead = "" if where.startswith("--") else f"{self.file}: "
        self.lines += [f"{lead}{where}: {problem}" for problem in problems]
