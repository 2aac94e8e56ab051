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
        "5 of 10 runs, 1 failed, 1 running, wall 0:10, ETA –",
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
    assert lines[0].endswith("6 of 10   wall 1:03   ETA 2:01")  # 4 of 61 s, two at a time, 2 s of them over
    assert lines[0].count("━") == round(0.6 * lines[0].index("  6"))
    assert lines[1:] == ["running     0:02  c/seed-1", "1 failed", "failed: b/seed-1: it broke"]
    board.tick()
    board.close()
    board.close()
    assert "c/seed-1" in stream.getvalue()
    assert stream.getvalue().rstrip().endswith("failed: b/seed-1: it broke")


def eta(board):
    return board.line().rpartition("ETA ")[2]


def test_the_time_left_does_not_grow_while_runs_take_no_longer_nor_when_one_dies():
    clock = Clock()
    board = begun(io.StringIO(), clock)
    clock.now = 140
    board.ended(Run("a/seed-1"), Outcome("done", ""))
    board.started(Run("c/seed-1"))
    assert eta(board) == "1:20"  # 5 of 40 s, two at a time, one of them over
    clock.now = 150
    assert eta(board) == "1:15"
    board.ended(Run("c/seed-1"), Outcome("failed", "it was killed"))
    board.started(Run("d/seed-1"))
    assert eta(board) == "1:00"


def test_when_all_have_ended_no_time_is_left():
    board = Board(io.StringIO(), Clock())
    board.planned("mine", 1, 0, 1)
    board.started(Run("a"))
    board.ended(Run("a"), Outcome("failed", "it broke"))
    assert eta(board) == "0:00"
