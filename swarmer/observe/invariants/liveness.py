"""What must come about in the end, once all is well: L1 one swarm, L5 silence only when there is one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from swarmer.observe.invariants.base import TINY, Facts, Invariant, Life
from swarmer.physics.flight import Velocity, duration

if TYPE_CHECKING:
    from swarmer.plan import Plan


class OneSwarm(Invariant):
    name, title = "L1", "one swarm"
    guards = (
        "Once all is well, all FLSs become one swarm within (10 + 2 log2 F) times λ and the longest flight."
    )

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        self._bound_s = one_swarm_within_s(facts.plan)

    def finished(self, now_s: float) -> tuple[Life | None, str] | None:
        calm_s = self.facts.calm_s
        if calm_s is None or not one_swarm_is_promised(self.facts.plan):
            return None
        if self.facts.single_s is None and now_s < calm_s + self._bound_s - 1e-9:
            return None  # it may still come
        self.looked += 1
        took = math.inf if self.facts.single_s is None else self.facts.single_s - calm_s
        if took <= self._bound_s:
            return None
        swarms: dict[tuple[int, ...], list[int]] = {}
        for life in self.facts.lives:
            if life is not None:
                swarms.setdefault(tuple(life.swarm), []).append(life.fid)
        return None, f"no single swarm {self._bound_s:.1f} s after {calm_s:.1f} s: {swarms}"


class Silence(Invariant):
    name, title = "L5", "silence"
    guards = "When every FLS is R-Complete, in one epoch and with Swarm-IDs that only fall, there is only one swarm."

    def finished(self, now_s: float) -> tuple[Life | None, str] | None:
        facts, rules = self.facts, self.facts.rules
        lives = [life for life in facts.lives if life is not None]
        falls = facts.ids_decide and rules.epochs and not facts.replaced
        if not falls or facts.plan.config.neighbours != "connected":
            return None
        if not all(life.alive and life.machine.awake and life.machine.complete for life in lives):
            return None
        if len({life.machine.epoch for life in lives}) > 1:
            return None
        self.looked += 1
        swarms = {life.machine.swarm for life in lives}
        return None if len(swarms) == 1 else (None, f"all are R-Complete, in {len(swarms)} swarms")


def one_swarm_is_promised(plan: Plan) -> bool:
    """The rules of this plan lead to one swarm in good weather, whatever has been.

    The radio must be quick enough for a challenge, its acceptance and the ACK within half a λ, and an FLS for the
    challenges of all: else an FLS challenges anew before anybody can pair with it. Challenges must reach the planned
    neighbours: between real positions (`range.measured`) somebody may stand farther away than the display is long. And
    FLSs that share one generator (`deploy.error`) may all challenge at the same moment, for ever.
    """
    config = plan.config
    quick = 6 * config.virtual.latency_max_ms <= config.lambda_ms
    able = plan.size * config.virtual.handling_ms <= 0.2 * config.lambda_ms
    return (
        config.challenge_policy in ("r_complete", "always")
        and config.neighbours == "connected"
        and config.epochs
        and config.probe_every > 0
        and config.lease_ms >= 20
        and config.deploy.error == "own"
        and quick
        and able
        and _reaches(plan)
    )


def _reaches(plan: Plan) -> bool:
    """Challenges come to reach every planned neighbour within ten turns."""
    reach = plan.config.range
    start = plan.diagonal_cells if reach.start_cells is None else reach.start_cells
    far = plan.diagonal_cells <= start + 10 * reach.step_cells
    return far and reach.measured == "ground_truth" and plan.diagonal_cells <= plan.rules.range_max + TINY


def one_swarm_within_s(plan: Plan) -> float:
    """Within so many emulated seconds of good weather all must be one swarm (soaks took a third of it)."""
    rules = plan.rules
    longest = plan.diagonal_cells + max(
        math.dist((0.0, 0.0, 0.0), point) for point in plan.cloud.points.tolist()
    )
    flight_s = duration(longest, Velocity(*rules.velocity))
    waiting_s = rules.waiting_bound_s if rules.waiting_bound_s < 1e6 else 2 * rules.lambda_s
    turns = 10 + 2 * math.log2(max(2, rules.count))
    return turns * (rules.lambda_s + flight_s) + 2 * waiting_s + 2 * rules.lease_s
