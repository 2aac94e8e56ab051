"""What a sweep shows while it runs."""

import io
from pathlib import Path

from swarmer.experiments.board import Board
from swarmer.experiments.one_run import Outcome


class Run:
    """As much of a run as a board needs."""

    def __init__(self, name):
        self.path = Path(name)


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def begun(stream, clock):
    board = Board(stream, clock)
    board.planned("mine", 10, 4, 2)
    for name in ("a/seed-1", "b/seed-1"):
        board.started(Run(name))
    return board


def test_without_a_terminal_a_line_every_5_seconds_and_failures_at_once():
    stream, clock = io.StringIO(), Clock()
    board = begun(stream, clock)
    for now in range(101, 109):
        clock.now = now
        board.tick()
    clock.now = 110
    board.ended(Run("a/seed-1"), Outcome("failed", "it broke"))
    board.tick()
    board.close()
    assert stream.getvalue().splitlines() == [
        "mine: 10 runs, 4 of them finished already, 2 at a time",
        "4 of 10 runs, 2 running, wall 0:05, ETA –",
        "failed: a/seed-1: it broke",
        "5 of 10 runs, 1 failed, 1 running, wall 0:10, ETA 0:50",
    ]


def test_on_a_terminal_a_panel_with_what_runs_and_what_failed():
    stream, clock = Terminal(), Clock()
    board = begun(stream, clock)
    clock.now = 161
    board.ended(Run("a/seed-1"), Outcome("done", ""))
    board.ended(Run("b/seed-1"), Outcome("failed", "it broke"))
    board.started(Run("c/seed-1"))
    clock.now = 163
    lines = board.lines(70)
    assert lines[0].endswith("6 of 10   wall 1:03   ETA 2:06")
    assert lines[0].count("━") == round(0.6 * lines[0].index("  6"))
    assert lines[1:] == ["running     0:02  c/seed-1", "1 failed", "failed: b/seed-1: it broke"]
    board.tick()
    board.close()
    board.close()
    assert "c/seed-1" in stream.getvalue()
    assert stream.getvalue().rstrip().endswith("failed: b/seed-1: it broke")
