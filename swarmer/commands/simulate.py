"""`swarmer simulate`: random worlds full of faults in virtual time, every invariant checked, for as long as told."""

from __future__ import annotations

import itertools
import shlex
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmer.commands.numbers import Finite
from swarmer.commands.run import directory_named
from swarmer.commands.sweep import ctrl_c
from swarmer.errors import BadInput, RunFailed
from swarmer.interrupts import ends_at_once

if TYPE_CHECKING:
    from swarmer.experiments.simulate import Finding, Task
    from swarmer.experiments.worlds import World

EVERY_S = 5.0  # between two lines of progress
SECONDS = 60.0
REFUSED_MAX = 50  # worlds in a row that the settings do not allow
OUT = Path("runs/simulate")


@click.command("simulate")
@click.argument("file", required=False)
@click.option("--minutes", type=Finite(0.0, 1e5, min_open=True), metavar="N", help="Play fresh seeds for so many minutes.")  # fmt: skip
@click.option("--seconds", type=Finite(0.0, 1e7, min_open=True), metavar="N", help=f"The same in seconds. [default: {SECONDS:g}]")  # fmt: skip
@click.option("--seeds", metavar="N|LIST", help="These in place of fresh ones: a count, or numbers with commas between.")  # fmt: skip
@click.option(
    "--seed", type=click.IntRange(0, 2**31 - 1), metavar="N", help="Replay one seed and tell how it went."
)
@click.option("--until", "until_s", type=Finite(0.0, 1e6, min_open=True), metavar="S", help="Replay no further than this, emulated seconds.")  # fmt: skip
@click.option("--technique", metavar="NAME", help="The technique of all worlds. [default: signal_strength]")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="A setting of all worlds; may be repeated.")  # fmt: skip
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="N", help="Worlds at a time. [default: one for each core]")  # fmt: skip
@click.option("--out", metavar="DIR", help=f"Where failing worlds are kept. [default: {OUT}]")
def command(
    file: str | None,
    minutes: float | None,
    seconds: float | None,
    seeds: str | None,
    seed: int | None,
    until_s: float | None,
    technique: str | None,
    overrides: tuple[str, ...],
    jobs: int | None,
    out: str | None,
) -> int:
    """Look for what breaks: every seed is a world of its own, with a shape, settings and faults drawn from it.

    It is played in virtual time with every invariant checked, first full of faults, then in good weather, in which one
    swarm must form. A seed that fails is made as small as it can be within a minute, kept in a file, and printed with
    the command that plays it. FILE, or --seed, replays one. Exit status 1 if anything failed.
    """
    with ends_at_once():
        from swarmer.engines.limits import cores
        from swarmer.experiments.experiment import seeds_asked
        from swarmer.experiments.simulate import Task, read_world
        from swarmer.experiments.worlds import draw

        several = {"--minutes": minutes, "--seconds": seconds, "--seeds": seeds}
        named = [name for name, value in several.items() if value is not None]
        one = [name for name, value in (("FILE", file), ("--seed", seed)) if value is not None]
        if len(one + named) > 1:
            raise BadInput.saying(f"{named[-1] if named else one[0]}: not beside {(one + named)[0]}")
        given = _given(technique, overrides)
        if file is not None and given:
            raise BadInput.saying("FILE: has its settings; --technique and --set are for drawn worlds")
        if until_s is not None and not one:
            raise BadInput.saying("--until: is for one world, FILE or --seed")
        place = directory_named(out) or OUT
        if one:
            world = read_world(Path(file)) if file is not None else draw(seed or 0, given)
    if one:
        return replay(world, until_s)
    # By the clock, far apart for two that begin a second apart, and within what a run takes for its seed.
    fresh = int(time.time()) * 100_003 % 2**30
    numbers: Iterable[int] = seeds_asked(seeds) or itertools.count(fresh)
    length_s = None if seeds else 60 * minutes if minutes else seconds or SECONDS
    tasks = (Task(number, given) for number in numbers)
    return search(tasks, length_s, jobs or cores(), place, _words(technique, overrides))


def _given(technique: str | None, overrides: tuple[str, ...]) -> dict[str, Any]:
    """The settings that every world has. Raises BadInput."""
    from swarmer.config import load_config, setting_facts
    from swarmer.plan import find_technique
    from swarmer.settings_file import flat_layers

    found = flat_layers(None, overrides, {}, setting_facts())
    if technique is not None:
        found["technique"] = technique
    for name in ("engine", "seed", "duration_s"):
        if name in found:
            raise BadInput.saying(f"{name}: is the world's own; it cannot be set")
    # epochs: false goes with some of the policies that are drawn, and not with the default one
    load_config(None, [], **{name: value for name, value in found.items() if name != "epochs"})
    if "technique" in found:
        find_technique(found["technique"])
    return found


def _words(technique: str | None, overrides: tuple[str, ...]) -> str:
    """The options that say what all worlds have, as they were given."""
    words = [f"--technique {shlex.quote(technique)}"] if technique else []
    return " ".join(words + [f"--set {shlex.quote(text)}" for text in overrides])


def replay(world: World, until_s: float | None) -> int:
    """Play one world and tell how it went; the exit status. Raises BadInput."""
    from swarmer.experiments.simulate import WORLD_S
    from swarmer.experiments.world_watch import processor_time
    from swarmer.experiments.worlds import play
    from swarmer.faults import to_yaml

    click.echo(f"seed {world.seed}: {world.words()}")
    click.echo(f"settings: {world.settings}")
    click.echo(to_yaml(world.schedule), nl=False)
    with processor_time(WORLD_S):
        outcome = play(world, until_s)
    if outcome.failure:
        if outcome.last:
            click.echo("the last events of those concerned:")
        for line in outcome.last:
            click.echo(f"  {line}")
        raise RunFailed(
            f"seed {world.seed} at {outcome.at_s:.4f} s, event {outcome.events}: {outcome.failure}"
        )
    took = "no promise of one swarm"
    if outcome.took_s is not None:
        took = f"one swarm {outcome.took_s:.2f} s after the healing (at most {outcome.bound_s:.1f} s)"
    until = "" if until_s is None else f"until {until_s:g} s, "
    click.echo(
        f"held: {until}{outcome.events} events, {outcome.stands}, {took}, sha256 {outcome.digest[:16]}"
    )
    return 0


class Tally:
    """How the search stands."""

    def __init__(self, options: str) -> None:
        self.options = options
        self.worlds = self.failed = self.refused = self.events = 0
        self.slowest = 0.0
        self.why = ""
        self.told: set[str] = set()  # what has been told of in full: names of invariants
        self._began = self._spoke = time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    def note(self, finding: Finding) -> None:
        """A world more. Raises BadInput if the settings allow none."""
        from swarmer.experiments.simulate import command_of

        outcome = finding.outcome
        if finding.refused:
            self.refused += 1
            if not self.worlds and self.refused >= REFUSED_MAX:
                raise BadInput.saying(f"no world is possible with these settings: {finding.refused}")
            self.why = finding.refused
            return
        self.worlds += 1
        self.events += outcome.events
        if outcome.took_s is not None:
            self.slowest = max(self.slowest, outcome.took_s / outcome.bound_s)
        if outcome.failure:
            self.failed += 1
            click.echo(f"FAILED seed {finding.seed} at {outcome.at_s:.3f} s: {outcome.failure}")
            whole = f"swarmer simulate --seed {finding.seed} {self.options}".rstrip()
            if finding.file is None:
                click.echo(f"  replay: {whole}")
            else:
                click.echo(f"  {finding.words}")
                click.echo(f"  all of it: {whole}")
                click.echo(f"  as small as it fails: {finding.small}")
                click.echo(f"  replay: {command_of(finding.file)}")
            self.told.add(outcome.invariant)

    def tick(self) -> None:
        """A line on stderr now and then."""
        if time.monotonic() - self._spoke >= EVERY_S:
            self._spoke = time.monotonic()
            click.echo(self.line(), err=True)

    def line(self) -> str:
        """Where the search stands."""
        refused = f"{self.refused} impossible, " if self.refused else ""
        return (
            f"{self.seconds:.0f} s  {self.worlds} worlds, {self.failed} failed, {refused}{self.events} events, "
            f"one swarm after at most {100 * self.slowest:.0f} % of its bound"
        )


def search(tasks: Iterable[Task], length_s: float | None, jobs: int, out: Path, options: str) -> int:
    """Play worlds; the exit status. Raises BadInput, KeyboardInterrupt."""
    tally = Tally(options)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFailed(f"cannot make {out}: {error.strerror}") from error
    try:
        with ctrl_c():
            for finding in _findings(_in_time(tasks, tally, length_s), jobs, out, tally):
                tally.note(finding)
                tally.tick()
    except KeyboardInterrupt:
        click.echo(tally.line())
        raise
    if not tally.worlds and tally.refused:
        raise BadInput.saying(f"no world is possible with these settings: {tally.why}")
    click.echo(tally.line())
    return 1 if tally.failed else 0


def _in_time(tasks: Iterable[Task], tally: Tally, length_s: float | None) -> Iterator[Task]:
    for task in tasks:
        if length_s is not None and tally.seconds >= length_s:
            return
        yield task._replace(known=frozenset(tally.told))


def _findings(tasks: Iterable[Task], jobs: int, out: Path, tally: Tally) -> Iterator[Finding]:
    """What comes of the tasks: here, or in workers."""
    from swarmer.experiments.pool import Pool
    from swarmer.experiments.simulate import Finding, judge
    from swarmer.experiments.worlds import Outcome

    if jobs == 1:
        for task in tasks:
            yield judge(task, out)
        return
    with Pool(jobs, out, judge) as pool:
        for task, found in pool.outcomes(tasks, lambda task: None, tally.tick):
            if isinstance(found, Finding):
                yield found
            else:  # the worker died over it
                yield Finding(task.seed, Outcome(failure=found.message, invariant=found.status))
