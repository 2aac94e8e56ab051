"""A broken invariant for who ran the run: what it guards, the last events, the command that makes the run again."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import Any

from swarmer.observe.run_directory import CONFIG


def violation_lines(summary: dict[str, Any], run_dir: Path, program: str) -> list[str]:
    """For stderr. summary: as written; without a violation there is nothing to say."""
    violation = summary.get("violation")
    if not violation:
        return []
    config = shlex.quote(str(run_dir / CONFIG))
    until = math.ceil(violation["t_s"] * 1000 + 1) / 1000
    return [
        f"  {violation['invariant']}: {violation['guards']}",
        f"  broken at event {violation['event']:,}; the last events of those concerned:",
        *(f"    {line}" for line in violation["last"]),
        f"  again  {program} run --config {config} --check --duration {until:g}",
    ]
