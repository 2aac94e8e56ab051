"""How the cost of a display grows with its FLSs, and how many hosts that asks for: docs/scaling.md.

`scaling_page.py --measure 1000 3000` runs formations in virtual time and keeps what was counted in
`scripts/scaling/measured.json`; without arguments the page is written from what is kept.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

PAGE = ROOT / "docs" / "scaling.md"
MEASURED = ROOT / "scripts" / "scaling" / "measured.json"


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--measure",
        dest="points",
        type=int,
        nargs="+",
        default=[],
        metavar="F",
        help="count formations of so many FLSs",
    )
    parser.add_argument("--policy", default="roster", help="thaw.policy (default roster)")
    options = parser.parse_args(arguments)
    for points in options.points:
        from scaling.measure import measure

        keep(f"{options.policy} {points}", measure(points, **{"thaw.policy": options.policy}))
    from scaling.page import page

    PAGE.write_text(page(kept()), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: written")
    return 0


def kept() -> dict[str, Any]:
    """What was counted so far, by policy and F."""
    return dict(json.loads(MEASURED.read_text("utf-8"))) if MEASURED.exists() else {}


def keep(key: str, one: dict[str, Any]) -> None:
    """Put one more beside what is kept."""
    everything = sorted(
        (kept() | {key: one}).items(), key=lambda pair: (pair[0].split()[0], pair[1]["points"])
    )
    MEASURED.write_text(json.dumps(dict(everything), indent=1) + "\n", encoding="utf-8")
    print(f"{key}: {one['cpu_s']} s of a core, thaws at {one['thaws_s']} s", flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
