"""Three ways to run the two roles of an FLS (`fls_process.Fls`), picked by the setting `fls_loop`.

    single    one thread: the network role whenever a datagram is there, else one step of the handler
    threads   the paper's two threads, each blocking in its own place
    asyncio   both roles as callbacks of one event loop

All three keep the rules of section 6: what arrives is judged before the next thing is handled, races are answered
without waiting for the handler, and the handler alone mutates.
"""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from time import sleep

from swarmer.fls import NEVER
from swarmer.fls_process import Fls
from swarmer.messages import MAX_SIZE
from swarmer.telemetry import Phase

LONGEST_WAIT_S = 1.0  # wall seconds: how long a lost wake-up may go unnoticed
FULL_WAIT_S = 0.002  # wall seconds that the network thread leaves the handler to itself when too much waits
BURST = 64  # datagrams read from one socket before the other one has its turn


class Ear:
    """Reads datagrams of one FLS's sockets into one buffer."""

    def __init__(self, fls: Fls) -> None:
        self.fls = fls
        self._buffer = bytearray(MAX_SIZE + 1)  # one byte more, so that what is too long is seen to be
        self._view = memoryview(self._buffer)

    def drain(self, sock: socket.socket) -> None:
        """Hear what is there, at most a burst of it; nothing while more waits already than is good."""
        if self.fls.full:
            return
        receive, hear, buffer, view = sock.recv_into, self.fls.receive, self._buffer, self._view
        try:
            for _ in range(BURST):
                hear(view[: receive(buffer)])
        except BlockingIOError:
            return


def wall_wait(fls: Fls, emulated_s: float) -> float:
    """Wall seconds to wait for an emulated moment, never below 0 nor above LONGEST_WAIT_S."""
    clock = fls.clock
    if emulated_s == NEVER:
        return LONGEST_WAIT_S
    wait = clock.wall_until(emulated_s)
    if clock.phase != Phase.GO:
        return LONGEST_WAIT_S
    return min(max(wait, 0.0), LONGEST_WAIT_S)


def run_single(fls: Fls) -> None:
    """One thread for both roles."""
    ear = Ear(fls)
    sockets = {sock.fileno(): sock for sock in (fls.udp.unicast, fls.udp.broadcast)}
    poll = select.poll()
    for fd in sockets:
        poll.register(fd, select.POLLIN)
    busy = False
    while fls.exit_status is None:
        wait = 0.0 if busy else wall_wait(fls, min(fls.deadline(), fls.network_deadline()))
        for fd, _ in poll.poll(wait * 1e3):
            ear.drain(sockets[fd])
        if fls.network_deadline() != NEVER:
            fls.release()
        busy = fls.step() and (fls.has_messages or fls.deadline() <= fls.clock.now())


def run_threads(fls: Fls) -> None:
    """The paper's two threads. The handler's thread is this one."""
    doorbell: SimpleQueue[None] = SimpleQueue()
    fls.published = fls.machine.view()
    network = threading.Thread(target=_listen, args=(fls, doorbell), daemon=True, name="network")
    network.start()
    while fls.exit_status is None:
        while fls.step():
            fls.published = fls.machine.view()
        if fls.exit_status is not None or fls.has_messages:
            continue
        try:
            doorbell.get(timeout=wall_wait(fls, fls.deadline()))
            while True:
                doorbell.get_nowait()
        except Empty:
            pass


def _listen(fls: Fls, doorbell: SimpleQueue[None]) -> None:
    ear = Ear(fls)
    sockets = {sock.fileno(): sock for sock in (fls.udp.unicast, fls.udp.broadcast)}
    poll = select.poll()
    for fd in sockets:
        poll.register(fd, select.POLLIN)
    phase = fls.clock.phase
    while fls.exit_status is None:
        for fd, _ in poll.poll(wall_wait(fls, fls.network_deadline()) * 1e3):
            ear.drain(sockets[fd])
        if fls.full:
            sleep(FULL_WAIT_S)
        if fls.network_deadline() != NEVER:
            fls.release()
        fls.clock.now()
        if fls.has_messages or fls.clock.phase != phase:
            phase = fls.clock.phase
            doorbell.put(None)


def run_asyncio(fls: Fls) -> None:
    """Both roles as callbacks of one event loop."""
    import asyncio

    asyncio.run(_run_asyncio(fls))


async def _run_asyncio(fls: Fls) -> None:
    import asyncio

    loop = asyncio.get_running_loop()
    ear = Ear(fls)
    ended = asyncio.Event()
    wake: asyncio.TimerHandle | None = None
    planned = False

    def readable(sock: socket.socket) -> None:
        ear.drain(sock)
        plan()

    def plan() -> None:
        nonlocal planned
        if not planned:
            planned = True
            loop.call_soon(step)

    def step() -> None:
        nonlocal planned, wake
        planned = False
        if fls.network_deadline() != NEVER:
            fls.release()
        more = fls.step()
        if fls.exit_status is not None:
            ended.set()
        elif more:
            plan()
        else:
            if wake is not None:
                wake.cancel()
            wake = loop.call_later(wall_wait(fls, min(fls.deadline(), fls.network_deadline())), plan)

    for sock in (fls.udp.unicast, fls.udp.broadcast):
        loop.add_reader(sock, readable, sock)
    plan()
    await ended.wait()


LOOPS: dict[str, Callable[[Fls], None]] = {
    "single": run_single,
    "threads": run_threads,
    "asyncio": run_asyncio,
}
