"""Policy rollout: simulate candidate plans in a predicted world, and send the first command of the
best plan.
"""

from __future__ import annotations

from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.planners.planner_policy import Budgeted
from shoal.swarm.policies.planners.tuning import Tuning

P1 = Tuning(
    end_frontier=200,
    horizon=150,
    discount=0.99,
    near_horizon=60,
    frontier_worth=30,
    beam_width=24,
    beam_depth=12,
    beam_leaves=6,
    variations=8,
    left_behind_cost=0,
    free_threshold=0.75,
    prediction_layers=12,
    run_candidates=0,
    force_after=450,
    joint_chance=0,
    future_weight=0,
    surprise_weight=0,
    surprise_shrink=0,
    end_surprise=0,
    far_surprise=0,
    far_horizon=150,
    far_discount=0.99,
    lattices=0,
    learned=0,
)


@dataclass(frozen=True)
class Rollout(Budgeted):
    """Simulate several plans in the predicted world and send the first command of the best plan.

    The candidate plans are the rest of the last plan, all single commands, the best plans of a beam
    search, and random variations of the best candidate. A greedy base policy completes each
    candidate plan. After 450 consecutive moves that classify no cell, the planner sends all
    commands of the shortest path to a frontier cell, so that every episode ends. The policy rollout
    is the prototype of the policy beam-rollout. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "rollout"
    code: ClassVar[int] = 7
    tuning: ClassVar[Tuning] = P1
