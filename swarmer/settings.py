"""What a setting is: one declaration that gives default, range, help, error line and documentation.

A group of settings is a class of `Group`; each field is declared by `number`, `whole`, `flag`, `choice`, `named`,
`text` or `positions`. A value is checked by `Setting.checked` alone, so an error says what the reference says.
"""

from __future__ import annotations

import difflib
import math
import numbers
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from swarmer.entry_points import installed
from swarmer.errors import shown

UNIT_WORDS = {
    "ms": "milliseconds",
    "s": "seconds",
    "deg": "degrees",
    "cells": "display cells",
    "m": "metres",
    "m/s": "metres per second",
    "m/s2": "metres per second squared",
    "1/s": "per second",
    "Hz": "hertz",
    "kB": "kilobytes",
    "%": "percent",
    "wall": "emulated seconds per wall second",
    "p": "probability",
}
EXPONENT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)[eE][+-]?\d+")  # YAML 1.1 reads 1e3 as a text
TEXT_LENGTH = 4096


class Refused(ValueError):
    """A value a setting does not take; the text says what it is instead: 'is out of range'."""


@dataclass(frozen=True)
class Setting:
    """One declaration. `name` is the dotted name, known once the setting stands in its place in RunConfig."""

    kind: str  # number | whole | flag | choice | name | text | positions | rows
    default: Any
    help: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    above: bool = False  # low itself is not allowed
    words: tuple[
        Any, ...
    ] = ()  # the choices, for a name those that are ours; for a number: words taken besides
    none: str = ""  # what null stands for; empty where null is not taken
    only: str = ""  # the engine that alone heeds it; empty: every engine does
    group: str = ""  # for a name: of entry points, under which other packages add theirs
    name: str = ""

    @property
    def range(self) -> str:
        """What is allowed, without unit and default.

        >>> number(250, "ms", 1, 60_000, "").json_schema_extra["setting"].range
        '1 to 60000'
        """
        if self.kind == "flag":
            return "true or false"
        if self.kind == "text":
            return "a text"
        if self.kind == "positions":
            return f"{plain(self.low)} to {plain(self.high)} positions [L, H, D]"
        if self.kind == "rows":
            return f"a list of up to {plain(self.high)} mappings"
        if self.kind == "choice":
            return spelled(self.words)
        if self.kind == "name":
            return f"{spelled(self.words)}, or a plugin's name ({self.group})"
        return self.span + self.besides

    @property
    def explained(self) -> str:
        """The help, and which engine alone heeds the setting, where its group does not say so."""
        said = not self.only or self.name.startswith(f"{self.only}.")
        engines = "engines process and cluster" if self.only == "process" else f"engine {self.only}"
        return self.help if said else f"{self.help} ({engines} only)"

    @property
    def span(self) -> str:
        """The range of a number, without the words it takes besides."""
        low = f"above {plain(self.low)}, up to" if self.above else f"{plain(self.low)} to"
        return f"{low} {plain(self.high)}"

    @property
    def besides(self) -> str:
        """', or auto' for a number that takes the word `auto`."""
        return "".join(f", or {word}" for word in self.words)

    @property
    def allowed(self) -> str:
        """Unit, range and default, as an error line ends: 'milliseconds, 1 to 60000 (default 250)'."""
        unit = "whole number, " if self.kind == "whole" else ""
        unit = f"{UNIT_WORDS[self.unit]}, {unit}" if self.unit else unit
        null = ", or null" if self.none else ""
        means = f": {self.none}" if self.default is None else ""
        return f"{unit}{self.range}{null} (default {as_yaml(self.default)}{means})"

    def line(self, value: object, reason: str) -> str:
        """The error line: 'lease_ms: -5 is out of range; milliseconds, 1 to 60000 (default 250)'."""
        hint = ""
        if self.kind in ("choice", "name") and isinstance(value, str):
            words = [*self.words, *(installed(self.group) if self.group else ())]
            hint = did_you_mean(value, [word for word in words if isinstance(word, str)])
        return f"{self.name}: {shown(value)} {reason};{hint} {self.allowed}"

    def checked(self, value: Any) -> Any:
        """`value` as the setting keeps it. Raises Refused."""
        if value is None:
            if self.none:
                return None
            raise Refused("is not allowed")
        return CHECKS[self.kind](self, value)


def is_number(value: Any) -> bool:
    """True for whole and real numbers, numpy's too; a bool is none."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def _check_number(setting: Setting, value: Any) -> Any:
    if isinstance(value, str):
        if value in setting.words:
            return value
        if EXPONENT.fullmatch(value.strip()):
            value = float(value)
    if not is_number(value):
        raise Refused("is not a number")
    if not isinstance(value, numbers.Integral) and not math.isfinite(value):
        raise Refused("is not a finite number")
    if setting.kind == "whole" and value != int(value):
        raise Refused("is not a whole number")
    if not setting.low <= value <= setting.high or (setting.above and value == setting.low):
        raise Refused("is out of range")
    return int(value) if setting.kind == "whole" else float(value)


def _check_flag(setting: Setting, value: Any) -> bool:
    if not isinstance(value, bool):
        raise Refused("is neither true nor false")
    return value


def _check_choice(setting: Setting, value: Any) -> Any:
    if isinstance(value, bool):  # YAML reads a bare `off` as false
        value = "on" if value else "off"
    elif isinstance(value, float) and value == math.inf:
        value = "inf"
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, str | int) and value in setting.words:
        return value
    raise Refused("is not a choice")


def _check_name(setting: Setting, value: Any) -> str:
    if isinstance(value, bool):  # YAML reads a bare `off` as false
        value = "on" if value else "off"
    if isinstance(value, str) and (value in setting.words or value in installed(setting.group)):
        return value
    raise Refused("is not a choice")


def _check_text(setting: Setting, value: Any) -> str:
    if not isinstance(value, str):
        raise Refused("is not a text")
    if not value.strip() or len(value) > TEXT_LENGTH or not value.isprintable():
        raise Refused("is empty, too long or has control characters")
    return value


def _check_positions(setting: Setting, value: Any) -> tuple[tuple[float, float, float], ...]:
    if not isinstance(value, list | tuple):
        raise Refused("is not a list of positions")
    if not setting.low <= len(value) <= setting.high:
        raise Refused(f"has {len(value)} entries")
    return tuple(_position(entry) for entry in value)


def _position(entry: Any) -> tuple[float, float, float]:
    if not isinstance(entry, list | tuple) or len(entry) != 3:
        raise Refused("has an entry that is not [L, H, D]")
    for part in entry:
        if not is_number(part) or not abs(part) <= 1_000_000:
            raise Refused("has a coordinate that is no number between -1000000 and 1000000")
    return (float(entry[0]), float(entry[1]), float(entry[2]))


def _check_rows(setting: Setting, value: Any) -> tuple[dict[str, Any], ...]:
    if not isinstance(value, list | tuple) or not all(isinstance(entry, dict) for entry in value):
        raise Refused("is not a list of mappings")
    if not setting.low <= len(value) <= setting.high:
        raise Refused(f"has {len(value)} entries")
    return tuple(value)


CHECKS = {
    "number": _check_number,
    "whole": _check_number,
    "flag": _check_flag,
    "choice": _check_choice,
    "name": _check_name,
    "text": _check_text,
    "positions": _check_positions,
    "rows": _check_rows,
}


# How a field is declared. These return Any, as pydantic's Field does, so that the field keeps its own type.


def number(default: Any, unit: str, low: float, high: float, help: str, **more: Any) -> Any:
    """A real number within low and high; `more`: above, words, none, only."""
    return _field(Setting("number", default, help, unit, low, high, **more))


def whole(default: int | None, unit: str, low: int, high: int, help: str, **more: Any) -> Any:
    """A whole number within low and high."""
    return _field(Setting("whole", default, help, unit, low, high, **more))


def flag(default: bool, help: str, only: str = "") -> Any:
    """True or false."""
    return _field(Setting("flag", default, help, only=only))


def choice(default: Any, help: str, only: str = "") -> Any:
    """One of the words of the field's own type, a Literal."""
    return _field(Setting("choice", default, help, only=only))


def named(default: str, words: tuple[str, ...], group: str, help: str) -> Any:
    """One of `words`, or what an installed package has added under the `group` of entry points."""
    return _field(Setting("name", default, help, words=words, group=group))


def text(default: str | None, help: str, none: str = "", only: str = "") -> Any:
    """A name that something else checks later; `none`: what null stands for."""
    return _field(Setting("text", default, help, none=none, only=only))


def positions(default: tuple[tuple[float, ...], ...], unit: str, low: int, high: int, help: str) -> Any:
    """Between low and high positions."""
    return _field(Setting("positions", default, help, unit, low, high))


def rows(low: int, high: int, help: str) -> Any:
    """Between low and high mappings, of which something else knows more; none by default."""
    return _field(Setting("rows", (), help, low=low, high=high))


def _field(setting: Setting) -> Any:
    return Field(default=setting.default, description=setting.help, json_schema_extra={"setting": setting})  # type: ignore[dict-item]


class Group(BaseModel):
    """Settings that stand together under one name."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)

    @field_validator("*", mode="before")
    @classmethod
    def _check(cls, value: Any, info: ValidationInfo) -> Any:
        setting = declared(cls, str(info.field_name))
        if setting is None:
            return value
        try:
            return setting.checked(value)
        except Refused as refused:
            raise PydanticCustomError("setting", "{reason}", {"reason": str(refused)}) from None


@cache
def declared(group: type[BaseModel], field: str) -> Setting | None:
    """The declaration of a field, or None if the field is itself a group."""
    info = group.model_fields[field]
    extra = info.json_schema_extra
    if not isinstance(extra, dict):
        return None
    setting: Any = extra["setting"]
    return replace(setting, words=get_args(info.annotation)) if setting.kind == "choice" else setting


def walk(group: type[BaseModel], prefix: str = "") -> Iterator[Setting]:
    """Every setting of a group and of the groups in it, in declared order, with its dotted name."""
    for field, info in group.model_fields.items():
        setting = declared(group, field)
        if setting is not None:
            yield replace(setting, name=prefix + field)
        elif isinstance(info.annotation, type):
            yield from walk(info.annotation, f"{prefix}{field}.")


def error_lines(error: ValidationError, facts: dict[str, Setting]) -> list[str]:
    """A line for each thing that pydantic found, in the order of the declarations."""
    lines = []
    for entry in error.errors(include_url=False):
        name = ".".join(str(part) for part in entry["loc"])
        reason = entry.get("ctx", {}).get("reason")
        if reason is not None and name in facts:
            lines.append(facts[name].line(entry["input"], reason))
        elif entry["type"] == "extra_forbidden":
            lines.append(unknown_line(name, facts))
        else:
            lines.append(f"{name or 'settings'}: {entry['msg']}")
    return lines


def unknown_line(name: str, names: Iterable[str]) -> str:
    """The line for a name that is not a setting, with the setting that was probably meant."""
    known = list(names)
    inside = [full for full in known if full.startswith(f"{name}.")]
    if inside:
        return f"{name}: is a group of settings; give one of them, such as '{inside[0]}'"
    hint = did_you_mean(name, known)
    if not hint:
        by_last = {full.rpartition(".")[2]: full for full in known}
        close = difflib.get_close_matches(name.rpartition(".")[2], by_last, n=1)
        hint = f" did you mean '{by_last[close[0]]}'?" if close else " the settings reference lists all"
    return f"{shown(name)[1:-1]}: no such setting;{hint}"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The hint ` did you mean 'x'?`, with the space before it, or nothing."""
    close = difflib.get_close_matches(word[:100], list(known), n=1)
    return f" did you mean '{close[0]}'?" if close else ""


def plain(value: float) -> str:
    """A number as one writes it: 60000, 0.001."""
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def spelled(words: Iterable[Any]) -> str:
    """'a, b or c'."""
    texts = [str(word) for word in words]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} or {texts[-1]}"


def as_yaml(value: Any) -> str:
    """A default as a settings file spells it, on one line."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, int | float):
        return plain(value)
    if isinstance(value, tuple | list):
        return f"[{', '.join(as_yaml(part) for part in value)}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {as_yaml(part)}' for key, part in value.items())}}}"
    return f'"{value}"' if value in ("off", "on") else str(value)
