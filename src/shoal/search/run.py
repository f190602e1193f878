"""Run a search problem: plan the search, simulate the robots or run them live, and return the episode."""

from __future__ import annotations

import time

from shoal.core.errors import InvalidInputError
from shoal.core.version import versions
from shoal.search.allocation.plan import SearchPlan, plan_search
from shoal.search.episode import SearchEpisode
from shoal.search.problem import SearchProblem
from shoal.search.problem.keys import read_key
from shoal.search.simulation.live.trace import live_trace
from shoal.search.simulation.scenario import Scenario, scenario_of
from shoal.search.simulation.trace import planned_trace, simulated_trace

SIMULATED = 1_000_000
"""Size of the largest search that Shoal simulates by default.

The size of a search is the larger of two numbers: the number of cells times the number of robots, and half the cube of the number
of robots.
"""


def run(problem: SearchProblem, *, seed: int = 0, plan: SearchPlan | None = None) -> SearchEpisode:
    """Search a region with robots that have no coordinator.

    Parameters
    ----------
    problem : SearchProblem
    seed : int
        Seed of the random starts, targets, obstacles and crashes, and of the simulation.
    plan : SearchPlan, optional
        A plan that was made for exactly ``problem`` and ``seed``. By default, the function plans the search first.

    Raises
    ------
    InvalidInputError
        If the robots cannot do the task in the region, or if a search without simulation has settings that need a simulation, such
        as faults, message loss or obstacles.
    UnknownNameError

    Examples
    --------
    >>> episode = run(SearchProblem("square:100", robots=4, loss=0.3), seed=1)
    >>> episode.status, episode.coverage.covered_fraction
    (<Status.COMPLETE: 'complete'>, 1.0)
    """
    began = time.perf_counter()
    key = b"" if problem.key is None else read_key(problem.key)
    plan = plan_search(problem, seed=seed) if plan is None else plan
    scenario = scenario_of(problem, plan, seed)
    cells, robots = len(plan.tour_cost), problem.robots
    simulated = problem.live is None and (
        robots * max(cells, robots**2 // 2) <= SIMULATED if problem.simulate is None else problem.simulate
    )
    if problem.live is not None:
        scenario, trace = live_trace(scenario, live=problem.live, key=key)
    elif simulated:
        trace = simulated_trace(plan, scenario)
    elif needs := _simulated_only(scenario):
        what = f"search: {' and '.join(needs)}: expected a simulation, because a plan alone contains no such event"
        if problem.simulate is False:
            raise InvalidInputError(f"{what}, got simulate = false (--no-simulate)")
        raise InvalidInputError(
            f"{what}, got {cells} cells and {robots} robots, which are simulated only on request; request "
            "the simulation with simulate = true (--simulate)"
        )
    else:
        trace = planned_trace(plan, scenario.brief)
    return SearchEpisode(
        problem=problem,
        plan=plan,
        scenario=scenario,
        trace=trace,
        simulated=simulated,
        seed=seed,
        seconds=time.perf_counter() - began,
        versions=versions(),
    )


def _simulated_only(scenario: Scenario) -> list[str]:
    """Return the names of the scenario's settings that have an effect only in a simulation."""
    brief = scenario.brief
    there = {
        "faults": bool(scenario.faults),
        "loss or a network": bool(scenario.network.media),
        "a key": scenario.signed,
        "packet": scenario.packet > 0,
        "multiplicity": brief.multiplicity > 1,
        "obstacles": brief.tour_cost.stepwise,
    }
    return [name for name, is_there in there.items() if is_there]
