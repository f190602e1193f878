"""Policy greedy-classify: send the command that immediately classifies the most frontier cells."""

from __future__ import annotations

from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.planners.planner_policy import PlannerPolicy


@dataclass(frozen=True)
class GreedyClassify(PlannerPolicy):
    """Send the command that immediately classifies the most frontier cells.

    If no command classifies a cell, send the path to the nearest frontier cell.

    Each command or path classifies a cell. Therefore every episode ends, as with closest-frontier. Source:
    docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "greedy-classify"
    code: ClassVar[int] = 6
