"""`swarmer explain RUN`: what happened to an FLS or to a datagram, from the run's event log; or a scenario played."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from swarmer.errors import BadInput, RunFailed

if TYPE_CHECKING:
    from swarmer.observe.trace_file import Record, TraceFile

MANY = 8  # lives told one after the other


class Window(NamedTuple):
    """Emulated seconds, both ends included."""

    from_s: float
    to_s: float


@click.command("explain")
@click.argument("run", metavar="RUN", required=False, type=click.Path(path_type=Path))
@click.option("--fls", "fids", metavar="FIDS", help="The story of this FLS, or of several, as 17,40-42.")
@click.option("--from", "from_s", type=float, metavar="S", help="From this emulated second on. [default: 0]")
@click.option("--to", "to_s", type=float, metavar="S", help="Up to this emulated second. [default: the end]")
@click.option(
    "--message", metavar="ID", help="The life of one datagram, as 17.0#203: FID.incarnation#number."
)
@click.option(
    "--all",
    "everything",
    is_flag=True,
    help="With --from or --to: also what had no effect, as ticks that were skipped, datagrams that were only noted.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="The records of the log themselves, one JSON object a line."
)
@click.option(
    "--scenario",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Play a scenario file instead, and compare with what it says.",
)
def command(
    run: Path | None,
    fids: str | None,
    from_s: float | None,
    to_s: float | None,
    message: str | None,
    everything: bool,
    as_json: bool,
    scenario: Path | None,
) -> None:
    """Tell what happened in RUN, a directory of a run made with --trace.

    With --from or --to, every event in those seconds: when, at which FLS, its state and Swarm-ID before and after, what
    it was, and what the FLS did because of it. In brackets stand the ids of datagrams; --message follows one of them
    from cause to effect. With --fls alone, the FLS's life in numbers; with no option, all datagrams by kind.
    """
    if scenario is not None:
        if everything or as_json or any(one is not None for one in (run, fids, from_s, to_s, message)):
            raise click.UsageError("--scenario FILE is played alone: it needs no RUN, and no other option")
        play_scenario(scenario)
        return
    if run is None:
        raise click.UsageError("whose story? give RUN, the directory of a run made with --trace")
    if everything and (message is not None or as_json or from_s is to_s is None):
        raise click.UsageError(
            "--all is of a story, --from S or --to S; without it, nothing would be left out"
        )
    from swarmer.observe.trace_file import TraceFile

    window = window_of(from_s, to_s)
    trace = TraceFile(run)
    chosen = None if fids is None else chosen_fids(fids, trace)
    if message is not None:
        check_message(message, fids, from_s, to_s)
    records = trace.records(chosen, message or "", *window)
    lines: Iterator[str]
    if as_json:
        lines = (json.dumps(record) for record in records)
    elif message is not None:
        lines = tell_message(trace, records, message)
    elif from_s is None and to_s is None:
        lines = tell_lives(records, chosen) if chosen else tell_overview(trace)
    else:
        lines = tell_story(trace, records, everything)
    for line in lines:
        click.echo(line)
    for note in trace.notes():
        click.echo(f"note: {note}", err=True)


def play_scenario(path: Path) -> None:
    """Play a file and print it with what came of it. Raises BadInput if it is none, RunFailed if it says otherwise."""
    from swarmer.observe.scenario import first_difference, read
    from swarmer.observe.stage import play

    told = read(path)
    given = play(told)
    click.echo(told.rewritten(given), nl=False)
    if difference := first_difference(told, given):
        raise RunFailed(f"{path}, {difference}")


def window_of(from_s: float | None, to_s: float | None) -> Window:
    """The seconds asked for. Raises BadInput."""
    for name, value in (("from", from_s), ("to", to_s)):
        if value is not None and not (math.isfinite(value) and value >= 0):
            raise BadInput(name, value, "an emulated second, 0 or more")
    window = Window(from_s or 0.0, math.inf if to_s is None else to_s)
    if window.from_s > window.to_s:
        raise BadInput("from", from_s, f"a second not after --to, {to_s:g}")
    return window


def chosen_fids(text: str, trace: TraceFile) -> frozenset[int]:
    """The FLSs asked for. Raises BadInput for those that the run, or its log, does not have."""
    from swarmer.observe.trace import fids_named

    chosen = fids_named(text, trace.header.points, "fls")
    kept = trace.header.fids
    if kept is not None and (missing := chosen - kept):
        raise BadInput(
            "fls", text, f"an FLS that was logged; --trace-fids of this run left out {min(missing)}"
        )
    return chosen


def check_message(message: str, fids: str | None, from_s: float | None, to_s: float | None) -> None:
    """Raises BadInput for what is no id, or is asked for together with something else."""
    from swarmer.observe.lives import MESSAGE_ID

    if not MESSAGE_ID.fullmatch(message):
        raise BadInput("message", message, "the id of a datagram, FID.incarnation#number, as 17.0#203")
    if fids is not None or from_s is not None or to_s is not None:
        raise click.UsageError("--message is told whole; leave out --fls, --from and --to")


def tell_story(trace: TraceFile, records: Iterator[Record], everything: bool) -> Iterator[str]:
    """Every event of a window, a line each."""
    from swarmer.observe.story import scenes

    told = left_out = 0
    for scene in scenes(records):
        if scene.quiet and not everything:
            left_out += 1
            continue
        told += 1
        yield scene.line(trace.header.points)
    if left_out:
        yield f"{left_out:,} event{'s' * (left_out != 1)} without effect left out; --all tells them"
    elif not told:
        yield "nothing happened in these seconds"


def tell_message(trace: TraceFile, records: Iterator[Record], message: str) -> Iterator[str]:
    """The life of a datagram. Raises BadInput if the log does not know it."""
    from swarmer.observe.lives import message_life, message_lines

    sent, came = message_life(records, message)
    if sent is None and not came:
        raise BadInput("message", message, "the id of a datagram in this log")
    return message_lines(sent, came, message, trace.header.points)


def tell_lives(records: Iterator[Record], chosen: frozenset[int]) -> Iterator[str]:
    """The lives of some FLSs in numbers. Raises BadInput for too many."""
    from swarmer.observe.lives import Life

    if len(chosen) > MANY:
        raise BadInput("fls", f"{len(chosen)} FLSs", f"at most {MANY}, or a window, --from and --to")
    lives = {fid: Life(fid) for fid in sorted(chosen)}
    for record in records:
        lives[record["fid"]].add(record)
    return (line for life in lives.values() for line in life.lines())


def tell_overview(trace: TraceFile) -> Iterator[str]:
    """What a log holds, and all datagrams by kind."""
    from swarmer.observe.lives import overview

    header = trace.header
    kept = "" if header.fids is None else f"; logged: {len(header.fids)} of them"
    yield f"{header.shape}, {header.points} FLSs, seed {header.seed}{kept}"
    yield from overview(trace)
    yield "one FLS: --fls FID; every event of some seconds: --from S --to S; one datagram: --message ID"
