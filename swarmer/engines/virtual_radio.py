"""The radio of the virtual-time engine: `radio`'s rules in memory. Whom a datagram may reach is found fast.

A datagram goes to those whom the rules let it reach when it is sent, as the kernel's filter has it for processes; each
of them gets it after a latency of its own, and asks the rules again (docs/virtual-time.md).
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Callable, Iterable
from operator import itemgetter
from random import Random
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from swarmer.engines.virtual_time import DATAGRAM, GROUP, Agenda
from swarmer.messages import CHALLENGE_INIT, NO_SWARM, TO_FLS, TO_SWARM, Message, Stamp, Swarm
from swarmer.radio import EndRules, heard

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from swarmer.engines.virtual_fls import VirtualFls
    from swarmer.fls_spec import FlsSpec
    from swarmer.rules import Rules

RUN = 1  # there is no other run on this air
FEW = 64  # FLSs of other swarms that are asked one by one, wherever they are
HAIR = 1e-6  # cells: more than two ways to compute a distance differ; the rules decide
MANY = 24  # receivers for which arrays are the faster way
AHEAD = 1.5  # a table that is too short is made to reach so many times as far as is asked for


class Air:
    """Who is on the air, in which swarm and where, and the way of a datagram to them."""

    def __init__(
        self,
        agenda: Agenda,
        latency_s: tuple[float, float],
        points: NDArray[np.float64],
        rules: Rules,
        next_points: NDArray[np.float64] | None = None,
    ) -> None:
        """latency_s: shortest, longest. points: (F, 3), cells. next_points: the same of the shape that comes after."""
        self.agenda = agenda
        self._lowest, self._span = latency_s[0], latency_s[1] - latency_s[0]
        self._points, self._estimated = points, rules.range_estimated
        self._next_points = next_points
        self._tree: Any = None
        self.count = len(points)
        self.flss: list[VirtualFls | None] = [None] * (self.count + 1)  # by FID, as what follows
        self.alive = np.zeros(self.count + 1, np.bool_)
        self.swarms: dict[Swarm, dict[int, VirtualFls]] = {}
        self.listens = array("i", [0]) * (
            self.count + 1
        )  # to the swarm of which Swarm-ID; 0: to none, it is dark
        self.tunings = 0.0  # how often anybody has begun to listen to another swarm
        self._lit = 0
        self._listed_by: list[list[int]] = [
            [] for _ in range(self.count + 1)
        ]  # whose planned neighbour it is
        self._lists: list[tuple[int, ...]] = [()] * (self.count + 1)  # its planned neighbours
        self.on_single: Callable[[], None] | None = None  # told when an FLS has joined or left the only swarm
        self._near: list[Sequence[int]] = [()] * (self.count + 1)
        self._distances: list[Sequence[float]] = [()] * (self.count + 1)
        self._places = np.zeros((self.count + 1, 3))  # at the last look, cells
        self._moved: dict[int, VirtualFls] = {}  # who has begun or ended a flight since, or still flies
        sender, receiver = EndRules(*rules.sender), EndRules(*rules.receiver)
        self._longest_s = (
            latency_s[1] + sender.longest_s + receiver.longest_s
        )  # that a datagram is on its way
        # By FID: may one of its datagrams come twice, or later than WINDOW younger ones, or after its successor's?
        # Only then need a receiver remember which it has had; all others would cost it much memory, and refuse none.
        self.doubtful = [bool(sender.duplicate or receiver.duplicate)] * (self.count + 1)

    def join(self, fls: VirtualFls, spec: FlsSpec) -> None:
        """A new FLS listens, in the place of its predecessor."""
        self.flss[fls.fid], self.alive[fls.fid] = fls, True
        if not self._distances[fls.fid]:
            self._place(fls.fid, spec)
        if spec.incarnation:
            self.doubtful[fls.fid] = True
        self.moved(fls)

    def _place(self, fid: int, spec: FlsSpec) -> None:
        self._near[fid], self._distances[fid] = spec.near, spec.distances
        self._lists[fid] = spec.neighbours
        for neighbour in spec.neighbours:
            self._listed_by[neighbour].append(fid)

    def move(self, fls: VirtualFls, spec: FlsSpec) -> None:
        """It has another point from now on. Whoever moves first brings the points of all: they move together."""
        if self._next_points is not None:
            self._points, self._tree, self._next_points = self._next_points, None, None
        for neighbour in self._lists[fls.fid]:
            self._listed_by[neighbour].remove(fls.fid)
        self._place(fls.fid, spec)
        self.tunings += 1.0

    def hurries(self, fid: int, seconds: float) -> None:
        """This FLS has sent half a WINDOW of datagrams within so many emulated seconds.

        A WINDOW and one more hold two multiples of half a WINDOW. So whoever never sends as many as that between two
        of them while a datagram may be on its way has none that comes later than WINDOW younger ones.
        """
        if seconds <= self._longest_s:
            self.doubtful[fid] = True

    def leave(self, fls: VirtualFls) -> None:
        """It neither sends nor hears any more; what it has sent is still on its way."""
        self.flss[fls.fid], self.alive[fls.fid] = None, False
        self.tune(fls, fls.ears.swarm, NO_SWARM)

    def tune(self, fls: VirtualFls, old: Swarm, new: Swarm) -> None:
        """From now on it listens to what is for the swarm `new`."""
        swarms = self.swarms
        self.tunings += 1.0
        if old != NO_SWARM:
            members = swarms[old]
            del members[fls.fid]
            if not members:
                del swarms[old]
            self._lit -= 1
        if new != NO_SWARM:
            swarms.setdefault(new, {})[fls.fid] = fls
            self._lit += 1
        self.listens[fls.fid] = new.xi
        if self.on_single is not None and len(swarms) == 1:
            self.on_single()

    def moved(self, fls: VirtualFls) -> None:
        """It has begun or ended a flight."""
        self._moved[fls.fid] = fls

    def places(self) -> NDArray[np.float64]:
        """(F + 1, 3): where every FLS is now, cells; row 0 is nobody's."""
        moved = self._moved
        if moved:
            self._places[list(moved)] = [fls.position() for fls in moved.values()]
            self._moved = {fid: fls for fid, fls in moved.items() if fls.flight.length > 0.0}
        return self._places

    def transmit(self, message: Message, stamp: Stamp, latency: Random, sender: VirtualFls | None) -> None:
        """Put a datagram on the air. sender: whom it cannot reach; None: the engine sends."""
        to = message.to
        if to == TO_FLS:
            one = self.flss[message.addressee.xi]
            if one is not None and one is not sender:
                agenda = self.agenda
                at = agenda.now + self._lowest + self._span * latency.random()
                agenda.put(at, DATAGRAM, one, message, stamp)
        elif to == TO_SWARM:
            members = self.swarms.get(message.addressee, _NOBODY).values()
            self._send_to([fls for fls in members if fls is not sender], message, stamp, latency)
        elif message.kind == CHALLENGE_INIT and sender is not None:
            self._send_to(self._in_range(message, stamp, sender), message, stamp, latency)
        else:
            others = [fls for fls in self.flss if fls is not None and fls is not sender]
            self._send_to(others, message, stamp, latency)

    def _send_to(self, receivers: list[VirtualFls], message: Message, stamp: Stamp, latency: Random) -> None:
        """One entry for all, latest first: the loop takes them off the end, each at its own moment."""
        count, first, span = len(receivers), self.agenda.now + self._lowest, self._span
        if count > MANY:
            moments = first + span * next_draws(latency, count)
            order = np.argsort(moments, kind="stable")[::-1]
            arrivals = list(
                zip(moments[order].tolist(), map(receivers.__getitem__, order.tolist()), strict=True)
            )
        elif receivers:
            draw = latency.random
            arrivals = [(first + span * draw(), fls) for fls in receivers]
            arrivals.sort(key=_moment)
            arrivals.reverse()  # of equal moments the lower FID is taken off first, as above
        else:
            return
        self.agenda.put(arrivals[-1][0], GROUP, None, arrivals, (message, stamp, self.tunings))

    def _in_range(self, message: Message, stamp: Stamp, sender: VirtualFls) -> list[VirtualFls]:
        """Whom a challenge reaches, by the rules, at the moment of sending."""
        count, flss, estimated = self.count, self.flss, self._estimated
        swarm, me = message.swarm, sender.fid
        members = self.swarms.get(swarm, _NOBODY)
        near: Iterable[int]
        if self._lit - len(members) <= FEW:  # its own swarm's challenge only its neighbours take
            near = [fid for fid in self._listed_by[me] if fid in members]
            near += [fid for one, found in self.swarms.items() if one != swarm for fid in found]
        elif estimated:
            near = self._placed_within(message.range, stamp)
        else:
            near = self._within(me, message.range)
        return [
            fls
            for fid in near
            # What most are refused for, their own swarm's challenge, is asked here, where it costs no call.
            if (fls := flss[fid])
            and ((ears := fls.ears).swarm != swarm or me in ears.neighbours)
            and heard(message, stamp, ears, count, fls.position() if estimated else None) is None
        ]

    def _within(self, fid: int, reach: float) -> Sequence[int]:
        """FIDs of all others within `reach` cells of a point, nearest first."""
        distances = self._distances[fid]
        if reach >= distances[-1] and len(distances) < self.count - 1:
            distances = self._look_farther(fid, AHEAD * reach)
        return self._near[fid][: bisect_right(distances, reach)]

    def _look_farther(self, fid: int, reach: float) -> Sequence[float]:
        if self._tree is None:
            self._tree = cKDTree(self._points)
        point = self._points[fid - 1]
        rows = np.array(self._tree.query_ball_point(point, reach), dtype=np.int64)
        rows = rows[rows != fid - 1]
        squared = ((self._points[rows] - point) ** 2).sum(axis=1)
        order = np.lexsort((rows, squared))
        self._near[fid] = array("i", (rows[order] + 1).astype(np.int32).tobytes())
        self._distances[fid] = distances = array("d", np.sqrt(squared[order]).tobytes())
        return distances

    def _placed_within(self, reach: float, stamp: Stamp) -> list[int]:
        """FIDs of whom are now within `reach` cells of where a datagram comes from."""
        far = np.sqrt(((self.places() - stamp.origin) ** 2).sum(axis=1))
        return np.flatnonzero(far <= reach + HAIR).tolist()


def next_draws(rng: Random, count: int) -> NDArray[np.float64]:
    """The next `count` numbers of `rng.random()`, bit for bit, without a call for each.

    >>> next_draws(Random(1), 3).tolist() == [(one := Random(1)).random(), one.random(), one.random()]
    True
    """
    # As CPython makes them: 27 bits of one word of the twister and 26 of the next.
    words = np.frombuffer(rng.randbytes(8 * count), np.dtype("<u4"))
    high, low = words[0::2] >> np.uint32(5), words[1::2] >> np.uint32(6)
    return (high * 67_108_864.0 + low) / 9_007_199_254_740_992.0


_moment = itemgetter(0)
_NOBODY: dict[int, VirtualFls] = {}
