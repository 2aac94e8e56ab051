"""The host agent: has the FLSs of one host in its care, for an engine on another.

It is started as `python -m swarmer.engines.cluster.agent`, by whatever way there is to start a program on that host,
and reads one line of JSON from stdin: where the engine is, and the key of the run. It connects there, shows that it has
the key, and does what it is told: it starts the dispatcher, which forks the FLSs as on a single machine, and the relay;
it keeps the control page, copies what has changed in the slots to the engine, and says for it what it says to all FLSs.

It ends, and its FLSs with it, when it is told to, when stdin or the connection ends, or when it has heard nothing for
so long that the engine must take it for dead.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import platform
import signal
import socket
import subprocess
import sys
import time
from typing import Any, NamedTuple

import swarmer
from swarmer.engines.cluster.channel import Channel, NotOurs, shake_hands
from swarmer.engines.cluster.copies import Copier
from swarmer.engines.cluster.relay import udp_socket
from swarmer.engines.limits import available_mb, check_limits, cores
from swarmer.engines.process import mean_private_mb, say_to_all, start_beside
from swarmer.engines.reading import kernel_drops
from swarmer.engines.sources import sources_sha256
from swarmer.errors import BadInput
from swarmer.messages import Kind
from swarmer.telemetry import Clock, Life, Phase, SharedMemory, Slot
from swarmer.udp_wrapper import ELSEWHERE, HOME, PORT_ALLOWED, lock_port

COPY_S = 0.05  # wall seconds from one copy of the slots to the next
WEIGH_EVERY_S, WEIGHED = 5.0, 8
CONNECT_S = 10.0
LOOK_S = 0.1  # wall seconds between two looks at whether the engine lives
END_S = 5.0
LINE_MAX = 1 << 28


class Orders(NamedTuple):
    """The line on stdin."""

    address: str
    port: int
    key: bytes
    name: str

    @classmethod
    def read(cls, line: bytes) -> Orders:
        said = json.loads(line)
        return cls(said["address"], said["port"], bytes.fromhex(said["key"]), said["name"])


class Agent:
    """One host's part of one run."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.over = asyncio.Event()
        self._heard_at = time.monotonic()
        self._patience_s = 60.0
        self._offset_s = 0.0  # our monotonic clock is so far ahead of the engine's
        self._tasks: set[asyncio.Task[Any]] = set()
        self._programs: list[subprocess.Popen[bytes]] = []
        self._lock: socket.socket | None = None
        self._memory_mb: float | None = None
        self._relay_says: dict[str, Any] = {}
        self._relay_answered = True

    async def serve(self) -> None:
        """Until it is over."""
        self._task(self._obey())
        self._task(self._watch_the_engine())
        await self.over.wait()
        for program in self._programs:
            program.kill()  # the kernel ends the dispatcher's FLSs with it
            program.wait()
        for task in self._tasks:
            task.cancel()

    def _task(self, coroutine: Any) -> None:
        task = asyncio.ensure_future(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            if not isinstance(error, ConnectionError):
                complain(f"{type(error).__name__}: {error}")
            self.over.set()

    # -- what the engine wants ------------------------------------------------------------------------------------

    async def _obey(self) -> None:
        does = {
            "ping": self._answer, "reserve": self._reserve, "begin": self._begin, "peers": self._tell_relay,
            "clock": self._set_clock, "say": self._say, "adopt": self._adopt, "look": self._look, "stop": self._stop,
        }  # fmt: skip
        while True:
            said, blob = await self.channel.hear()
            self._heard_at = time.monotonic()
            await does[said["do"]](said, blob)

    async def _watch_the_engine(self) -> None:
        while time.monotonic() - self._heard_at < self._patience_s:
            await asyncio.sleep(LOOK_S)
        self.over.set()

    async def _answer(self, said: dict[str, Any], _: bytes) -> None:
        self.channel.say(
            {"is": "pong", "asked": said["asked"], "monotonic": time.monotonic(), "wall": time.time()}
        )

    async def _reserve(self, said: dict[str, Any], _: bytes) -> None:
        """Before anything is started: can this host take so many FLSs, and is the port free?"""
        text, port = "", said["port"]
        try:
            check_limits(said["flss"])
            self._lock = lock_port(port)
        except BadInput as error:
            text = str(error)
        except OSError as error:
            text = str(BadInput("radio.port", port, f"{error}; {PORT_ALLOWED}"))
        self.channel.say({"is": "reserved", "text": text})

    async def _begin(self, said: dict[str, Any], _: bytes) -> None:
        """Everything but the FLSs' go."""
        try:
            self._start(said)
        except OSError as error:
            self.channel.say({"is": "refused", "text": error.strerror or str(error)})

    def _start(self, said: dict[str, Any]) -> None:
        setup, relay = said["setup"], said["relay"]
        run = setup["run"]
        self._patience_s, self._offset_s = said["patience_s"], said["offset_s"]
        self.fids = [row[0] for row in setup["fls"]]
        count = run["rules"]["count"]
        self.shared = SharedMemory(count)
        self.clock = Clock(self.shared)
        self._write_clock(said["clock"])
        assert self._lock is not None
        self.run_id, self.key = run["run"], bytes.fromhex(run["key"])
        directory = self.shared.directory()
        for at in range(count):
            directory[at] = ELSEWHERE
        for fid in self.fids:
            directory[fid - 1] = 0
        buffer = run["wires"]["receive_buffer"]
        outside, inside = udp_socket(self.channel.own_address, buffer), udp_socket(HOME, buffer)
        with outside, inside:
            run["wires"] |= {"port": self._lock.getsockname()[1], "relay_port": inside.getsockname()[1]}
            if run["cpus"]:
                run["cpus"] = sorted(os.sched_getaffinity(0))
            program, self._relay = self._start_program(
                "swarmer.engines.cluster.relay", outside.fileno(), inside.fileno()
            )
            address = outside.getsockname()
        self._ports = [run["wires"]["port"], run["wires"]["relay_port"], address[1]]
        self._copier = Copier(self.shared, self.fids)
        tell(self._relay, relay | {
            "flss": count, "mac": run["key"], "wires": run["wires"], "here": self.fids, "seed": run["seed"],
        })  # fmt: skip
        self._task(self._hear_relay(program))
        self._dispatcher_program, self._dispatcher = self._start_program("swarmer.engines.dispatcher")
        self._task(self._hear_dispatcher())
        tell(self._dispatcher, setup)
        self.channel.say({"is": "begun", "address": address[0], "port": address[1]})
        self._task(self._copy())
        self._task(self._weigh())

    def _start_program(self, module: str, *fds: int) -> tuple[subprocess.Popen[bytes], socket.socket]:
        program, control = start_beside(module, self.shared.fd, *fds)
        self._programs.append(program)
        self._task(self._hear_complaints(program))
        return program, control

    async def _tell_relay(self, said: dict[str, Any], _: bytes) -> None:
        tell(self._relay, {name: said[name] for name in ("peers", "here", "truth", "host_of")})

    async def _set_clock(self, said: dict[str, Any], _: bytes) -> None:
        self._task(self._set_clock_at(said["clock"]))

    async def _set_clock_at(self, clock: dict[str, Any]) -> None:
        """The new line holds from a moment on that is still to come: so no host's time jumps."""
        await asyncio.sleep(clock["wall"] + self._offset_s - time.monotonic())
        self._write_clock(clock)
        if clock["wake"]:
            self._broadcast(Kind.CONTROL, 0, clock["number"])

    def _write_clock(self, clock: dict[str, Any]) -> None:
        self.clock.write(
            Phase(clock["phase"]), clock["wall"] + self._offset_s, clock["emulated"], clock["scale"]
        )

    async def _say(self, said: dict[str, Any], _: bytes) -> None:
        self._broadcast(Kind(said["kind"]), said["epoch"], said["number"])

    def _broadcast(self, kind: Kind, epoch: int, number: int) -> None:
        assert self._lock is not None
        sent_at = time.monotonic() if self.clock.phase == Phase.WAIT else self.clock.now()
        say_to_all(self._lock, self.run_id, self.key, kind, epoch, number, sent_at)

    async def _adopt(self, said: dict[str, Any], blob: bytes) -> None:
        """FLSs of a host that is gone: their slots go on here."""
        fids = [row[0] for row in said["fls"]]
        self._copier.take(fids, blob)
        directory = self.shared.directory()
        for fid in fids:
            directory[fid - 1] = 0
            Slot(self.shared, fid).live(Life.ENDED)
        self.fids += fids
        tell(self._dispatcher, {"command": "adopt", "fls": said["fls"]})

    async def _look(self, said: dict[str, Any], _: bytes) -> None:
        """A last copy, with all that is known."""
        tell(self._relay, {})
        await asyncio.sleep(COPY_S)
        drops = sum(map(kernel_drops, self._ports))
        self._send_copy(looked=True, drops=drops, memory_mb=self._mean_memory_mb(said["weigh"]))

    async def _stop(self, _: dict[str, Any], __: bytes) -> None:
        with contextlib.suppress(OSError):
            tell(self._dispatcher, {"command": "stop"})

    # -- what there is to tell ------------------------------------------------------------------------------------

    async def _copy(self) -> None:
        while True:
            self._send_copy()
            await self.channel.drain()
            if self._relay_answered:
                self._relay_answered = False
                tell(self._relay, {})
            await asyncio.sleep(COPY_S)

    def _send_copy(self, **more: Any) -> None:
        head = {"is": "slots", "relay": self._relay_says, "memory_mb": self._memory_mb} | more
        self.channel.say(head, self._copier.changed())

    async def _weigh(self) -> None:
        while True:
            self._memory_mb = await asyncio.to_thread(self._mean_memory_mb, WEIGHED)
            await asyncio.sleep(WEIGH_EVERY_S)

    def _mean_memory_mb(self, processes: int) -> float | None:
        return mean_private_mb(self._dispatcher_program.pid, processes)

    async def _hear_dispatcher(self) -> None:
        reader, _ = await asyncio.open_connection(sock=self._dispatcher, limit=LINE_MAX)
        with contextlib.suppress(ConnectionError):
            while line := await reader.readline():
                event = json.loads(line)
                self.channel.say({"is": "event", "event": event})
                if event["event"] == "ended":
                    await self.channel.drain()
                    await asyncio.to_thread(self._dispatcher_program.wait, END_S)
        self.channel.say({"is": "ended"})
        await self.channel.drain()
        self.over.set()

    async def _hear_relay(self, program: subprocess.Popen[bytes]) -> None:
        reader, _ = await asyncio.open_connection(sock=self._relay, limit=LINE_MAX)
        with contextlib.suppress(ConnectionError):
            while line := await reader.readline():
                self._relay_says, self._relay_answered = json.loads(line), True
        await asyncio.to_thread(program.wait)
        self.channel.say({"is": "stderr", "text": "the relay process died"})
        await self.channel.drain()
        self.over.set()

    async def _hear_complaints(self, program: subprocess.Popen[bytes]) -> None:
        pipe = asyncio.StreamReader()
        protocol = asyncio.StreamReaderProtocol(pipe)
        await asyncio.get_running_loop().connect_read_pipe(lambda: protocol, program.stderr)
        while line := await pipe.readline():
            self.channel.say({"is": "stderr", "text": line.decode(errors="replace").rstrip()})


def tell(control: socket.socket, said: dict[str, Any]) -> None:
    """A line to a program beside; what it does not take at once is waited for."""
    data = memoryview(json.dumps(said).encode() + b"\n")
    while data:
        try:
            data = data[control.send(data) :]
        except BlockingIOError:
            time.sleep(0.001)


async def run(line: bytes) -> None:
    """Be the agent that the line asks for. Raises NotOurs, OSError."""
    orders = Orders.read(line)
    reader, writer = await asyncio.wait_for(
        asyncio.open_connection(orders.address, orders.port, limit=LINE_MAX), CONNECT_S
    )
    channel = await shake_hands(reader, writer, orders.key, engine=False)
    channel.say({
        "is": "hello", "name": orders.name, "version": swarmer.__version__, "sources": sources_sha256(),
        "cores": cores(), "memory_mb": available_mb(), "pid": os.getpid(), "node": platform.node(),
    })  # fmt: skip
    agent = Agent(channel)
    loop = asyncio.get_running_loop()
    loop.add_reader(sys.stdin.fileno(), _stdin_has_something, agent)
    await agent.serve()
    channel.close()


def complain(line: str) -> None:
    """To whoever started us: the engine reads it, over ssh too."""
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def _stdin_has_something(agent: Agent) -> None:
    """Nothing more is said there: it has ended, with whoever started us."""
    if not os.read(sys.stdin.fileno(), 4096):
        agent.over.set()


def main() -> int:
    """The exit status."""
    for number in (signal.SIGINT, signal.SIGHUP):  # a terminal's Ctrl-C is the engine's business
        signal.signal(number, signal.SIG_IGN)
    line = b""
    while not line.endswith(b"\n"):
        part = os.read(sys.stdin.fileno(), 4096)
        if not part:
            complain("swarmer's host agent: no orders on stdin; an engine starts it")
            return 2
        line += part
    try:
        asyncio.run(run(line))
    except NotOurs as error:
        complain(f"the engine was not reached: {error}")
        return 1
    except TimeoutError:
        complain("the engine was not reached: no answer")
        return 1
    except OSError as error:
        # Not `strerror`: asyncio puts the address there.
        complain(f"the engine was not reached: {os.strerror(error.errno) if error.errno else error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
