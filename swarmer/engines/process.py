"""The process engine: one OS process per FLS on this machine (section 6).

It starts the dispatcher, which forks the FLSs, and speaks to them over the loopback interface; all else of a run is
`real_time`'s.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
import socket
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Self

from swarmer.engines.limits import check_limits, check_loop, children_of, private_mb
from swarmer.engines.reading import kernel_drops
from swarmer.engines.real_time import RealTimeRun
from swarmer.engines.result import Observer, RunResult
from swarmer.engines.specs import setup
from swarmer.errors import BadInput, RunFailed
from swarmer.messages import ENGINE_FID, NO_SWARM, ZERO, Kind, Message, Stamp, To, encode
from swarmer.telemetry import Phase
from swarmer.udp_wrapper import BROADCAST, PORT_ALLOWED, lock_port

if TYPE_CHECKING:
    from swarmer.plan import Plan

END_PATIENCE_S = 10.0


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
            raise BadInput("radio.port", port, f"{error}; {PORT_ALLOWED}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()

    def run(self, observer: Observer) -> RunResult:
        """Run to the end, the goal, Ctrl-C or a failure; the result says which. Raises RunFailed if `observer` does."""
        observer.planned(self.plan)
        what = "no memory to share"
        try:
            run = _Run(self.plan, observer, self._lock)
            what = "the run could not be started"
            check_loop()
            return asyncio.run(run.play())
        except OSError as error:
            raise RunFailed(f"{what}: {error.strerror or error}") from error


class _Run(RealTimeRun):
    def __init__(self, plan: Plan, observer: Observer, lock: socket.socket) -> None:
        super().__init__(plan, observer, "process")
        self.lock = lock
        self.port = lock.getsockname()[1]
        self.run_id = secrets.randbits(32)
        self.key = secrets.token_bytes(16) if plan.config.radio.mac else b""
        self._numbers = 0
        self._process: subprocess.Popen[bytes] | None = None

    # -- the life of a run ---------------------------------------------------------------------------------------

    async def play(self) -> RunResult:
        self.clock.set(Phase.WAIT, self.governor.scale, -1e9)
        began = time.monotonic()
        process, control = self._start_dispatcher()
        self._heed_endings()
        listener = complaints = None
        try:
            reader, writer = await asyncio.open_connection(sock=control, limit=1 << 20)
            listener = asyncio.create_task(self._listen(reader))
            complaints = asyncio.create_task(self._hear_complaints(process))
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
            if complaints is not None:
                complaints.cancel()
            self._finish()
        return self.result

    def _start_dispatcher(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        self._process, control = start_beside("swarmer.engines.dispatcher", self.shared.fd)
        return self._process, control

    async def _hear_complaints(self, process: subprocess.Popen[bytes]) -> None:
        """What the dispatcher and its FLSs write to stderr."""
        pipe = asyncio.StreamReader()
        protocol = asyncio.StreamReaderProtocol(pipe)
        await asyncio.get_running_loop().connect_read_pipe(lambda: protocol, process.stderr)
        while line := await pipe.readline():
            self._complain(line)

    async def _send_setup(self, writer: asyncio.StreamWriter) -> None:
        writer.write(json.dumps(setup(self.plan, self.run_id, self.port, self.key)).encode() + b"\n")
        with contextlib.suppress(ConnectionError):
            await writer.drain()

    async def _end(
        self, writer: asyncio.StreamWriter, process: subprocess.Popen[bytes], listener: asyncio.Task[None]
    ) -> None:
        """Ask everybody to end, and wait for the dispatcher to have seen them go."""
        self._measure_end()
        await self._set_clock(Phase.STOP, self.clock.scale)
        self.wake_all()
        with contextlib.suppress(ConnectionError):
            writer.write(b'{"command": "stop"}\n')
            await writer.drain()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(asyncio.shield(listener), END_PATIENCE_S)
        with contextlib.suppress(subprocess.TimeoutExpired):
            await asyncio.to_thread(process.wait, END_PATIENCE_S)

    def _kill(self, process: subprocess.Popen[bytes]) -> None:
        if process.poll() is None:
            process.kill()  # the kernel ends its FLSs with it
            process.wait()

    def _end_at_once(self) -> None:
        if self._process is not None:
            self._process.kill()

    # -- what the dispatcher says --------------------------------------------------------------------------------

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        while line := await _line(reader):
            event = json.loads(line)
            if event["event"] == "ended":
                return
            await self._heard(event)
        if not self.stopping.is_set() and self.clock.phase != Phase.STOP:
            await self._fail_with_last_words("the dispatcher process died")

    def _mean_memory_mb(self, processes: int) -> float | None:
        return None if self._process is None else mean_private_mb(self._process.pid, processes)

    def _dropped_by_kernel(self) -> int:
        return kernel_drops(self.port)

    # -- speaking --------------------------------------------------------------------------------------------------

    async def _set_clock(self, phase: Phase, scale: float, emulated_s: float | None = None) -> None:
        self.clock.set(phase, scale, emulated_s)

    def say(self, kind: Kind, epoch: int) -> None:
        self._numbers += 1
        # Before time 0 a wake-up is a rehearsal, which is timed by the wall clock.
        sent_at = time.monotonic() if self.clock.phase == Phase.WAIT else self.clock.now()
        say_to_all(self.lock, self.run_id, self.key, kind, epoch, self._numbers, sent_at)


def start_beside(module: str, memory_fd: int, *fds: int) -> tuple[subprocess.Popen[bytes], socket.socket]:
    """Start `python -m module CONTROL_FD MEMORY_FD [FD ...]`, and the end of its control socket that is ours."""
    ours, theirs = socket.socketpair()  # whatever fails from here on, the sockets go with what holds them
    with theirs:
        handed = (theirs.fileno(), memory_fd, *fds)
        process = subprocess.Popen(
            [sys.executable, "-m", module, *map(str, handed)],
            pass_fds=handed,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,  # a terminal's Ctrl-C reaches only the engine
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        )  # fmt: skip
    ours.setblocking(False)
    return process, ours


def mean_private_mb(dispatcher: int, processes: int) -> float | None:
    """Mean private memory of about so many FLSs spread over all, MB. dispatcher: its process id."""
    pids = children_of(dispatcher)
    step = max(1, len(pids) // processes)
    sizes = [size for pid in pids[::step] if (size := private_mb(pid)) is not None]
    return sum(sizes) / len(sizes) if sizes else None


def say_to_all(
    lock: socket.socket, run_id: int, key: bytes, kind: Kind, epoch: int, number: int, sent_at: float
) -> None:
    """Broadcast what the engine says to every FLS on this machine. lock: the socket that holds the run's port."""
    message = Message(kind, ENGINE_FID, 0, epoch, NO_SWARM, 0, ZERO, To.ALL)
    with contextlib.suppress(OSError):
        lock.sendto(
            encode(message, Stamp(run_id, number, ZERO, sent_at), key), (BROADCAST, lock.getsockname()[1])
        )


async def _line(reader: asyncio.StreamReader) -> bytes:
    """The next line; empty at the end, also at one that was no parting in good order."""
    try:
        return await reader.readline()
    except ConnectionError:
        return b""
