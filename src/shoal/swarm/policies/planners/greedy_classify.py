"""Policy greedy-classify: send the command that classifies most frontier cells immediately."""

from __future__ import annotations

from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.planners.planner_policy import PlannerPolicy


@dataclass(frozen=True)
class GreedyClassify(PlannerPolicy):
    """Send the command that classifies most frontier cells.

    If no command classifies a cell, send the path to the nearest frontier cell.

    Every episode ends, as for closest-frontier, because each command or path classifies a cell. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "greedy-classify"
    code: ClassVar[int] = 6
