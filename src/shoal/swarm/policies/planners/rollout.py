"""rollout: candidates completed by a base policy in the predicted world; the best one's first command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from shoal.swarm.policies.planners.tuning import Budgeted, Tuning

P1 = Tuning(
    few=200,
    horizon=150,
    discount=0.99,
    near_horizon=60,
    near_discount=0.98,
    share=30,
    width=24,
    depth=12,
    leaves=6,
    ahead=0,
    rate=0,
    cap=0,
    variations=8,
    charge=0,
    likely=0.75,
    layers=12,
    runs=0,
    renew=8,
    patience=450,
    sure=0,
    after=0,
    wonder=0,
    trust=0,
    calm=0,
    foreseen=0,
    far_horizon=150,
    far_discount=0.99,
    lattices=0,
)


@dataclass(frozen=True)
class Rollout(Budgeted):
    """Imagine several plans in the world as predicted; send the first command of the best.

    Candidates are what is left of the last plan, the single commands, the best leaves of a beam search and variations of the
    best so far; each is completed greedily. If nothing is settled for 450 moves, a whole way to the nearest frontier cell is
    played, so every episode ends. Source: docs/concepts/planners.md (the prototype there).
    """

    kind: ClassVar[str] = "rollout"
    code: ClassVar[int] = 7
    tuning: ClassVar[Tuning] = P1
