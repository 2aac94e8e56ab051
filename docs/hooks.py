"""Called by mkdocs: the commands from their help; the protocol's table, invariants and gallery from the code."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import click
from mkdocs.structure.files import File, Files

from swarmer import cli

sys.path.insert(0, str(Path(__file__).resolve().parent))
import explained
import five_runs
import gallery_page
import invariants_list
import protocol_table

# What a page may hold in a line of its own, and who makes what stands there instead.
GENERATED = {
    "<!-- protocol: picture -->": protocol_table.picture_svg,
    "<!-- protocol: table -->": protocol_table.table_html,
    "<!-- protocol: rules -->": protocol_table.rules_html,
    "<!-- invariants: list -->": invariants_list.list_markdown,
    "<!-- gallery: tiles -->": gallery_page.tiles_html,
    "<!-- gallery: shapes -->": gallery_page.shapes_markdown,
    "<!-- explained: sequence -->": explained.sequence,
    "<!-- explained: follow -->": explained.follow,
    "<!-- explained: thaw -->": explained.thaw,
    "<!-- five runs -->": five_runs.runs_markdown,
}
ROOT = Path(__file__).resolve().parent.parent
SHOWN_FILE = re.compile(r"<!-- file: (\S+) -->")


def on_files(files: Files, config: Any) -> Files:
    """Add `reference/commands.md` to the pages, and the gallery's pictures beside it."""
    files.append(File.generated(config, "reference/commands.md", content=commands_page()))
    for path, picture in gallery_page.pictures().items():
        files.append(File.generated(config, path, content=picture))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put what is generated where a page asks for it."""
    for mark, make in GENERATED.items():
        if mark in markdown:
            markdown = markdown.replace(mark, make())
    return SHOWN_FILE.sub(shown_file, markdown)


def shown_file(found: re.Match[str]) -> str:
    """A file of the checkout as a block of code, so that a page cannot show another text. Raises OSError."""
    path = ROOT / found.group(1)
    language = {".py": "python"}.get(path.suffix, path.suffix.lstrip("."))
    return f"```{language}\n{path.read_text('utf-8').rstrip()}\n```"


def commands_page() -> str:
    """The help of every command, subcommands below their own."""
    parts = [
        "# Commands\n\n`swarmer-run` is `swarmer run`. Exit status: 0 done, 1 the run failed, 2 bad input, "
    ]
    parts += ["130 interrupted."]
    for name in cli.COMMANDS:
        parts += sections(cli.load(name), f"swarmer {name}", 2)
    return "".join(parts) + "\n"


def sections(command: click.Command, name: str, level: int) -> list[str]:
    """The help of a command and of those below it."""
    context = click.Context(command, info_name=name, terminal_width=100, max_content_width=100)
    parts = [f"\n\n{'#' * level} {name}\n\n```text\n{command.get_help(context)}\n```"]
    if isinstance(command, click.Group):
        for below in command.list_commands(context):
            parts += sections(command.commands[below], f"{name} {below}", level + 1)
    return parts
