"""greedy-classify: the command that settles most frontier cells now."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from shoal.swarm.policies.planners.tuning import PlannerPolicy


@dataclass(frozen=True)
class GreedyClassify(PlannerPolicy):
    """Send the command that settles most frontier cells at once; if none settles any, the whole way to the nearest one.

    Ends as closest-frontier does: each command or way settles a cell. Source: docs/concepts/planners.md.
    """

    kind: ClassVar[str] = "greedy-classify"
    code: ClassVar[int] = 6
