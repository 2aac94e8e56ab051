"""The invariants as a page lists them: from the classes themselves, whenever the docs are built."""

from __future__ import annotations

from swarmer.observe.invariants import INVARIANTS


def list_markdown() -> str:
    """A table: name, title, what it guards."""
    rows = [f"| {kind.name} | {kind.title} | {kind.guards} |" for kind in INVARIANTS]
    return "\n".join(["| | | what it guards |", "|---|---|---|", *rows])
