"""The panel on stderr while a run lives; where stderr is not a terminal, one plain line every 5 seconds.

rich is imported when the first thing is drawn.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO

from swarmer.engines.result import Snapshot
from swarmer.observe.panel_view import View, panel_lines, plain_line
from swarmer.observe.words import columns_of

if TYPE_CHECKING:
    from swarmer.observe.progress import Progress
    from swarmer.plan import Plan

PLAIN_EVERY_S = 5.0
DRAW_EVERY_S = 0.25
WIDTH_MAX = 96
RATE_OVER_S = 2.0  # emulated; over how long messages per second are counted
CURVE_POINTS = 400


class Panel:
    """Shows a run. Every method returns at once; nothing here may stop a run."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        """stream: stderr if None. clock: wall seconds."""
        self._stream = sys.stderr if stream is None else stream
        self._clock = clock
        self._terminal = self._stream.isatty()
        self._view = View()
        self._live: Any = None
        self._shown_at = -1e9
        self._go_at: float | None = None
        self._rates: deque[tuple[float, float, float]] = deque()

    def planned(self, plan: Plan) -> None:
        """Learn what is run."""
        config, view = plan.config, self._view
        view.size, view.duration_s, view.unit = plan.size, config.length, config.unit
        view.until_hd_cells, view.late_bound_ms = config.until_hd_cells, config.lease_ms / 2
        pace = f"λ {config.lambda_ms:g} ms" if view.unit == "s" else f"M {config.m}"
        view.title = f"{plan.cloud.name} · {plan.size} FLSs · {pace} · seed {config.seed}"
        if not self._terminal:
            self.say(f"planned {plan.cloud.name}: {plan.size} points, seed {config.seed}")

    def launching(self, ready: int, total: int) -> None:
        """Show how far the launch is."""
        if not self._due(DRAW_EVERY_S if self._terminal else PLAIN_EVERY_S) and ready < total:
            return
        if not self._terminal:
            self.say(f"launching: {ready} of {total} FLSs ready")
            return
        tail = f"  {ready} of {total} FLSs ready"
        room = max(0, min(30, columns_of(self._stream) - len("launching  ") - len(tail) - 1))
        done = round(room * ready / max(total, 1))
        bar = "━" * done + "─" * (room - done)
        self._stream.write(f"\r\x1b[2Klaunching  {bar}{tail}")
        self._stream.flush()

    def go(self, launch_s: float) -> None:
        """Time 0."""
        self._go_at = self._clock()
        if self._terminal:
            self._stream.write("\r\x1b[2K")
            self._stream.flush()
        else:
            self.say(f"go: launched in {launch_s:.1f} s")
        self._shown_at = -1e9 if self._terminal else self._clock()

    def sample(self, snapshot: Snapshot, progress: Progress) -> None:
        """Take a sample; draw if it is time."""
        self._learn(snapshot, progress)
        self._show()

    def beat(self, t_s: float) -> None:
        """No sample, but emulated second `t_s`; draw if it is time."""
        self._view.t_s = t_s
        self._view.wall_s = 0.0 if self._go_at is None else self._clock() - self._go_at
        self._show()

    def _show(self) -> None:
        if not self._due(DRAW_EVERY_S if self._terminal else PLAIN_EVERY_S):
            return
        if self._terminal:
            self._draw()
        else:
            self.say(plain_line(self._view))

    def say(self, line: str) -> None:
        """Print a line, above the panel if there is one."""
        if self._live is not None:
            self._live.console.print(line, highlight=False, markup=False)
        else:
            lead = "\r\x1b[2K" if self._terminal else ""
            self._stream.write(f"{lead}{line}\n")
            self._stream.flush()

    def close(self) -> None:
        """Give the terminal back. A second call does nothing."""
        if self._live is not None:
            live, self._live = self._live, None
            live.stop()
        elif self._terminal and self._go_at is None:
            self._stream.write("\r\x1b[2K")
            self._stream.flush()

    def _due(self, every_s: float) -> bool:
        now = self._clock()
        if now - self._shown_at < every_s:
            return False
        self._shown_at = now
        return True

    def _learn(self, snapshot: Snapshot, progress: Progress) -> None:
        view = self._view
        view.t_s = snapshot.t_s
        view.wall_s = 0.0 if self._go_at is None else self._clock() - self._go_at
        view.lit = int(snapshot.lit.sum())
        view.states = tuple(progress.states.tolist())
        view.swarms, view.largest_swarm = progress.swarms.number, progress.swarms.largest
        view.single_swarms = progress.single_swarms(snapshot.counters)
        view.thaws = snapshot.counters.get("thaws")
        view.hd, view.hd_min, view.live = progress.hd, progress.hd_min, snapshot.live
        if progress.hd_counts:
            view.curve.append((snapshot.t_s, progress.hd))
        if len(view.curve) >= 2 * CURVE_POINTS:
            del view.curve[1::2]
        self._learn_rates(snapshot)

    def _learn_rates(self, snapshot: Snapshot) -> None:
        counters, rates = snapshot.counters, self._rates
        rates.append((snapshot.t_s, counters.get("datagrams_sent", 0), counters.get("handled", 0)))
        while len(rates) > 2 and rates[-1][0] - rates[0][0] > RATE_OVER_S:
            rates.popleft()
        passed = rates[-1][0] - rates[0][0]
        if passed > 0:
            self._view.sent_per_s = (rates[-1][1] - rates[0][1]) / passed
            self._view.handled_per_s = (rates[-1][2] - rates[0][2]) / passed

    def _draw(self) -> None:
        from rich import box
        from rich.console import Console, Group
        from rich.live import Live
        from rich.panel import Panel as Frame

        if self._live is None:
            console = Console(file=self._stream)
            self._live = Live(console=console, auto_refresh=False, transient=True)
            self._live.start()
        width = min(self._live.console.width, WIDTH_MAX)
        lines = panel_lines(self._view, width - 4)
        frame = Frame(
            Group(*lines),
            title=self._view.title,
            title_align="left",
            box=box.ROUNDED,
            width=width,
            border_style="bright_black",
        )
        self._live.update(frame, refresh=True)
