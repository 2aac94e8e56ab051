"""The cluster engine: one run over many hosts, with the FLS processes, radio and rules of the process engine.

Each host has an agent (`agent`), which starts the dispatcher and the relay there. Here the agents are gathered, and the
points are shared out among them by space; `run` is what follows.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Self

import numpy as np

from swarmer.engines.cluster.hosts import Gathering
from swarmer.engines.cluster.launch import make_launcher
from swarmer.engines.cluster.run import ClusterRun
from swarmer.engines.cluster.shares import all_points, shares
from swarmer.engines.result import Observer, RunResult
from swarmer.errors import BadInput, RunFailed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swarmer.plan import Plan


class ClusterEngine:
    """Runs one plan on many hosts. Made, checked and given back as a context; `run` runs once.

    Making one starts the hosts' agents, and raises BadInput where one cannot be had or cannot take its part.
    """

    name = "cluster"

    def __init__(self, plan: Plan) -> None:
        refuse(plan)
        self.plan = plan
        self._launcher = make_launcher(plan.config.cluster)
        self._runner = asyncio.Runner()
        try:
            names = self._launcher.names
            if len(names) > plan.size:
                raise BadInput.saying(
                    f"{self._launcher.setting}: {len(names)} hosts are more than the {plan.size} FLSs of the run"
                )
            self._gathering = Gathering(plan.config.cluster, self._launcher, names)
            self._hosts = self._runner.run(self._gathering.gather())
        except BaseException:
            self._close()
            raise
        try:
            self._host_of = self._share_out()
            self._runner.run(self._gathering.reserve(self._hosts, plan.config.radio.port))
        except BadInput:
            self.__exit__()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._gathering.end()
        self._close()

    def _close(self) -> None:
        self._launcher.close()
        self._runner.close()

    def _share_out(self) -> NDArray[np.int64]:
        """(F,) the host of each FLS. Raises BadInput if a host would have more than it may."""
        host_of = shares(all_points(self.plan)[:, 0], [host.cores for host in self._hosts])
        most = self.plan.config.cluster.flss_per_host
        for host in self._hosts:
            host.fids = np.flatnonzero(host_of == host.index) + 1
            host.begun = len(host.fids)
            if most is not None and len(host.fids) > most:
                raise BadInput.saying(
                    f"cluster.flss_per_host: {most} on each of {len(self._hosts)} hosts are too few for the "
                    f"{self.plan.size} FLSs of the run: {host.name} would have {len(host.fids)}"
                )
        return host_of

    def run(self, observer: Observer) -> RunResult:
        """Run to the end, the goal, Ctrl-C or a failure; the result says which. Raises RunFailed if `observer` does."""
        observer.planned(self.plan)
        try:
            run = ClusterRun(self.plan, observer, self._hosts, self._host_of)
        except OSError as error:
            raise RunFailed(f"no memory to share: {error.strerror or error}") from error
        return self._runner.run(run.play())


def refuse(plan: Plan) -> None:
    """Raises BadInput for what this engine cannot do."""
    config = plan.config
    if config.battery.standby_group:
        raise BadInput.saying(
            f"battery.standby_group: {config.battery.standby_group} is not for the engine cluster, "
            "where a group's FLSs may be on two hosts; 0"
        )
    if any(fault.swarm_of for fault in plan.faults.faults):
        raise BadInput.saying(
            "faults: a fault that strikes a swarm is not for the engine cluster, where a swarm may be on many hosts"
        )
