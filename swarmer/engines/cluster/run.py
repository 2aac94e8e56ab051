"""One run over many hosts, once each has its share and an agent that waits.

One clock, one copy of all slots, and what becomes of FLSs whose host is gone. The rest is `real_time`'s, which reads
the copy as it reads shared memory elsewhere.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import time
from itertools import permutations
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmer.engines.cluster.copies import Copy
from swarmer.engines.cluster.hosts import Host, exchanged
from swarmer.engines.cluster.shares import all_points, box_of, taken_over
from swarmer.engines.real_time import COMPLAINT_S, WEIGHED_LAST, RealTimeRun
from swarmer.engines.result import GONE, Event, Lateness, Observer, RunResult
from swarmer.engines.specs import setup
from swarmer.errors import RunFailed
from swarmer.messages import Kind
from swarmer.metrics.lateness import BUCKETS, percentiles
from swarmer.telemetry import Life, Phase

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swarmer.plan import Plan

AHEAD_S = 0.05  # wall seconds from saying that time goes otherwise to its doing so, on all hosts at once
BEGIN_S = 30.0  # wall seconds for a host to have begun
HEAR_S = 5.0  # wall seconds for the relays to hear each other, which they do four times a second
LOOK_PATIENCE_S = 3.0
END_PATIENCE_S = 10.0
PINGS = 8  # within the patience with a host


class ClusterRun(RealTimeRun):
    """Plays once. `host_of`: (F,) the host of each FLS. Raises OSError where there is no memory to share."""

    def __init__(self, plan: Plan, observer: Observer, hosts: list[Host], host_of: NDArray[np.int64]) -> None:
        super().__init__(plan, observer, "cluster")
        self.hosts, self.host_of = hosts, host_of
        self.points = all_points(plan)
        self.copy = Copy(self.shared)
        self.key = secrets.token_bytes(16) if plan.config.radio.mac else b""
        self.setup = setup(plan, secrets.randbits(32), plan.config.radio.port, self.key)
        self._numbers = 0
        self._tasks: list[asyncio.Task[None]] = []
        self._begun: dict[int, asyncio.Event] = {host.index: asyncio.Event() for host in hosts}
        self._incarnations: dict[int, int] = {}
        self._lost: list[str] = []
        self._copied = 0  # bytes

    @property
    def alive(self) -> list[Host]:
        return [host for host in self.hosts if host.alive]

    # -- the life of a run ---------------------------------------------------------------------------------------

    async def play(self) -> RunResult:
        self.clock.set(Phase.WAIT, self.governor.scale, -1e9)
        began = time.monotonic()
        self._heed_endings()
        try:
            for host in self.hosts:
                host.heard_at = began
                self._tasks.append(asyncio.create_task(self._listen(host)))
            self._begin()
            self._tasks.append(asyncio.create_task(self._keep()))
            await self._all_begun()
            if not self.stopping.is_set() and await self._all_ready() and await self._all_hear():
                await self._rehearse()
                self.result.launch_s = time.monotonic() - began
                await self._fly()
            await self._end()
        except RunFailed as failure:
            self._fail(str(failure))
        finally:
            for task in self._tasks:
                task.cancel()
            for host in self.hosts:
                host.channel.close()
                host.launched.end()
            self._sum_up()
            self.copy.close()
            self._finish()
        return self.result

    def _begin(self) -> None:
        cluster, rows = self.config.cluster, self.setup["fls"]
        relay = {
            "key": secrets.token_hex(16),
            "ranged": not self.plan.rules.range_estimated,
            "loss": cluster.relay_loss,
            "delay_s": cluster.relay_delay_ms / 1e3,
        }
        for host in self.hosts:
            host.channel.say({
                "do": "begin",
                "setup": self.setup | {"fls": [rows[fid - 1] for fid in host.fids]},
                "relay": relay | {"host": host.index, "truth": self.points[host.fids - 1].tolist()},
                "patience_s": cluster.wall_patience_s / 2,
                "offset_s": host.offset.offset_s,
                "clock": self._clock_line(time.monotonic(), Phase.WAIT, self.governor.scale, -1e9),
            })  # fmt: skip

    async def _all_begun(self) -> None:
        for host in self.hosts:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._begun[host.index].wait(), BEGIN_S)
            if not self._begun[host.index].is_set():
                raise RunFailed(f"{host.name} did not begin within {BEGIN_S:g} s")
        self._tell_peers()

    async def _all_hear(self) -> bool:
        """Wait until each relay has heard all others; False if the run was stopped before.

        Where a firewall lets no UDP pass between two hosts, what comes of a run would look like the protocol's doing.
        Raises RunFailed.
        """
        deadline = time.monotonic() + HEAR_S
        while not self.stopping.is_set():
            pairs = permutations(self.hosts, 2)
            deaf = [(to, of) for to, of in pairs if of.index not in to.relay_says.get("heard", ())]
            if not deaf:
                return True
            if time.monotonic() > deadline:
                to, of = deaf[0]
                raise RunFailed(
                    f"{to.name} hears nothing from {of.name}: UDP from {of.relay[0]} does not get to {to.relay[0]}, "
                    "where each run has a free port; does a firewall drop it?"
                )
            await self._sleep(0.05)
        return False

    def _tell_peers(self) -> None:
        """Who is where, for the relays."""
        alive = self.alive
        rows = [
            [host.index, *host.relay, box_of(self.points[host.fids - 1].reshape(-1, 3))] for host in alive
        ]
        for host in alive:
            host.channel.say({
                "do": "peers",
                "peers": [row for row in rows if row[0] != host.index],
                "host_of": self.host_of.tolist(),
                "here": host.fids.tolist(),
                "truth": self.points[host.fids - 1].tolist(),
            })  # fmt: skip

    async def _end(self) -> None:
        await self._look_once_more()
        self._measure_end()
        await self._set_clock(Phase.STOP, self.clock.scale)
        for host in self.alive:
            host.channel.say({"do": "stop"})
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(
                asyncio.gather(*(host.ended.wait() for host in self.alive)), END_PATIENCE_S
            )

    async def _look_once_more(self) -> None:
        """Have the newest of everything."""
        for host in self.alive:
            host.channel.say({"do": "look", "weigh": max(1, WEIGHED_LAST // len(self.hosts))})
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(
                asyncio.gather(*(host.looked.wait() for host in self.alive)), LOOK_PATIENCE_S
            )

    def _end_at_once(self) -> None:
        for host in self.hosts:
            host.channel.close()

    # -- what hosts say -------------------------------------------------------------------------------------------

    async def _listen(self, host: Host) -> None:
        try:
            while True:
                said, blob = await host.channel.hear()
                host.heard_at = time.monotonic()
                await self._take(host, said, blob)
        except (ConnectionError, ValueError, KeyError) as error:
            if not host.ended.is_set():
                await asyncio.sleep(COMPLAINT_S)  # its last words may still be on their way
                words = host.launched.last_words()
                self._lose(host, words or str(error) or "the connection has ended")

    async def _take(self, host: Host, said: dict[str, Any], blob: bytes) -> None:
        kind = said["is"]
        if kind == "slots" and host.alive:
            self._take_slots(host, said, blob)
        elif kind == "pong":
            told = exchanged(said)
            middle = (told.asked + told.heard) / 2
            # A slow exchange says little; of its error no more than half its time can be its own.
            moved = abs(told.monotonic - middle - host.offset.offset_s) - (told.heard - told.asked) / 2
            host.drift_s = max(host.drift_s, moved - host.offset.bound_s, 0.0)
        elif kind == "event" and host.alive:
            await self._take_event(host, said["event"])
        elif kind == "stderr":
            self._complain(f"{host.name}: {said['text']}".encode())
        elif kind == "begun":
            host.relay = said["address"], said["port"]
            self._begun[host.index].set()
        elif kind == "refused":
            self._begun[host.index].set()
            self._fail(f"{host.name} cannot take its part: {said['text']}")
        elif kind == "ended":
            host.ended.set()
            if self.clock.phase != Phase.STOP and not self.stopping.is_set():
                self._lose(host, self._complaint or "its dispatcher died")

    def _take_slots(self, host: Host, said: dict[str, Any], changed: bytes) -> None:
        self.copy.write(changed)
        self._copied += len(changed)
        host.relay_says = said["relay"] or host.relay_says
        if said["memory_mb"] is not None:
            host.memory_mb = said["memory_mb"]
        if said.get("looked"):
            host.drops = said["drops"]
            host.looked.set()

    async def _take_event(self, host: Host, event: dict[str, Any]) -> None:
        if event["event"] == "ended":
            return
        if event["event"] == "fault" and host is not self.alive[0]:  # all hosts tell of it
            return
        if event["event"] == "replaced":
            self._incarnations[event["fid"]] = event["incarnation"]
        await self._heard(event)

    # -- hosts that are gone ---------------------------------------------------------------------------------------

    async def _keep(self) -> None:
        """Show every host that we live, and see which do."""
        patience_s = self.config.cluster.wall_patience_s
        while True:
            for host in self.alive:
                silent_s = time.monotonic() - host.heard_at
                if silent_s > patience_s and not host.ended.is_set():
                    self._lose(host, f"nothing was heard from it for {silent_s:.1f} s")
                else:
                    host.channel.say({"do": "ping", "asked": time.monotonic()})
            await asyncio.sleep(patience_s / PINGS)

    def _lose(self, host: Host, why: str) -> None:
        """A host is gone: its FLSs have failed, and are replaced on the others."""
        if not host.alive or self.clock.phase == Phase.STOP or self.stopping.is_set():
            host.ended.set()
            host.looked.set()
            return
        host.alive = False
        host.ended.set()
        host.looked.set()
        host.channel.close()
        self._lost.append(host.name)
        now = host.lost_s = max(self.clock.now(), 0.0)
        if self.clock.phase != Phase.GO or not self.alive:
            self._begun[host.index].set()
            left = "no host is left; " if self.clock.phase == Phase.GO else ""
            self._fail(f"{left}{host.name} is gone: {why}")
            return
        there = host.fids[self.reader.life()[host.fids - 1] == Life.READY]
        for fid in there.tolist():
            self._happened("failed", {"fid": fid, "t_s": now})
        self.copy.end(host.fids)
        then = "are not replaced"
        if self.config.failure.replace:
            host.replaced_on = self._move(host.fids)
            then = f"are replaced on {', '.join(host.replaced_on)}"
        text = f"{host.name}{GONE} ({why}); its {len(host.fids)} FLSs {then}"
        self.observer.event(Event(now, "host", 0, text))

    def _move(self, fids: NDArray[np.int64]) -> dict[str, int]:
        """Replace FLSs on hosts that are left; how many go to each, by its name."""
        alive = {host.index: host for host in self.alive}
        weights = {index: float(host.cores) for index, host in alive.items()}
        to = taken_over(self.points[:, 0], self.host_of, fids - 1, weights)
        self.host_of[fids - 1] = to
        incarnations = self.reader.sample().incarnation
        moves = {index: fids[to == index] for index in np.unique(to).tolist()}
        for index, moved in moves.items():
            alive[index].fids = np.concatenate([alive[index].fids, moved])
        self._tell_peers()
        for index, moved in moves.items():
            rows = []
            for fid in moved.tolist():
                row = list(self.setup["fls"][fid - 1])
                # One more than is known: the host may have replaced it, and not have lived to tell.
                row[1] = max(int(incarnations[fid - 1]), self._incarnations.get(fid, 0)) + 1
                rows.append(row)
            alive[index].channel.say({"do": "adopt", "fls": rows}, self.copy.slots(moved))
        return {alive[index].name: len(moved) for index, moved in moves.items()}

    # -- time, speech, memory --------------------------------------------------------------------------------------

    def _clock_line(
        self, wall: float, phase: Phase, scale: float, emulated_s: float, wake: bool = False
    ) -> dict[str, Any]:
        self._numbers += 1
        return {
            "phase": int(phase), "wall": wall, "emulated": emulated_s, "scale": scale, "wake": wake,
            "number": self._numbers,
        }  # fmt: skip

    async def _set_clock(self, phase: Phase, scale: float, emulated_s: float | None = None) -> None:
        at = time.monotonic() + AHEAD_S
        if emulated_s is None:
            emulated_s = self.clock.now() + self.clock.scale * AHEAD_S
        line = self._clock_line(at, phase, scale, emulated_s, wake=True)
        for host in self.alive:
            host.channel.say({"do": "clock", "clock": line})
        await asyncio.sleep(at - time.monotonic())
        self.clock.write(phase, at, emulated_s, scale)
        self.clock.refresh()

    def say(self, kind: Kind, epoch: int) -> None:
        self._numbers += 1
        for host in self.alive:
            host.channel.say({"do": "say", "kind": int(kind), "epoch": epoch, "number": self._numbers})

    def _mean_memory_mb(self, processes: int) -> float | None:
        known = [(host.memory_mb, len(host.fids)) for host in self.alive if host.memory_mb is not None]
        flss = sum(count for _, count in known)
        return sum(mb * count for mb, count in known) / flss if flss else None

    def _dropped_by_kernel(self) -> int:
        return sum(host.drops for host in self.hosts)

    def _sum_up(self) -> None:
        """What only this engine has, for the summary."""
        counts: dict[str, int] = {}
        late = np.zeros(BUCKETS, np.int64)
        for host in self.hosts:
            for name, count in host.relay_says.get("counts", {}).items():
                counts[name] = counts.get(name, 0) + count
            late += np.array(host.relay_says.get("late", [0] * BUCKETS))
        known = percentiles(late.tolist())
        self.result.host_rows = [host.row() for host in self.hosts]
        self.result.extra |= {
            "hosts": len(self.hosts),
            "hosts_lost": len(self._lost),
            "relayed_datagrams": counts.get("arrived"),
            "relay_packets": counts.get("packets"),
            "relay_bytes": counts.get("packet_bytes"),
            "relay_lost": counts.get("lost"),
            "relay_rejected": counts.get("rejected"),
            "relay_late_ms": None if known is None else Lateness(*known)._asdict(),
            "clock_bound_ms": 1e3 * max(host.offset.bound_s for host in self.hosts),
            "clock_drift_ms": 1e3 * max(host.drift_s for host in self.hosts),
            "telemetry_bytes": self._copied,
        }
