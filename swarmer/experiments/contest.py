"""What `swarmer compare` is asked for, as an experiment: techniques × shapes × settings, on the same seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import yaml

from swarmer.errors import BadInput, shown
from swarmer.experiments.experiment import FACTS, Experiment, experiment_of
from swarmer.settings import unknown_line
from swarmer.yaml_file import parse

SEEDS = 10
OPTIONS = "options"  # who is to blame in error lines, where there is no file
BEST_ENGINES = ("rounds", "virtual")  # the first that this version has
TECHNIQUES = {
    "rounds": ("signal_strength", "dead_reckoning", "triangulation", "trilateration"),
    "virtual": ("signal_strength", "physical_movement"),
}
"""What is compared where nothing is asked for, by engine."""


def default_engine() -> str:
    """The engine of a comparison, unless one is named."""
    return next(engine for engine in BEST_ENGINES if engine in FACTS["engine"].words)


def contest(
    techniques: Sequence[str],
    shapes: Sequence[str],
    engines: Sequence[str],
    vary: Sequence[str],
    config: str | None = None,
    overrides: Iterable[str] = (),
    seeds: str | None = None,
    **settings: Any,
) -> Experiment:
    """The experiment. vary: texts `KEY=VALUE,VALUE`. settings: more of the base; None is not given. Raises BadInput.

    Where techniques alone can compete, none stands for those that the engine has, and one for it beside them.
    """
    engines = list(engines) or [default_engine()]
    grid: dict[str, Any] = {"shape": list(shapes) or ["dragon"]}
    varied = dict(map(_varied, vary))
    if len(techniques) < 2 and len(engines) == 1 and not varied:
        known = TECHNIQUES.get(engines[0], TECHNIQUES["virtual"])
        techniques = list(dict.fromkeys([*known, *techniques]))
    base: dict[str, Any] = {"extends": config} if config else {}
    for name, values in (("technique", list(techniques)), ("engine", engines)):
        if len(values) > 1:
            grid[name] = values
        elif values:
            base[name] = values[0]
    for name, values in varied.items():
        if name in grid or name in base:
            raise BadInput.saying(f"--vary: {name}: is given twice")
        grid[name] = values
    base |= {name: value for name, value in settings.items() if value is not None}
    what = [name for name, values in grid.items() if len(values) > 1 and name != "shape"]
    named = ["compare", *(what or ["shape"]), *(str(shape) for shape in grid["shape"][:3])]
    name = "-".join("".join(c if c.isalnum() or c == "_" else "-" for c in part).strip("-") for part in named)
    whole = {"base": base, "grid": grid, "seeds": SEEDS}
    return experiment_of(whole, f"{name}.yaml", OPTIONS, overrides, seeds)


def split(texts: Iterable[str]) -> list[str]:
    """`a,b` and `c` are three names.

    >>> split(["a,b", "c"])
    ['a', 'b', 'c']
    """
    return [part.strip() for text in texts for part in text.split(",") if part.strip()]


def _varied(text: str) -> tuple[str, list[Any]]:
    name, equals, raw = text.partition("=")
    name = name.strip()
    if not equals or not name or not raw.strip():
        raise BadInput.saying(f"--vary: {shown(text)} is not NAME=VALUE,VALUE, such as epsilon_deg=1,3,5")
    if name not in FACTS:
        raise BadInput.saying(f"--vary: {unknown_line(name, FACTS)}")
    if FACTS[name].kind == "text":
        return name, split([raw])
    try:
        values = parse(f"[{raw}]")
    except (yaml.YAMLError, ValueError, RecursionError):
        values = split([raw])
    return name, list(values) if isinstance(values, list) else [values]
