"""The terminal replay: keys, sizes, and a terminal that is left as it was, whatever ends it."""

import fcntl
import io
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time

import numpy as np
import pytest

from swarmer.observe.report_drawing import ROUNDS
from swarmer.observe.saved_run import load
from swarmer.observe.terminal_player import HELP, Player, play, stills
from swarmer.observe.terminal_screen import keys_in
from swarmer.observe.terminal_view import CUBE, TRUE_COLOUR, Means, Moment, Stage

CODES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
PATIENCE_S = 60


class FakeScreen:
    """A terminal without one: sizes and keys as told, each frame kept; a wait for keys lets the clock go on."""

    def __init__(self, interactive=False, keys=(), sizes=((80, 24),)):
        self.interactive, self.fresh = interactive, True
        self.pressed, self.sizes = list(keys), list(sizes)
        self.frames, self.now = [], 0.0

    def size(self):
        return self.sizes.pop(0) if len(self.sizes) > 1 else self.sizes[0]

    def show(self, lines):
        self.fresh = False
        self.frames.append([CODES.sub("", line) for line in lines])

    def keys(self, wait_s):
        self.now += wait_s
        return self.pressed.pop(0) if self.pressed else []


def played(run, screen, speed=1.0, means=Means(TRUE_COLOUR)):
    play(load(run).timeline, screen, speed, means, "ball", lambda: screen.now)
    return screen.frames


def test_where_no_key_can_come_it_ends_by_itself(finished_run):
    screen = FakeScreen()
    frames = played(finished_run, screen, speed=2.0)
    assert 4.0 <= screen.now <= 6.0  # 8 s at twice the speed, and a moment to look
    assert {len(frame) for frame in frames} == {24}
    assert max(len(line) for frame in frames for line in frame) <= 80
    assert "40/40 lit" in "\n".join(frames[-1])
    assert "1 swarm " in "\n".join(frames[-1])


def test_with_keys_it_stays_at_the_end_until_one_ends_it(finished_run):
    screen = FakeScreen(True, [["end"], *[[]] * 200, ["q"]])
    frames = played(finished_run, screen)
    assert screen.now > 10.0
    assert frames[-1][-1].startswith("q quit")
    assert "8.0 of 8.0 s" in "\n".join(frames[-1])


def test_the_arrow_back_shows_what_was(finished_run):
    screen = FakeScreen(True, [["space"], ["r"], ["9"], ["home"], ["q"]])
    frames = played(finished_run, screen)
    bars = [next(line for line in frame if " of 8.0 s" in line) for frame in frames]
    times = [float(re.search(r"([\d.]+) of", bar).group(1)) for bar in bars]
    assert times[-2:] == [7.2, 0.0]
    assert [bar.count("━") for bar in bars[-2:]] == sorted(
        (bar.count("━") for bar in bars[-2:]), reverse=True
    )
    assert "swarms" in "\n".join(frames[-1])


def test_nothing_is_drawn_while_nothing_changes(finished_run):
    screen = FakeScreen(True, [["space"], *[[]] * 50, ["q"]])
    assert len(played(finished_run, screen)) <= 3


def test_a_new_size_is_drawn_at_once(finished_run):
    screen = FakeScreen(True, [[], [], [], ["q"]], sizes=[(100, 40), (60, 18), (20, 6), (5, 3)])
    assert [len(frame) for frame in played(finished_run, screen)] == [40, 18, 6, 3]
    assert screen.frames[-1][0] == "too s"


@pytest.mark.parametrize("columns", [1, 12, 20, 33, 64, 300])
@pytest.mark.parametrize("rows", [1, 5, 6, 8, 13, 14, 90])
def test_every_size_is_filled_and_never_passed(finished_run, columns, rows):
    timeline = load(finished_run).timeline
    for at in (0, 40, 80):
        lines = Stage(timeline, (columns, rows), Means(TRUE_COLOUR), "t" * 400).frame(Moment(at), HELP)
        assert len(lines) == rows
        assert max(len(CODES.sub("", line)) for line in lines) <= columns


def test_colours_as_the_terminal_has_them(finished_run):
    timeline = load(finished_run).timeline
    drawn = {
        colours: "\n".join(Stage(timeline, (80, 24), Means(colours)).frame(Moment(40)))
        for colours in (TRUE_COLOUR, CUBE, 0)
    }
    assert len(set(re.findall(r"\x1b\[38;2;[\d;]+m", drawn[TRUE_COLOUR]))) > 3
    assert len(set(re.findall(r"\x1b\[38;5;\d+m", drawn[CUBE]))) > 3
    assert "\x1b" not in drawn[0]


def test_without_unicode_all_is_ascii(finished_run):
    stage = Stage(load(finished_run).timeline, (80, 24), Means(0, braille=False), "Höhe")
    for at in (0, 60):
        text = "\n".join(stage.frame(Moment(at, paused=True, speed=2.0)))
        assert text.isascii()
    assert "#" in text or "o" in text


def test_a_title_with_codes_is_shown_as_text(finished_run):
    stage = Stage(load(finished_run).timeline, (80, 24), Means(0), "\x1b]0;evil\x07<script>\n")
    title = stage.frame(Moment(0))[0]
    assert title.isprintable()
    assert "<script>" in title


def test_a_run_of_rounds_is_shown_in_rounds(finished_run):
    timeline = load(finished_run).timeline
    stage = Stage(timeline, (80, 24), Means(0), unit=ROUNDS)
    assert any(f"round 0 of {timeline.t_s[-1]:.0f} >" in line for line in stage.frame(Moment(0)))
    out = io.StringIO()
    stills(timeline, out, Means(0), unit=ROUNDS)
    assert " round 0   HD" in out.getvalue()
    assert " s   HD" not in out.getvalue()


def test_both_shapes_of_a_run_fit_in_the_picture(finished_run):
    timeline = load(finished_run).timeline
    centre = (timeline.truth.min(axis=0) + timeline.truth.max(axis=0)) / 2
    large = centre + 3 * (timeline.truth - centre)
    timeline.truth_at_s = np.array([0.0, timeline.t_s[5]])
    timeline.truths = np.stack([timeline.truth, large])
    timeline.position[5:] = large
    wide = Stage(timeline, (80, 24), Means(0)).picture(Moment(6))
    timeline.truth = large
    timeline.truth_at_s = timeline.truths = None
    assert wide == Stage(timeline, (80, 24), Means(0)).picture(Moment(6))


def test_keys_change_what_is_seen(finished_run):
    player = Player(load(finished_run).timeline)
    player.press("space")
    player.advance(5.0)
    assert (player.now_s, player.turned_deg) == (0.0, 0.0)
    for key, now_s in (
        ("5", 4.0),
        (".", 4.1),
        (",", 4.0),
        ("right", 4.0 + 8 / 60),
        ("page down", 4.0 + 56 / 60),
    ):
        player.press(key)
        assert player.now_s == pytest.approx(now_s)
    player.press("d")
    player.press("up")
    assert (player.turned_deg, player.raised_deg, player.spinning) == (15.0, 15.0, False)
    player.press("+")
    player.press("space")
    player.advance(1.0)
    assert player.now_s == pytest.approx(4.0 + 56 / 60 + 2.0)
    player.press("end")
    assert player.ended
    player.press("space")  # once more
    assert (player.now_s, player.paused) == (0.0, False)
    assert player.press("x")
    assert not player.press("q")


def test_strange_input_is_no_key(finished_run):
    player = Player(load(finished_run).timeline)
    before = player.moment()
    for key in keys_in("\x1b[200~\x1b[<0;1;1M\x00\x7f\x1bOP²\x1b"):
        assert player.press(key)
    assert player.moment() == before


class Terminal:
    """`swarmer replay --terminal` in a terminal of its own."""

    def __init__(self, *command):
        self.ours, theirs = pty.openpty()
        self.before = termios.tcgetattr(theirs)
        self.resize(100, 30)
        self.seen = ""

        def its_own():
            os.setsid()
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)
            signal.signal(signal.SIGINT, signal.default_int_handler)

        self.process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=its_own,
            env={**os.environ, "TERM": "xterm-256color", "PYTHONUTF8": "1"},
        )  # fmt: skip
        self._theirs = theirs

    def resize(self, columns, rows):
        fcntl.ioctl(self.ours, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def press(self, keys):
        os.write(self.ours, keys.encode())

    def until(self, text):
        """Read until it writes `text`; what it wrote, from there on forgotten."""
        end = time.monotonic() + PATIENCE_S
        while text not in self.seen:
            ready, _, _ = select.select([self.ours], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"never wrote {text!r}: {self.seen[-2000:]!r}"
            self.seen += os.read(self.ours, 1 << 16).decode("utf-8", "replace")
        found, _, self.seen = self.seen.partition(text)
        return found + text

    def ended(self):
        """Its status, and whether the terminal is as it was."""
        self.until("\x1b[?25h\x1b[?1049l")
        status = self.process.wait(PATIENCE_S)
        same = termios.tcgetattr(self._theirs) == self.before
        return status, same

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self.ours)
        os.close(self._theirs)


def replay(run):
    return sys.executable, "-m", "swarmer", "replay", "--terminal", str(run)


@pytest.fixture
def terminal(finished_run):
    terminal = Terminal(*replay(finished_run))
    yield terminal
    terminal.close()


def test_in_a_real_terminal(terminal):
    terminal.until("40/40 lit")
    terminal.press(" ")
    terminal.until("||")
    terminal.press("\x1b[F")
    terminal.until("8.0 of 8.0 s")
    terminal.resize(50, 16)
    assert "\x1b[2J" in terminal.until("8.0 of 8.0 s")
    terminal.press("q")
    assert terminal.ended() == (0, True)


@pytest.mark.parametrize(
    ("how", "status"),
    [("\x03", 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)],
    ids=["ctrl-c", "term", "hup"],
)
def test_however_it_ends_the_terminal_is_as_it_was(terminal, how, status):
    terminal.until("lit")
    if isinstance(how, str):
        terminal.press(how)
    else:
        terminal.process.send_signal(how)
    assert terminal.ended() == (status, True)


# What a shell does with a job: its own group, which has the terminal; stopped, it is continued.
SHELL = """
import os, signal, subprocess, sys
signal.signal(signal.SIGTTOU, signal.SIG_IGN)
job = subprocess.Popen(sys.argv[1:], process_group=0)
os.tcsetpgrp(0, job.pid)
while os.WIFSTOPPED(status := os.waitpid(job.pid, os.WUNTRACED)[1]):
    os.write(1, b"it stopped")
    os.kill(job.pid, signal.SIGCONT)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def test_stopped_and_gone_on(finished_run):
    terminal = Terminal(sys.executable, "-c", SHELL, *replay(finished_run))
    try:
        terminal.until("40/40 lit")
        terminal.press("\x1a")
        assert "\x1b[?1049l" in terminal.until("it stopped")
        terminal.until("\x1b[?1049h")
        terminal.until("40/40 lit")
        terminal.press("q")
        assert terminal.ended() == (0, True)
    finally:
        terminal.close()
