"""`swarmer replay RUN`: a recorded run in the desktop viewer, on a local page, or in the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from swarmer.commands.numbers import Finite

if TYPE_CHECKING:
    from swarmer.observe.saved_run import SavedRun

CUT = "the run did not close its recording: it was killed, or still goes on; this is what is whole"


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
    type=Finite(0.01, 1000),
    default=1.0,
    show_default=True,
    help="With --terminal: emulated seconds per second.",
)
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    help="With --web: of the page. [default: 9090, or a free one if that is taken]",
)
@click.pass_context
def command(
    context: click.Context, run: Path, again: bool, web: bool, terminal: bool, speed: float, port: int | None
) -> None:
    """Play a recorded run: in rerun's desktop viewer, or as the options say.

    A run that was killed, or still goes on, is played as far as it is whole. In the terminal: space pauses, the arrows
    go back and forth, a and d turn, q ends. --again plays nothing: it proves that a run of the virtual engine is what
    its seed and its settings make of it, and ends with status 1 if it is not.
    """
    from swarmer.observe.saved_run import check_run_directory, newer_in

    if web + terminal + again > 1:
        raise click.UsageError("--web and --terminal are two ways to watch, --again runs anew; choose one")
    for name, wanted, chosen in (("speed", "terminal", terminal), ("port", "web", web)):
        if not chosen and context.get_parameter_source(name) is not ParameterSource.DEFAULT:
            raise click.UsageError(f"--{name} is of --{wanted}, which was not asked for")
    if again:
        from swarmer.commands.again import run_again

        run_again(run)
        return
    check_run_directory(run)
    for line in newer_in(run):
        click.echo(f"note: {line}", err=True)
    if terminal:
        _play_in_terminal(run, speed)
    elif web:
        _serve(run, port)
    else:
        _show(run)


def _play_in_terminal(run: Path, speed: float) -> None:
    import os
    import sys

    from swarmer.errors import BadInput
    from swarmer.observe.report_drawing import clock_of
    from swarmer.observe.saved_run import load
    from swarmer.observe.terminal_player import play, stills
    from swarmer.observe.terminal_screen import Screen
    from swarmer.observe.terminal_view import Means, means_of

    saved = load(run)
    for line in saved.missing:
        if line.startswith("timeline"):
            click.echo(f"note: {line}", err=True)
    if saved.timeline is None or not len(saved.timeline.t_s):
        raise BadInput("run", str(run), "it has no timeline that can be read" + _instead(saved, "--web"))
    unit = clock_of(saved)
    if not sys.stdout.isatty() or os.environ.get("TERM", "dumb") == "dumb":
        stills(saved.timeline, sys.stdout, Means(braille=means_of(sys.stdout).braille), unit=unit)
        return
    with Screen.standard() as screen:
        play(saved.timeline, screen, speed, means_of(sys.stdout), f"{saved.name}: {saved.shape}", unit=unit)


def _instead(saved: SavedRun, way: str) -> str:
    """What else to try, if there is anything else to show."""
    there = saved.timeline is not None if way == "--terminal" else saved.recording() is not None
    return f"; try {way}" if there else ", nor anything else that can be played"


def _recording(run: Path) -> Path:
    """The recording, whole or partial. Raises BadInput where there is none."""
    from swarmer.errors import BadInput
    from swarmer.observe.recording_file import is_whole
    from swarmer.observe.run_directory import RECORDING
    from swarmer.observe.saved_run import existing, load

    path = existing(run, RECORDING)
    if path is None or not path.is_file():
        why = "it has no recording (was it run with --no-recording?)"
        raise BadInput("run", str(run), why + _instead(load(run), "--terminal"))
    if path.stat().st_size == 0:
        raise BadInput("run", str(run), "its recording is empty" + _instead(load(run), "--terminal"))
    if not is_whole(path):
        click.echo(f"note: {CUT}", err=True)
    return path


def _show(run: Path) -> None:
    """The desktop viewer, until it is closed."""
    from swarmer.errors import RunFailed
    from swarmer.observe.recording_file import readable
    from swarmer.observe.viewer import display_available, free_port, native_command
    from swarmer.observe.viewer_process import end, start

    path = _recording(run)
    if not display_available():
        raise RunFailed(
            "there is no display for the desktop viewer; use `swarmer replay --web` or `--terminal`"
        )
    _leave_on_sigterm()
    with readable(path) as file:
        viewer = start(native_command((file,), free_port()), quiet=False)
        try:
            status = viewer.wait()
        finally:
            end(viewer)
    if status:
        raise RunFailed(
            f"the viewer ended with status {status}; `swarmer replay --web` or `--terminal` may do better"
        )


def _serve(run: Path, port: int | None) -> None:
    """The page, until Ctrl-C or SIGTERM."""
    from swarmer.observe.recording_file import is_whole, readable
    from swarmer.observe.replay_server import bound_server, page_files, viewer_files

    path = _recording(run)
    _leave_on_sigterm()
    note = "" if is_whole(path) else CUT
    with readable(path) as file, bound_server(file, port) as server:
        server.files = {**page_files(run.resolve().name, note), **viewer_files()}
        try:
            _tell_where(server.address)
            server.serve_forever()
        except KeyboardInterrupt:
            return  # how one ends a page


def _tell_where(address: str) -> None:
    from swarmer.observe.viewer import display_available

    click.echo(f"open {address}")
    if not display_available():
        port = address.rstrip("/").rpartition(":")[2]
        click.echo(
            f"from another machine: ssh -L {port}:127.0.0.1:{port} HOST, and open the same there", err=True
        )
    click.echo("Ctrl-C ends it", err=True)


def _leave_on_sigterm() -> None:
    """From here on SIGTERM leaves in order: what was started ends with us."""
    import signal
    import sys

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
