"""Scenarios: texts that say what happens to some FLSs and what they must answer (docs/explain.md has the words).

A scenario is comments (`#`), commands, one a line, a line `----`, and what the commands since the last one must give,
up to an empty line. `parse` reads one, `swarmer.observe.stage` plays it on state machines.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

from swarmer.errors import BadInput, shown

RULE = "----"
LONGEST = 1 << 20  # characters of a file
# Each command, and how it goes on.
COMMANDS = {
    "set": "NAME=VALUE ...",
    "given": "FID ... STATE [flying] [xi=N] [epoch=N] [incarnation=N] [neighbours=FID,...] [with=FID,...]",
    "tick": "FID", "bound": "FID", "lease": "FID", "renew": "FID", "thaw": "FID",
    "report": "FID", "land": "FID", "battery": "FID",
    "measure": "FID CELLS",
    "fail": "FID",
    "replace": "FID",
    "deliver": "[KIND] [from FID] [to FID] [twice]",
    "lose": "[KIND] [from FID] [to FID]",
    "run": "",
    "advance": "to=MS | by=MS",
    "show": "FID ...",
}  # fmt: skip
SILENT = {"set", "given", "lose", "fail"}  # these give nothing, so they need no `----`


class Word(NamedTuple):
    """A word of a command and where it stands, both counted from 1."""

    text: str
    file: str
    line: int
    column: int

    def refuse(self, what: str) -> NoReturn:
        """Raise BadInput that says where."""
        raise BadInput.saying(f"scenario: {self.file}, line {self.line}, column {self.column}: {what}")

    def number(self, low: int = 0, high: int = 0xFFFF) -> int:
        """The whole number that it is. Raises BadInput."""
        if not re.fullmatch(r"[0-9]{1,9}", self.text) or not low <= int(self.text) <= high:
            self.refuse(f"{shown(self.text)} is no whole number from {low} to {high}")
        return int(self.text)

    def value(self) -> Word:
        """Of `name=value` the value. Raises BadInput."""
        name, equals, value = self.text.partition("=")
        if not equals or not value:
            self.refuse(f"{shown(self.text)} needs a value, as {name}=...")
        return self._replace(text=value, column=self.column + len(name) + 1)

    def parts(self) -> list[Word]:
        """What stands between commas."""
        return [
            self._replace(text=found[0], column=self.column + found.start())
            for found in re.finditer(r"[^,]+", self.text)
        ]


class Block(NamedTuple):
    """Commands, and what they must give; the lines from `first` to `last` (not included, from 0) say so."""

    commands: tuple[tuple[Word, ...], ...]
    expected: tuple[str, ...]
    first: int
    last: int


class Scenario(NamedTuple):
    """A file taken apart."""

    name: str
    lines: tuple[str, ...]
    blocks: tuple[Block, ...]

    def rewritten(self, given: Sequence[Sequence[str]]) -> str:
        """The text with what the blocks gave in place of what they should."""
        lines = list(self.lines)
        for block, output in reversed(list(zip(self.blocks, given, strict=True))):
            lines[block.first : block.last] = output
        return "\n".join(lines) + "\n"


def read(path: Path) -> Scenario:
    """Read a file. Raises BadInput for one that cannot be read, or says something that is no scenario."""
    try:
        text = path.read_bytes().decode("utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "not a text in UTF-8"
        raise BadInput("scenario", str(path), f"a file of commands ({reason})") from None
    if len(text) > LONGEST:
        raise BadInput("scenario", str(path), f"a file of at most {LONGEST} characters")
    return parse(text, path.name)


def parse(text: str, name: str) -> Scenario:
    """Take a scenario apart. Raises BadInput with line and column of the first thing that is not understood."""
    lines = tuple(line.rstrip() for line in text.split("\n"))
    while lines and not lines[-1]:
        lines = lines[:-1]
    blocks: list[Block] = []
    commands: list[tuple[Word, ...]] = []
    at = 0
    while at < len(lines):
        line = lines[at]
        at += 1
        if line == RULE:
            if not commands:
                Word(RULE, name, at, 1).refuse("no command stands before it")
            end = next((k for k in range(at, len(lines)) if not lines[k]), len(lines))
            blocks.append(Block(tuple(commands), lines[at:end], at, end))
            commands, at = [], end
        elif line and not line.startswith("#"):
            commands.append(_command(line, name, at))
    for words in commands:
        if words[0].text not in SILENT:
            words[0].refuse(f"what must come of it? a line {RULE} and the answer are missing")
    if not blocks:
        first = commands[0][0] if commands else Word("", name, 1, 1)
        first.refuse("nothing happens: no command gives anything")
    return Scenario(name, lines, tuple(blocks))


def _command(line: str, name: str, number: int) -> tuple[Word, ...]:
    words = tuple(
        Word(found[0], name, number, found.start() + 1) for found in re.finditer(r"[^\s#]\S*|#.*", line)
    )
    words = tuple(word for word in words if not word.text.startswith("#"))
    if words[0].text not in COMMANDS:
        words[0].refuse(f"no command {shown(words[0].text)}; there are {', '.join(COMMANDS)}")
    return words


def first_difference(scenario: Scenario, given: Sequence[Sequence[str]]) -> str:
    """Where a scenario is not as its file says, in words; empty if it is nowhere."""
    for block, output in zip(scenario.blocks, given, strict=True):
        if tuple(output) == block.expected:
            continue
        for k in range(max(len(output), len(block.expected))):
            said = block.expected[k] if k < len(block.expected) else "nothing more"
            came = output[k] if k < len(output) else "nothing more"
            if said != came:
                return f"line {block.first + k + 1}: it says `{said}`, and what came is `{came}`"
    return ""
