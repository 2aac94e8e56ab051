"""An experiment as its file has it: settings to stand on, settings to vary, seeds; and where such files are found.

A file holds `base` (settings), `grid` (setting: list of values), `seeds` (a count or a list), and, where one grid does
not say it all, `blocks`: a list of entries with the same three, each of which adds to what the file says for all.
Everything wrong is refused here, with the line that the settings themselves have for it, before anything runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmer.config import setting_facts
from swarmer.errors import BadInput, shown
from swarmer.settings import Refused, Setting, did_you_mean, unknown_line
from swarmer.settings_file import flat_layers, flatten, preset_dir, preset_names
from swarmer.yaml_file import read_mapping

PARTS = ("base", "grid", "seeds")
BLOCKS = "blocks"
SEED = "seed"
SEEDS_MAX = 100_000  # in one block
QUIET = {
    "recording.enabled": False
}  # a recording for each of hundreds of runs is asked for, not made unasked
FACTS: dict[str, Setting] = {fact.name: fact for fact in setting_facts()}


@dataclass(frozen=True)
class Block:
    """One grid: every combination of its values, with every seed."""

    own: dict[str, Any]  # settings that this block has and the file's base has not, or otherwise
    grid: dict[str, tuple[Any, ...]]
    seeds: tuple[int, ...]


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
        if path.exists():
            return path
    except (OSError, ValueError):  # too long, NUL
        pass
    names = experiment_names()
    raise BadInput.saying(
        f"experiment: no file {shown(name)};{did_you_mean(name, names)} experiments that ship: {', '.join(names)}"
    )


def read_experiment(name: str, overrides: Iterable[str] = (), seeds: str | None = None) -> Experiment:
    """Read an experiment by name or path.

    overrides: texts `a.b=value` that every run gets in place of what the file has. seeds: a count, or numbers with
    commas between, in place of the file's. Raises BadInput with a line for each thing that is wrong.
    """
    path = find_experiment(name)
    reader = _Reader(path, name if path == Path(name) else path.name)
    return reader.experiment(read_mapping(path), list(overrides), seeds_asked(seeds))


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
        self._check_parts(whole, "", (*PARTS, BLOCKS))
        below, all_say = self._base(whole.get("base"), "base")
        base, grid = below | QUIET | all_say, self._grid(whole.get("grid"), "grid")
        self._check_apart(grid, all_say, "base")
        common = self._seeds(whole.get("seeds", 1), "seeds")
        forced = self._check_values(flat_layers(None, overrides, {}, FACTS.values()), "--set")
        blocks = []
        for number, entry in enumerate(entries, 1):
            where = f"block {number}: "
            self._check_parts(entry, where, PARTS)
            extended, said = self._base(entry.get("base"), f"{where}base")
            varied = grid | self._grid(entry.get("grid"), f"{where}grid")
            self._check_apart(varied, said, f"{where}base")
            self._check_apart(varied, forced, "--set")
            own = _others(extended, base, {*QUIET, *all_say}) | said
            own = {name: value for name, value in own.items() if name not in forced and name not in varied}
            its = self._seeds(entry["seeds"], f"{where}seeds") if "seeds" in entry else common
            blocks.append(Block(own, varied, seeds or its))
        if self.lines:
            raise BadInput.saying(*self.lines)
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

    def _check_apart(self, grid: Mapping[str, Any], base: Mapping[str, Any], where: str) -> None:
        for name in grid:
            if name in base:
                self._say(where, f"{name}: stands in grid, too; give it once")

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
