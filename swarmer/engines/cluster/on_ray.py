"""Host agents started by Ray: a placement group with one small actor on each node, which starts the agent's program.

The program is a process of its own, begun by exec: FLSs are forked from what it starts, not from anything that has Ray
in memory.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from swarmer.engines.cluster.launch import Launched, Program
from swarmer.engines.ray_session import LOCAL, check_versions, nodes, session
from swarmer.errors import BadInput, RunFailed

if TYPE_CHECKING:
    from swarmer.config_groups import Cluster

PLACE_S = 60.0  # wall seconds for nodes to be given
ANSWER_S = 30.0


class RayNodes:
    """Nodes of a Ray cluster, each a host."""

    setting = "cluster.address"
    patience_s = 60.0

    def __init__(self, cluster: Cluster) -> None:
        """Joins the cluster, or starts one on this machine alone. Raises BadInput."""
        self._cluster = cluster
        self._open = contextlib.ExitStack()
        address = cluster.address or os.environ.get("RAY_ADDRESS") or LOCAL
        try:
            with _of_this_engine():
                self._ray: Any = self._open.enter_context(session(address))
                there = nodes(self._ray)
                check_versions(self._ray, there)
            wanted = cluster.nodes or len(there)
            if wanted > len(there):
                raise BadInput("cluster.nodes", wanted, f"Ray has {len(there)} with a core to give")
            self._place(wanted)
        except BaseException:
            self.close()
            raise

    def _place(self, wanted: int) -> None:
        """A slot on each of so many nodes. Raises BadInput if they are not to be had."""
        from ray.util.placement_group import placement_group, remove_placement_group

        group = placement_group([{"CPU": 1}] * wanted, strategy="STRICT_SPREAD")
        self._open.callback(remove_placement_group, group)
        if not group.wait(PLACE_S):
            raise BadInput.saying(
                f"cluster.nodes: Ray has not given a core on each of {wanted} nodes within {PLACE_S:g} s: "
                "others have them"
            )
        self._group = group
        self.names = [f"node-{number + 1}" for number in range(wanted)]

    def address(self) -> str:
        """As `cluster.listen` says; else this node's, as Ray has it."""
        return self._cluster.listen or str(self._ray.util.get_node_ip_address())

    def start(self, name: str, orders: bytes) -> Launched:
        """An actor on that node, which starts the program there."""
        from ray.util.scheduling_strategies import PlacementGroupSchedulingStrategy

        bundle = self.names.index(name)
        place = PlacementGroupSchedulingStrategy(self._group, placement_group_bundle_index=bundle)
        actor = self._ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy=place)(Starter)
        return OnNode(self._ray, actor.remote(orders))

    def close(self) -> None:
        """Give the slots back, and leave the cluster."""
        with contextlib.suppress(Exception):  # whatever of it is gone already
            self._open.close()


@contextlib.contextmanager
def _of_this_engine() -> Iterator[None]:
    """What is wrong with Ray is told by the setting that names it here, not by the option of a sweep."""
    try:
        yield
    except (BadInput, RunFailed) as error:
        text = str(error)
        if text.startswith("ray: is not installed"):
            text = f"engine: cluster needs Ray, which {text.removeprefix('ray: ')}; or name hosts in cluster.hosts"
        elif isinstance(error, RunFailed):
            text = f"cluster.address: {text}"
        raise BadInput.saying(text.replace("--ray:", "cluster.address:")) from None


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
            lines = str(error).split("\n")
            self._known = True, lines[0].strip() or type(error).__name__
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
