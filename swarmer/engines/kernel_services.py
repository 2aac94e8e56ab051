"""Does this kernel do what an FLS asks of it? Each service is tried once, with the code that a run uses."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from swarmer.engines.control_groups import read_number
from swarmer.engines.doctor import FAIL, INFO, MANY, OK, WARN, Check
from swarmer.messages import LARGEST, SIZE, Kind, Message, Stamp, Swarm, To, encode
from swarmer.radio import Ears, Grid
from swarmer.udp_wrapper import BROADCAST, Filter, Wires, address_of, lock_port, open_socket

HOST_PID_SPACE = "pid:[4026531836]"
SOON_S = 0.5  # a datagram on the loopback interface is there long before


def checks() -> list[Check]:
    """Everything that is tried."""
    return [receive_buffer(), broadcast(), socket_filter(), memfd(), batch_scheduling(), name_spaces()]


@contextlib.contextmanager
def port() -> Iterator[Wires]:
    """A port that no run uses, while we try."""
    from swarmer.config import RunConfig

    with lock_port(0) as lock:
        yield Wires(lock.getsockname()[1], receive_buffer=RunConfig().radio.receive_buffer_kb * 1024)


def receive_buffer() -> Check:
    """What a run asks for each socket, and what the system grants."""
    name = "UDP receive buffer"
    try:
        with port() as wires, open_socket(address_of(1), wires) as sock:
            granted = (
                sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
            )  # the kernel reports the double
    except OSError as error:
        return Check(
            name, str(error), FAIL, "ip link set lo up   (as root), or free UDP ports 20000 to 29999"
        )
    asked = wires.receive_buffer
    found = f"{granted // 1024} of {asked // 1024} kB"
    most = read_number("/proc/sys/net/core/rmem_max")
    if most is not None:
        found += f", net.core.rmem_max {most}"
    if granted >= asked:
        return Check(name, found, OK)
    return Check(name, found, WARN, f"sudo sysctl -w net.core.rmem_max={asked}")


def broadcast() -> Check:
    """One datagram to 127.255.255.255 must reach all who listen there."""
    name = "broadcast on loopback"
    try:
        with port() as wires, contextlib.ExitStack() as stack:
            ears = [stack.enter_context(open_socket(BROADCAST, wires, shared=True)) for _ in range(2)]
            mouth = stack.enter_context(open_socket(address_of(1), wires))
            mouth.sendto(b"x" * SIZE, (BROADCAST, wires.port))
            heard = sum(arrives(ear) for ear in ears)
    except OSError as error:
        return Check(name, str(error), FAIL, "ip link set lo up   (as root)")
    if heard == len(ears):
        return Check(name, "works", OK)
    return Check(name, f"reached {heard} of 2", WARN, "swarmer-run --set radio.carrier=unicast   (slower)")


def socket_filter() -> Check:
    """The filter of a run, on a socket: it must drop what is not addressed, and pass what is."""
    name = "kernel socket filter"
    ears = Ears(7, 1, Swarm(1, 0), (0.0, 0.0, 0.0), frozenset())
    grid = Grid.for_display(10.0)
    try:
        with port() as wires, contextlib.ExitStack() as stack:
            ear = stack.enter_context(open_socket(address_of(1), wires))
            mouth = stack.enter_context(open_socket(address_of(2), wires))
            Filter(ears, grid, True).attach(ear)
            passed = [offer(mouth, ear, wires, addressee) for addressee in (1, 2)]
    except OSError as error:
        return Check(name, str(error), WARN, "none needed: the same rule runs in Python, at more cost")
    if passed == [True, False]:
        return Check(name, "attached; drops and passes as it should", OK)
    return Check(name, "attached, but does not work", FAIL, "swarmer-run --set radio.kernel_filter=off")


def offer(mouth: socket.socket, ear: socket.socket, wires: Wires, addressee: int) -> bool:
    """Send a datagram for FLS `addressee` to FLS 1's socket; did it pass?"""
    message = Message(
        Kind.CHALLENGE_FIN,
        2,
        0,
        0,
        Swarm(2, 0),
        1,
        (0.0, 0.0, 0.0),
        To.FLS,
        Swarm(addressee, 0),
        range=LARGEST,
    )
    mouth.sendto(encode(message, Stamp(7, addressee, (0.0, 0.0, 0.0), 0.0)), (address_of(1), wires.port))
    return arrives(ear, SOON_S if addressee == 1 else 0.02)


def arrives(sock: socket.socket, within_s: float = SOON_S) -> bool:
    import select

    if not select.select([sock], [], [], within_s)[0]:
        return False
    sock.recv(2 * SIZE)
    return True


def memfd() -> Check:
    """Shared memory without a name, for as many slots as 2000 FLSs need."""
    from swarmer.telemetry import SharedMemory

    try:
        shared = SharedMemory(MANY)
    except (OSError, AttributeError) as error:
        return Check(
            "shared memory (memfd)", str(error), FAIL, "Linux 3.17 or newer, and room in memory, are needed"
        )
    size = shared.size
    shared.close()
    return Check("shared memory (memfd)", f"{size / 2**20:.0f} MB for {MANY} FLSs", OK)


def batch_scheduling() -> Check:
    """SCHED_BATCH, and back again."""
    name = "SCHED_BATCH"
    try:
        before, param = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        os.sched_setscheduler(0, before, param)
    except OSError as error:
        return Check(
            name, str(error), WARN, "none needed: FLSs then preempt each other, and are later by some ms"
        )
    return Check(name, "allowed", OK)


def name_spaces() -> Check:
    """A container has process ids and a loopback interface of its own."""
    name = "process name spaces"
    try:
        own = str(Path("/proc/self/ns/pid").readlink()) != HOST_PID_SPACE
        children = os.access(f"/proc/self/task/{os.getpid()}/children", os.R_OK)
    except OSError as error:
        return Check(name, str(error), INFO)
    found = "own (a container): its limits bind, too" if own else "the machine's own"
    if not children:
        return Check(
            name, f"{found}; children are not listed", WARN, "none needed: memory per FLS is not reported"
        )
    return Check(name, found, OK)
