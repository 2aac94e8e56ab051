"""Where settings come from: presets and files that extend each other, then overrides, then options.

Everything becomes one mapping from dotted names to values: a later layer replaces single settings of an earlier.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from swarmer.errors import BadInput, shown
from swarmer.settings import Setting, did_you_mean
from swarmer.yaml_file import parse, read_mapping

CHAIN_MAX = 16  # files that extend each other
LISTED = "schedule"  # what a list stands for, where a group has one
OF_EXPERIMENTS = {"base", "grid", "blocks"}  # parts of an experiment file, and no settings


def preset_dir() -> Path:
    """The folder of the presets: inside the installed package, or `configs/` of the checkout."""
    here = Path(__file__).resolve().parent
    installed = here / "configs"
    return installed if installed.is_dir() else here.parent / "configs"


def preset_names() -> list[str]:
    """The names that `--config` takes besides a path."""
    return sorted(path.stem for path in preset_dir().glob("*.yaml"))


def flat_layers(
    file: str | Path | None,
    overrides: Iterable[str],
    flags: Mapping[str, Any],
    facts: Iterable[Setting],
    base: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The values of all layers by dotted name, the later ones in place of the earlier. Raises BadInput."""
    known = {setting.name: setting for setting in facts}
    flat = dict(base or {})
    if file is not None:
        flat |= _read(_find(file, Path()), known, ())
    for override in overrides:
        flat |= _override(override, known)
    return flat | flatten(flags, known, "options")


def flatten(mapping: Mapping[str, Any], known: Iterable[str], source: str) -> dict[str, Any]:
    """`{"radio": {"loss": 0}}` and `{"radio.loss": 0}` become `{"radio.loss": 0}`; both at once are refused."""
    names = set(known)
    groups = {name.rpartition(".")[0] for name in names if "." in name}
    flat: dict[str, Any] = {}
    for name, value in mapping.items():
        if name in groups and value is None:  # `radio:` with nothing but comments below it
            continue
        if isinstance(value, list) and f"{name}.{LISTED}" in names:  # `faults:` with a list below it
            inside = {f"{name}.{LISTED}": value}
        elif isinstance(value, dict) and name not in names:
            inside = {f"{name}.{key}": entry for key, entry in value.items()}
        else:
            inside = {name: value}
        for full, entry in inside.items():
            if full in flat:
                raise BadInput.saying(f"{full}: is given twice in {source}")
            flat[full] = entry
    return flat


def _override(override: str, known: Mapping[str, Setting]) -> dict[str, Any]:
    name, equals, raw = override.partition("=")
    name = name.strip()
    if not equals or not name:
        raise BadInput.saying(f"--set: {shown(override)} is not NAME=VALUE, such as radio.loss=0.1")
    if name in known and known[name].kind == "text":
        word = raw.strip()
        return {name: None if word == "null" and known[name].none else word}
    try:
        value = parse(raw)
    except (yaml.YAMLError, ValueError, RecursionError):
        value = raw
    return flatten({name: value}, known, "--set")


def _find(name: str | Path, beside: Path) -> Path:
    """The file meant by a preset's name or a path, relative to the folder `beside`."""
    text = str(name)
    if isinstance(name, str) and text in preset_names():
        return preset_dir() / f"{text}.yaml"
    path = beside / text
    try:
        if path.exists():
            return path
    except (OSError, ValueError):  # too long, NUL
        pass
    hint = did_you_mean(text, preset_names())
    raise BadInput.saying(f"config: no file {shown(text)};{hint} presets: {', '.join(preset_names())}")


def _read(path: Path, known: Mapping[str, Setting], chain: tuple[Path, ...]) -> dict[str, Any]:
    """A file's settings on top of those of the file it extends."""
    place = path.resolve()
    if place in chain or len(chain) >= CHAIN_MAX:
        names = " -> ".join(step.name for step in (*chain, place))
        raise BadInput.saying(f"extends: {shown(names, 200)[1:-1]} never ends")
    mapping = read_mapping(path)
    if OF_EXPERIMENTS & mapping.keys():
        name = shown(str(path), 200)[1:-1]
        raise BadInput.saying(f"config: {name} is an experiment file; `swarmer sweep {name}` makes its runs")
    extends = mapping.pop("extends", None)
    if extends is None:
        below: dict[str, Any] = {}
    elif isinstance(extends, str):
        below = _read(_find(extends, path.parent), known, (*chain, place))
    else:
        raise BadInput.saying(f"extends: {shown(extends)} is not a preset's name or a path")
    return below | flatten(mapping, known, path.name)
