"""Policy greedy-classify: send the command that immediately classifies the most frontier cells."""

from __future__ import annotations

from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.planners.planner_policy import PlannerPolicy


@dataclass(frozen=True)
class GreedyClassify(PlannerPolicy):
    """Send the command that immediately classifies the most frontier cells.

    If no command classifies a cell immediately, send the commands of a shortest path to a frontier
    cell.

    Every episode of the policy greedy-classify ends, because each command or path classifies at
    least one cell. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "greedy-classify"
    code: ClassVar[int] = 6
