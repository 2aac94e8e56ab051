"""The protocol's invariants, checked after every event of a run in virtual time (docs/invariants.md).

`INVARIANTS` lists them; `Checks` is the witness that asks them, and ends the run when one is broken.
"""

from __future__ import annotations

from swarmer.observe.invariants.base import Invariant
from swarmer.observe.invariants.checks import INVARIANTS, Broken, Checks
from swarmer.observe.invariants.liveness import one_swarm_is_promised, one_swarm_within_s

__all__ = ["INVARIANTS", "Broken", "Checks", "Invariant", "one_swarm_is_promised", "one_swarm_within_s"]
