"""The runs of a sweep on Ray: tasks, each placed on a machine that has room, whose files come back to the sweep."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self

from swarmer.engines.ray_session import LOCAL, Node, check_versions, nodes, on_node, session
from swarmer.errors import BadInput, RunFailed, SwarmerError
from swarmer.experiments import dispatch, errand
from swarmer.experiments.dispatch import Lost
from swarmer.experiments.needs import Needs
from swarmer.experiments.one_run import Outcome, disk_full
from swarmer.experiments.runs import Run

if TYPE_CHECKING:
    from swarmer.experiments.board import Board
    from swarmer.plan import Plan

CANCEL_S = 10.0  # for runs to put away what they have, before their workers are killed


class OnRay:
    """A Ray as the place of a sweep. A context: entering connects, or starts one."""

    def __init__(self, address: str, cores: int | None = None) -> None:
        """address: as `session` takes it. cores: what a Ray started here gets; of another no more are used."""
        self._address, self._cores = address, cores
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            ray = stack.enter_context(session(self._address, self._cores))
            self._crew = RayCrew(ray, self._cores, self._address == LOCAL)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *reason: Any) -> None:
        self._stack.__exit__(*reason)
        errand.clear_desks()

    def at_once(self, runs: list[Run]) -> int:
        """See sweep.Place. Raises BadInput if a node is another world, or a run has room on none."""
        if any(run.config.engine == "cluster" for run in runs):
            raise BadInput.saying(
                "--ray: a run of the engine cluster takes hosts from Ray by itself; sweep it without --ray"
            )
        there = self._crew.nodes()
        if not there:
            raise BadInput.saying("--ray: too few slots: no node of the cluster has a core")
        dispatch.check_room(there, runs)
        return dispatch.at_once(there, [run.needs for run in runs])

    def notes(self, runs: list[Run]) -> list[str]:
        """See sweep.Place."""
        there = self._crew.nodes()
        cores = sum(node.cores for node in there)
        return [f"Ray has {len(there)} node{'s' * (len(there) != 1)} with {cores} cores for this"]

    def outcomes(self, runs: list[Run], out: Path, board: Board) -> Iterator[tuple[Run, Outcome]]:
        """See sweep.Place; runs that need a machine come last."""
        self._crew.out = out
        try:
            order = sorted(runs, key=lambda run: run.whole_machine)
            yield from dispatch.outcomes(order, self._crew, board.started, board.tick, board.say)
        finally:
            self._crew.end_all()


class RayCrew:
    """What `dispatch` needs, by Ray's tasks."""

    def __init__(self, ray: ModuleType, cores: int | None, ours: bool) -> None:
        """ours: it was started here, so there is nothing to find out."""
        self._ray, self._cores, self._ours = ray, cores, ours
        self._do = ray.remote(max_retries=0)(errand.do)
        self._known: set[str] = set()  # the nodes that have what we have
        self._begun: dict[Any, Node] = {}
        self.out = Path()

    def nodes(self) -> list[Node]:
        """See Crew. Raises BadInput for one with another Python, Ray or swarmer."""
        with self._whole():
            there = nodes(self._ray)
        if not self._ours:
            fresh = [node for node in there if node.id not in self._known]
            self._known |= {node.id for node in check_versions(self._ray, fresh)}
            there = [node for node in there if node.id in self._known]
        return _at_most(there, self._cores)

    def begin(self, run: Run, needs: Needs, node: Node) -> Any:
        """See Crew."""
        options = {
            "num_cpus": node.cores if needs.machine else needs.cores,
            "memory": int(needs.memory_mb * 1e6),
            "scheduling_strategy": on_node(self._ray, node.id),
            "name": run.path.as_posix(),
        }
        job = errand.Errand(run.config, list(sys.argv), plan_here(run))
        handle = self._do.options(**options).remote(job)
        self._begun[handle] = node
        return handle

    def wait(self, begun: list[Any], limit_s: float) -> list[Any]:
        """See Crew."""
        with self._whole():
            ended, _ = self._ray.wait(begun, num_returns=1, timeout=limit_s)
        return ended

    def outcome(self, ended: Any, run: Run) -> Outcome:
        """See Crew."""
        node = self._begun.pop(ended)
        errors = self._ray.exceptions
        try:
            brought = self._ray.get(ended)
        except errors.OutOfMemoryError:
            return Outcome(
                "failed", f"out of memory on {node.name}; `needs` in the file says how much a run needs"
            )
        except errors.RayTaskError as error:  # a fault of ours
            return Outcome("failed", f"on {node.name}: {_last_line(error)}")
        except errors.WorkerCrashedError:
            raise Lost(f"its worker on {node.name} was killed", machine_gone=False) from None
        except errors.RayError as error:
            raise Lost(f"{node.name} was lost ({type(error).__name__})") from None
        try:
            errand.put_down(brought, self.out / run.path)
        except SwarmerError as error:
            return Outcome("failed", str(error), disk_full=disk_full(error))
        return brought.outcome

    @contextlib.contextmanager
    def _whole(self) -> Iterator[None]:
        """Without its head there is no cluster. Raises RunFailed."""
        try:
            yield
        except (self._ray.exceptions.RayError, ConnectionError, RuntimeError) as error:
            reason = _last_line(error)
            raise RunFailed(
                f"--ray: the cluster is lost: {reason}; the same command goes on elsewhere"
            ) from None

    def end_all(self) -> None:
        """End what is at work; a worker that does not within some seconds is killed."""
        left = list(self._begun)
        self._begun.clear()
        for how in ({"force": False}, {"force": True}):
            for handle in left:
                with contextlib.suppress(Exception):
                    self._ray.cancel(handle, **how)
            if left:
                _, left = self._ray.wait(left, num_returns=len(left), timeout=CANCEL_S)


def plan_here(run: Run) -> Plan | None:
    """The plan of a run that needs a file of this machine; None where any machine can make it."""
    from swarmer.plan import make_plan
    from swarmer.shapes.catalogue import CATALOGUE

    config = run.config
    files = [shape for shape in (config.shape, config.transition.shape) if shape and shape not in CATALOGUE]
    return make_plan(config) if files or config.faults.file else None


def _at_most(there: list[Node], cores: int | None) -> list[Node]:
    """The machines with no more cores in all than asked for."""
    if cores is None:
        return there
    kept = []
    for node in there:
        if cores > 0:
            kept.append(node._replace(cores=min(node.cores, cores)))
            cores -= node.cores
    return kept


def _last_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
