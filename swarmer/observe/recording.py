"""The rerun recording of a run, and the live viewer. The only file that knows rerun.

rerun writes from a thread of its own, which waits for ever on a full disk. So it writes into a pipe, and a thread here
carries the bytes to a `Stream`: a full disk becomes RunFailed like everywhere else, and closing never hangs.
"""

from __future__ import annotations

import math
import os
import select
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmer.errors import RunFailed
from swarmer.observe.palette import STATE_COLOURS, STATES, TRUTH, Palette
from swarmer.observe.viewer import answers, display_available, free_port, start_viewer

if TYPE_CHECKING:
    from swarmer.engines.result import Event
    from swarmer.observe.files import Stream
    from swarmer.observe.timeline import Frame

TIMELINE = "emulated_time"
HD_FLOOR = 1e-6  # cells; log10 of nothing smaller is drawn
SILENCE_S = 0.5
CLOSE_S = 20.0  # how long closing may take

EVENT_LEVELS = {"failure": "WARN", "error": "ERROR", "unfaithful": "WARN"}


def import_rerun() -> None:
    """Import what takes half a second, so that a Recording is made at once."""
    import rerun
    import rerun.blueprint  # noqa: F401


class Recording:
    """recording.rrd while it is written: the cloud, the swarm, HD, swarms, states and events over emulated time."""

    def __init__(
        self, stream: Stream, truth: NDArray[np.float64], name: str = "swarm", live: bool = False
    ) -> None:
        """stream: of recording.rrd. truth: (F, 3), cells. live: show it in a viewer, too, if one can be started."""
        import rerun as rr

        self._rr: Any = rr
        self._palette = Palette(len(truth))
        self._dot = _dot_size(truth)
        self._shown: tuple[NDArray[Any], NDArray[Any]] | None = None
        self._step = 0
        self.warning: str | None = None
        self._rec: Any = rr.RecordingStream("swarmer", recording_id=f"{name}-{os.getpid()}")
        self._pump = _Pump(stream)
        sinks: list[Any] = [rr.FileSink(self._pump.path)]
        if live and (address := self._viewer()):
            sinks.insert(0, rr.GrpcSink(address))
        self._rec.set_sinks(*sinks, default_blueprint=_blueprint(truth, live))
        self._pump.opened()
        self._describe(truth)

    def _viewer(self) -> str | None:
        """Start a viewer on a free port of this machine and give its address; None, with a warning, if none comes."""
        if not display_available():
            self.warning = (
                "no display for the live viewer; the run goes on (later: `swarmer replay --web RUN`)"
            )
            return None
        port = free_port()
        try:
            start_viewer(port)
        except OSError as error:
            self.warning = f"the live viewer did not start ({error}); the run goes on without it"
            return None
        if not answers(port):
            self.warning = "the live viewer does not answer; the run goes on without it"
            return None
        return f"rerun+http://127.0.0.1:{port}/proxy"

    def _describe(self, truth: NDArray[np.float64]) -> None:
        """Log what never changes."""
        rr, rec = self._rr, self._rec
        rec.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
        rec.log("truth", rr.Points3D(truth, radii=0.35 * self._dot, colors=TRUTH), static=True)
        line = {"interpolation_mode": rr.components.InterpolationMode.Linear}
        rec.log(
            "hd/log10", rr.SeriesLines(names="log10 HD", colors=(76, 155, 232), widths=2, **line), static=True
        )
        rec.log(
            "hd_cells",
            rr.SeriesLines(names="HD, cells", colors=(76, 155, 232), widths=2, **line),
            static=True,
        )
        rec.log(
            "swarms", rr.SeriesLines(names="swarms", colors=(242, 177, 52), widths=2, **line), static=True
        )
        for state, colour in zip(STATES, STATE_COLOURS, strict=True):
            look = rr.SeriesLines(names=state, colors=_rgb(colour), widths=1.5, **line)
            rec.log(_state_entity(state), look, static=True)

    def frame(self, frame: Frame, swarms: int, states: NDArray[Any]) -> None:
        """Log a sample. swarms: how many; states: FLSs in each state. Raises RunFailed if the file cannot grow."""
        self._pump.check()
        rr, rec = self._rr, self._rec
        rec.set_time(TIMELINE, duration=float(frame.t_s))
        rec.set_time("sample", sequence=self._step)
        self._step += 1
        rec.log("swarm", rr.Points3D(np.array(frame.position, dtype=np.float32), **self._look(frame)))
        rec.log("swarms", rr.Scalars(float(swarms)))
        for state, count in zip(STATES, states, strict=True):
            rec.log(_state_entity(state), rr.Scalars(float(count)))
        if math.isfinite(frame.hd_cells):
            rec.log("hd_cells", rr.Scalars(frame.hd_cells))
            rec.log("hd/log10", rr.Scalars(math.log10(max(frame.hd_cells, HD_FLOOR))))

    def _look(self, frame: Frame) -> dict[str, Any]:
        """Colours and sizes, if they are others than at the frame before."""
        if self._shown is not None and all(
            np.array_equal(old, new) for old, new in zip(self._shown, (frame.swarm, frame.lit), strict=True)
        ):
            return {}
        self._shown = (frame.swarm.copy(), frame.lit.copy())
        radii = np.where(frame.lit, self._dot, 0.45 * self._dot).astype(np.float32)
        return {"colors": self._palette.colours(frame.swarm, frame.lit), "radii": radii}

    def event(self, event: Event) -> None:
        """Log an event as a line of text."""
        who = f"FLS {event.fid}: " if event.fid else ""
        self._rec.set_time(TIMELINE, duration=float(event.t_s))
        level = EVENT_LEVELS.get(event.kind, "INFO")
        self._rec.log("events", self._rr.TextLog(f"{who}{event.text or event.kind}", level=level))

    def close(self) -> None:
        """End the file; its stream is closed by whoever made it. Raises RunFailed if the file is not whole."""
        ender = threading.Thread(target=self._rec.disconnect, daemon=True)
        ender.start()
        ender.join(CLOSE_S)
        self._pump.finish(CLOSE_S, ended=not ender.is_alive())


class _Pump:
    """Carries what rerun writes from a pipe to a stream; after a failure it still drains the pipe, into nothing."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._failure: RunFailed | None = None
        self._ended = threading.Event()
        self._reader, self._writer = os.pipe()
        self.path = f"/dev/fd/{self._writer}"
        self._thread = threading.Thread(target=self._carry, name="recording", daemon=True)

    def opened(self) -> None:
        """rerun has opened the pipe by its path: give up our end, and start."""
        os.close(self._writer)
        self._thread.start()

    def _carry(self) -> None:
        while data := self._read():
            if self._failure is None:
                try:
                    self._stream.write(data)
                except RunFailed as failure:
                    self._failure = failure
        os.close(self._reader)

    def _read(self) -> bytes:
        """What comes next; nothing at the end.

        The end is the pipe's, or silence after rerun has ended: a child forked meanwhile may hold the pipe open.
        """
        while not select.select([self._reader], [], [], SILENCE_S)[0]:
            if self._ended.is_set():
                return b""
        return os.read(self._reader, 1 << 20)

    def check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def finish(self, timeout_s: float, ended: bool) -> None:
        if ended:
            self._ended.set()
            self._thread.join(timeout_s)
        if self._thread.is_alive() and self._failure is None:
            self._failure = RunFailed(
                f"{self._stream.path}: the recorder did not end; the recording stays partial"
            )
        if self._failure is not None:
            self._stream.abandon()
            raise self._failure


def _blueprint(truth: NDArray[np.float64], live: bool) -> Any:
    """What the viewer shows at first: the swarm large on the left, curves and events on the right."""
    import rerun.blueprint as rrb

    low, high = truth.min(axis=0), truth.max(axis=0)
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
    flat = low[2] == high[2]  # seen from the front, or what is nearer to the eye is drawn larger
    eye = centre + size * np.array([0.0, 0.0, 1.0] if flat else [0.32, 0.22, 0.80])
    legend = rrb.PlotLegend(rrb.Corner2D.RightTop)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/",
                contents=["/swarm", "/truth"],
                name="Swarm",
                background=rrb.Background(color=(13, 16, 23)),
                line_grid=rrb.LineGrid3D(visible=False),
                eye_controls=rrb.EyeControls3D(position=eye, look_target=centre, eye_up=(0.0, 1.0, 0.0)),
            ),
            rrb.Vertical(
                rrb.Tabs(
                    rrb.TimeSeriesView(
                        origin="/hd", name="Hausdorff distance, log10 of cells", plot_legend=legend
                    ),
                    rrb.TimeSeriesView(origin="/hd_cells", name="in cells", plot_legend=legend),
                ),
                rrb.TimeSeriesView(origin="/swarms", name="Swarms", plot_legend=legend),
                rrb.TimeSeriesView(origin="/states", name="FLSs in each state", plot_legend=legend),
                rrb.TextLogView(origin="/events", name="Events"),
                row_shares=[3, 2, 3, 2],
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following" if live else "playing"),
        collapse_panels=True,
    )


def _dot_size(truth: NDArray[np.float64]) -> float:
    """Radius of a lit FLS in cells: a good part of the usual spacing."""
    from scipy.spatial import cKDTree

    few = truth[:: max(1, len(truth) // 2000)]
    distances = np.asarray(cKDTree(truth).query(few, k=min(2, len(truth)))[0])
    spacing = float(np.median(distances[:, -1])) if distances.ndim == 2 else 0.0
    return 0.28 * spacing or 0.5


def _state_entity(state: str) -> str:
    return "states/" + state.lower().replace(" ", "_")


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
