"""beam-rollout, the best planner that we know: plans to the end, completed in two manners, in a farther prediction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from shoal.swarm.policies.planners.tuning import MOST_FEW, MOST_MANY, USUAL, Budgeted, Tuning

TUNING = Tuning(
    few=200,
    horizon=300,
    discount=0.99,
    near_horizon=60,
    near_discount=0.98,
    share=25,
    width=10,
    depth=5,
    leaves=8,
    ahead=1,
    rate=0.9,
    cap=8,
    variations=6,
    charge=1,
    likely=0.75,
    layers=200,
    runs=1,
    renew=8,
    patience=450,
    sure=0.7,
    after=1,
    wonder=35,
    trust=2,
    calm=0.4,
    foreseen=0.03,
    far_horizon=1000,
    far_discount=0.999,
    lattices=3,
)


@dataclass(frozen=True)
class BeamRollout(Budgeted):
    """As rollout, with three things added: it is the one that ``best`` stands for.

    Plans are imagined until nothing is left to do from the first move on. They are also completed carefully, probing what would be
    left behind before stepping on. And the prediction goes on as long as all cells up to there are likely to be free together.
    Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "beam-rollout"
    code: ClassVar[int] = 7
    tuning: ClassVar[Tuning] = TUNING
    budget: float = 1000.0

    def settings(self, particles: int) -> tuple[float, ...]:
        """Return budget and tuning for so many particles.

        The more thought that few and many are given goes into variations. The more they are, the sooner all is settled: then
        the end is in sight of more frontier cells, and what is settled early counts less.
        """
        fewer, more = min(MOST_FEW, USUAL / max(1, particles)), min(MOST_MANY, particles / USUAL)
        tuning, many = self.tuning, max(1.0, more)
        tuning = tuning._replace(few=tuning.few * many, share=tuning.share / many)
        if not self.milliseconds:
            tuning = tuning._replace(variations=tuning.variations * max(fewer, more))
        return (super().settings(particles)[0], *tuning)
