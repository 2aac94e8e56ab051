"""The hosts of one run, as the engine has them: agents started, met, found to be of this version, their clocks read."""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

import swarmer
from swarmer.engines.cluster.channel import Channel, NotOurs, shake_hands
from swarmer.engines.cluster.clocks import Exchange, Offset, estimate
from swarmer.engines.result import HostRow
from swarmer.engines.sources import sources_sha256
from swarmer.errors import BadInput
from swarmer.metrics.lateness import BUCKETS, percentiles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swarmer.config_groups import Cluster
    from swarmer.engines.cluster.launch import Launched, Launcher

EXCHANGES = 8  # of times, before a run
LOOK_S = 0.1
ANSWER_S = 10.0  # wall seconds for an answer
NO_OFFSET = Offset(0.0, 0.0, 0.0)


@dataclass(eq=False)
class Host:
    """One host of the run."""

    index: int
    name: str
    launched: Launched
    channel: Channel
    hello: dict[str, Any]
    offset: Offset = NO_OFFSET
    fids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    alive: bool = True
    heard_at: float = 0.0  # our monotonic clock
    relay: tuple[str, int] = ("", 0)
    relay_says: dict[str, Any] = field(default_factory=dict)
    memory_mb: float | None = None
    drops: int = 0
    drift_s: float = 0.0  # the most that the clocks have moved against each other
    begun: int = 0  # FLSs at first
    lost_s: float | None = None  # emulated
    replaced_on: dict[str, int] = field(default_factory=dict)  # host: FLSs
    looked: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def cores(self) -> int:
        return int(self.hello["cores"])

    def row(self) -> HostRow:
        """Its line in hosts.csv."""
        counts: dict[str, int] = self.relay_says.get("counts", {})
        p50, p99, most = percentiles(self.relay_says.get("late", [0] * BUCKETS)) or (None, None, None)
        apart_ms, bound_ms, drift_ms = (
            round(1e3 * value, 4) for value in (self.offset.apart_s, self.offset.bound_s, self.drift_s)
        )
        return HostRow(
            host=self.name, cores=self.cores, flss_begun=self.begun, flss=len(self.fids) if self.alive else 0,
            datagrams_out=counts.get("crossed"), datagrams_in=counts.get("arrived"), packets=counts.get("packets"),
            packets_of_datagrams=counts.get("packets_of_datagrams"), packet_bytes=counts.get("packet_bytes"),
            lost=counts.get("lost"), send_failed=counts.get("send_failed"), rejected=counts.get("rejected"),
            dropped_by_kernel=self.drops, late_p50_ms=p50, late_p99_ms=p99, late_max_ms=most,
            clock_apart_ms=apart_ms, clock_bound_ms=bound_ms, clock_drift_ms=drift_ms,
            lost_s=None if self.lost_s is None else round(self.lost_s, 4),
            replaced_on=", ".join(f"{count} on {name}" for name, count in self.replaced_on.items()),
        )  # fmt: skip


class Gathering:
    """Starts agents and waits until all of them have called."""

    def __init__(self, cluster: Cluster, launcher: Launcher, names: list[str]) -> None:
        self._cluster, self._launcher, self._names = cluster, launcher, names
        self._key, self._sources = secrets.token_bytes(32), sources_sha256()
        self._launched: dict[str, Launched] = {}
        self._met: dict[str, tuple[Channel, dict[str, Any]]] = {}

    async def gather(self) -> list[Host]:
        """All hosts, in the order of their names. Raises BadInput, and then none is left running."""
        address = self._launcher.address()
        try:
            server = await asyncio.start_server(self._meet, address, 0, family=socket.AF_INET, limit=1 << 28)
        except OSError as error:
            raise BadInput(
                "cluster.listen", address, f"{error.strerror}; an IPv4 address of this machine"
            ) from None
        try:
            port = server.sockets[0].getsockname()[1]
            for name in self._names:
                self._launched[name] = self._launcher.start(name, self._orders(name, address, port))
            await self._wait()
            hosts = [
                Host(index, name, self._launched[name], *self._met[name])
                for index, name in enumerate(self._names)
            ]
            for host in hosts:
                await self._check(host)
            return hosts
        except BaseException:
            self.end()
            raise
        finally:
            server.close()

    def _orders(self, name: str, address: str, port: int) -> bytes:
        orders = {"address": address, "port": port, "key": self._key.hex(), "name": name}
        return json.dumps(orders).encode()

    def end(self) -> None:
        """End every agent."""
        for channel, _ in self._met.values():
            channel.close()
        for launched in self._launched.values():
            launched.end()

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Somebody has called; who is none of ours is left."""
        try:
            channel = await shake_hands(reader, writer, self._key, engine=True)
            hello, _ = await asyncio.wait_for(channel.hear(), ANSWER_S)
            name = hello["name"]
            if name not in self._launched or name in self._met:
                raise NotOurs("a host of this name is there")
        except (NotOurs, ConnectionError, TimeoutError):
            writer.close()
            return
        self._met[name] = channel, hello

    async def _wait(self) -> None:
        deadline = time.monotonic() + self._launcher.patience_s
        while len(self._met) < len(self._names):
            for name, launched in self._launched.items():
                if name not in self._met and launched.ended():
                    words = launched.last_words() or "the agent ended at once"
                    raise BadInput.saying(f"{self._launcher.setting}: {name}: {words}")
            if time.monotonic() > deadline:
                name = next(name for name in self._names if name not in self._met)
                words = self._launched[name].last_words() or "is it up, and can it reach cluster.listen?"
                raise BadInput.saying(
                    f"{self._launcher.setting}: {name}: no call from there in {self._launcher.patience_s:g} s; {words}"
                )
            await asyncio.sleep(LOOK_S)

    async def _check(self, host: Host) -> None:
        """Raises BadInput for a host that cannot take part."""
        version = host.hello["version"]
        if version != swarmer.__version__:
            raise BadInput.saying(
                f"{self._launcher.setting}: {host.name} has swarmer {version}, this is {swarmer.__version__}; "
                "the same everywhere"
            )
        if host.hello.get("sources") != self._sources:
            raise BadInput.saying(
                f"{self._launcher.setting}: {host.name} has other sources of swarmer {version} than this machine; "
                "install the same there"
            )
        try:
            host.offset = estimate([await exchange(host.channel) for _ in range(EXCHANGES)])
        except (ConnectionError, TimeoutError):
            raise BadInput.saying(f"{self._launcher.setting}: {host.name}: it fell silent at once") from None
        check_clock(self._cluster, host.name, host.offset)

    async def reserve(self, hosts: list[Host], port: int) -> None:
        """Have each host look whether it can take its FLSs, and keep a port for them. Raises BadInput."""
        for host in hosts:  # one after the other: of two on one machine the second finds the port taken
            host.channel.say({"do": "reserve", "flss": len(host.fids), "port": port})
            try:
                answer, _ = await asyncio.wait_for(host.channel.hear(), ANSWER_S)
            except (ConnectionError, TimeoutError):
                answer = {"text": host.launched.last_words() or "it fell silent"}
            if answer["text"]:
                raise BadInput.saying(
                    f"{self._launcher.setting}: {host.name} cannot take its part: {answer['text']}"
                )


def check_clock(cluster: Cluster, name: str, offset: Offset) -> None:
    """Raises BadInput for a host whose clock is too far off, or cannot be read well enough."""
    apart_s, most_s = abs(offset.apart_s), cluster.clocks_apart_s
    if apart_s > most_s:
        raise BadInput.saying(
            f"cluster.clocks_apart_s: the clock of {name} is {apart_s:.3g} s "
            f"{'ahead of' if offset.apart_s > 0 else 'behind'} this one's, and {most_s:g} is allowed; "
            "have NTP set both"
        )
    if 1e3 * offset.bound_s > cluster.clock_bound_ms:
        raise BadInput.saying(
            f"cluster.clock_bound_ms: the clock of {name} is known to {1e3 * offset.bound_s:.3g} ms only, and "
            f"{cluster.clock_bound_ms:g} is allowed; a network that answers sooner"
        )


async def exchange(channel: Channel) -> Exchange:
    """Ask for the time. Raises ConnectionError, TimeoutError."""
    channel.say({"do": "ping", "asked": time.monotonic()})
    answer, _ = await asyncio.wait_for(channel.hear(), ANSWER_S)
    return exchanged(answer)


def exchanged(pong: dict[str, Any]) -> Exchange:
    """What an answer to `ping` says, heard now."""
    return Exchange(pong["asked"], pong["monotonic"], pong["wall"], time.monotonic(), time.time())
