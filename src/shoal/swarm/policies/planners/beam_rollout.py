"""beam-rollout, the best planner that we know: plans to the end, completed in two manners, in a farther prediction."""

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
    """As rollout, with three things added: it is the one that ``best`` stands for.

    Plans are simulated until nothing is left to do from the first move on. They are also completed carefully, probing what would be
    left behind before stepping on. And the prediction goes on as long as all cells up to there are likely to be free together.
    Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "beam-rollout"
    code: ClassVar[int] = 7
    tuning: ClassVar[Tuning] = TUNING
    budget: float = 1000.0

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return budget and tuning for so many particles.

        The more thought that few and many are given goes into variations, and that of many into a wider and deeper beam, too. The
        more they are, the sooner all is classified: then the end is in sight of more frontier cells, and what is classified early
        counts less.
        """
        fewer, more = min(MOST_FEW, USUAL / max(1, particles)), min(MOST_MANY, particles / USUAL)
        tuning, many = self.tuning, max(1.0, more)
        tuning = tuning._replace(end_frontier=tuning.end_frontier * many, frontier_worth=tuning.frontier_worth / many)
        if not self.milliseconds:
            tuning = tuning._replace(
                variations=tuning.variations * max(fewer, more),
                beam_width=tuning.beam_width * many**2,
                beam_depth=tuning.beam_depth * many**0.5,
            )
        return (super().settings(particles)[0], *tuning)
