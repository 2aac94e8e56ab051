"""`swarmer doctor`: what this machine can carry, and what to raise where it is too little."""

from __future__ import annotations

import json
import textwrap
from typing import TYPE_CHECKING, Any

import click

from swarmer.errors import RunFailed, SwarmerError

if TYPE_CHECKING:
    from swarmer.engines.doctor import Check
    from swarmer.engines.trial import Trial

OWN_LINE = {"free memory"}  # told in any case: it changes from hour to hour
COLOURS = {"ok": "green", "warn": "yellow", "fail": "red"}


@click.command("doctor")
@click.option("--quick", is_flag=True, help="Leave out the trial run of some seconds, and so the estimates.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def command(quick: bool, as_json: bool) -> None:
    """Tell what this machine can carry: limits, kernel, a trial run of some seconds, the largest shape at time scale 1.

    A warning marks what is too little for 2000 FLSs, and says what to raise. The exit status is 0 if a run of the
    dragon (760 FLSs) is possible, else 1. With --quick everything that was looked at has a line.
    """
    from swarmer.engines import doctor
    from swarmer.engines.limits import available_mb

    if not doctor.is_linux():
        elsewhere(doctor.possible_engines(), as_json)
    checks = doctor.all_checks()
    if not as_json:
        show_checks(checks, every=quick)
    trial, trouble = (None, "") if quick else try_trial(as_json)
    failed = next((check for check in checks if check.mark == "fail"), None)
    possible = failed is None and not trouble
    if as_json:
        click.echo(json.dumps(as_data(checks, trial, possible, trouble), allow_nan=False))
    elif trial is not None:
        show_trial(trial, available_mb())
    if failed is not None:
        raise RunFailed(
            f"no run of the dragon is possible here: {failed.name}: {failed.found}; {failed.advice}"
        )
    if trouble:
        raise RunFailed(trouble)
    if not as_json:
        warned = sum(check.mark == "warn" for check in checks)
        click.echo("A run of the dragon is possible" + (f"; {warned} warnings above." if warned else "."))


def elsewhere(engines: list[str], as_json: bool) -> None:
    """Not on Linux: say what works there. Raises RunFailed: the dragon needs the process engine by default."""
    import platform

    names = ", ".join(engines) or "none of this version's"
    if as_json:
        click.echo(
            json.dumps({"format": 1, "dragon": False, "system": platform.system(), "engines": engines})
        )
    raise RunFailed(
        f"the engine `process` needs Linux, and this is {platform.system()}; engines that work here: {names}"
    )


def try_trial(as_json: bool) -> tuple[Trial | None, str]:
    """The trial, or why there is none."""
    from swarmer.engines.trial import POINTS, RUN_S, run_trial

    if not as_json:
        click.echo(f"starting {POINTS} FLSs for {RUN_S:g} s ...", err=True)
    try:
        return run_trial(), ""
    except SwarmerError as error:
        return None, str(error)


def as_data(checks: list[Check], trial: Trial | None, possible: bool, trouble: str) -> dict[str, Any]:
    """What `--json` prints."""
    from swarmer.engines import doctor
    from swarmer.engines.limits import available_mb

    data: dict[str, Any] = {
        "format": 1,
        "dragon": possible,
        "engines": doctor.possible_engines(),
        "checks": [check._asdict() for check in checks],
        "trial": None,
        "estimate": None,
        "trouble": trouble or None,
    }
    if trial is not None:
        from swarmer.engines.trial import SHAPES

        data["trial"] = trial.as_data()
        data["estimate"] = {
            "largest_at_time_scale_1": trial.largest(available_mb()),
            "time_scale": {str(points): round(trial.scale_for(points), 3) for points in SHAPES},
        }
    return data


def show_checks(checks: list[Check], every: bool) -> None:
    """The table of what was looked at, and below each warning what to do. every: a line also for each that is fine."""
    fine = [] if every else [check for check in checks if check.mark == "ok" and check.name not in OWN_LINE]
    lines = [check for check in checks if check not in fine]
    wide = max(len(check.name) for check in lines)
    for check in lines:
        mark = click.style(f"{check.mark:4}", fg=COLOURS.get(check.mark))
        click.echo(f"{mark}  {check.name:{wide}}  {check.found}")
        if check.advice:
            click.echo(f"{'':4}  {'':{wide}}  -> {check.advice}")
    if fine:
        names = textwrap.wrap(", ".join(check.name for check in fine), 74)
        mark = click.style("ok  ", fg=COLOURS["ok"])
        click.echo(f"{mark}  " + "\n      ".join(names))


def show_trial(trial: Trial, free_mb: float | None) -> None:
    """What was measured, and what follows."""
    from swarmer.engines.trial import BURST, BUSY_MAX, SHAPES

    rows = [
        ("launch", f"{trial.launch_s:.2f} s, {trial.fork_ms:.1f} ms for each FLS more"),
        ("all woken at once", f"the last 1 % after {trial.wake_p99_ms:.1f} ms"),
        ("messages in the run", f"handled at most {trial.handled_p99_ms:.1f} ms late (p99)"),
        (
            "an FLS takes",
            f"{trial.memory_mb:.1f} MB of its own, {trial.cpu_ms:.1f} ms of {trial.cores} cores an emulated second",
        ),
    ]
    show_rows(f"trial run, {trial.points} FLSs at time scale 1", rows)
    rows = [("at time scale 1", f"up to some {rounded(trial.largest(free_mb))} FLSs")]
    rows += [(f"{points} FLSs", f"time scale {trial.scale_for(points):.2f}") for points in SHAPES]
    show_rows("estimate of what runs faithfully here", rows)
    click.echo(
        f"      faithful: {BURST:g} wake-ups, or the trial's lateness, within {trial.lease_ms / 2:g} ms, on "
        f"{BUSY_MAX:.0%} of the cores;\n"
        "      what else runs counts against it; `--time-scale auto` finds out by itself"
    )


def show_rows(title: str, rows: list[tuple[str, str]]) -> None:
    """A small table under a title."""
    click.echo(f"\n{title}")
    wide = max(len(name) for name, _ in rows)
    for name, text in rows:
        click.echo(f"      {name:{wide}}  {text}")


def rounded(count: int) -> int:
    """To two digits: it is an estimate."""
    step = int(10 ** max(0, len(str(count)) - 2))
    return count // step * step
