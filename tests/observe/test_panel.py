import io

import pytest

from swarmer.observe.closing import closing_lines
from swarmer.observe.panel import Panel
from swarmer.observe.panel_view import View, panel_lines


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    """Wall time that passes by a tenth of a second whenever one looks."""

    def __init__(self, step):
        self.now, self.step = 0.0, step

    def __call__(self):
        self.now += self.step
        return self.now


def test_without_a_terminal_one_plain_line_every_5_seconds(tmp_path, fake):
    out = io.StringIO()
    fake.record(tmp_path / "run", Panel(out, Clock(0.1)), recording={"enabled": False})
    lines = out.getvalue().splitlines()
    assert "\x1b" not in out.getvalue()
    samples = [line for line in lines if " swarm" in line]
    assert 2 <= len(samples) <= 4  # of 81 samples in some 16 s of the clock
    assert "HD" in samples[0]
    assert lines[1].startswith("launching: 40 of 40")


def test_on_a_terminal_it_draws_and_gives_the_terminal_back(tmp_path, fake, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm-256color")
    out = Terminal()
    fake.record(tmp_path / "run", Panel(out, Clock(0.1)), recording={"enabled": False})
    assert "Busy Localizing" in out.getvalue()
    assert out.getvalue().rindex("\x1b[?25h") > out.getvalue().rindex("\x1b[?25l")


VIEWS = {
    "empty": View(),
    "first": View("t", 3, 60.0, t_s=0.1),
    "huge": View("x" * 200, 10**7, 1e9, t_s=1e8, wall_s=1e7, states=(10**7,) * 5, swarms=10**7, largest_swarm=10**7,
                 single_swarms=10**6, hd=1e12, hd_min=1e-12, sent_per_s=1e9, handled_per_s=1e9,
                 curve=[(0.0, 1e12), (1e8, 1e-12)]),
    "zero": View("t", 3, 60.0, t_s=5.0, hd=0.0, hd_min=0.0, curve=[(1.0, 0.0), (2.0, float("nan"))]),
}  # fmt: skip


@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize("width", [40, 76, 92])
def test_height_never_changes_and_80_columns_are_enough(name, width):
    lines = panel_lines(VIEWS[name], width)
    assert len(lines) == 13
    if name != "huge" and width >= 76:
        assert max(line.cell_len for line in lines) <= width


def test_closing_lines_say_what_happened_and_what_to_do_next(tmp_path):
    summary = {
        "status": "done", "shape": "dragon", "points": 760, "emulated_s": 60.0, "wall_s": 61.0, "hd_cells": 0.002,
        "hd_min_cells": 0.001, "time_to_hd_s": {"1": 12.3, "0.01": None}, "first_single_swarm_s": 4.1,
        "single_swarm_count": 3, "faithful": False, "suggested_time_scale": 0.5,
        "timer_late_ms": {"p99": 300.0}, "handled_late_ms": {"p99": 20.0},
    }  # fmt: skip
    text = "\n".join(closing_lines(summary, tmp_path / "my run"))
    for part in (
        "done: dragon, 760",
        "one swarm at 4.1 s, 3 ×",
        "12.3 s",
        "never",
        "NOT FAITHFUL",
        "--time-scale 0.5",
    ):
        assert part in text
    assert f"replay '{tmp_path / 'my run'}'" in text
    assert closing_lines({"status": "failed", "message": "why"}, tmp_path)[1].strip() == "why"


def test_while_emulated_time_stands_still_the_line_still_comes(fake):
    out = io.StringIO()
    panel = Panel(out, Clock(2.0))
    panel.planned(fake.plan())
    panel.go(0.1)
    for _ in range(6):
        panel.beat(3.25)
    lines = [line for line in out.getvalue().splitlines() if "3.2" in line]
    assert 2 <= len(lines) <= 3, "one in 5 seconds of the wall clock"
