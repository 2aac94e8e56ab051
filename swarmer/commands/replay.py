"""`swarmer replay RUN`: a recorded run in the desktop viewer, on a local page, or in the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

if TYPE_CHECKING:
    from swarmer.observe.saved_run import SavedRun


@click.command("replay")
@click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
@click.option(
    "--again",
    is_flag=True,
    help="Make a run of the virtual engine once more; it must be the same to the last event.",
)
@click.option("--web", is_flag=True, help="Serve a page on this machine, 127.0.0.1 alone; needs no internet.")
@click.option("--terminal", is_flag=True, help="Play in this terminal; piped, a few still pictures.")
@click.option(
    "--speed",
    type=click.FloatRange(0.01, 1000),
    default=1.0,
    show_default=True,
    help="With --terminal: emulated seconds per second.",
)
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=9090,
    show_default=True,
    help="With --web: of the page, or the next free one.",
)
@click.pass_context
def command(
    context: click.Context, run: Path, again: bool, web: bool, terminal: bool, speed: float, port: int
) -> None:
    """Play a recorded run: in rerun's desktop viewer, or as the options say.

    A recording that was cut short is played as far as it is whole. --again plays nothing: it proves that a run of the
    virtual engine is what its seed and its settings make of it, and ends with status 1 if it is not.
    """
    from swarmer.observe.saved_run import check_run_directory, load

    if web + terminal + again > 1:
        raise click.UsageError("--web and --terminal are two ways to watch, --again runs anew; choose one")
    for name, wanted, chosen in (("speed", "terminal", terminal), ("port", "web", web)):
        if not chosen and context.get_parameter_source(name) is not ParameterSource.DEFAULT:
            raise click.UsageError(f"--{name} is of --{wanted}, which was not asked for")
    if again:
        from swarmer.commands.again import run_again

        run_again(run)
        return
    if terminal:
        saved = load(run)
        _tell(saved)
        _play_in_terminal(saved, speed)
        return
    check_run_directory(run)
    if web:
        _serve(_recording(run), port)
    else:
        _show(_recording(run))


def _tell(saved: SavedRun) -> None:
    """What of the timeline is not there, on stderr."""
    for line in saved.missing:
        if line.startswith("timeline"):
            click.echo(f"note: {line}", err=True)


def _play_in_terminal(saved: SavedRun, speed: float) -> None:
    import shutil
    import sys

    from swarmer.errors import BadInput
    from swarmer.observe.terminal_player import play, stills

    if saved.timeline is None or not len(saved.timeline.t_s):
        raise BadInput(
            "run", str(saved.path), "it has no timeline that can be read; is there a recording? try --web"
        )
    if sys.stdout.isatty():
        size = shutil.get_terminal_size()
        play(saved.timeline, sys.stdout, speed, size.columns, size.lines)
    else:
        stills(saved.timeline, sys.stdout)


def _recording(run: Path) -> Path:
    """The recording as far as it is whole. Raises BadInput where there is none."""
    from swarmer.errors import BadInput
    from swarmer.observe.files import PARTIAL
    from swarmer.observe.run_directory import RECORDING
    from swarmer.observe.saved_run import existing

    path = existing(run, RECORDING)
    if path is None:
        raise BadInput(
            "run", str(run), "it has no recording (was it run with --no-recording?); try --terminal"
        )
    if path.stat().st_size == 0:
        raise BadInput("run", str(run), "its recording is empty; try --terminal")
    if path.name.endswith(PARTIAL):
        click.echo("note: the run ended before its recording was closed; playing what is whole", err=True)
    return path


def _show(path: Path) -> None:
    """The desktop viewer, until it is closed."""
    import subprocess

    from swarmer.errors import RunFailed
    from swarmer.observe.viewer import display_available, free_port, native_command, playable

    if not display_available():
        raise RunFailed(
            "there is no display for the desktop viewer; use `swarmer replay --web` or `--terminal`"
        )
    with playable(path) as file:
        status = subprocess.run(native_command((file,), free_port()), check=False).returncode
    if status:
        raise RunFailed(
            f"the viewer ended with status {status}; `swarmer replay --web` or `--terminal` may do better"
        )


def _serve(path: Path, port: int) -> None:
    """The web viewer, until Ctrl-C or SIGTERM."""
    import signal
    import subprocess
    import sys

    from swarmer.errors import RunFailed
    from swarmer.observe.viewer import answers, free_port, playable, web_address, web_command

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # the server ends with us
    grpc, page = free_port(), free_port(port)
    with playable(path) as file:
        server = subprocess.Popen(
            web_command((file,), grpc, page), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            if not answers(page, 30.0):
                raise RunFailed("the page did not come up; `swarmer replay --terminal` needs nothing")
            click.echo(f"open {web_address(grpc, page)}")
            click.echo("Ctrl-C ends it", err=True)
            if server.wait():
                raise RunFailed(f"the viewer's server ended with status {server.returncode}")
        except KeyboardInterrupt:
            return  # how one ends a page
        finally:
            server.terminate()
            server.wait()
