"""The observer of a run: every sample becomes HD, swarms and states, and goes to timeline, recording and panel.

A disk that fails does not crash the run: the first RunFailed is kept, `sample` asks the engine to stop, and `finish`
writes what can still be written and says `failed`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from swarmer.engines.result import Event, RunResult, Snapshot
from swarmer.errors import RunFailed
from swarmer.observe.progress import Progress
from swarmer.observe.run_directory import RECORDING, RunDirectory
from swarmer.observe.summary import make_summary, transition_facts
from swarmer.observe.timeline import Frame, TimelineWriter, series_of

if TYPE_CHECKING:
    from swarmer.next_shape import Standing
    from swarmer.observe.live import LiveViewer
    from swarmer.observe.panel import Panel
    from swarmer.observe.recording import Recording
    from swarmer.plan import Plan


class Collector:
    """An engine's Observer (see engines.result), and after the run the writer of its summary."""

    def __init__(self, directory: RunDirectory, panel: Panel | None = None, live: str | None = None) -> None:
        """directory: open, closed by `finish`. panel: shown while the run lives. live: a way of `live.open_viewer`."""
        self.directory = directory
        self.failure: RunFailed | None = None
        self._panel = panel
        self._live = live
        self._plan: Plan | None = None
        self._progress: Progress | None = None
        self._timeline: TimelineWriter | None = None
        self._recording: Recording | None = None
        self._was_single = False
        self._shapes: list[Standing] = []  # to come

    def expect(self, plan: Plan) -> None:
        """From here on there is something to sum up, however early the run ends."""
        self._plan = plan
        self._progress = Progress.through(plan.standings(), bool(plan.config.oracle.count))

    def planned(self, plan: Plan) -> None:
        """Open everything that grows. Raises RunFailed: nothing has started yet."""
        self.expect(plan)
        standings = plan.standings()
        self.directory.write_config(plan.config, plan.cloud.sha256)
        self._timeline = TimelineWriter(self.directory.path, standings[0].truth, standings)
        self._shapes = list(standings[1:])
        if self._panel is not None:
            self._panel.planned(plan)
        self._open_recording(plan)
        self._keep(
            self.directory.log, f"planned: {plan.cloud.name}, {plan.size} FLSs, seed {plan.config.seed}"
        )

    def _open_recording(self, plan: Plan) -> None:
        """For the file, for a live viewer, for both; a viewer that cannot be had is only told of."""
        viewer = self._open_viewer()
        if not plan.config.recording.enabled and viewer is None:
            return
        from swarmer.observe.recording import Recording

        stream = self.directory.stream(RECORDING) if plan.config.recording.enabled else None
        self._recording = Recording(plan, stream, viewer)
        if self._recording.every > 1:
            self._tell(
                f"note: {plan.size} FLSs are many: the recording shows them at 1 of {self._recording.every} samples "
                "(recording.positions_per_s)"
            )
        self._tell_of_viewer()

    def _open_viewer(self) -> LiveViewer | None:
        if self._live is None:
            return None
        from swarmer.observe.live import open_viewer

        try:
            return open_viewer(self._live, self.directory.path.resolve().name)
        except RunFailed as failure:
            self._tell(f"warning: {failure}; the run goes on")
            return None

    def launching(self, ready: int, total: int) -> None:
        """Show how far the launch is."""
        if self._panel is not None:
            self._panel.launching(ready, total)

    def go(self, launch_s: float) -> None:
        """Time 0."""
        self._keep(self.directory.log, f"go: launched in {launch_s:.2f} s")
        if self._panel is not None:
            self._panel.go(launch_s)

    def sample(self, snapshot: Snapshot) -> bool:
        """Take a sample. True: the HD waited for is reached, or nothing more can be written."""
        assert self._plan is not None, "planned() comes first"
        assert self._progress is not None
        self._progress.update(snapshot)
        self._tell_next_shape(snapshot.t_s)
        self._keep(self._record, snapshot)
        self._tell_single_swarm(snapshot.t_s)
        self._tell_of_viewer()
        if self._panel is not None:
            self._panel.sample(snapshot, self._progress)
        return self.failure is not None or self._progress.reached(self._plan.config.until_hd_cells)

    def _record(self, snapshot: Snapshot) -> None:
        assert self._timeline is not None
        assert self._progress is not None
        frame = Frame(
            snapshot.t_s, snapshot.position, snapshot.swarm, snapshot.state, snapshot.lit, self._progress.hd
        )
        self._timeline.append(frame, series_of(snapshot))
        self._timeline.flown = snapshot.flown
        if self._recording is not None:
            self._recording.sample(snapshot, self._progress)

    def _tell_next_shape(self, t_s: float) -> None:
        """The display has become another shape: an event, and the recording shows the points of that one."""
        assert self._plan is not None
        while self._shapes and t_s >= self._shapes[0].from_s:
            standing, shape = self._shapes.pop(0), self._plan.next
            assert shape is not None
            moved = f"{len(shape.joiners)} FLSs join, {len(shape.leavers)} leave"
            self.event(
                Event(
                    standing.from_s, "next_shape", 0, f"from now on the shape is {shape.cloud.name}; {moved}"
                )
            )

    def _tell_single_swarm(self, t_s: float) -> None:
        assert self._progress is not None
        single = self._progress.swarms.single
        if single and not self._was_single:
            text = f"all FLSs are one swarm, HD {self._progress.hd:.3g} cells"
            self.event(Event(t_s, "single_swarm", 0, text))
        self._was_single = single

    def event(self, event: Event) -> None:
        """Write an event down."""
        self._keep(self.directory.event, event)
        if self._recording is not None:
            self._recording.event(event)

    def beat(self, t_s: float) -> None:
        """Show that the run lives."""
        if self._panel is not None:
            self._panel.beat(t_s)

    def finish(self, result: RunResult) -> dict[str, Any]:
        """Close everything, write the summary, and give it.

        With `failure` set afterwards the summary says `failed`: raise it, once the user has read the rest.
        Without `expect` or `planned` there is nothing to sum up: the directory is closed and the summary is empty.
        """
        if self._panel is not None:
            self._panel.close()
        if self._timeline is not None:
            self._keep(self._timeline.close)
        if self._recording is not None:
            self._keep(self._recording.close)
            self._tell_of_viewer()
        went = f"{result.emulated_s:.0f} rounds" if result.in_rounds else f"{result.emulated_s:.2f} s"
        self._keep(self.directory.log, f"{result.status}: {went} {result.message}".rstrip())
        if result.round_rows:
            self._keep(self.directory.write_rounds, result.round_rows)
        if result.host_rows:
            self._keep(self.directory.write_hosts, result.host_rows)
        summary = self._summary(result)
        self._keep(self.directory.close, summary.get("status", result.status))
        if summary:
            summary = self._summary(result)  # closing may have failed
            self._keep(self.directory.write_summary, summary)
        return self._summary(result)

    def _summary(self, result: RunResult) -> dict[str, Any]:
        if self._plan is None or self._progress is None:
            return {}
        if self.failure is not None:
            result.status = "failed"
            result.message = str(self.failure)
        plan = self._plan
        summary = make_summary(
            self._progress, result, plan.cloud.name, len(plan.cloud), plan.config.seed, plan.size
        )
        return summary | transition_facts(plan)

    def _keep(self, action: Callable[..., Any], *args: Any) -> None:
        """Do it; the first RunFailed is kept, and what the disk refuses afterwards is not tried again in a run."""
        try:
            action(*args)
        except RunFailed as failure:
            if self.failure is None:
                self.failure = failure

    def _tell_of_viewer(self) -> None:
        for line in self._recording.news() if self._recording is not None else ():
            self._tell(line)

    def _tell(self, text: str) -> None:
        self._keep(self.directory.log, text)
        if self._panel is not None:
            self._panel.say(text)
