"""The process engine: one OS process per FLS on this machine (section 6).

It holds the run together: starts the dispatcher, gives the go signal, samples the shared memory, thaws if the policy is
`centralized`, keeps the machine faithful (`fidelity`), and ends everything.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any, Self

from swarmer.engines.fidelity import LOOK_S, Governor, Tally
from swarmer.engines.limits import check_limits, children_of, private_mb
from swarmer.engines.result import Event, Live, Observer, RunResult, Snapshot
from swarmer.errors import BadInput, RunFailed
from swarmer.fls_process import RunSpec
from swarmer.messages import ENGINE_FID, NO_SWARM, ZERO, Kind, Message, Stamp, To, encode
from swarmer.physics.flight import Velocity
from swarmer.plan import as_data
from swarmer.protocol.events import Count
from swarmer.radio import Grid
from swarmer.telemetry import Clock, Life, Phase, Reader, Sample, SharedMemory, Wire
from swarmer.udp_wrapper import BROADCAST, Wires, lock_port

if TYPE_CHECKING:
    from swarmer.plan import Plan

NEAR_MAX = 64  # nearest FLSs an FLS can reach by unicast; more go by broadcast
LAUNCH_PATIENCE_S = 60.0  # without any FLS getting ready
END_PATIENCE_S = 10.0
REHEARSALS = 3
REHEARSED = 0.98  # share of the FLSs that must have been woken before the next round
REHEARSAL_PATIENCE_S = 2.0
MEMORY_SAMPLE = 24  # processes whose private memory is read, once
CRASHES_MAX = 0.05  # share of FLSs that may die unexpectedly before the run is given up


class ProcessEngine:
    """Runs one plan as F processes. Made, checked and given back as a context; `run` runs once.

    Making one raises BadInput where this machine cannot take the run; nothing has started then.
    """

    name = "process"

    def __init__(self, plan: Plan) -> None:
        check_limits(plan.size)
        self.plan = plan
        port = plan.config.radio.port
        try:
            self._lock = lock_port(port)
        except OSError as error:
            raise BadInput("radio.port", port, f"{error}; a free port, or 0 for the first free one") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()

    def run(self, observer: Observer) -> RunResult:
        """Run to the end, the goal, Ctrl-C or a failure; the result says which. Raises RunFailed if `observer` does."""
        observer.planned(self.plan)
        return asyncio.run(_Run(self.plan, observer, self._lock).play())


class _Run:
    def __init__(self, plan: Plan, observer: Observer, lock: socket.socket) -> None:
        self.plan, self.observer, self.lock = plan, observer, lock
        self.config, self.count = plan.config, plan.size
        self.port = lock.getsockname()[1]
        self.run_id = secrets.randbits(32)
        self.key = secrets.token_bytes(16) if plan.config.radio.mac else b""
        self.shared = SharedMemory(self.count)
        self.clock = Clock(self.shared)
        self.reader = Reader(self.shared, Velocity(*plan.rules.velocity))
        self.tally = Tally()
        self.governor = Governor(self.config.time_scale, self.config.lease_ms)
        self.result = RunResult("process", "done", 0.0, 0.0)
        self.events: dict[str, int] = {"failed": 0, "departed": 0, "died": 0, "replaced": 0}
        self.stopping = asyncio.Event()
        self._numbers = 0
        self._thaw_epoch = 0
        self._last_thaw_s = 0.0
        self._thaws_seen = 0
        self._went_wall = 0.0
        self._dispatcher_pid = 0

    # -- the life of a run ---------------------------------------------------------------------------------------

    async def play(self) -> RunResult:
        self.clock.set(Phase.WAIT, self.governor.scale, -1e9)
        began = time.monotonic()
        process, control = self._start_dispatcher()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            with contextlib.suppress(
                ValueError, RuntimeError
            ):  # not in the main thread: the caller's business
                asyncio.get_running_loop().add_signal_handler(number, self._interrupt)
        listener: asyncio.Task[None] | None = None
        try:
            reader, writer = await asyncio.open_connection(sock=control, limit=1 << 20)
            listener = asyncio.create_task(self._listen(reader))
            await self._send_setup(writer)
            if await self._all_ready():
                await self._rehearse()
                self.result.launch_s = time.monotonic() - began
                await self._fly()
            await self._end(writer, process, listener)
        except RunFailed as failure:
            self._fail(str(failure))
        finally:
            self._kill(process)
            if listener is not None:
                listener.cancel()
            self._finish()
        return self.result

    def _start_dispatcher(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        ours, theirs = socket.socketpair()
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-m", "swarmer.engines.dispatcher", str(theirs.fileno()), str(self.shared.fd)],
                pass_fds=(theirs.fileno(), self.shared.fd),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # a terminal's Ctrl-C reaches only the engine
                env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
            )  # fmt: skip
        ours.setblocking(False)
        self._dispatcher_pid = process.pid
        return process, ours

    async def _send_setup(self, writer: asyncio.StreamWriter) -> None:
        writer.write(json.dumps(self._setup()).encode() + b"\n")
        with contextlib.suppress(ConnectionError):
            await writer.drain()

    async def _all_ready(self) -> bool:
        """Wait until every FLS is ready; False if the run was stopped before."""
        last, since = -1, time.monotonic()
        while not self.stopping.is_set():
            ready = int((self.reader.life() == Life.READY).sum())
            if ready != last:
                last, since = ready, time.monotonic()
                self.observer.launching(ready, self.count)
            if ready == self.count:
                return True
            if time.monotonic() - since > LAUNCH_PATIENCE_S:
                raise RunFailed(f"only {ready} of {self.count} FLSs got ready in {LAUNCH_PATIENCE_S:g} s")
            await self._sleep(0.05)
        return False

    async def _rehearse(self) -> None:
        """Wake everybody at once, as a thaw will, and see how long the last one takes."""
        if not self.governor.auto:
            return
        for round_number in range(1, REHEARSALS + 1):
            self.wake_all()
            since = time.monotonic()
            while not self.stopping.is_set() and time.monotonic() - since < REHEARSAL_PATIENCE_S:
                await self._sleep(0.02)
                if int(self.reader.sample().counters[Wire.WOKEN]) >= REHEARSED * round_number * self.count:
                    break
        self.tally.add(self.reader.sample())
        late = self.tally.handled()
        if late is not None:
            self.governor.rehearsed(late.p99)
        self.tally.start()

    async def _fly(self) -> None:
        self.clock.set(Phase.GO, self.governor.scale, 0.0)
        self._went_wall = time.monotonic()
        self.wake_all()
        self.observer.go(self.result.launch_s or 0.0)
        governing = asyncio.create_task(self._govern())
        try:
            await self._watch()
        finally:
            governing.cancel()

    async def _watch(self) -> None:
        period = 1.0 / self.config.recording.rate_hz
        due = 0.0
        while not self.stopping.is_set():
            done = self._look()
            now = self.clock.now()
            if done or now >= self.config.duration_s:
                return
            due = max(due + period, now)
            await self._sleep(min(due, self.config.duration_s) - now, emulated=True)

    async def _sleep(self, seconds: float, emulated: bool = False) -> None:
        wall = seconds / self.clock.scale if emulated else seconds
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self.stopping.wait(), max(wall, 0.0))

    async def _end(
        self, writer: asyncio.StreamWriter, process: subprocess.Popen[bytes], listener: asyncio.Task[None]
    ) -> None:
        """Ask everybody to end, and wait for the dispatcher to have seen them go."""
        self._measure_end()
        self.clock.set(Phase.STOP, self.clock.scale)
        self.wake_all()
        with contextlib.suppress(ConnectionError):
            writer.write(b'{"command": "stop"}\n')
            await writer.drain()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(listener, END_PATIENCE_S)
        with contextlib.suppress(subprocess.TimeoutExpired):
            await asyncio.to_thread(process.wait, END_PATIENCE_S)

    def _kill(self, process: subprocess.Popen[bytes]) -> None:
        if process.poll() is None:
            process.kill()  # the kernel ends its FLSs with it
            process.wait()

    def _interrupt(self) -> None:
        self.result.status = "interrupted"
        self.stopping.set()

    def _fail(self, message: str) -> None:
        self.result.status, self.result.message = "failed", message
        self.stopping.set()

    # -- what the dispatcher says --------------------------------------------------------------------------------

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        while line := await reader.readline():
            event = json.loads(line)
            kind = event["event"]
            if kind == "ended":
                return
            if kind == "fork_failed":
                self._fail(
                    f"only {event['running']} of {self.count} processes could be started: {event['text']}"
                )
            else:
                self._happened(kind, event)
        if not self.stopping.is_set() and self.clock.phase != Phase.STOP:
            self._fail("the dispatcher process died")

    def _happened(self, kind: str, event: dict[str, Any]) -> None:
        self.events[kind] += 1
        fid, t_s = event["fid"], max(event["t_s"], 0.0)
        if kind == "replaced":
            text = f"incarnation {event['incarnation']} launched"
        elif kind == "died":
            text = f"process ended unexpectedly with status {event['code']}"
        else:
            text = "went dark" if kind == "failed" else "left to charge"
        self.observer.event(Event(t_s, _EVENT_NAMES[kind], fid, text))
        if kind == "died" and self.events["died"] > max(3, CRASHES_MAX * self.count):
            self._fail(
                f"{self.events['died']} FLS processes died unexpectedly, the last with status {event['code']}"
            )

    # -- looking ---------------------------------------------------------------------------------------------------

    def _look(self) -> bool:
        sample = self.reader.sample()
        self._thaw_if_centralized(sample)
        self._report_thaws(sample)
        self.tally.add(sample)
        self.result.emulated_s = sample.t_s
        return self.observer.sample(self._snapshot(sample))

    async def _govern(self) -> None:
        """Keep the time scale where this machine stays faithful."""
        while self.governor.auto:
            await asyncio.sleep(LOOK_S)
            now = self.clock.now()
            timer, handled, epoch = self.reader.lateness()
            scale = self.governor.judge(timer, handled, epoch, now, time.monotonic())
            if scale != self.clock.scale and self.clock.phase == Phase.GO:
                faster = scale > self.clock.scale
                self.clock.set(Phase.GO, scale)
                if faster:  # those who wait must wait less long; for slower they wake early, look, and wait on
                    self.wake_all()
                self.observer.event(Event(now, "time_scale", 0, f"{scale:.2f}: {self.governor.reason}"))

    def _snapshot(self, sample: Sample) -> Snapshot:
        alive = sample.life == Life.READY
        live = Live(
            self.clock.scale,
            self.tally.recent_timer(),
            self.tally.recent_handled(),
            int(alive.sum()),
            None,
            self.tally.faithful(self.config.lease_ms),
        )
        return Snapshot(
            sample.t_s, sample.position, sample.swarm, sample.state, sample.lit & alive, alive,
            self._counters(sample), live,
        )  # fmt: skip

    def _counters(self, sample: Sample) -> dict[str, float]:
        c = sample.counters
        return {
            "datagrams_sent": int(c[Wire.SENT]),
            "datagrams_delivered": int(c[Wire.DELIVERED]),
            "datagrams_lost": int(c[Wire.LOST_SENDER] + c[Wire.LOST_RECEIVER]),
            "bytes_sent": int(c[Wire.BYTES_SENT]),
            "bytes_delivered": int(c[Wire.BYTES_DELIVERED]),
            "localizations": int(c[Count.LOCALIZATIONS]),
            "anchorings": int(c[Count.ANCHORINGS]),
            "leases_granted": int(c[Count.LEASES_GRANTED]),
            "leases_expired": int(c[Count.LEASES_EXPIRED]),
            "thaws": self._thaws_seen,
            "thawed_flss": int(c[Count.THAWS_OBEYED]),
            "joins": int(c[Count.JOINS]),
            "distance_cells": float(c[Wire.DISTANCE_MICROCELLS]) / 1e6,
            "flights": int(c[Wire.FLIGHTS]),
            "failures": self.events["failed"] + self.events["died"],
            "departures": self.events["departed"],
            "replacements": self.events["replaced"],
            "handled": int(c[Count.HANDLED]),
            "ignored": int(c[Count.IGNORED]),
            "stale": int(c[Count.STALE]),
            "answered_at_once": int(c[Wire.ANSWERED_AT_ONCE]),
            "rejected": int(c[Wire.BAD] + c[Wire.OTHER_RUN]),
            "not_addressed": int(c[Wire.NOT_ADDRESSED] + c[Wire.OUT_OF_RANGE]),
            "replayed": int(c[Wire.REPLAYED]),
            "send_failed": int(c[Wire.SEND_FAILED]),
        }

    # -- speaking --------------------------------------------------------------------------------------------------

    def wake_all(self) -> None:
        """Have everybody look at the control page."""
        self._broadcast(Kind.CONTROL, 0)

    def _broadcast(self, kind: Kind, epoch: int) -> None:
        self._numbers += 1
        message = Message(kind, ENGINE_FID, 0, epoch, NO_SWARM, 0, ZERO, To.ALL)
        # Before time 0 a wake-up is a rehearsal, which is timed by the wall clock.
        sent_at = time.monotonic() if self.clock.phase == Phase.WAIT else self.clock.now()
        stamp = Stamp(self.run_id, self._numbers, ZERO, sent_at)
        with contextlib.suppress(OSError):
            self.lock.sendto(encode(message, stamp, self.key), (BROADCAST, self.port))

    def _thaw_if_centralized(self, sample: Sample) -> None:
        """Rule 11, `centralized`: at one swarm, or H seconds after the last thaw."""
        if self.config.thaw.policy != "centralized" or not bool(sample.lit.all()):
            return
        single = bool((sample.swarm == sample.swarm[0]).all())
        overdue = sample.t_s - self._last_thaw_s >= self.plan.rules.thaw_h_s
        # The last thaw must have reached everybody, or the same single swarm would thaw twice.
        settled = not self.plan.rules.epochs or int(sample.epoch.min()) >= self._thaw_epoch
        if (single and settled and sample.t_s - self._last_thaw_s > self.plan.rules.lambda_s) or overdue:
            self._last_thaw_s = sample.t_s
            if self.plan.rules.epochs:
                self._thaw_epoch = int(sample.epoch.max()) + 1
            self._broadcast(Kind.THAW, self._thaw_epoch)
            self._thaws_seen += 1
            self.observer.event(Event(sample.t_s, "thaw", 0, "one swarm" if single else "overdue"))

    def _report_thaws(self, sample: Sample) -> None:
        if self.config.thaw.policy == "centralized":
            return
        thaws = (
            int(sample.epoch.max()) if self.plan.rules.epochs else int(sample.counters[Count.THAWS_STARTED])
        )
        if thaws > self._thaws_seen:
            self._thaws_seen = thaws
            self.observer.event(Event(sample.t_s, "thaw", 0, f"thaw {thaws} began"))

    # -- setup and results -----------------------------------------------------------------------------------------

    def _setup(self) -> dict[str, Any]:
        plan, config = self.plan, self.config
        cpus = sorted(os.sched_getaffinity(0)) if config.process.pin else []
        run = RunSpec(
            run=self.run_id,
            seed=config.seed,
            key=self.key,
            rules=plan.rules,
            wires=Wires(
                self.port, config.radio.carrier, config.radio.unicast_max, config.radio.kernel_filter == "auto",
                config.radio.receive_buffer_kb * 1024,
            ),
            steps_per_cell=Grid.for_display(plan.diagonal_cells).steps_per_cell,
            loop=config.fls_loop,
            cpus=tuple(cpus),
        )  # fmt: skip
        data = run._asdict() | {
            "key": self.key.hex(), "rules": as_data(plan.rules), "wires": run.wires._asdict(), "cpus": cpus,
        }  # fmt: skip
        return {"run": data, "fls": fls_specs(plan), "replace": config.failure.replace}

    def _measure_end(self) -> None:
        if self.result.launch_s is None:
            return
        self.result.wall_s = time.monotonic() - self._went_wall
        sample = self.reader.sample()
        self.result.emulated_s = min(sample.t_s, max(self.config.duration_s, self.result.emulated_s))
        self.result.counters = self._counters(sample)
        self.result.counters["dropped_by_kernel"] = kernel_drops(self.port)
        self.tally.add(sample)
        self.result.processes = int((sample.life == Life.READY).sum())
        self.result.memory_mb_per_fls = self._memory()

    def _memory(self) -> float | None:
        """Mean private memory of some of the FLSs, in MB."""
        pids = children_of(self._dispatcher_pid)
        step = max(1, len(pids) // MEMORY_SAMPLE)
        sizes = [size for pid in pids[::step] if (size := private_mb(pid)) is not None]
        return sum(sizes) / len(sizes) if sizes else None

    def _finish(self) -> None:
        result, lease_ms = self.result, self.config.lease_ms
        result.timer_late_ms, result.handled_late_ms = self.tally.timer(), self.tally.handled()
        if result.wall_s > 0:
            result.time_scale = result.emulated_s / result.wall_s
            result.faithful = self.tally.faithful(lease_ms)
            result.suggested_time_scale = self.tally.suggestion(result.time_scale, lease_ms)
        self.reader.close()
        self.shared.close()


_EVENT_NAMES = {"failed": "failure", "departed": "departure", "died": "crash", "replaced": "replacement"}


def fls_specs(plan: Plan) -> list[list[Any]]:
    """One `FlsSpec` per FLS as JSON takes it, FID 1 first."""
    import numpy as np

    from swarmer.shapes.neighbours import nearest_table

    near, distances = nearest_table(plan.cloud.points, min(NEAR_MAX, plan.size - 1))
    origins = _origins(plan)
    stations = np.array(plan.config.deploy.dispatchers)
    launched = [0] * len(stations)
    specs = []
    for row, point in enumerate(plan.cloud.points.tolist()):
        station = int(np.argmin(((stations - point) ** 2).sum(axis=1)))
        rate = plan.config.deploy.rate_per_s
        launch_at = launched[station] / rate if rate else 0.0
        launched[station] += 1
        specs.append(
            [
                row + 1, 0, point, plan.neighbours.neighbours[row], float(plan.neighbours.reach_cells[row]),
                near[row].tolist(), distances[row].tolist(), origins[row] or stations[station].tolist(), launch_at, 0,
            ]
        )  # fmt: skip
    return specs


def _origins(plan: Plan) -> list[list[float] | None]:
    """Where each FLS starts, if not at its dispatcher: anywhere in the display's box."""
    if not plan.rules.deploy_random:
        return [None] * plan.size
    import numpy as np

    low, high = plan.cloud.points.min(axis=0), plan.cloud.points.max(axis=0)
    rng = np.random.default_rng(plan.config.seed)
    return rng.uniform(low, high, size=(plan.size, 3)).tolist()


def kernel_drops(port: int) -> int:
    """Datagrams that the kernel dropped at the FLSs' unicast sockets because a buffer was full.

    The broadcast sockets are left out: there the kernel counts what the filter refused, too.
    """
    wanted, broadcast, drops = f":{port:04X}", f"{0xFFFFFF7F:08X}:{port:04X}", 0
    with contextlib.suppress(OSError), open("/proc/net/udp") as table:
        for line in table:
            fields = line.split()
            if len(fields) > 12 and fields[1].endswith(wanted) and fields[1] != broadcast:
                drops += int(fields[-1])
    return drops
