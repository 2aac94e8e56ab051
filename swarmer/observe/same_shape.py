"""Is the shape still what it was when a run was made? Its manifest keeps a hash of the points."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from swarmer.observe.run_directory import MANIFEST

if TYPE_CHECKING:
    from swarmer.plan import Plan

MAKING = ("shape", "points", "duplicates", "seed")  # the settings that the points follow from


def shape_changed(run: Path, plan: Plan) -> bool:
    """Whether the run in `run` was made from the same settings of the shape as `plan`, and had other points.

    False also where no manifest tells.
    """
    try:
        manifest = json.loads((run / MANIFEST).read_text(encoding="utf-8"))
        then, hashed = manifest["settings"], manifest["points_sha256"]
        same = all(then.get(name) == now for name, now in _making(plan).items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False
    return same and hashed != plan.cloud.sha256


def _making(plan: Plan) -> dict[str, str | None]:
    unusual = plan.config.unusual()
    return {name: unusual.get(name) for name in MAKING}
