"""Policy beam-rollout, Shoal's best planner: the policy rollout with a second base policy and a
prediction of more cells.
"""

from __future__ import annotations

from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.planners.planner_policy import MOST_FEW, MOST_MANY, USUAL, Budgeted
from shoal.swarm.policies.planners.tuning import Tuning

TUNING = Tuning(
    end_frontier=200,
    horizon=300,
    discount=0.99,
    near_horizon=60,
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
    surprise_shrink=2,
    end_surprise=0.3,
    far_surprise=0.03,
    far_horizon=1000,
    far_discount=0.999,
    lattices=3,
    learned=1,
)


@dataclass(frozen=True)
class BeamRollout(Budgeted):
    """The policy rollout with longer simulations, a second base policy, and a prediction of more
    cells.

    The names ``best`` and ``beam-rollout`` mean the same policy.

    If its predictions are reliable, the planner beam-rollout simulates plans to the end of the
    task, even with many frontier cells. Two base policies complete plans: the greedy base policy of
    the policy rollout, and a careful base policy. The careful base policy probes nearby unknown
    cells before the particles move on. The planner beam-rollout predicts cells farther beyond the
    frontier than the policy rollout does. For cells farther beyond the frontier, the prediction
    demands a higher probability of being free. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "beam-rollout"
    code: ClassVar[int] = 7
    tuning: ClassVar[Tuning] = TUNING
    budget: float = 1000.0

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return the planning budget and the tuning for a number of particles, in the form that
        kernels expect.

        For fewer or more than 1000 particles, the planning budget is larger than for 1000
        particles, and the planner tries more random variations of plans. For more than 1000
        particles, the beam search is also wider and deeper, and the early classification of cells
        has less weight. The planner then simulates plans to the end even if the frontier is large,
        because many particles classify all cells in few moves. With a limit on computing time, the
        number of variations and the size of the beam search do not depend on the number of
        particles.
        """
        fewer, more = min(MOST_FEW, USUAL / max(1, particles)), min(MOST_MANY, particles / USUAL)
        tuning, many = self.tuning, max(1.0, more)
        tuning = tuning._replace(
            end_frontier=tuning.end_frontier * many, frontier_worth=tuning.frontier_worth / many
        )
        if not self.milliseconds:
            tuning = tuning._replace(
                variations=tuning.variations * max(fewer, more),
                beam_width=tuning.beam_width * many**2,
                beam_depth=tuning.beam_depth * many**0.5,
            )
        return (super().settings(particles)[0], *tuning)
