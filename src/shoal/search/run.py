"""Run a search problem: plan the search, simulate the robots or run them live, and return the
episode.
"""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.core.version import versions
from shoal.search.allocation.allocate import ALLOCATORS
from shoal.search.cells.grid import CellGrid, cells_of
from shoal.search.episode import SearchEpisode
from shoal.search.planning.plan import SearchPlan, plan_search, start_points
from shoal.search.problem import SearchProblem
from shoal.search.problem.fields import AUTO, read_key
from shoal.search.problem.network import network_of
from shoal.search.regions.places import places_of, points_inside
from shoal.search.regions.region import SearchRegion
from shoal.search.simulation.scenario import Scenario, scenario_of
from shoal.search.simulation.trace import planned_trace, simulated_trace
from shoal.search.tours import TOURS

SIMULATED = 1_000_000
"""Size of the largest search that Shoal simulates by default.

The size of a search is the larger of two numbers: the number of cells times the number of robots,
and half the cube of the number of robots.
"""


def run(problem: SearchProblem, *, seed: int = 0, plan: SearchPlan | None = None) -> SearchEpisode:
    """Search a region with robots that have no coordinator.

    Parameters
    ----------
    problem : SearchProblem
    seed : int
        Seed of the random starts, targets, obstacles and crashes, and of the simulation.
    plan : SearchPlan, optional
        A plan that was made for exactly ``problem`` and ``seed``. By default, the function plans
        the search first.

    Raises
    ------
    InvalidInputError
        If the robots cannot do the task in the region, or if a search without simulation has
        settings that need a simulation, such as faults, message loss or obstacles.
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
    simulated = _is_simulated(problem, plan)
    if problem.live is not None:
        # most searches start no processes
        from shoal.search.simulation.live.supervisor import live_trace

        scenario, trace = live_trace(
            scenario, live=problem.live, key=key, makespan=plan.allocation.makespan
        )
    elif simulated:
        trace = simulated_trace(plan, scenario)
    else:
        _refuse_unsimulated(problem, plan, scenario)
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


def check(problem: SearchProblem) -> None:
    """Refuse a problem that cannot run, without simulating it: unknown names, unreadable files, too
    many cells or targets.

    The function plans the search only if nothing less can tell whether it can run: if third-party
    code makes the tour or the allocation, or if the problem has so many targets or obstacles, or so
    large a search, that the number of cells decides.
    """
    problem.check_at_place()
    region, robots = problem.place, problem.robots
    if problem.key is not None:
        read_key(problem.key)
    elif network_of(problem.network, loss=problem.loss).has("forgeries"):
        raise InvalidInputError("network: expected a key together with forged messages, got none")
    third_party = [
        registry.get(name)
        for registry, name in ((TOURS, problem.tour), (ALLOCATORS, problem.allocation))
        if name not in (*registry, AUTO)
    ]
    side = float(np.min(problem.chosen_footprint))
    grid = _cells_of(region, side, problem.chosen_angle or 0.0)
    start_points(problem, grid, np.random.default_rng(0))
    if problem.land is not None:
        places_of(problem.land, region, robots, what="land")
    for name in ("targets", "obstacles"):
        value = getattr(problem, name)
        if not isinstance(value, int):
            points_inside(value, region, what=name)
    fewest = max(1, int(region.area_m2 / side**2))
    many = any(
        isinstance(number, int) and number > fewest - robots
        for number in (problem.targets, problem.obstacles)
        if number
    )
    unsure = problem.simulate is False or (
        problem.simulate is None and 2 * robots * max(grid.n_cells, robots**2 // 2) > SIMULATED
    )
    if third_party or many or (unsure and problem.live is None):
        plan = plan_search(problem, seed=0)
        scenario = scenario_of(problem, plan, 0)
        if not _is_simulated(problem, plan):
            _refuse_unsimulated(problem, plan, scenario)


@lru_cache(maxsize=4)
def _cells_of(region: SearchRegion, side: float, angle: float) -> CellGrid:
    """Return the cells of a region. The points of a sweep often share one region, which compares by
    identity.
    """
    return cells_of(region, side, angle=angle)


def _is_simulated(problem: SearchProblem, plan: SearchPlan) -> bool:
    """Return whether a search is simulated, as the user asks, or because it is small."""
    cells, robots = len(plan.tour_cost), problem.robots
    small = robots * max(cells, robots**2 // 2) <= SIMULATED
    return problem.live is None and (small if problem.simulate is None else problem.simulate)


def _refuse_unsimulated(problem: SearchProblem, plan: SearchPlan, scenario: Scenario) -> None:
    """Refuse settings that have an effect only in a simulation, for a search without one."""
    needs = _simulated_only(scenario)
    if not needs or problem.live is not None:
        return
    expectation = (
        f"search: {' and '.join(needs)}: expected a simulation, because a plan alone contains no"
        " such event"
    )
    if problem.simulate is False:
        raise InvalidInputError(f"{expectation}, got simulate = false (--no-simulate)")
    raise InvalidInputError(
        f"{expectation}, got {len(plan.tour_cost)} cells and {problem.robots} robots, which are"
        " simulated only on request; request the simulation with simulate = true (--simulate)"
    )


def _simulated_only(scenario: Scenario) -> list[str]:
    """Return the names of the scenario's settings that have an effect only in a simulation."""
    brief = scenario.brief
    settings = {
        "faults": bool(scenario.faults),
        "loss or a network": bool(scenario.network.media),
        "a key": scenario.signed,
        "packet": scenario.packet > 0,
        "multiplicity": brief.multiplicity > 1,
        "obstacles": brief.tour_cost.stepwise,
        "targets": bool(scenario.targets),
        "false alarms": scenario.false_alarm > 0,
    }
    return [name for name, is_set in settings.items() if is_set]
