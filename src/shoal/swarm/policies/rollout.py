"""rollout: candidates completed by a base policy in the predicted world; the best one's first command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from shoal.swarm.policies.planner import PlannerPolicy


@dataclass(frozen=True)
class Rollout(PlannerPolicy):
    """Imagine several plans to the end in the world as predicted; send the first command of the best.

    If nothing is settled for three horizons, a whole way to the nearest frontier cell is played, so every episode ends.
    Source: docs/concepts/planners.md (prototype P1).
    """

    kind: ClassVar[str] = "rollout"
    code: ClassVar[int] = 7

    @property
    def settings(self) -> tuple[float, ...]:
        return (1e9, 200, 150, 0.99, 60, 0.98, 30, 24, 12, 6, 0, 0, 0, 8, 0, 0.75, 12, 0, 8, 450, 0)
