"""`swarmer-run`: one run, from the settings to its run directory.

The help is written out here, because reading it from the settings would cost a fifth of a second; a test compares the
two. Everything else is imported once there is something to run.
"""

from __future__ import annotations

import errno
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmer.commands.witnesses import EVERYBODY, make_checks, make_tracer, refuse_witnesses
from swarmer.errors import BadInput, RunFailed
from swarmer.interrupts import INTERRUPTED, endings_over, endings_wait, ends_at_once

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.engines.result import RunResult
    from swarmer.next_shape import NextShape
    from swarmer.observe.collector import Collector
    from swarmer.plan import Plan

ANY_WIDTH = 1000  # where there is no terminal, a line stays one


@click.command("run")
@click.option("--shape", metavar="NAME|FILE", help="Catalogue name (`swarmer shapes`) or a file: .ptcld .xyz .csv .txt .npy .mat .off .ply .obj .stl .glb. [default: dragon]")  # fmt: skip
@click.option("--lambda", "lambda_ms", metavar="MS", help="Mean time between two challenges of an FLS, milliseconds. [default: 500]")  # fmt: skip
@click.option("--duration", "duration_s", metavar="S", help="Length of the run from the go signal, emulated seconds. [default: 60]")  # fmt: skip
@click.option("--rounds", metavar="N", help="With --engine rounds: rounds at most. [default: 100]")
@click.option("--until-hd", "until_hd_cells", metavar="CELLS", help="End as soon as the Hausdorff distance is below this, display cells.")  # fmt: skip
@click.option("--seed", metavar="N", help="Root of every random draw. [default: 1]")
@click.option("--points", metavar="N", help="Sample exactly N points of the shape.")
@click.option("--engine", metavar="NAME", help="What runs the FLSs: process (one OS process each, over UDP), virtual (one for all, in virtual time, repeatable), rounds (no protocol, round by round, to a million points) or cluster (one OS process each, on many hosts). [default: process]")  # fmt: skip
@click.option("--time-scale", metavar="X|auto", help="Emulated seconds per wall second, 0.001 to 10; auto is as fast as this machine stays faithful, at most 1. Not for virtual and rounds. [default: auto]")  # fmt: skip
@click.option(
    "--config", metavar="FILE", help="Settings: a YAML file, or a preset: default, paper, authors_code."
)
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Set any setting, as radio.loss=0.1; may be repeated.")  # fmt: skip
@click.option("--dedupe", is_flag=True, help="Drop points that the shape has twice instead of refusing it.")
@click.option("--out", metavar="DIR", help="The run directory itself. [default: runs/SHAPE-TIME-SEED]")  # fmt: skip
@click.option("--then", metavar="NAME|FILE", help="The shape that the display becomes, at --at; as --shape.")
@click.option("--at", metavar="S", help="When it becomes that, emulated seconds from the go signal.")
@click.option("--live", metavar="[auto|desktop|web|PORT]", is_flag=False, flag_value="auto", help="Show it in rerun's viewer while it runs: the one that is open, else a new window, else a page. Or in the one listed.")  # fmt: skip
@click.option("--no-recording", is_flag=True, help="Do not write recording.rrd.")
@click.option("--check", is_flag=True, help="Check the protocol's invariants after every event, and stop at the first that is broken; with --engine virtual.")  # fmt: skip
@click.option("--trace", is_flag=True, help="Write trace.jsonl.gz, the log of all that happened to each FLS, for `swarmer explain`; with --engine virtual.")  # fmt: skip
@click.option("--trace-fids", metavar="FIDS", help="Log these FLSs alone, as 17,40-60; implies --trace.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print the summary on stdout instead of the run directory."
)
def command(
    config: str | None,
    overrides: tuple[str, ...],
    dedupe: bool,
    out: str | None,
    live: str | None,
    no_recording: bool,
    check: bool,
    trace: bool,
    trace_fids: str | None,
    as_json: bool,
    shape: str | None,
    rounds: str | None,
    then: str | None,
    at: str | None,
    **texts: str | None,
) -> int:
    """Run a shape, from dead-reckoned chaos to a localized swarm.

    Settings are read from --config, then --set, then the other options. Progress goes to stderr; the last line of stdout
    is the run directory.
    """
    # As texts the other options are read like `--set`, which knows what each must be.
    given = [f"{name}={text}" for name, text in texts.items() if text is not None]
    given += [] if rounds is None else [f"rounds.max_rounds={rounds}"]
    given += [] if at is None else [f"transition.at_s={at}"]
    flags: dict[str, Any] = {"shape": shape, "transition.shape": then}
    if dedupe:
        flags["duplicates"] = "drop"
    if no_recording:
        flags["recording.enabled"] = False
    with ends_at_once():
        from swarmer.config import load_config

        settings = load_config(config, [*overrides, *given], **flags)
    if trace and trace_fids is None:
        trace_fids = EVERYBODY
    return run(
        settings, directory_named(out), live, as_json, source=config, trace_fids=trace_fids, check=check
    )


def preset(source: str | None) -> RunConfig | None:
    """The settings of the preset that `--config` names, if it names one."""
    from swarmer.config import load_config
    from swarmer.settings_file import preset_names

    return load_config(source) if source in preset_names() else None


def directory_named(out: str | None) -> Path | None:
    """The path that --out names. Raises BadInput for what no directory can be called."""
    if out is None:
        return None
    try:
        out.encode()
    except UnicodeEncodeError:
        raise BadInput("out", out, "a directory's name, in characters that UTF-8 has") from None
    if not out or "\0" in out or "\n" in out:
        raise BadInput("out", out, "a directory's name, on one line")
    return Path(out)


def run(
    config: RunConfig,
    out: Path | None,
    live: str | None,
    as_json: bool,
    source: str | None = None,
    trace_fids: str | None = None,
    check: bool = False,
) -> int:
    """Check, plan, run, sum up; the exit status. Raises BadInput before anything is written, RunFailed after.

    source: the file that the settings were read from; with a run beside it, the shape is compared with that run's.
    live: how it is shown meanwhile, as the option has it; None for not at all.
    trace_fids: whose events are logged, as the option has it, or EVERYBODY; None for no log.
    check: the invariants, after every event.
    """
    with ends_at_once():
        from swarmer.engines.named import make_engine
        from swarmer.engines.notes import notes_on
        from swarmer.observe.collector import Collector
        from swarmer.observe.live import check_way
        from swarmer.observe.panel import Panel
        from swarmer.observe.run_directory import TRACE, RunDirectory, check_out
        from swarmer.plan import make_plan

        remains = check_out(out) if out is not None else []
        if live is not None:
            check_way(live)
        refuse_witnesses(config, trace_fids, check)
        plan = make_plan(config)
        tracer = make_tracer(plan, trace_fids)
        ready = make_engine(plan, [*([tracer] if tracer else []), *make_checks(plan, check)])
        if config.recording.enabled or live is not None:
            from swarmer.observe.recording import import_rerun

            import_rerun()
    with ready as engine, endings_wait() as let_endings_come:
        directory = RunDirectory.create(out, config.shape, config.seed, sys.argv)
        collector = Collector(directory, Panel(), live)
        collector.expect(plan)
        if tracer:
            tracer.open(directory.stream(TRACE))

        def begin() -> None:
            let_endings_come()
            tell_plan(plan)
            if remains:
                click.echo(f"note: {out} held what a run that was cut off had left; it is replaced", err=True)
            for line in notes_on(config, plan.rules, plan.faults, config.unlike(preset(source))):
                click.echo(f"note: {line}", err=True)
            tell_changed_shape(plan, source)

        result = play(engine, collector, begin)
        if tracer:
            tracer.close(result)
    summary = collector.finish(result)
    return close(summary, directory.path, as_json, collector, config)


def play(engine: Any, collector: Collector, begin: Callable[[], None]) -> RunResult:
    """Run the engine; whatever ends it early becomes a result, so that what there is gets written.

    From here on all that is left is writing that down, and another Ctrl-C does not cut it off.
    begin: what comes before, and may be cut off as well.
    """
    from swarmer.engines.result import RunResult

    try:
        begin()
        result: RunResult = engine.run(collector)
        endings_over()
    except KeyboardInterrupt:
        endings_over()
        return RunResult(engine.name, "interrupted", 0.0, 0.0)
    except RunFailed as failure:
        endings_over()
        return RunResult(engine.name, "failed", 0.0, 0.0, message=str(failure))
    return result


def _say(text: str) -> None:
    """On stdout; the terminal may have been closed, and how the run ended stays its exit status."""
    try:
        click.echo(text)
    except OSError as error:
        if error.errno != errno.EIO:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the flush at the end is quiet, too


def close(summary: dict[str, Any], path: Path, as_json: bool, collector: Collector, config: RunConfig) -> int:
    """The last words, and the exit status."""
    from swarmer.observe.closing import closing_lines, missed_hd
    from swarmer.observe.violation import violation_lines
    from swarmer.observe.words import columns_of

    program = program_beside_python()
    for line in violation_lines(summary, path, program):
        click.echo(line, err=True)
    missed = missed_hd(summary, config)
    for line in closing_lines(summary, path, program, columns_of(sys.stderr), missed):
        click.echo(line, err=True)
    _say(json.dumps(summary, allow_nan=False) if as_json else str(path))
    if collector.failure is not None:
        raise collector.failure
    return {"done": 0, "interrupted": INTERRUPTED}.get(str(summary.get("status")), 1)


def tell_plan(plan: Plan) -> None:
    """The facts of the plan, on one line of stderr, or as many as the terminal needs."""
    from swarmer.observe.words import columns_of, wrapped
    from swarmer.plan import make_technique
    from swarmer.plugins import references_of

    n = plan.neighbours
    links = "1 link" if n.added_links == 1 else f"{n.added_links} links"
    joined = f", joined by {links}" if n.added_links else ""
    parts = "1 component" if n.components == 1 else f"{n.components} components"
    head = f"{plan.cloud.name}: {len(plan.cloud)} points in {plan.rules.dim}D, neighbours"
    line = (
        f"{head} {n.mode} (η {n.eta}): "
        f"{parts}{joined}, longest link {n.longest_link_cells:.1f} cells, mean degree {n.mean_degree:.1f}"
    )
    if plan.config.engine == "rounds":
        references = references_of(make_technique(plan.rules.technique), plan.rules.dim)
        if references > 1:
            line = f"{head} the {max(n.eta, references)} nearest in the shape (η, {references} at least)"
        elif plan.config.rounds.neighbours == "estimated":
            line = f"{head} the {n.eta} nearest (η) where the FLSs are, anew in each round"
    lines = [line]
    if plan.config.eta is not None and 2 * n.eta > plan.size:
        lines.append(f"note: eta: {n.eta} is more than half of the {plan.size} FLSs")
    if plan.next is not None:
        lines.append(next_shape_line(plan.next))
    if n.components > 1 and not n.added_links:
        lines.append(
            f"note: no link of the {n.components} components leads to another: each may stay a swarm of its own; "
            "neighbours: connected would join them"
        )
    for one in lines:
        for part in wrapped(one, columns_of(sys.stderr, ANY_WIDTH)):
            click.echo(part, err=True)


def next_shape_line(shape: NextShape) -> str:
    """What the display becomes, and who flies there."""
    how = "the least that there is" if shape.optimal else "nearly the least"
    joins = f"{len(shape.joiners)} join" if shape.joiners else f"{len(shape.leavers)} leave"
    return (
        f"then {shape.cloud.name} at {shape.at_s:g} s: {len(shape.cloud)} points in {shape.cloud.dim}D, {joins}, "
        f"the others fly {shape.way_cells:.1f} cells in the mean, {how}"
    )


def tell_changed_shape(plan: Plan, source: str | None) -> None:
    """A note on stderr if the settings are those of a run, and the points of its shape are not what they were."""
    from swarmer.observe.same_shape import shape_changed

    if source is not None and Path(source).is_file() and shape_changed(Path(source).parent, plan):
        click.echo(
            f"note: not the shape of the run in {Path(source).parent}: {plan.config.shape} has other points by now",
            err=True,
        )


def program_beside_python() -> str:
    """How this user's shell finds `swarmer`: by its name, or by the path beside this Python."""
    import os
    import shutil

    beside = Path(sys.executable).with_name("swarmer")
    found = shutil.which("swarmer")
    if (found and Path(found).resolve() == beside.resolve()) or not beside.exists():
        return "swarmer"
    return os.path.relpath(beside) if beside.is_relative_to(Path.cwd()) else str(beside)
