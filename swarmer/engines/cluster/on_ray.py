"""Host agents started by Ray: a placement group with one small actor on each node, which starts the agent's program.

The program is a process of its own, begun by exec: FLSs are forked from what it starts, not from anything that has Ray
in memory. Ray is imported only here, and only where it is asked for.
"""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from typing import TYPE_CHECKING, Any

from swarmer.engines.cluster.launch import Launched, Program
from swarmer.errors import BadInput

if TYPE_CHECKING:
    from swarmer.config_groups import Cluster

REACH_S = 5.0  # wall seconds for an address to answer
PLACE_S = 60.0  # for nodes to be given
ANSWER_S = 30.0


class RayNodes:
    """Nodes of a Ray cluster, each a host."""

    setting = "cluster.address"
    patience_s = 60.0

    def __init__(self, cluster: Cluster) -> None:
        """Joins the cluster, or starts one on this machine alone. Raises BadInput."""
        self._cluster = cluster
        self._ray: Any = import_ray()
        self._group: Any = None
        self._joined = False
        try:
            self._join()
            self.names, self._bundles = self._place()
        except BaseException:
            self.close()
            raise

    def _join(self) -> None:
        ray = self._ray
        address = self._cluster.address or os.environ.get("RAY_ADDRESS") or None
        if ray.is_initialized():  # by whoever uses this as a library
            return
        if address not in (None, "auto", "local"):
            check_reached(str(address))
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        try:
            ray.init(
                address=address, include_dashboard=False if address is None else None, log_to_driver=False,
                logging_level="ERROR", namespace="swarmer",
            )  # fmt: skip
        except Exception as error:  # Ray raises whatever its parts do
            raise refused(self._cluster.address, error) from None
        self._joined = True

    def _place(self) -> tuple[list[str], dict[str, int]]:
        """The hosts' names, and which bundle of the placement group is on each. Raises BadInput for too few nodes."""
        ray = self._ray
        from ray.util.placement_group import placement_group

        nodes = [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0) >= 1]
        wanted = self._cluster.nodes or len(nodes)
        if not nodes or wanted > len(nodes):
            raise BadInput.saying(
                f"cluster.nodes: {wanted or 1} hosts are wanted, and Ray has {len(nodes)} nodes with a free slot"
            )
        self._group = placement_group([{"CPU": 1}] * wanted, strategy="STRICT_SPREAD")
        try:
            ray.get(self._group.ready(), timeout=PLACE_S)
        except ray.exceptions.GetTimeoutError:
            raise BadInput.saying(
                f"cluster.nodes: Ray could not give a slot on each of {wanted} nodes within {PLACE_S:g} s: "
                "others have them"
            ) from None
        names = [f"node-{number + 1}" for number in range(wanted)]
        return names, {name: number for number, name in enumerate(names)}

    def address(self) -> str:
        """As `cluster.listen` says; else this node's, as Ray has it."""
        return self._cluster.listen or str(self._ray.util.get_node_ip_address())

    def start(self, name: str, orders: bytes) -> Launched:
        """An actor on that node, which starts the program there."""
        from ray.util.scheduling_strategies import PlacementGroupSchedulingStrategy

        place = PlacementGroupSchedulingStrategy(
            self._group, placement_group_bundle_index=self._bundles[name]
        )
        actor = self._ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy=place)(Starter)
        return OnNode(self._ray, actor.remote(orders))

    def close(self) -> None:
        """Give the slots back, and leave the cluster if we had to join it."""
        with contextlib.suppress(Exception):
            if self._group is not None:
                from ray.util.placement_group import remove_placement_group

                remove_placement_group(self._group)
        self._group = None
        if self._joined:
            self._ray.shutdown()
            self._joined = False


class Starter:
    """What runs on a node, within Ray: it starts the agent and is asked how that is."""

    def __init__(self, orders: bytes) -> None:
        from swarmer.engines.cluster.launch import AGENT

        self._program = Program([sys.executable, "-m", AGENT], orders)

    def state(self) -> tuple[bool, str]:
        """Whether it has ended, and what it said last."""
        return self._program.ended(), self._program.last_words()

    def end(self) -> None:
        """End the agent."""
        self._program.end()


class OnNode:
    """An agent on a node."""

    def __init__(self, ray: Any, actor: Any) -> None:
        self._ray, self._actor = ray, actor
        self._asked = actor.state.remote()
        self._known: tuple[bool, str] = (False, "")

    def _look(self) -> tuple[bool, str]:
        """What the actor said last, without waiting."""
        ray = self._ray
        try:
            done, _ = ray.wait([self._asked], timeout=0)
            if done:
                self._known = ray.get(self._asked)
                self._asked = self._actor.state.remote()
        except Exception as error:  # the actor is gone, with its node or by itself
            self._known = True, first_line(error)
        return self._known

    def ended(self) -> bool:
        """As far as is known."""
        return self._look()[0]

    def last_words(self) -> str:
        """As far as is known."""
        return self._look()[1]

    def end(self) -> None:
        """End it, and its actor."""
        with contextlib.suppress(Exception):
            self._ray.get(self._actor.end.remote(), timeout=ANSWER_S)
        with contextlib.suppress(Exception):
            self._ray.kill(self._actor)


def import_ray() -> Any:
    """Raises BadInput where it is not installed."""
    try:
        import ray
    except ImportError:
        raise BadInput.saying(
            "engine: cluster needs Ray: pip install 'swarmer[cluster]'; or name hosts without it, in cluster.hosts"
        ) from None
    return ray


def check_reached(address: str) -> None:
    """Raises BadInput if nobody listens there: Ray itself would try for a minute."""
    host, colon, port = address.rpartition("://")[2].rpartition(":")
    if not colon or not port.isdecimal() or not 0 < int(port) < 65536:
        raise BadInput("cluster.address", address, "HOST:PORT, as `ray start --head` says it, or auto")
    try:
        socket.create_connection((host, int(port)), REACH_S).close()
    except OSError as error:
        raise BadInput.saying(
            f"cluster.address: {address} is not reached: {error.strerror or error}; is Ray's head running there?"
        ) from None


def refused(address: str | None, error: Exception) -> BadInput:
    """Why Ray did not let us in, on one line."""
    line = first_line(error)
    if "ersion mismatch" in str(error):
        return BadInput.saying(f"cluster.address: {address} has another version of Ray or Python: {line}")
    return BadInput.saying(f"cluster.address: {address or 'this machine'}: Ray does not start: {line}")


def first_line(error: Exception) -> str:
    """Of what it says, or its name."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__
