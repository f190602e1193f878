"""Episodes for tests of the search part."""

from __future__ import annotations

from typing import Any

from shoal.search import SearchEpisode, SearchPlan, SearchProblem, plan_search
from shoal.search.run import run


def search(region: Any, *, seed: int = 0, **fields: Any) -> SearchEpisode:
    """Return the episode of a problem with these fields."""
    return run(SearchProblem(region, **fields), seed=seed)


def planned(region: Any, *, seed: int = 0, **fields: Any) -> SearchPlan:
    """Return the plan of a problem with these fields."""
    return plan_search(SearchProblem(region, **fields), seed=seed)
