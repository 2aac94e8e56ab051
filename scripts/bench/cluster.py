"""What a way over two relays costs, and a run on two hosts beside the same run on one."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median, quantiles

from bench.tables import ratio, show
from swarmer.config import load_config
from swarmer.engines.named import make_engine
from swarmer.engines.process import start_beside
from swarmer.messages import NO_SWARM, SIZE, Kind, Message, Stamp, Swarm, To, decode, encode
from swarmer.observe.collector import Collector
from swarmer.observe.run_directory import RunDirectory
from swarmer.plan import make_plan
from swarmer.telemetry import Clock, Phase, SharedMemory
from swarmer.udp_wrapper import ELSEWHERE, HOME, Wires, address_of

KEY = "00" * 16
SENT, PACE_S = 1500, 0.002
BURST = 64
POINTS, RUN_S, SEEDS = 200, 8.0, (1, 2, 3)
TIMES = ("1", "0.1", "0.01")


def run(repeat: int) -> None:
    """Print both tables."""
    rows: list[list[object]] = []
    with relays() as (port, doors):
        for name, burst, pace_s in (
            ("one at a time", 1, PACE_S),
            (f"{BURST} at once", BURST, BURST * PACE_S),
        ):
            direct = [way(port, (address_of(2), port), burst, pace_s) for _ in range(repeat)]
            over = [way(port, doors[0], burst, pace_s) for _ in range(repeat)]
            for what, found in (("to a socket here", direct), ("over two relays", over)):
                half, last = (1e6 * median(part) for part in zip(*found, strict=True))
                rows.append([f"{name}, {what}", half, last])
            rows.append([f"{name}, added", rows[-1][1] - rows[-2][1], rows[-1][2] - rows[-2][2]])  # type: ignore[operator]
    notes = [
        f"µs from sending to hearing, {SENT} datagrams of {SIZE} bytes; each relay is a process of its own"
    ]
    show("cluster: the way from an FLS to one on another host", ("datagrams", "median", "p99"), rows, notes)
    compare()


@contextlib.contextmanager
def relays() -> Iterator[tuple[int, list[tuple[str, int]]]]:
    """Two relays; FLS 1 is with the first, FLS 2 with the second. Gives the port of FLSs, and where FLSs find them."""
    port = free_port()
    with contextlib.ExitStack() as ends:
        programs: list[subprocess.Popen[bytes]] = []
        controls, outside, doors = [], [], []
        for host in range(2):
            memory = SharedMemory(2)
            Clock(memory).set(Phase.GO, 1.0, 0.0)
            directory = memory.directory()
            directory[host], directory[1 - host] = host + 1, ELSEWHERE
            out, inside = udp(), udp()
            program, control = start_beside(
                "swarmer.engines.cluster.relay", memory.fd, out.fileno(), inside.fileno()
            )
            programs.append(program)
            control.setblocking(True)
            controls.append(ends.enter_context(control))
            outside.append(out.getsockname())
            doors.append(inside.getsockname())
            ends.enter_context(out), ends.enter_context(inside)
            tell(control, {
                "host": host, "flss": 2, "key": KEY, "mac": "", "wires": Wires(port)._asdict(), "ranged": True,
                "here": [host + 1], "truth": [[[float(host), 0.0, 0.0]]], "loss": 0.0, "delay_s": 0.0, "seed": 1,
            })  # fmt: skip
        for host, control in enumerate(controls):
            box = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
            tell(control, {
                "peers": [[1 - host, *outside[1 - host], box]], "here": [host + 1],
                "truth": [[[float(host), 0.0, 0.0]]], "host_of": [0, 1],
            })  # fmt: skip
            control.recv(1 << 16)
        yield port, doors
    for program in programs:
        program.wait(10)


def tell(control: socket.socket, said: dict[str, object]) -> None:
    control.sendall(json.dumps(said).encode() + b"\n")


def udp() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    sock.bind((HOME, 0))
    return sock


def free_port() -> int:
    with udp() as sock:
        return int(sock.getsockname()[1])


def way(port: int, to: tuple[str, int], burst: int, pace_s: float) -> tuple[float, float]:
    """Median and p99, seconds, from sending to hearing."""
    took: list[float] = []
    truth = (0.0, 0.0, 0.0)
    message = Message(
        Kind.SET_AVAILABLE, 1, 0, 0, Swarm(1, 0), 1, truth, To.FLS, Swarm(2, 0), 0, 0, 1e9, NO_SWARM, truth
    )
    with udp() as mouth, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind((address_of(2), port))
        for begin in range(0, SENT, burst):
            for number in range(begin, begin + burst):
                mouth.sendto(encode(message, Stamp(1, number, truth, time.monotonic())), to)
            for _ in range(burst):
                if select.select([ear], [], [], 1.0)[0]:
                    data = ear.recv(4096)
                    took.append(time.monotonic() - decode(data)[1].sent_at)
            time.sleep(pace_s)
    return median(took), quantiles(took, n=100)[-1]


def compare() -> None:
    """The same run on one host and on two, seed by seed."""
    rows = []
    for seed in SEEDS:
        one, two = (
            summary(engine=engine, seed=seed, **more)
            for engine, more in (("process", {}), ("cluster", {"cluster.hosts": "localhost,localhost"}))
        )
        for name, found in (("process", one), ("cluster, 2 hosts", two)):
            late = found.get("relay_late_ms") or {}
            rows.append([
                f"{name}, seed {seed}", *(found["time_to_hd_s"][hd] for hd in TIMES), found["hd_cells"],
                found["datagrams_sent"], found["handled_late_ms"]["p99"], late.get("p50"), found["time_scale"],
                found["faithful"],
            ])  # fmt: skip
        rows.append(
            ["", *(ratio(two["time_to_hd_s"][hd], one["time_to_hd_s"][hd]) for hd in TIMES), *[""] * 6]
        )
    columns = ("run", *(f"HD < {hd}, s" for hd in TIMES), "HD at the end", "datagrams", "late p99, ms", "relay p50, ms",
               "scale", "faithful")  # fmt: skip
    notes = [f"sphere, {POINTS} FLSs, {RUN_S:g} s emulated; both hosts are agents on this machine"]
    show("cluster: one host, and two", columns, rows, notes)


def summary(**settings: object) -> dict[str, object]:
    """Of one run."""
    given = {"shape": "sphere", "points": POINTS, "duration_s": RUN_S, "recording.enabled": False} | settings
    plan = make_plan(load_config(**given))
    with tempfile.TemporaryDirectory() as place, make_engine(plan) as engine:
        collector = Collector(RunDirectory.create(Path(place) / "run", "sphere", 1, ["bench"]))
        return collector.finish(engine.run(collector))


if __name__ == "__main__":
    run(1)
