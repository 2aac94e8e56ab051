"""`swarmer compare`: contenders on the same shapes and seeds; a table, and which is better where a test says so."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmer.commands.run import directory_named
from swarmer.commands.sweep import MANY, MANY_LISTED, make, place_of, tell, tell_notes
from swarmer.errors import BadInput, RunFailed
from swarmer.interrupts import ends_at_once

if TYPE_CHECKING:
    from swarmer.experiments.experiment import Experiment
    from swarmer.experiments.runs import Run
    from swarmer.experiments.sweep import Place

PAGE, PAIRS, FIGURES = "comparison.md", "pairs.csv", "figures"
WIDTH = 110  # of what is said, where there is no terminal


@click.command("compare")
@click.argument("file", required=False)
@click.option("--technique", "techniques", multiple=True, metavar="NAME,...", help="Techniques; may be repeated. One alone competes with those that the engine has. [default: these]")  # fmt: skip
@click.option("--shape", "shapes", multiple=True, metavar="NAME|FILE,...", help="Shapes; may be repeated. [default: dragon]")  # fmt: skip
@click.option("--engine", "engines", multiple=True, metavar="NAME,...", help="Engines. [default: the fastest that there is]")  # fmt: skip
@click.option("--vary", multiple=True, metavar="KEY=VALUE,...", help="Values of any setting, as epsilon_deg=1,3,5; may be repeated.")  # fmt: skip
@click.option("--between", multiple=True, metavar="KEY,...", help="The settings whose values compete; all others that vary are conditions. [default: technique, else engine, else the first of --vary]")  # fmt: skip
@click.option("--measure", "measures", multiple=True, metavar="COLUMN,...", help="Columns of results.csv to compare by, less is better. [default: HD, time to HD < 0.09, distance, datagrams]")  # fmt: skip
@click.option("--seeds", metavar="N|LIST", help="A count, or numbers with commas between, as 3,7. [default: 10]")  # fmt: skip
@click.option("--duration", "duration_s", metavar="S", help="Length of each run, emulated seconds.")
@click.option("--rounds", "rounds", metavar="N", help="Rounds of each run at most, with the engine rounds.")
@click.option("--points", metavar="N", help="Sample exactly N points of each shape.")
@click.option("--config", metavar="FILE", help="Settings of all runs: a YAML file, or a preset.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="A setting of all runs; may be repeated.")  # fmt: skip
@click.option("--out", metavar="DIR", help="The directory. Named again, it is gone on with. [default: runs/compare-...]")  # fmt: skip
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="N", help="Runs at a time. [default: one for each core]")  # fmt: skip
@click.option("--dry-run", is_flag=True, help="List the runs, one a line, and make none.")
@click.option("--yes", is_flag=True, help=f"Go on even if these are more than {MANY} runs.")
def command(
    file: str | None,
    techniques: tuple[str, ...],
    shapes: tuple[str, ...],
    engines: tuple[str, ...],
    vary: tuple[str, ...],
    between: tuple[str, ...],
    measures: tuple[str, ...],
    seeds: str | None,
    config: str | None,
    overrides: tuple[str, ...],
    out: str | None,
    jobs: int | None,
    dry_run: bool,
    yes: bool,
    **settings: str | None,
) -> None:
    """Compare techniques, engines or settings on the same shapes and seeds.

    Every combination is run with every seed, on all cores; started again, what is missing is made. FILE, in place of the
    options that say what is compared, is an experiment file or the name of one that ships. The directory, whose path is
    the last line of stdout, gets results.csv, pairs.csv, comparison.md and figures.
    """
    with ends_at_once():
        from swarmer.experiments.comparison import check_measures
        from swarmer.experiments.contest import split
        from swarmer.experiments.runs import asked_of, check_plans, expand, size

        directory = directory_named(out)
        asked = {
            "--technique": techniques, "--shape": shapes, "--engine": engines, "--vary": vary, "--config": config,
        } | {f"--{name.removesuffix('_s')}": value for name, value in settings.items()}  # fmt: skip
        experiment, home = _experiment(file, asked, overrides, seeds)
        most = MANY_LISTED if dry_run else MANY
        if size(experiment) > most and not yes:
            raise BadInput.saying(
                f"compare: these are {size(experiment):,} runs; more than {most:,} need --yes"
            )
        runs = expand(experiment)
        check_between(experiment, runs, split(between))
        check_measures(split(measures))
        tell_notes(check_plans(runs, experiment.file, asked_of(experiment)))
        if dry_run:
            for run in runs:
                click.echo(run.path.as_posix())
            return
    carry_out(experiment, runs, directory or home, place_of(jobs), split(between), split(measures))


def _experiment(
    file: str | None, asked: dict[str, Any], overrides: tuple[str, ...], seeds: str | None
) -> tuple[Experiment, Path]:
    """What is to be run, and the directory that it has unless the user names one. Raises BadInput."""
    from swarmer.experiments.contest import contest, split
    from swarmer.experiments.experiment import find_experiment, read_experiment
    from swarmer.experiments.sweep_directory import home_of
    from swarmer.observe.run_directory import ROOT

    if file is not None:
        if given := [name for name, value in asked.items() if value]:
            raise BadInput.saying(
                f"{given[0]}: not beside FILE, which says what is compared; --set changes a setting"
            )
        return home_of(read_experiment(file, overrides, seeds), find_experiment(file))
    more = [f"{name}={value}" for name, value in (
        ("duration_s", asked["--duration"]), ("rounds.max_rounds", asked["--rounds"]), ("points", asked["--points"]),
    ) if value is not None]  # fmt: skip
    experiment = contest(
        split(asked["--technique"]), split(asked["--shape"]), split(asked["--engine"]), asked["--vary"],
        asked["--config"], [*more, *overrides], seeds,
    )  # fmt: skip
    return experiment, ROOT / experiment.name


def check_between(experiment: Experiment, runs: list[Run], between: list[str]) -> None:
    """Raises BadInput before anything runs if nothing competes, or what is named does not vary."""
    from swarmer.experiments.comparison import chosen
    from swarmer.experiments.runs import varied_names

    flat = [run.config.flat() for run in runs]
    varied = [name for name in varied_names(experiment) if len({str(one[name]) for one in flat}) > 1]
    chosen(between, varied)


def carry_out(
    experiment: Experiment,
    runs: list[Run],
    out: Path,
    where: AbstractContextManager[Place],
    between: list[str],
    measures: list[str],
) -> None:
    """Make the runs, compare them, write and print what comes of it. Raises RunFailed, KeyboardInterrupt."""
    with ends_at_once():
        from swarmer.experiments.comparison import compare
        from swarmer.experiments.comparison_figures import draw
        from swarmer.experiments.results import RESULTS
        from swarmer.experiments.tables import aligned, unfaithful
        from swarmer.experiments.verdicts import (
            limit_lines,
            markdown,
            method_lines,
            pairs_csv,
            statements,
            table_rows,
        )
        from swarmer.observe.files import write_text
        from swarmer.observe.words import columns_of, wrapped

    ended = make(experiment, runs, out, where)
    if len(ended.failures) == ended.total:
        tell(ended, out)
    comparison = compare(out / RESULTS, between, measures)
    write_text(out / PAIRS, pairs_csv(comparison))
    write_text(out / PAGE, markdown(comparison, experiment.name))
    try:
        draw(comparison, out / RESULTS, out / FIGURES)
    except OSError as error:
        raise RunFailed(f"cannot write {out / FIGURES}: {error.strerror}") from error
    for line in [*aligned(table_rows(comparison)), ""]:
        click.echo(line)
    limits = [
        line for limit in limit_lines(comparison) for line in (limit, "")
    ]  # first: what follows shows nothing
    for line in [*limits, *statements(comparison, only_first=True), "", *method_lines(comparison)]:
        for part in wrapped(line, columns_of(sys.stdout, WIDTH)):
            click.echo(part)
    if late := unfaithful(out / RESULTS):
        click.echo(f"note: {late} runs are not faithful", err=True)
    click.echo(str(out))
    tell(ended, out)
