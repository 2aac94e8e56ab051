"""Make the paper's figures again, quickly, and say how far they agree: `make paper`.

Runs the experiments of `configs/experiments` that a figure or a table of the paper belongs to, with few seeds, and
writes `docs/paper.md`: figure by figure, the paper's number, ours with its interval, whether they agree, and why not.
Started again it repeats nothing. The same files with their own 20 seeds are `swarmer sweep NAME`.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import textwrap
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from paper.agreement import Found, judge  # noqa: E402
from paper.claims import CLAIMS, EMULATOR, QUICK, SMALL, TEXT, TEXT_ERROR, Claim, Order  # noqa: E402

from swarmer.engines.limits import cores  # noqa: E402
from swarmer.experiments.board import Board  # noqa: E402
from swarmer.experiments.experiment import Experiment, experiment_of, find_experiment  # noqa: E402
from swarmer.experiments.runs import expand, spelled  # noqa: E402
from swarmer.experiments.sweep import ThisMachine, sweep  # noqa: E402

PAGE = ROOT / "docs" / "paper.md"
TOO_FEW = "the interval holds the paper's value: more seeds would tell"
PROGRAM, THE_TEXT = "authors_code", "paper"


def main(arguments: list[str]) -> int:
    """The exit status: 1 if runs have failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--out", type=Path, default=ROOT / "runs" / "paper", metavar="DIR", help="default: runs/paper"
    )
    parser.add_argument("--jobs", type=int, default=cores(), metavar="N", help="default: one for each core")
    parser.add_argument(
        "--only", nargs="*", metavar="NAME", help="experiments to run; the page has what is there"
    )
    options = parser.parse_args(arguments)
    began, failed = time.monotonic(), 0
    for name in QUICK if options.only is None else options.only:
        for preset in presets(name):
            experiment = quick(name, preset)
            out = home(options.out, name, preset)
            ended = sweep(experiment, expand(experiment), out, ThisMachine(options.jobs), Board())
            failed += len(ended.failures)
    PAGE.write_text(page(options.out), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: written, after {time.monotonic() - began:.0f} s; {failed} runs failed")
    return 1 if failed else 0


def presets(name: str) -> tuple[str, ...]:
    """Whose rules an experiment is run by: those of its file, and of some those of the text."""
    return (PROGRAM, THE_TEXT) if name in TEXT else (PROGRAM,)


def home(out: Path, name: str, preset: str) -> Path:
    return out / (name if preset == PROGRAM else f"{name}-by-the-text")


def quick(name: str, preset: str) -> Experiment:
    """The experiment with few seeds and the values of its grid that the page asks for."""
    seeds, values, overrides = QUICK[name]
    whole = yaml.safe_load(find_experiment(name).read_text("utf-8"))
    if preset == THE_TEXT:
        whole["base"]["extends"] = THE_TEXT
    forced = {one.partition("=")[0] for one in overrides}
    for name_ in forced:
        whole["base"].pop(name_, None)
    experiment = experiment_of(whole, f"{name}.yaml", name, overrides, seeds)
    blocks = tuple(
        dataclasses.replace(block, grid={
            setting: tuple(one for one in has if spelled(one) in values.get(setting, (spelled(one),)))
            for setting, has in block.grid.items()
        })
        for block in experiment.blocks
    )  # fmt: skip
    return dataclasses.replace(experiment, blocks=blocks)


def page(out: Path) -> str:
    """The whole page."""
    found = [(claim, *(judge(claim, home(out, claim.experiment, preset)) for preset in (PROGRAM, THE_TEXT)))
             for claim in CLAIMS]  # fmt: skip
    judged = [(claim, ours) for claim, ours, _ in found if ours is not None]
    agree = sum(ours.agrees for _, ours in judged)
    parts = [
        "<!-- made by `make paper`; do not edit -->",
        "# The paper's figures, made again",
        f"{agree} of {len(judged)} figures, orders and numbers of the SwarMer paper agree with ours. A "
        "disagreement is a finding; what is known of it stands beside it.",
        "This is the quick version, a few seeds each, which `make paper` makes in some minutes and writes here. "
        "With 20 seeds: `swarmer sweep NAME`, for each experiment in `configs/experiments`. Which of two is "
        "better, with a test: `swarmer compare NAME`.",
        "*Ours* is a mean with a bootstrap interval of 95 % (with fewer than 6 seeds Student's t, with one none),"
        " the number of seeds in brackets; of an order both means, and on how many seeds it holds. What a run may"
        " never reach is a median.",
        "A number *agrees* if ours lies in the band that is accepted for it; an order if a paired test shows it, "
        "or with too few seeds for a test if every seed has it.",
        "The paper's figures come from the authors' program, whose rules are not those of its text: "
        "`authors_code` here. Where that matters the text's rules stand beside it (`paper`). They differ most in the "
        "error of a flight in 3D: in the text it lies in a random plane and on both sides, in the program in one plane "
        "that the vector fixes, and on one side of it.",
        "## The rounds simulator",
        _table([entry for entry in found if entry[0] in SMALL], True),
        "## The emulator",
        "By the paper's rules, in virtual time. The paper shows curves without numbers: its words stand for them.",
        _table([entry for entry in found if entry[0] in EMULATOR], False),
        "## What is quick about it",
        "The seeds, the values of what varies where the file has more, and settings in place of the file's.",
        _reduced(),
    ]
    wrapped = (part if part.startswith(("|", "<", "#")) else textwrap.fill(part, 118) for part in parts)
    return "\n\n".join(wrapped).replace("-->\n\n", "-->\n") + "\n"


def _table(found: list[tuple[Claim | Order, Found | None, Found | None]], both: bool) -> str:
    titles = ["figure", "of", "quantity", "paper", "band", "ours", "agrees"]
    titles += ["by the text", "agrees", "why"] if both else ["why"]
    rows = [titles, ["---"] * len(titles)]
    for claim, ours, text in found:
        if ours is None and text is None:
            continue
        where = ", ".join(f"{_short(name)} {value}" for name, value in claim.where.items())
        said = [claim.figure, where or "–", claim.words, *_paper(claim), *_ours(ours)]
        rows.append([*said, *(_ours(text) if both else ()), _why(claim, ours, text)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _reduced() -> str:
    """What the quick version leaves out of each experiment's file."""
    rows = [["experiment", "seeds", "values", "in place of the file's"], ["---"] * 4]
    for name, (seeds, values, overrides) in sorted(QUICK.items()):
        kept = "; ".join(f"`{setting}` {', '.join(some)}" for setting, some in values.items())
        rows.append([f"`{name}`", seeds, kept, ", ".join(f"`{one}`" for one in overrides)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _why(claim: Claim | Order, ours: Found | None, text: Found | None) -> str:
    """What is known of a disagreement, and of one by the rules of the text."""
    known = []
    if ours is not None and not ours.agrees:
        number = claim.paper if isinstance(claim, Claim) and not isinstance(claim.paper, str) else math.nan
        known.append(claim.why or (TOO_FEW if ours.low <= number <= ours.high else ""))
    if text is not None and not text.agrees:
        known.append(TEXT_ERROR)
    return "; ".join(one for one in known if one)


def _short(name: str) -> str:
    return {"epsilon_deg": "ε", "m": "M", "lambda_ms": "λ"}.get(name, name.rpartition(".")[2])


def _paper(claim: Claim | Order) -> tuple[str, str]:
    if isinstance(claim, Order):
        return "yes", ""
    low, high = claim.band
    band = f"{low:g} or more" if high >= 1e9 else f"{_plain(low)} to {_plain(high)}"
    return claim.paper if isinstance(claim.paper, str) else f"{claim.paper:,g}", band


def _plain(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def _ours(found: Found | None) -> tuple[str, str]:
    if found is None:
        return "", ""
    return found.ours, "yes" if found.agrees else "**no**"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
