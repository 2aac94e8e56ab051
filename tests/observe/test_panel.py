import io

import pytest

from swarmer.engines.result import Lateness, Live
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
@pytest.mark.parametrize("width", [36, 56, 73, 74, 76, 92, 116])
def test_height_never_changes_and_40_columns_are_enough(name, width):
    lines = panel_lines(VIEWS[name], width)
    assert len(lines) == (13 if width >= 74 else 16)
    if name != "huge":
        assert max(line.cell_len for line in lines) <= width


@pytest.mark.parametrize("width", [36, 56, 76])
def test_a_run_of_760_is_told_in_full(width):
    late = Lateness(2.0, 1044.0, 2000.0)
    live, states = Live(0.09, late, late, 760, 2590.0, False), (0, 451, 78, 760, 231)
    view = View("t", 760, 60.0, 0.1, 125.0, 58.94, 3723.0, 760, states, 185, 760, 16, 12.0, 0.00336, 0.00331, 5161.0,
                18800.0, live, [(1.0, 5.0), (50.0, 0.01)])  # fmt: skip
    lines = [line.plain for line in panel_lines(view, width)]
    assert max(map(len, lines)) <= width
    for part in (
        "0.00336",
        "0.00331",
        "Busy Localizing",
        "1:02:03",
        "18,800/s",
        "1044 ms",
        "2.59 GB",
        "0.09",
        "not",
    ):
        assert any(part in line for line in lines), part


def test_closing_lines_say_what_happened_and_what_to_do_next(tmp_path):
    summary = {
        "status": "done", "shape": "dragon", "points": 760, "emulated_s": 60.0, "wall_s": 61.0, "hd_cells": 0.002,
        "hd_min_cells": 0.001, "time_to_hd_s": {"1": 12.3, "0.01": None}, "first_single_swarm_s": 4.1,
        "single_swarm_count": 3, "faithful": False, "suggested_time_scale": 0.5,
        "timer_late_ms": {"p99": 300.0}, "handled_late_ms": {"p99": 20.0}, "lit_share": 1.0,
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
    assert f"report '{tmp_path / 'my run'}'" in text
    assert "lit" not in text
    assert closing_lines({"status": "failed", "message": "why"}, tmp_path)[1].strip() == "why"


@pytest.mark.parametrize(
    ("left", "display", "offered"),
    [
        ("recording.rrd", ":0", "replay RUN"),
        ("recording.rrd.partial", ":0", "replay RUN"),
        ("recording.rrd", "", "replay --web RUN"),
        ("timeline.npz", ":0", "replay --terminal RUN"),
        ("log.txt", ":0", None),
    ],
)
def test_what_is_offered_next_works(tmp_path, monkeypatch, left, display, offered):
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    (tmp_path / left).touch()
    text = "\n".join(closing_lines({"status": "done"}, tmp_path)).replace(str(tmp_path), "RUN")
    assert ("replay" in text) == (offered is not None)
    assert offered is None or f"swarmer {offered}" in text


@pytest.mark.parametrize(
    ("share", "hd", "words"),
    [(0.9, 0.1, "36 of 40 FLSs lit at the end: HD is theirs alone"), (0.025, None, "no HD of so few")],
)
def test_it_is_said_how_many_are_lit_where_not_all_are(tmp_path, share, hd, words):
    summary = {"status": "done", "points": 40, "lit_share": share, "hd_cells": hd}
    assert words in "\n".join(closing_lines(summary, tmp_path))


@pytest.mark.parametrize("width", [40, 60, 80])
def test_closing_lines_fit_the_terminal(tmp_path, width):
    times = dict.fromkeys(("1", "0.1", "0.09", "0.01", "0.001"), 12.3)
    late = {"p99": 1234.0}
    summary = {
        "status": "done", "shape": "butterfly1008", "points": 1008, "emulated_s": 60.0, "wall_s": 161.0,
        "hd_cells": 0.0021, "hd_min_cells": 0.001, "time_to_hd_s": times, "first_single_swarm_s": 4.1,
        "single_swarm_count": 3, "faithful": False, "suggested_time_scale": 0.5, "timer_late_ms": late,
        "handled_late_ms": late, "lit_share": 0.5,
    }  # fmt: skip
    lines = [line for line in closing_lines(summary, tmp_path, width=width) if str(tmp_path) not in line]
    assert max(map(len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    for part in (
        "one swarm at 4.1 s, 3 ×",
        "< 0.001",
        "12.3 s",
        "--time-scale 0.5 would do",
        "504 of 1,008 FLSs lit",
    ):
        assert part in text


def test_while_emulated_time_stands_still_the_line_still_comes(fake):
    out = io.StringIO()
    panel = Panel(out, Clock(2.0))
    panel.planned(fake.plan())
    panel.go(0.1)
    for _ in range(6):
        panel.beat(3.25)
    lines = [line for line in out.getvalue().splitlines() if "3.2" in line]
    assert 2 <= len(lines) <= 3, "one in 5 seconds of the wall clock"
