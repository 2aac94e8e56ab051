"""`swarmer sweep`: an experiment file's runs on this machine's cores or a cluster's, and one table of them."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmer.commands.run import directory_named
from swarmer.errors import BadInput, RunFailed
from swarmer.interrupts import ends_at_once

if TYPE_CHECKING:
    from swarmer.experiments.experiment import Experiment
    from swarmer.experiments.runs import Run
    from swarmer.experiments.sweep import Ended, Place

LOCAL = "local"  # a Ray of our own
MANY = 3000  # runs; more are refused without --yes
MANY_LISTED = 100_000  # so are more than these with --dry-run
NOTES_SHOWN = 10


@click.command("sweep")
@click.argument("file")
@click.option("--out", metavar="DIR", help="The sweep's directory. Named again, it is gone on with. [default: runs/EXPERIMENT, or where FILE is, if a sweep wrote it]")  # fmt: skip
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="N", help="Runs at a time. [default: one for each core]")  # fmt: skip
@click.option("--ray", metavar="[ADDRESS]", is_flag=False, flag_value=LOCAL, help="Make the runs on Ray: one started here, or that at ADDRESS, HOST:PORT, or auto for the one this machine is part of.")  # fmt: skip
@click.option("--seeds", metavar="N|LIST", help="In place of the file's: a count, or numbers with commas between, as 3,7.")  # fmt: skip
@click.option(
    "--small", is_flag=True, help="The small version that the file has of the experiment, for a laptop."
)
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="A setting of every run, in place of the file's base; may be repeated.")  # fmt: skip
@click.option("--dry-run", is_flag=True, help="List the runs, one a line, and make none.")
@click.option("--yes", is_flag=True, help=f"Go on even if these are more than {MANY} runs.")
def command(
    file: str,
    out: str | None,
    jobs: int | None,
    ray: str | None,
    seeds: str | None,
    small: bool,
    overrides: tuple[str, ...],
    dry_run: bool,
    yes: bool,
) -> None:
    """Make the runs of an experiment: every combination of its grid's values with every seed.

    FILE is a YAML file, or the name of an experiment that ships. It holds base (settings), grid (setting: list of
    values) and seeds (a count or a list); also list (combinations), random or latin_hypercube (samples). Each run has a directory of its own; results.csv has a row for each.
    Started again, a sweep makes what is missing and repeats nothing. The last line of stdout is its directory.
    """
    with ends_at_once():
        from swarmer.experiments.experiment import find_experiment, read_experiment
        from swarmer.experiments.runs import asked_of, check_plans, expand, size
        from swarmer.experiments.sweep_directory import home_of

        directory = directory_named(out)
        experiment = read_experiment(file, overrides, seeds, small)
        experiment, home = home_of(experiment, find_experiment(file))
        most = MANY_LISTED if dry_run else MANY
        if size(experiment) > most and not yes:
            raise BadInput.saying(
                f"{experiment.file}: stands for {size(experiment):,} runs; more than {most:,} need --yes"
            )
        runs = expand(experiment)
        tell_notes(check_plans(runs, experiment.file, asked_of(experiment)))
        if dry_run:
            for run in runs:
                click.echo(run.path.as_posix())
            return
    carry_out(experiment, runs, directory or home, place_of(jobs, ray))


def tell_notes(notes: list[str]) -> None:
    """What is to be known of the settings, on stderr, once for all runs."""
    more = [f"and {len(notes) - NOTES_SHOWN} more of this kind"] if len(notes) > NOTES_SHOWN else []
    for line in notes[:NOTES_SHOWN] + more:
        click.echo(f"note: {line}", err=True)


def place_of(jobs: int | None, ray: str | None = None) -> AbstractContextManager[Place]:
    """Where the runs are to be made: on this machine, or on Ray. Raises BadInput where there is no Ray."""
    with ends_at_once():
        from swarmer.engines.limits import cores
        from swarmer.experiments.sweep import ThisMachine

        if ray is not None:
            from swarmer.experiments.on_ray import OnRay

            return OnRay(ray, jobs)
    return contextlib.nullcontext(ThisMachine(jobs or cores()))


def carry_out(
    experiment: Experiment, runs: list[Run], out: Path, where: AbstractContextManager[Place]
) -> None:
    """Make them, print the table, and say what failed. Raises RunFailed, KeyboardInterrupt."""
    with ends_at_once():
        from swarmer.experiments.results import RESULTS
        from swarmer.experiments.tables import lines_of, unfaithful

    ended = make(experiment, runs, out, where)
    for line in lines_of(out / RESULTS):
        click.echo(line)
    if late := unfaithful(out / RESULTS):
        why = "this machine was too slow for them, or in virtual time the FLSs were"
        click.echo(f"note: {late} runs are not faithful: {why}", err=True)
    click.echo(str(out))
    tell(ended, out)


def make(experiment: Experiment, runs: list[Run], out: Path, where: AbstractContextManager[Place]) -> Ended:
    """Make what is missing of the runs; on Ctrl-C say where the rest is. Raises RunFailed, KeyboardInterrupt."""
    with ends_at_once():
        from swarmer.experiments.board import Board
        from swarmer.experiments.sweep import sweep

    try:
        with ctrl_c(), where as place:
            return sweep(experiment, runs, out, place, Board())
    except KeyboardInterrupt:
        click.echo(f"what is finished is in {out}; the same command goes on with the rest", err=True)
        click.echo(str(out))
        raise


def tell(ended: Ended, out: Path) -> None:
    """The last words. Raises RunFailed if a run has failed."""
    if ended.failures:
        run, outcome = ended.failures[0]
        raise RunFailed(
            f"{len(ended.failures)} of {ended.total} runs failed, the first {run.path} ({outcome.message}); "
            f"started again with --out {out} these are made anew"
        )


@contextlib.contextmanager
def ctrl_c() -> Iterator[None]:
    """What ends a terminal or a job ends the sweep as Ctrl-C does: in good order."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    heard = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]  # nohup stays nohup
    before = {number: signal.signal(number, interrupt) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
