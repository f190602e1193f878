"""One plan of a search for all that the studio shows, simulates and writes of it.

Missions keep a reserve, a margin and start times that a plan without them lacks. So the plan of a
page is that of its missions, if it has any.
"""

from __future__ import annotations

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import ShoalError
from shoal.missions.mission_set import MissionSet
from shoal.missions.options import MissionOptions
from shoal.search.episode import SearchEpisode
from shoal.search.planning.plan import SearchPlan, plan_search
from shoal.search.problem import SearchProblem
from shoal.search.run import run


@dataclass(frozen=True, eq=False)
class PlannedSearch:
    """The plan of a search, and its missions.

    Parameters
    ----------
    problem : SearchProblem
        The problem that was planned. With missions, it has their reserve and their margin.
    plan : SearchPlan
    missions : MissionSet or None
        The missions of the plan, or None if none were asked for, without a vehicle, or if there can
        be none.
    refusal : ShoalError or None
        The reason why there can be no missions.
    """

    problem: SearchProblem
    plan: SearchPlan
    missions: MissionSet | None = None
    refusal: ShoalError | None = None

    def run(self, *, seed: int) -> SearchEpisode:
        """Simulate the search along its plan."""
        if self.missions is not None:
            return self.missions.run()
        return run(self.problem, seed=seed, plan=self.plan)


def planned_search(
    problem: SearchProblem, options: MissionOptions | None = None, *, seed: int
) -> PlannedSearch:
    """Plan a search and, with ``options`` and a vehicle, its missions.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if there is no plan, with missions or without them.
    """
    if options is None or problem.vehicle is None:
        return PlannedSearch(problem, plan_search(problem, seed=seed))
    try:
        missions = MissionSet.from_problem(problem, options, seed=seed)
    except ShoalError as error:
        return PlannedSearch(problem, plan_search(problem, seed=seed), refusal=error)
    assert missions.problem is not None
    return PlannedSearch(missions.problem, missions.scheduled, missions)


def is_same_plan(plan: SearchPlan, other: SearchPlan) -> bool:
    """Return whether the robots of two plans search the same cells in the same order, and are back
    at the same times.
    """
    times = [
        [time for sorties in one.sorties for sortie in sorties for time in sortie]
        for one in (plan, other)
    ]
    return (
        np.array_equal(plan.tour.cells, other.tour.cells)
        and plan.allocation.work == other.allocation.work
        and np.shape(times[0]) == np.shape(times[1])
        and np.allclose(times[0], times[1], rtol=0, atol=_EQUAL)
    )


_EQUAL = 0.05  # seconds: corners of a drawing are rounded to a millimetre
