"""Read a YAML file that someone else wrote: plain data only, small, shallow, no surprises.

Refused: more than 1 MB or 10,000 values, deep nesting, aliases (a few lines can hold gigabytes), tags, merge
keys, a key given twice, anything but a mapping with texts as keys. `1e3` is a number and `1:30` is not (in YAML
1.1 it is the other way round).
"""

from __future__ import annotations

import re
import stat
from pathlib import Path
from typing import Any

import yaml

from swarmer.errors import BadInput, shown

SIZE_MAX = 1_000_000  # bytes
DEPTH_MAX = 20
NODES_MAX = 10_000  # keys and values; PyYAML takes seconds for so many
INT = re.compile(r"[-+]?(?:0|[1-9][0-9_]{0,99}|0x[0-9a-fA-F_]{1,99})$")
FLOAT = re.compile(
    r"[-+]?(?:[0-9][0-9_]*\.[0-9_]*(?:[eE][-+]?[0-9]+)?|[0-9][0-9_]*[eE][-+]?[0-9]+|\.[0-9]+(?:[eE][-+]?[0-9]+)?"
    r"|\.(?:inf|Inf|INF))$|\.(?:nan|NaN|NAN)$"
)
PLAIN_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("null", "bool", "int", "float", "str", "seq", "map")}


class _Refused(yaml.YAMLError):
    """Well-formed YAML that we do not take; says where."""


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, list[Any]] = {  # noqa: RUF012  (this is how PyYAML is configured)
        letter: [(tag, regexp) for tag, regexp in pairs if tag.rpartition(":")[2] in ("null", "bool")]
        for letter, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    depth = 0
    nodes = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        where = _place(event.start_mark)
        if isinstance(event, yaml.AliasEvent):
            raise _Refused(f"{where}: an alias (*name) is not allowed; write the value out")
        if self.depth >= DEPTH_MAX:
            raise _Refused(f"{where}: nested too deep; at most {DEPTH_MAX} levels")
        self.nodes += 1
        if self.nodes > NODES_MAX:
            raise _Refused(f"{where}: too long; at most {NODES_MAX} keys and values")
        self.depth += 1
        node: Any = super().compose_node(parent, index)
        self.depth -= 1
        if node.tag not in PLAIN_TAGS:
            raise _Refused(f"{where}: {shown(node.tag)} is not allowed; plain values only")
        if isinstance(node, yaml.MappingNode):
            _check_keys(node)
        return node


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+0123456789."))
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", INT, list("-+0123456789"))


def _place(mark: yaml.Mark) -> str:
    """As an editor counts: from 1."""
    return f"line {mark.line + 1}, column {mark.column + 1}"


def _check_keys(node: yaml.MappingNode) -> None:
    seen: set[str] = set()
    for key, _ in node.value:
        where = _place(key.start_mark)
        if not isinstance(key, yaml.ScalarNode) or key.tag != "tag:yaml.org,2002:str" or key.value == "<<":
            raise _Refused(f"{where}: a key must be a name")
        if key.value in seen:
            raise _Refused(f"{where}: {shown(key.value)} is given twice")
        seen.add(key.value)


def parse(text: str) -> Any:
    """The value a YAML text stands for. Raises yaml.YAMLError, ValueError."""
    return yaml.load(text, Loader=_Loader)  # a SafeLoader with more refusals


def read_mapping(path: Path) -> dict[str, Any]:
    """The mapping that a file holds; an empty file is an empty mapping. Raises BadInput."""
    try:
        found = parse(_read_text(path))
    except _Refused as error:
        raise _bad(path, str(error)) from None
    except yaml.MarkedYAMLError as error:
        where = f"{_place(error.problem_mark)}: " if error.problem_mark else ""
        raise _bad(path, f"{where}{error.problem or 'not YAML'}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise _bad(path, f"not YAML: {str(error).splitlines()[0] if str(error) else 'unreadable'}") from None
    if found is None:
        return {}
    if not isinstance(found, dict):
        raise _bad(path, f"{shown(found)} must be a mapping, `name: value` lines")
    return found


def _read_text(path: Path) -> str:
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise _bad(path, "is not a file")
        with path.open("rb") as file:
            raw = file.read(SIZE_MAX + 1)
    except OSError as error:
        raise _bad(path, error.strerror or "cannot be read") from None
    if len(raw) > SIZE_MAX:
        raise _bad(path, "is too large; at most 1 MB")
    return raw.decode("utf-8-sig")


def _bad(path: Path, problem: str) -> BadInput:
    return BadInput.saying(f"{shown(str(path), 200)[1:-1]}: {problem}")
