"""Who watches a run from inside, as `--trace` and `--check` ask for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarmer.errors import BadInput

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.engines.result import Witness
    from swarmer.observe.trace import Tracer
    from swarmer.plan import Plan

EVERYBODY = "all"


def refuse_witnesses(config: RunConfig, trace_fids: str | None, check: bool) -> None:
    """Raises BadInput for an event log, or checks, of a run that nobody sees event by event."""
    if config.engine == "virtual":
        return
    plays = "plays the protocol" if config.engine == "rounds" else "plays the same protocol"
    if trace_fids is not None:
        raise BadInput.saying(
            f"trace: the engine {config.engine} keeps no event log; --engine virtual does, and {plays}"
        )
    if check:
        raise BadInput.saying(
            f"check: the engine {config.engine} cannot be checked event by event; --engine virtual can, and {plays}"
        )


def make_tracer(plan: Plan, trace_fids: str | None) -> Tracer | None:
    """Who writes the event log of these FIDs, or of EVERYBODY; None if there is to be none.

    Raises BadInput for FIDs that the run does not have.
    """
    if trace_fids is None:
        return None
    from swarmer.observe.trace import Tracer, fids_named

    return Tracer(plan, None if trace_fids == EVERYBODY else fids_named(trace_fids, plan.size))


def make_checks(plan: Plan, check: bool) -> list[Witness]:
    """Who checks the invariants, if they are to be checked."""
    if not check:
        return []
    from swarmer.observe.invariants import Checks

    return [Checks(plan, plan.faults)]
