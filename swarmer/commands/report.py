"""`swarmer report RUN...`: one HTML file about runs, or about a sweep."""

from __future__ import annotations

from pathlib import Path

import click

from swarmer.interrupts import ends_at_once


@click.command("report")
@click.argument("runs", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The file to write. [default: RUN/report.html; of several runs ./report.html]",
)
def command(runs: tuple[Path, ...], out: Path | None) -> None:
    """Write one self-contained HTML file about a run: a verdict, the display through time, figures with their data,
    numbers, settings, how to reproduce it. It needs no network.

    Several runs are compared: those that differ in nothing but their seed are drawn as their mean with its 95 %
    interval. The directory of a sweep gives a report over its cells. Works on a run that was killed, too: it shows what
    is whole and names the rest. Beside the report of a run made with --trace it writes cause.html: why HD rose, and the
    story of any FLS. The last line of stdout is the report's path.
    """
    with ends_at_once():
        from swarmer.experiments.sweep_report import is_sweep, write_sweep_report
        from swarmer.observe.report import write_report

    if len(runs) == 1 and is_sweep(runs[0]):
        click.echo(str(write_sweep_report(runs[0], out)))
    else:
        click.echo(str(write_report(list(runs), out)))
