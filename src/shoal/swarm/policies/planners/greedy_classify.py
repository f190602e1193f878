"""greedy-classify: the command that classifies most frontier cells now."""

from __future__ import annotations

from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.planners.planner_policy import PlannerPolicy


@dataclass(frozen=True)
class GreedyClassify(PlannerPolicy):
    """Send the command that classifies most frontier cells at once; if none classifies any, the whole path to the nearest one.

    Ends as closest-frontier does: each command or way classifies a cell. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "greedy-classify"
    code: ClassVar[int] = 6
