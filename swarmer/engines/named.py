"""The engine that the settings name, imported when it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swarmer.engines.cluster.engine import ClusterEngine
    from swarmer.engines.process import ProcessEngine
    from swarmer.engines.result import Witness
    from swarmer.engines.rounds import RoundsEngine
    from swarmer.engines.virtual import VirtualEngine
    from swarmer.plan import Plan


def make_engine(
    plan: Plan, witnesses: Sequence[Witness] = ()
) -> ProcessEngine | VirtualEngine | RoundsEngine | ClusterEngine:
    """A context that runs the plan once. Raises BadInput where this machine cannot take the run.

    witnesses: of a run in virtual time; processes have none.
    """
    if plan.config.engine == "virtual":
        from swarmer.engines.virtual import VirtualEngine

        return VirtualEngine(plan, witnesses)
    if plan.config.engine == "rounds":
        from swarmer.engines.rounds import RoundsEngine

        return RoundsEngine(plan)
    if plan.config.engine == "cluster":
        from swarmer.engines.cluster.engine import ClusterEngine

        return ClusterEngine(plan)
    from swarmer.engines.process import ProcessEngine

    return ProcessEngine(plan)
