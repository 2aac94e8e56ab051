"""The commands `swarmer` and `swarmer-run`: names them, imports each on use, and ends all of them alike.

Exit status: 0 done, 1 the run failed, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import atexit
import contextlib
import difflib
import errno
import gc
import importlib
import os
import select
import sys
from collections.abc import Callable
from typing import Any, NamedTuple, NoReturn

import click

from swarmer import __version__
from swarmer.errors import SwarmerError
from swarmer.interrupts import INTERRUPTED, in_order

DISK_FULL = {errno.ENOSPC, errno.EDQUOT}
MACHINE_ERRORS = DISK_FULL | {errno.EROFS, errno.EACCES, errno.EMFILE, errno.ENFILE, errno.ENOMEM}
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


Resolved = tuple[str | None, click.Command | None, list[str]]


class Lazy(NamedTuple):
    """A command that is imported when it is used; the help line stands here so that the list needs no import."""

    place: str  # module:attribute
    help: str


COMMANDS = {
    "run": Lazy("swarmer.commands.run:command", "Run a shape: deploy, localize, record."),
    "replay": Lazy(
        "swarmer.commands.replay:command",
        "Play a recorded run: viewer, web page, terminal, or made anew.",
    ),
    "report": Lazy("swarmer.commands.report:command", "Write one HTML file about one or more runs."),
    "explain": Lazy(
        "swarmer.commands.explain:command", "Tell what happened to an FLS or a datagram, and why."
    ),
    "shapes": Lazy("swarmer.commands.shapes:command", "List, show, check and make shapes."),
    "sweep": Lazy(
        "swarmer.commands.sweep:command", "Make the runs of an experiment file, and one table of them."
    ),
    "compare": Lazy(
        "swarmer.commands.compare:command", "Compare techniques, engines or settings, seed by seed."
    ),
    "simulate": Lazy(
        "swarmer.commands.simulate:command", "Look for what breaks: random worlds full of faults."
    ),
    "doctor": Lazy("swarmer.commands.doctor:command", "Tell what this machine can carry, and what to raise."),
}


class LazyGroup(click.Group):
    """A group that imports a command only to run it or to show its own help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names, in the order one meets them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """The command, imported now."""
        return load(name) if name in COMMANDS else None

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Resolved:
        """As click does it, with the names that might be meant."""
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            close = difflib.get_close_matches(args[0], COMMANDS, n=1)
            ctx.fail(f"no command '{args[0]}'" + (f"; did you mean '{close[0]}'?" if close else ""))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands, from the lines above."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, lazy.help) for name, lazy in COMMANDS.items()])


def load(name: str) -> click.Command:
    """Import a command by its name."""
    module, _, attribute = COMMANDS[name].place.partition(":")
    command: click.Command = getattr(importlib.import_module(module), attribute)
    return dressed(command)


def dressed(command: click.Command) -> click.Command:
    """The same command with what all commands have: -h, --version and a wide help."""
    command.context_settings = {**CONTEXT, **command.context_settings}
    if not any("--version" in parameter.opts for parameter in command.params):
        command = version_option(command)
    return command


version_option: Callable[[Any], Any] = click.version_option(
    __version__, "--version", prog_name="swarmer", message="%(prog)s %(version)s"
)


@click.group(cls=LazyGroup, context_settings=CONTEXT)
@version_option
def swarmer() -> None:
    """Decentralized localization of Flying Light Specks, emulated: one process per drone, over UDP.

    `swarmer COMMAND --help` tells more about a command. `swarmer-run` is `swarmer run`.
    """


class Forgiving:
    """stderr that may go away: what nobody reads any more must not end a run."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """As of the stream, and without its errors."""
        with contextlib.suppress(OSError, ValueError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """As of the stream, and without its errors."""
        with contextlib.suppress(OSError, ValueError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def stand_firm() -> None:
    """Begin with three open descriptors, or the next file opened would become stdout; and do not die of stderr."""
    for fd in range(3):
        try:
            os.fstat(fd)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number: this one
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 -- for as long as the process lives
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = Forgiving(sys.stderr)


def main() -> NoReturn:
    """The command `swarmer`."""
    leave(lambda: invoke(swarmer, "swarmer"))


def main_run() -> NoReturn:
    """The command `swarmer-run`."""
    leave(lambda: invoke(load("run"), "swarmer-run"))


def invoke(command: click.Command, name: str) -> object:
    """Run a command with this process's arguments, or complete them for a shell that asks."""
    variable = f"_{name.replace('-', '_')}_COMPLETE".upper()
    if variable in os.environ:
        from click.shell_completion import shell_complete

        return shell_complete(command, {}, name, variable, os.environ[variable])
    try:
        with command.make_context(name, sys.argv[1:]) as context:
            return command.invoke(context)
    except click.exceptions.Exit as done:  # --help, --version
        return done.exit_code


def leave(action: Callable[[], object]) -> NoReturn:
    """Do it, and end the process with the exit status and the one line that belong to how it went."""
    status: object = 0
    atexit.register(
        gc.freeze
    )  # what is left goes with the process; to search millions of objects took seconds
    try:
        in_order()
        stand_firm()
        status = action()
        sys.stdout.flush()
    except SwarmerError as error:
        fail(str(error), error.exit_status)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(error.exit_code)
    except click.ClickException as error:
        fail(usage_line(error), error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        fail("interrupted", INTERRUPTED)
    except OSError as error:
        if isinstance(error, BrokenPipeError) and reader_gone():
            os.dup2(
                os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
            )  # the flush at the end is quiet, too
            sys.exit(0)
        if error.errno not in MACHINE_ERRORS:
            raise
        where = error.filename or ("stdout" if error.errno in DISK_FULL else "this machine")
        fail(f"{where}: {error.strerror}", SwarmerError.exit_status)
    sys.exit(status if isinstance(status, int) else 0)


def usage_line(error: click.ClickException) -> str:
    """What click found wrong with the command line, on one line that says where to read on."""
    line = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    return f"{line}; see `{context.command_path} --help`" if context else line


def reader_gone() -> bool:
    """True if nobody reads stdout any more, as after `| head`: not a broken pipe of the run itself."""
    poll = select.poll()
    poll.register(sys.stdout, select.POLLERR)
    return any(event & select.POLLERR for _, event in poll.poll(0))


def fail(line: str, status: int) -> NoReturn:
    """One line on stderr, and the exit status."""
    click.echo(line if status == INTERRUPTED else f"error: {line}", err=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
