"""Policy beam-rollout, the best planner.

It completes plans with two base policies, and its prediction extends farther.
"""

from __future__ import annotations

from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.planners.planner_policy import MOST_FEW, MOST_MANY, USUAL, Budgeted
from shoal.swarm.policies.planners.tuning import Tuning

TUNING = Tuning(
    horizon=1000,
    near_horizon=60,
    surprise_shrink=10,
    frontier_worth=25,
    beam_width=10,
    beam_depth=5,
    beam_leaves=8,
    variations=6,
    left_behind_cost=1,
    free_threshold=0.75,
    prediction_layers=200,
    run_candidates=1,
    force_after=450,
    joint_chance=0.7,
    future_weight=1,
    surprise_weight=35,
    end_surprise=0.3,
    lattices=3,
    learned=1,
)


@dataclass(frozen=True)
class BeamRollout(Budgeted):
    """The policy rollout with three extensions. ``best`` is another name for this planner.

    First, the horizon is longer where the prediction is reliable. Second, a second base policy also completes plans,
    carefully: before it moves on, it probes cells that it would leave behind. Third, the prediction extends farther. It stops where
    the predicted cells are no longer likely to be all free. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "beam-rollout"
    code: ClassVar[int] = 7
    tuning: ClassVar[Tuning] = TUNING
    budget: float = 1000.0

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return the budget and the tuning for a number of particles.

        With few or with many particles, the budget is larger, and the extra part is spent on variations. With many particles, a
        part of the budget also makes the beam wider and deeper. The more particles there are, the sooner all cells are classified.
        Therefore, with many particles, early classification has less weight.
        """
        fewer, more = min(MOST_FEW, USUAL / max(1, particles)), min(MOST_MANY, particles / USUAL)
        many = max(1.0, more)
        tuning = self.tuning._replace(frontier_worth=self.tuning.frontier_worth / many)
        if not self.milliseconds:
            tuning = tuning._replace(
                variations=tuning.variations * max(fewer, more),
                beam_width=tuning.beam_width * many**2,
                beam_depth=tuning.beam_depth * many**0.5,
            )
        return (super().settings(particles)[0], *tuning)
