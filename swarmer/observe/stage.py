"""Where a scenario is played: state machines, an air from which datagrams are delivered or lost on command, a clock.

Nothing moves by itself but leases, renewals and the bound of Waiting, and those only while `advance` lets time pass:
a scenario says what happens, and in which order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from random import Random
from typing import NamedTuple

from swarmer.config import load_config
from swarmer.errors import BadInput, shown
from swarmer.messages import (
    NO_SWARM,
    ZERO,
    Message,
    Stamp,
)
from swarmer.observe.protocol_words import (
    KIND_NUMBERS,
    STATE_NAMES,
    TIMER_NAMES,
    addressee_name,
    datagram_name,
    swarm_name,
)
from swarmer.observe.scenario import COMMANDS, Scenario, Word
from swarmer.observe.stage_entrances import APART, ENTRANCES, OWING, measured
from swarmer.observe.story import fate_words
from swarmer.plan import find_technique, make_machine
from swarmer.protocol import race
from swarmer.protocol.events import (
    IGNORED,
    Arm,
    BatteryLow,
    Depart,
    Disarm,
    Due,
    Event,
    Fly,
    Landed,
    Launch,
    Measure,
    Received,
    Send,
    Timer,
)
from swarmer.radio import Ears, ReplayWindow, heard
from swarmer.rules import make_rules
from swarmer.state_machine import Identity, ProtocolBug, State, StateMachine

RUN = 1
FLSS = 1000  # the largest FID of a scenario
WIDTH = 28  # of the column that says what happened
DISPLAY = 10_000.0  # its diagonal, cells: everybody is in range of everybody unless a scenario says otherwise
DELIVERIES = 1000  # of one `run`
TIMERS = {
    "tick": Timer.CHALLENGE, "bound": Timer.BOUND, "lease": Timer.LEASE, "renew": Timer.RENEW, "thaw": Timer.THAW,
    "report": Timer.REPORT,
}  # fmt: skip
OPTIONS = ("flying", "xi", "epoch", "incarnation", "neighbours", "with")  # of `given`
BY_ITSELF = (Timer.BOUND, Timer.LEASE, Timer.RENEW)


class Copy(NamedTuple):
    """A datagram on its way to one receiver."""

    message: Message
    number: int
    receiver: int


@dataclass(slots=True)
class Actor:
    """An FLS on the stage."""

    machine: StateMachine
    window: ReplayWindow = field(default_factory=ReplayWindow)
    armed: dict[Timer, float] = field(default_factory=dict)
    sent: int = 0
    dead: bool = False

    def ears(self) -> Ears:
        """Who listens, for the radio's rules."""
        m = self.machine
        return Ears(RUN, m.fid, m.swarm if m.awake else NO_SWARM, m.truth, m.beliefs.neighbours)

    def state(self) -> str:
        """In words: `Waiting(a)`, `BusyLocalizing flying`, ..."""
        m = self.machine
        name = STATE_NAMES[m.state]
        if m.state is State.WAITING and m.holders:
            name += "(a)" if m.anchoring else "(l)"
        return name + (" flying" if m.flying else "")


def play(scenario: Scenario) -> list[list[str]]:
    """What each block of a scenario gives. Raises BadInput for a command that cannot be done, saying where."""
    stage = Stage(scenario)
    given: list[list[str]] = []
    for block in scenario.blocks:
        stage.output = []
        for words in block.commands:
            stage.do(words)
        given.append(stage.output)
    return given


class Stage:
    """The actors, the air and the clock of one scenario."""

    def __init__(self, scenario: Scenario) -> None:
        commands = [words for block in scenario.blocks for words in block.commands]
        self._named = sorted({fid for words in commands if words[0].text == "given" for fid in _fids(words)})
        self._overrides: list[str] = []
        self.actors: dict[int, Actor] = {}
        self.air: list[Copy] = []
        self.now = 0.0  # emulated seconds
        self.output: list[str] = []

    def do(self, words: Sequence[Word]) -> None:
        """Carry out one command. Raises BadInput."""
        command, *more = words
        name = command.text
        try:
            if name in TIMERS:
                self._due(self._actor(command, more), TIMERS[name], command)
            elif name in ("land", "battery", "fail", "replace"):
                self._happen(name, self._actor(command, more, dead=name == "replace"))
            else:
                getattr(self, f"_{name}")(command, more)
        except ProtocolBug as bug:
            command.refuse(f"that cannot happen now: {bug}")

    # -- who is there --------------------------------------------------------------------------------------------

    def _set(self, command: Word, words: list[Word]) -> None:
        if self.actors:
            command.refuse("settings stand before the first `given`")
        for word in words:
            word.value()
        self._overrides += [word.text for word in words]
        try:
            load_config(None, self._overrides)
        except BadInput as error:
            guilty = [word for word in words if word.text.partition("=")[0] == error.field]
            (guilty or words or [command])[0].refuse(str(error))

    def _given(self, command: Word, words: list[Word]) -> None:
        fids = _fids((command, *words))
        rest = words[len(fids) :]
        if not fids or not rest:
            command.refuse(f"given {COMMANDS['given']}")
        state, *options = rest
        for word, fid in zip(words, fids, strict=False):
            if fid in self.actors:
                word.refuse(f"FLS {fid} is there already")
            self._place(fid, state, options)

    def _place(self, fid: int, state: Word, options: list[Word]) -> None:
        said: dict[str, Word] = {}
        for word in options:
            name = word.text.partition("=")[0]
            if name not in OPTIONS:
                word.refuse(f"given {COMMANDS['given']}")
            if name in said:
                word.refuse(f"{name} is said twice")
            said[name] = word
        if state.text not in ENTRANCES:
            state.refuse(f"no state {shown(state.text)}; there are {', '.join(ENTRANCES)}")
        if "with" in said and state.text not in OWING:
            said["with"].refuse(f"{state.text} is owed to nobody: `with` is of {', '.join(sorted(OWING))}")
        least = {"xi": 1, "epoch": 0, "incarnation": 0}
        number = {name: said[name].value().number(low) for name, low in least.items() if name in said}
        several = {
            name: [part.number(1, FLSS) for part in said[name].value().parts()]
            for name in ("neighbours", "with")
            if name in said
        }
        actor = self._make(
            fid, number.get("incarnation", 0), number.get("epoch", 0), several.get("neighbours")
        )
        for event in ENTRANCES[state.text](actor.machine, number.get("xi", fid), several.get("with", [])):
            self._feed(actor, event)
        if "flying" in said and actor.machine.anchor is not None:
            self._feed(actor, measured(actor.machine, 1.0))
        if actor.state() != state.text + (" flying" if "flying" in said else ""):
            state.refuse(f"FLS {fid} cannot be {state.text} so; it would be {actor.state()}")

    def _make(self, fid: int, incarnation: int, epoch: int, neighbours: Sequence[int] | None) -> Actor:
        config = load_config(None, self._overrides)
        rules = make_rules(config, max(self._named), 3, DISPLAY, find_technique(config.technique))
        others = tuple(other for other in self._named if other != fid)
        truth = (APART * fid, 0.0, 0.0)
        machine = make_machine(
            rules, Identity(fid, incarnation, truth), others if neighbours is None else tuple(neighbours), DISPLAY,
            Random(fid), epoch=epoch,
        )  # fmt: skip
        self.actors[fid] = Actor(machine)
        return self.actors[fid]

    def _actor(self, command: Word, words: list[Word], dead: bool = False) -> Actor:
        if len(words) != 1:
            command.refuse(f"{command.text} {COMMANDS[command.text]}")
        return self._known(words[0], dead)

    def _known(self, word: Word, dead: bool = False) -> Actor:
        actor = self.actors.get(word.number(1, FLSS))
        if actor is None or (actor.dead and not dead):
            word.refuse(
                f"no FLS {word.text} is there; {'`given` makes one' if actor is None else 'it is gone'}"
            )
        return actor

    # -- what happens to them ------------------------------------------------------------------------------------

    def _due(self, actor: Actor, timer: Timer, command: Word) -> None:
        at_s = actor.armed.get(timer)
        if at_s is None:
            command.refuse(f"FLS {actor.machine.fid} waits for no such timer ({TIMER_NAMES[timer]})")
        if timer in BY_ITSELF:  # the others are armed for a moment drawn at random: a scenario says when
            self.now = max(self.now, at_s)
        self._fire(actor, timer)

    def _fire(self, actor: Actor, timer: Timer) -> None:
        del actor.armed[timer]
        when = f", {self.now * 1e3:g} ms" if timer in BY_ITSELF else ""
        self._tell(actor, TIMER_NAMES[timer] + when, Due(timer))

    def _happen(self, name: str, actor: Actor) -> None:
        m = actor.machine
        if name == "land":
            self._tell(actor, "lands", Landed())
        elif name == "battery":
            self._tell(actor, "battery low", BatteryLow())
        else:
            self._gone(actor)
        if name == "replace":
            new = self._make(m.fid, m.incarnation + 1, m.epoch, sorted(m.beliefs.neighbours))
            self._tell(new, "takes its place", Launch(ZERO))

    def _gone(self, actor: Actor) -> None:
        """It hears nothing any more; what it has sent is still on its way."""
        actor.dead = True
        self.air = [copy for copy in self.air if copy.receiver != actor.machine.fid]

    def _measure(self, command: Word, words: list[Word]) -> None:
        if len(words) != 2:
            command.refuse(f"measure {COMMANDS['measure']}")
        actor = self._known(words[0])
        try:
            cells = float(words[1].text)
        except ValueError:
            cells = -1.0
        if not 0.0 <= cells <= DISPLAY:
            words[1].refuse("how long V is: cells, 0 or more")
        if actor.machine.anchor is None:
            words[0].refuse(f"FLS {words[0].text} measures nothing now")
        self._tell(actor, "has measured", measured(actor.machine, cells))

    def _advance(self, command: Word, words: list[Word]) -> None:
        if len(words) != 1 or words[0].text.partition("=")[0] not in ("to", "by"):
            command.refuse(f"advance {COMMANDS['advance']}")
        ms = words[0].value().number(0, 10_000_000)
        end = ms / 1e3 + (self.now if words[0].text.startswith("by") else 0.0)
        if end < self.now:
            words[0].refuse(f"it is {self.now * 1e3:g} ms already")
        while True:
            due = min(
                (
                    (at_s, fid, timer)
                    for fid, actor in self.actors.items()
                    for timer, at_s in actor.armed.items()
                    if timer in BY_ITSELF and not actor.dead
                ),
                default=None,
            )
            if due is None or due[0] > end + 1e-9:
                break
            self.now = max(self.now, due[0])
            self._fire(self.actors[due[1]], due[2])
        self.now = max(self.now, end)

    def _show(self, command: Word, words: list[Word]) -> None:
        for word in words:
            actor = self._known(word)
            m = actor.machine
            held = ", ".join(str(fid) for fid in range(1, FLSS + 1) if fid in m.leases)
            leases = f", leases of {held}" if held else ""
            self.output.append(f"{m.fid} {actor.state()}, xi {swarm_name(m.swarm)}, epoch {m.epoch}{leases}")

    # -- the air -------------------------------------------------------------------------------------------------

    def _deliver(self, command: Word, words: list[Word]) -> None:
        twice = bool(words) and words[-1].text == "twice"
        chosen = self._chosen(command, words[:-1] if twice else words)
        for copy in chosen:
            self.air.remove(copy)
            for _ in range(2 if twice else 1):
                self._arrive(copy)

    def _lose(self, command: Word, words: list[Word]) -> None:
        for copy in self._chosen(command, words):
            self.air.remove(copy)

    def _run(self, command: Word, words: list[Word]) -> None:
        if words:
            words[0].refuse("run stands alone: all datagrams are delivered until none is on the air")
        for _ in range(DELIVERIES):
            if not self.air:
                return
            self._arrive(self.air.pop(0))
        command.refuse(f"there is no end of it: {DELIVERIES} datagrams, and more to come")

    def _chosen(self, command: Word, words: list[Word]) -> list[Copy]:
        """Copies on the air that the words name; at least one, or a scenario says something that is not so."""
        chosen, rest = list(self.air), list(words)
        while rest:
            word = rest.pop(0)
            if word.text in KIND_NUMBERS:
                kind = KIND_NUMBERS[word.text]
                chosen = [copy for copy in chosen if copy.message.kind == kind]
            elif word.text in ("from", "to") and rest:
                fid = rest.pop(0).number(1, FLSS)
                chosen = [
                    copy
                    for copy in chosen
                    if fid == (copy.message.sender if word.text == "from" else copy.receiver)
                ]
            else:
                word.refuse(
                    f"{command.text} {COMMANDS[command.text]}; a KIND is one of {', '.join(KIND_NUMBERS)}"
                )
        if not chosen:
            command.refuse("no such datagram is on the air")
        return chosen

    def _transmit(self, actor: Actor, message: Message) -> None:
        actor.sent += 1
        self._say(actor, f"=> {addressee_name(message)} {datagram_name(message)}")
        for fid in sorted(self.actors):
            other = self.actors[fid]
            stamp = Stamp(RUN, actor.sent, ZERO, self.now)
            if not other.dead and other is not actor and heard(message, stamp, other.ears(), FLSS) is None:
                self.air.append(Copy(message, actor.sent, fid))

    def _arrive(self, copy: Copy) -> None:
        """What an FLS's network does with a datagram, and then its machine."""
        actor, message = self.actors[copy.receiver], copy.message
        what = f"<= {message.sender} {datagram_name(message)}"
        refusal = heard(message, Stamp(RUN, copy.number, ZERO, self.now), actor.ears(), FLSS)
        if refusal is None and not actor.window.fresh(message.sender, message.incarnation, copy.number):
            refusal = "replayed"
        if refusal is not None:
            self._say(actor, what, f"({fate_words(refusal)})")
            return
        machine = actor.machine
        verdict = race.judge(message, machine, machine.beliefs.neighbours, machine.settings.neighbour_reply)
        if verdict.queue:
            self._tell(actor, what, Received(message))
            return
        word = "answered at once" if verdict.reply is not None else "noted" if verdict.note else "dropped"
        self._say(actor, what, f"{actor.state()} ({word})")
        if verdict.reply is not None:
            reply = race.answer(
                message, verdict.reply, machine, machine.fid, machine.incarnation, machine.truth
            )
            self._transmit(actor, reply)
        if verdict.note:
            self._feed(actor, Received(message, noted=True))

    # -- the machines --------------------------------------------------------------------------------------------

    def _feed(self, actor: Actor, event: Event) -> list[object]:
        """An event to a machine; what others can notice of its answer."""
        noticed: list[object] = []
        for action in actor.machine.handle(event, self.now):
            if isinstance(action, Arm):
                actor.armed[action.timer] = action.at_s
            elif isinstance(action, Disarm):
                actor.armed.pop(action.timer, None)
            else:
                noticed.append(action)
        return noticed

    def _tell(self, actor: Actor, what: str, event: Event) -> None:
        """An event to a machine, and a line for it and for each thing that it does."""
        m = actor.machine
        before = (actor.state(), swarm_name(m.swarm), m.epoch, len(m.leases))
        ignored = m.counts[IGNORED]
        noticed = self._feed(actor, event)
        after = (actor.state(), swarm_name(m.swarm), m.epoch, len(m.leases))
        text = after[0] if before[0] == after[0] else f"{before[0]} -> {after[0]}"
        if before[1] != after[1]:
            text += f", xi {before[1]}->{after[1]}"
        if before[2] != after[2]:
            text += f", epoch {before[2]}->{after[2]}"
        if before[3] != after[3]:
            text += f", leases {before[3]}->{after[3]}"
        if m.counts[IGNORED] > ignored and not noticed:
            text += " (ignored)"
        elif type(event) is Received and any(event.message is waiting for waiting in m.pending):
            text += " (waits for the landing)"
        self._say(actor, what, text)
        for action in noticed:
            if isinstance(action, Send):
                self._transmit(actor, action.message)
            elif isinstance(action, Fly):
                self._say(actor, f"flies {sum(x * x for x in action.vector) ** 0.5:.4g} cells")
            elif isinstance(action, Measure):
                self._say(actor, f"measures {action.message.sender}")
            elif isinstance(action, Depart):
                self._say(actor, "departs")
                self._gone(actor)

    def _say(self, actor: Actor, what: str, text: str = "") -> None:
        self.output.append(f"{f'{actor.machine.fid} {what}':<{WIDTH}}  {text}".rstrip())


def _fids(words: Sequence[Word]) -> list[int]:
    """The FIDs right after `given`."""
    fids = []
    for word in words[1:]:
        if not word.text.isdigit():
            break
        fids.append(word.number(1, FLSS))
    return fids
