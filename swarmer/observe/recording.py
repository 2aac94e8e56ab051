"""recording.rrd while it is written (docs/recording.md): the display, curves and events over emulated time.

It is fed by the collector, whatever the engine, and what an engine does not have is not in it. Rows are gathered and
sent some samples at a time, so size and cost depend on what happens in the display, not on how fast the run is.
"""

from __future__ import annotations

import math
import secrets
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmer.errors import RunFailed
from swarmer.observe.blueprint import log_curves, make_blueprint
from swarmer.observe.narrator import Narrator
from swarmer.observe.pump import Pump
from swarmer.observe.scene import Scene
from swarmer.observe.tracks import Moment, Track

if TYPE_CHECKING:
    from swarmer.engines.result import Event, Snapshot
    from swarmer.observe.files import Stream
    from swarmer.observe.live import LiveViewer
    from swarmer.observe.progress import Progress
    from swarmer.plan import Plan

HD_FLOOR = 1e-6  # cells; log10 of nothing smaller is drawn
CLOSE_S = 20.0  # how long closing may take
CHUNK_SAMPLES, CHUNK_MIN = 20, 2
CHUNK_S, CHUNK_LIVE_S = 2.0, 0.25  # wall; so long may a few samples wait for being sent
CHUNK_POSITIONS = 500_000
FAILURES = ("failure", "departure", "crash")

EVENT_LEVELS = {"failure": "WARN", "departure": "WARN", "crash": "ERROR", "host": "ERROR", "stderr": "ERROR"}


def import_rerun() -> None:
    """Import what takes half a second, so that a Recording is made at once."""
    import rerun
    import rerun.blueprint  # noqa: F401


class Recording:
    """Takes every sample and every event of a run, for a file, a live viewer, or both."""

    def __init__(self, plan: Plan, stream: Stream | None, viewer: LiveViewer | None = None) -> None:
        """stream: of recording.rrd, closed by whoever made it. viewer: shown the same, and closed here.

        Raises RunFailed where no more files can be had.
        """
        import rerun as rr

        config, standings = plan.config, plan.standings()
        truth = standings[0].truth
        rate_hz = (
            1.0 if config.engine == "rounds" else config.recording.rate_hz
        )  # a round is drawn as a second
        self.every = samples_between(len(truth), rate_hz, config.recording.positions_per_s)
        self._pump, self._viewer = Pump(stream, viewer), viewer
        # Real time is shown as it comes; what virtual time computes ahead of the viewer is played.
        self._following = viewer is not None and config.engine in ("process", "cluster")
        self._look = partial(make_blueprint, truth, config.duration_s)
        self._network = True  # there are curves of datagrams and lateness
        self._rec: Any = rr.RecordingStream(
            "swarmer", recording_id=f"{plan.cloud.name}-{secrets.token_hex(4)}"
        )
        try:
            self._rec.set_sinks(rr.FileSink(self._pump.path))
        except RuntimeError as error:  # rerun's word for what is an OSError elsewhere
            if stream is not None:
                stream.abandon()
            raise RunFailed(
                f"the recording could not be begun: {str(error).partition(', path')[0]}"
            ) from error
        self._pump.opened()
        self._rec.send_recording_name(f"{plan.cloud.name}, {config.engine}, seed {config.seed}")
        if self._following:  # a launch takes a while; the viewer would make up a layout
            self._rec.send_blueprint(self._look(self._network, following=True))
        self._scene = Scene(self._rec, standings, config)
        self._narrator = Narrator()
        names = ("hd/log10", "hd_cells", "swarms", "states", "datagrams", "lateness")
        self._curves = {name: Track(name, rr.Scalars.columns) for name in names}
        self._events = Track("events", rr.TextLog.columns)
        self._samples = 0
        self._drawn = self._gathered = 0  # positions, samples, since rows were sent
        self._sampled_s = -math.inf
        self._undrawn: tuple[Moment, Snapshot] | None = None
        self._sent: tuple[float, float, float] | None = (
            None  # t_s, datagrams sent, delivered: at the sample before
        )
        self._sent_wall = time.monotonic()

    def sample(self, snapshot: Snapshot, progress: Progress) -> None:
        """Take a sample, of which `progress` knows HD and swarms. Raises RunFailed if the file cannot grow."""
        self._pump.check()
        self._sampled_s = round(float(snapshot.t_s), 3)
        at = Moment(self._sampled_s, self._samples)
        if self._samples == 0:
            self._open(snapshot)
        self._scene.note(snapshot)
        if self._samples % self.every:
            self._undrawn = at, snapshot
        else:
            self._draw(at, snapshot)
        self._draw_curves(at, snapshot, progress)
        lines = self._narrator.lines(snapshot, progress.swarms.number)
        self._tell(at, lines, "TRACE")
        self._samples += 1
        self._gathered += 1
        self._send_if_due()

    def _open(self, first: Snapshot) -> None:
        """Say how it is to be looked at, now that it is known what the engine has."""
        network = "datagrams_sent" in first.counters
        log_curves(self._rec, network)
        if not self._following or network != self._network:
            self._network = network
            self._rec.send_blueprint(self._look(network, self._following))

    def _draw(self, at: Moment, snapshot: Snapshot) -> None:
        self._undrawn = None
        self._drawn += len(snapshot.position)
        self._scene.draw(at, snapshot)

    def _draw_curves(self, at: Moment, snapshot: Snapshot, progress: Progress) -> None:
        self._curve("swarms", at, progress.swarms.number)
        self._curve("states", at, *progress.states.tolist())
        if math.isfinite(progress.hd):
            self._curve("hd_cells", at, progress.hd)
            self._curve("hd/log10", at, math.log10(max(progress.hd, HD_FLOOR)))
        timers, handled = snapshot.live.timer_late_ms, snapshot.live.handled_late_ms
        if timers and handled:
            self._curve("lateness", at, timers.p99, handled.p99)
        self._draw_datagrams(at, snapshot.counters)

    def _draw_datagrams(self, at: Moment, counters: dict[str, float]) -> None:
        if "datagrams_sent" not in counters:
            return
        now = at.t_s, counters["datagrams_sent"], counters.get("datagrams_delivered", 0.0)
        if self._sent is not None and now[0] > self._sent[0]:
            passed, sent, delivered = (new - old for new, old in zip(now, self._sent, strict=True))
            self._curve("datagrams", at, sent / passed, delivered / passed)
        self._sent = now

    def _curve(self, name: str, at: Moment, *values: float) -> None:
        self._curves[name].add(at, scalars=np.array(values, np.float64))

    def event(self, event: Event) -> None:
        """Take an event: a line of text, and a flash where an FLS failed."""
        who = f"FLS {event.fid}: " if event.fid else ""
        # An engine tells of what came before a sample, and then, at the sample's own moment, of what it found there.
        sample = self._samples - 1 if round(event.t_s, 3) <= self._sampled_s else self._samples
        at = Moment(round(float(event.t_s), 3), max(sample, 0))
        self._tell(at, [f"{who}{event.text or event.kind}"], EVENT_LEVELS.get(event.kind, "INFO"))
        if event.fid and event.kind in FAILURES:
            self._scene.failed(event.fid, event.t_s)

    def _tell(self, at: Moment, lines: list[str], level: str) -> None:
        for line in lines:
            self._events.add(at, text=[line], level=[level])

    def _send_if_due(self) -> None:
        waited = time.monotonic() - self._sent_wall
        if (
            self._samples % CHUNK_SAMPLES == 1
            or self._drawn >= CHUNK_POSITIONS
            or (waited >= (CHUNK_S if self._viewer is None else CHUNK_LIVE_S) and self._gathered >= CHUNK_MIN)
        ):
            self._send()

    def _send(self) -> None:
        self._sent_wall, self._drawn, self._gathered = time.monotonic(), 0, 0
        for track in (*self._scene.tracks(), *self._curves.values(), self._events):
            track.send(self._rec)

    def news(self) -> list[str]:
        """What the user should know of the live viewer since the last time."""
        return [] if self._viewer is None else self._viewer.news()

    def close(self) -> None:
        """End the file, and let the viewer be. Raises RunFailed if the file is not whole."""
        if self._undrawn is not None:
            self._draw(*self._undrawn)
        self._send()
        if self._following:
            self._rec.flush()
            self._pump.let_viewer_go()
            self._rec.send_blueprint(self._look(self._network, following=False))  # the file is to be played
        ender = threading.Thread(target=self._rec.disconnect, daemon=True)
        ender.start()
        ender.join(CLOSE_S)
        try:
            self._pump.finish(CLOSE_S, ended=not ender.is_alive())
        finally:
            if self._viewer is not None:
                self._viewer.close()


def samples_between(count: int, rate_hz: float, positions_per_s: float) -> int:
    """Of how many samples one shows the FLSs: of so many that no more positions than that are taken.

    >>> [samples_between(count, 10.0, 50_000.0) for count in (760, 5_000, 11_894, 22_375)]
    [1, 1, 3, 5]
    """
    return max(1, math.ceil(count * rate_hz / positions_per_s))
