"""Which sources this swarmer is made of: two checkouts of one version may differ, and must not make one run."""

from __future__ import annotations

import hashlib
from pathlib import Path

import swarmer


def sources_sha256() -> str:
    """Of every file of the package, with its name."""
    home, digest = Path(swarmer.__file__).parent, hashlib.sha256()
    for path in sorted(home.rglob("*.py")):
        digest.update(path.relative_to(home).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
