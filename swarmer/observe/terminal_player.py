"""A recorded run played in the terminal: it turns, pauses, goes to any moment; or a few still pictures in a pipe."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TextIO

import numpy as np

from swarmer.observe.report_drawing import SECONDS, Clock
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.terminal_screen import CLOSED, Screen
from swarmer.observe.terminal_view import Means, Moment, Stage

SPIN_DEG_PER_S = 6.0  # of the watcher's clock
FRAMES_PER_S = 12.0
STEPS = 60  # an arrow goes this part of the run
TURN_DEG = 15.0
RAISED_DEG = 75.0  # at most, from where one looks at first
SPEEDS = (0.01, 1000.0)
STILLS = 5  # frames printed where nobody watches
LINGER_S = 1.5  # at the end, where no key can come
HELP = "q quit  space pause  ←→ time  a d w s turn  r spin  + - speed  , . sample  0-9 home end"
PLAIN_HELP = HELP.replace("←→", "arrows")
TURNS = {"a": (-1, 0), "d": (1, 0), "w": (0, 1), "s": (0, -1), "up": (0, 1), "down": (0, -1)}


class Player:
    """Where in time and from where one looks; keys and the clock change it."""

    def __init__(self, timeline: SavedTimeline, speed: float = 1.0) -> None:
        """speed: emulated seconds per second."""
        self._t_s = timeline.t_s
        self.first_s, self.last_s = float(self._t_s[0]), float(self._t_s[-1])
        self.now_s, self.speed = self.first_s, speed
        self.paused, self.spinning = False, True
        self.turned_deg = self.raised_deg = 0.0

    @property
    def at(self) -> int:
        """The sample that is shown: the last one that is not ahead."""
        return max(0, int(np.searchsorted(self._t_s, self.now_s, side="right")) - 1)

    @property
    def ended(self) -> bool:
        return self.now_s >= self.last_s

    def moment(self) -> Moment:
        """What a frame now shows."""
        return Moment(self.at, self.turned_deg, self.raised_deg, self.paused or self.ended, self.speed)

    def advance(self, passed_s: float) -> None:
        """Let the watcher's clock go on."""
        if self.spinning and not self.paused:
            self.turned_deg = (self.turned_deg + passed_s * SPIN_DEG_PER_S) % 360
        if not self.paused:
            self.go(self.now_s + passed_s * self.speed)

    def go(self, t_s: float) -> None:
        """To a moment of the run, or to the end of it that is nearer."""
        self.now_s = min(max(t_s, self.first_s), self.last_s)

    def press(self, key: str) -> bool:
        """Do what a key says; others do nothing. False: it is over."""
        if key in ("q", "Q", CLOSED):
            return False
        span = self.last_s - self.first_s
        arrows = {"left": -1, "right": 1, "page up": -STEPS / 10, "page down": STEPS / 10}
        if key in arrows:
            self.go(self.now_s + arrows[key] * span / STEPS)
        elif key in TURNS:
            self._turn(*TURNS[key])
        elif key in (",", "."):
            self._step(1 if key == "." else -1)
        elif key in ("home", "end"):
            self.go(self.first_s if key == "home" else self.last_s)
        elif key.isdecimal() and len(key) == 1:
            self.go(self.first_s + span * int(key) / 10)
        elif key in ("+", "=", "-"):
            factor = 0.5 if key == "-" else 2.0
            self.speed = min(max(self.speed * factor, SPEEDS[0]), SPEEDS[1])
        elif key == "space":
            self._pause()
        elif key == "r":
            self.spinning = not self.spinning
        return True

    def _turn(self, right: int, up: int) -> None:
        self.spinning = self.spinning and not right
        self.turned_deg = (self.turned_deg + right * TURN_DEG) % 360
        self.raised_deg = min(max(self.raised_deg + up * TURN_DEG, -RAISED_DEG), RAISED_DEG)

    def _step(self, samples: int) -> None:
        self.paused = True
        self.go(float(self._t_s[min(max(self.at + samples, 0), len(self._t_s) - 1)]))

    def _pause(self) -> None:
        if self.ended:  # once more from the beginning
            self.paused = False
            self.go(self.first_s)
        else:
            self.paused = not self.paused


def play(
    timeline: SavedTimeline,
    screen: Screen,
    speed: float,
    means: Means,
    title: str = "",
    clock: Callable[[], float] = time.monotonic,
    unit: Clock = SECONDS,
) -> None:
    """Play until a key ends it; where no key can come, to the end and a moment longer.

    screen: taken already. speed: emulated seconds per second. unit: what the run counts. A
    slow line gets fewer frames, never an older one.
    """
    player, stage, drawn = Player(timeline, speed), None, None
    before, help_line = clock(), HELP if means.braille else PLAIN_HELP
    while True:
        size = screen.size()
        if stage is None or stage.size != size:
            stage, screen.fresh = Stage(timeline, size, means, title, unit), True
        moment = player.moment()
        if screen.fresh or moment != drawn:
            try:
                screen.show(stage.frame(moment, help_line if screen.interactive else ""))
            except OSError:
                return  # the terminal is gone
            drawn = moment
        if player.ended and not screen.interactive:
            screen.keys(LINGER_S)
            return
        for key in screen.keys(1 / FRAMES_PER_S):
            if not player.press(key):
                return
        now = clock()
        player.advance(now - before)
        before = now


def stills(
    timeline: SavedTimeline,
    out: TextIO,
    means: Means,
    columns: int = 72,
    rows: int = 20,
    unit: Clock = SECONDS,
) -> None:
    """A few frames one below the other: for a file or a pipe."""
    stage = Stage(timeline, (columns, rows + 7), means, unit=unit)
    last = len(timeline.t_s) - 1
    for at in dict.fromkeys(round(last * i / (STILLS - 1)) for i in range(STILLS)):
        lines = [*stage.picture(Moment(at)), f"{unit.say(timeline.t_s[at]):>8}   {stage.facts(at)}"]
        out.write("\n".join(lines) + "\n\n")
    out.write("\n".join(stage.curves(last)) + "\n")
