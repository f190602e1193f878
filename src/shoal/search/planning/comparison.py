"""Comparison: the plans of all tours and allocations for one search, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from shoal.core.checks import check_integer, check_kind
from shoal.core.dataclass import dataclass
from shoal.search.planning.patterns import pattern_plans
from shoal.search.planning.plan import (
    Points,
    SearchPlan,
    end_of,
    plan_search,
    plans_along,
    price_of_turns,
    turns_by_robot,
    whole_routes,
    with_prior_odds,
)
from shoal.search.planning.sightings import planned_success
from shoal.search.problem import SearchProblem
from shoal.search.problem.fields import AUTO
from shoal.search.tours import TOURS


@dataclass(frozen=True, eq=False)
class PlanFigures:
    """The figures of one plan in a comparison.

    Parameters
    ----------
    plan : SearchPlan
    seconds : float
        Time of the whole search: until the last vehicle is back or, without a vehicle, until all is
        searched.
    turns : int
        Number of turns on the routes of all robots.
    length : float
        Length of all routes in metres; of vehicles, with the way home.
    evenness : float
        Mean time of the robots divided by the time of the last one: 1 if all are done together.
    price : float
        The time that decides between plans, in seconds (`price_of_turns`).
    share : float
        Share of the cells that are searched: 1 for plans, and less for some patterns.
    pattern : str or None
        Name of the pattern (`shoal.search.planning.patterns`), in place of a tour and an allocation.
    by_prior : bool
        Whether robots search in the order that follows the prior.
    expected_find : float or None
        With a prior, the expected time until the target is found, in seconds.
    success : float or None
        With a prior, the probability that the target is found.
    refusal : str or None
        The reason why a vehicle cannot fly the plan, whose time is then an estimate.
    """

    plan: SearchPlan
    seconds: float
    turns: int
    length: float
    evenness: float
    price: float
    share: float = 1.0
    pattern: str | None = None
    by_prior: bool = False
    expected_find: float | None = None
    success: float | None = None
    refusal: str | None = None

    @property
    def names(self) -> tuple[str, str]:
        """Names of the tour and the allocation, or of the pattern."""
        allocation = self.plan.allocation.allocator
        if self.pattern is not None:
            return self.pattern, "pattern"
        return self.plan.tour.name, f"{allocation}, by the prior" if self.by_prior else allocation

    def report(self) -> dict[str, Any]:
        """Return the figures as a mapping that can be written as JSON."""
        planned = self.pattern is None
        return {
            "tour": self.plan.tour.name if planned else None,
            "allocation": self.plan.allocation.allocator if planned else None,
            "pattern": self.pattern,
            "by_prior": self.by_prior,
            "searched_fraction": self.share,
            "expected_find_s": self.expected_find,
            "success": self.success,
            "angle_degrees": self.plan.row_angle,
            "time_s": self.seconds,
            "turns": self.turns,
            "length_m": self.length,
            "evenness": self.evenness,
            "refusal": self.refusal,
        }


def compare_plans(problem: SearchProblem, *, seed: int = 0) -> list[PlanFigures]:
    """Plan a search along each tour and with each allocation, and in the patterns that crews know,
    and return the figures of all plans, the best first.

    A tour or an allocation that the problem names is the only one, without patterns. The order is
    the one in which `plan_search` chooses (`price_of_turns`): by the time until the last robot is
    done, with the price of turns. With a prior, the plan that follows it is compared, too, and the
    order is by the expected time to find. Patterns that do not search everything come last.

    Raises
    ------
    InvalidInputError
        If the robots cannot search the region as the problem demands.

    Examples
    --------
    >>> figures = compare_plans(SearchProblem("rectangle:80x50", robots=2, tour="strips"), seed=1)
    >>> {each.plan.tour.name for each in figures}, len(figures)
    ({'strips'}, 7)
    """
    seed = check_integer(seed, what="seed", least=0)
    check_kind(problem, SearchProblem, what="problem").check_at_place()
    names = [problem.tour] if problem.tour != AUTO else list(TOURS)
    plans, limit = plans_along(problem, seed, names=names), None
    if problem.launch is None:  # random starts are cells, which differ from grid to grid
        places = tuple((x, y) for x, y in plans[0].places.tolist())
        problem = problem.replaced(starts=places).at_place(problem.place)
    figures = []
    if problem.prior:
        best = plan_search(problem, seed=seed)
        if problem.moves:
            limit = problem.at_most * (best.plain_seconds or 0.0)
        figures.append(_figures(best, problem, limit, by_prior=True))
    best_of: dict[tuple[str, str], PlanFigures] = {}
    for plan in _all_with_prior_odds(plans, problem):
        found = _figures(plan, problem, limit)
        best_of[found.names] = min(best_of.get(found.names, found), found, key=_rank)
    figures += best_of.values()
    if problem.tour == AUTO and problem.allocation == AUTO:
        patterns = pattern_plans(problem, seed)
        figures += [_figures(plan, problem, limit, pattern=name) for name, plan in patterns]
    return sorted(figures, key=_rank)


def _rank(figures: PlanFigures) -> tuple[bool, bool, float]:
    first = figures.price if figures.expected_find is None else figures.expected_find
    return figures.refusal is not None, figures.share < 1, first


def _all_with_prior_odds(plans: Sequence[SearchPlan], problem: SearchProblem) -> list[SearchPlan]:
    """Return plans that know the prior of the problem, in their own orders."""
    if not problem.prior:
        return list(plans)
    informed_of: dict[int, SearchPlan] = {}
    informed = []
    for plan in plans:
        if id(plan.tour) not in informed_of:
            informed_of[id(plan.tour)] = with_prior_odds(plan, problem)
        like = informed_of[id(plan.tour)]
        informed.append(
            replace(
                plan,
                tour_cost=replace(plan.tour_cost, odds=like.tour_cost.odds, at_most=0.0),
                ground=like.ground,
                prior_inside=like.prior_inside,
                prior_before=like.prior_before,
            )
        )
    return informed


def routes_of(plan: SearchPlan) -> list[tuple[int, Points]]:
    """Return the number of each robot that has work, counted from 0, and its route in metres: from
    its start along its stops and, of a vehicle, to where it lands; float64, each of shape (k, 2).
    """
    return [(robot, route[:, :2]) for robot, route in whole_routes(plan)]


def _figures(
    plan: SearchPlan,
    problem: SearchProblem,
    limit: float | None,
    *,
    pattern: str | None = None,
    by_prior: bool = False,
) -> PlanFigures:
    """Return the figures of a plan. ``limit`` counts for a moving target that is not found; a search
    for one that stands still is repeated.
    """
    routes = whole_routes(plan)
    robots = range(len(plan.places))
    searched = [plan.visible_cells(robot, plan.stops(robot)) for robot in robots]
    cells = np.unique(np.concatenate([cells for own in searched for cells in own]))
    success, expected = None, None
    if plan.ground is not None:
        success_of_plan = planned_success(plan, problem, limit)
        success, expected = success_of_plan.probability, success_of_plan.mean
    times = [end_of(sorties) for sorties in plan.sorties] if plan.flies else _own_times(plan)
    last = max(times, default=0.0)
    return PlanFigures(
        plan,
        seconds=plan.planned_seconds,
        turns=int(turns_by_robot(plan).sum()),
        length=float(sum(plan.leg_lengths(route).sum() for _, route in routes)),
        evenness=float(np.mean(times)) / last if last else 1.0,
        price=price_of_turns(plan, problem),
        share=len(cells) / len(plan.tour_cost),
        pattern=pattern,
        by_prior=by_prior,
        expected_find=expected,
        success=success,
        refusal=None if plan.refusal is None else str(plan.refusal),
    )


def _own_times(plan: SearchPlan) -> Sequence[float]:
    return [plan.seconds(float(cells)) for cells in plan.allocation.times]
