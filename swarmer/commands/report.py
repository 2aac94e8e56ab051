"""`swarmer report RUN...`: one HTML file about runs."""

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
    """Write one self-contained HTML file about a run: figures, numbers, settings, how to reproduce it.

    Several runs are compared side by side. Works on a run that was killed, too: it shows what is whole and names the
    rest. The last line of stdout is the file's path.
    """
    with ends_at_once():
        from swarmer.observe.report import write_report

    click.echo(str(write_report(list(runs), out)))
