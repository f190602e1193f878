"""Run a steering problem: make a plan, simulate the plan, and return the episode."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status
from shoal.core.version import versions
from shoal.jit import Stopwatch, working_time
from shoal.steering.contact.clearance import why_sensitive
from shoal.steering.contact.world import ContactWorld
from shoal.steering.episode import SteeringEpisode
from shoal.steering.planners.clearance import plan_with_clearance
from shoal.steering.planners.pressing import holding_share, with_least_friction
from shoal.steering.planners.task import (
    SteeringTask,
    path_length,
    why_approachable,
    why_unreachable,
    worthwhile,
)
from shoal.steering.problem import SteeringProblem, check_can_part
from shoal.steering.simulation import Apparatus, replay
from shoal.steering.workspaces.convex import Points


def check(problem: SteeringProblem) -> None:
    """Refuse a problem that cannot run, without planning it."""
    problem.check_at_place()
    problem.endpoints(0)


def run(problem: SteeringProblem, *, seed: int = 0) -> SteeringEpisode:
    """Plan and simulate a steering problem: bring particles to their goals with one shared input.

    Parameters
    ----------
    problem : SteeringProblem
        The problem to solve. A planner knows the friction of the problem. Only closed-loop
        planners, such as ``robust``, know the noise and correct the plan during the run.
    seed : int
        Seed of all random numbers: for random starts and goals, for noise, and for the random
        decisions of planners.

    Returns
    -------
    SteeringEpisode
        The record of the run. ``bool(episode)`` is true only if the run has solved the problem.

    Examples
    --------
    >>> from shoal.steering import SteeringProblem
    >>> episode = run(SteeringProblem("square", [(0.2, 0.5), (0.4, 0.5)], [(0.3, 0.5), (0.4, 0.5)]))
    >>> str(episode.status), episode.planner, episode.moves, round(episode.length, 3)
    ('solved', 'shortest', 2, 0.6)
    """
    seed = check_integer(seed, what="seed", least=0)
    problem.check_at_place()
    planner = problem.chosen_planner
    if problem.bounds is not None and "tolerance" not in problem.given:
        problem = problem.replaced(tolerance=WITHIN * problem.place.size)
    start, goal = problem.endpoints(seed)
    check_can_part(start, goal, problem.tolerance)
    begun, watch = working_time(), Stopwatch()
    orders = (
        list(permutations(range(len(start))))
        if problem.interchangeable
        else [tuple(range(len(start)))]
    )
    attempts = []
    for remaining in range(len(orders), 0, -1):
        order = orders[-remaining]
        task = SteeringTask(
            problem.world(gain=0.0),
            start,
            goal[list(order)],
            problem.tolerance,
            problem.max_moves,
            seed,
            clearance=problem.clearance,
            margin=problem.clearance,
            bounds=problem.bounds,
        )
        if problem.time is not None:  # the remaining planning time is shared
            now = working_time()
            task = replace(task, deadline=now + (begun + problem.time - now) / remaining)
        attempts.append(_attempt(problem, planner, task, order))
    bounds = [attempt.lower_bound for attempt in attempts if attempt.lower_bound is not None]
    best = _best_of(
        attempts, problem.tolerance, by_moves=getattr(planner, "prefers", "length") == "moves"
    )
    return SteeringEpisode(
        problem=problem,
        planner=planner.name,
        status=best.status,
        reason=best.reason,
        inputs=best.inputs,
        states=best.states,
        order=np.array(best.order),
        seed=seed,
        # a plan may have any of the assignments
        lower_bound=min(bounds) if len(bounds) == len(orders) else None,
        seconds=watch.seconds,
        versions=versions(),
    )


WITHIN = 0.05
"""Tolerance of plans with stated errors, as a share of the size, if the user states none."""
HOLDS = 0.9
"""Share of the simulations with errors that must end at the goals, so that a plan counts as solved.
"""
ADVISED = 10
"""Tolerance that the message of a failed plan advises, as a multiple of the noise."""


@dataclass(frozen=True)
class _Attempt:
    """The result of planning and simulation for one assignment of goals to particles."""

    order: tuple[int, ...]
    status: Status
    reason: str
    inputs: Points
    states: Points
    error: float
    lower_bound: float | None


def _best_of(attempts: list[_Attempt], tolerance: float, *, by_moves: bool) -> _Attempt:
    """Return the best attempt.

    Solved attempts come first, then attempts that reach the goals; of these, `worthwhile` chooses
    the best by number of moves and length. If no attempt reaches the goals, the best attempt ends
    nearest to them.
    """
    arrived = [attempt for attempt in attempts if attempt.error <= tolerance]
    if not arrived:
        return min(attempts, key=lambda attempt: attempt.error)
    arrived = [attempt for attempt in arrived if attempt.status == Status.SOLVED] or arrived
    sizes = [(len(attempt.inputs), path_length(attempt.inputs)) for attempt in arrived]
    return arrived[worthwhile(sizes, by_moves=by_moves)]


def _attempt(
    problem: SteeringProblem, planner: Any, task: SteeringTask, order: tuple[int, ...]
) -> _Attempt:
    """Plan and simulate the problem with one assignment of goals to particles, and return the
    result.
    """
    start, goal = task.start, task.goal
    simple = isinstance(task.world, ContactWorld) and len(start) == 2
    outside = ~problem.place.contains(goal)
    inputs: Points | None = np.zeros((0, problem.place.dimensions))
    states, remark = None, ""
    why_never = (
        f"the goal {tuple(goal[outside][0].tolist())} is outside the workspace"
        if outside.any()
        else None
    )
    if why_never is None and simple:
        why_never = why_unreachable(with_least_friction(task))
    if why_never is None and hasattr(planner, "control"):
        apparatus = Apparatus(problem, start, seed=task.seed)
        inputs, states = planner.control(task, apparatus)
        remark = apparatus.remark
    elif why_never is None and task.bounds is not None:
        inputs = planner.plan(task)
    elif why_never is None and task.error(start) > task.tolerance:
        inputs = plan_with_clearance(task, planner)
    count = 0 if inputs is None else len(inputs)
    if inputs is None or (count > task.max_moves and states is None):
        inputs = np.zeros((0, problem.place.dimensions))
    if states is None:
        states = replay(problem, inputs, seed=task.seed)
    error = task.error(states[-1])
    if task.bounds is not None and why_never is None and len(inputs):
        share = holding_share(task, inputs, within=task.tolerance)
        remark = (
            f"with the stated errors, {100 * share:.1f} % of simulations end within"
            f" {task.tolerance:.3g} of all goals"
        )
        if share < HOLDS:
            return _Attempt(
                order,
                Status.LIMIT,
                f"the best plan holds too rarely: {remark}",
                inputs,
                states,
                error,
                None,
            )
    if error <= problem.tolerance and why_never is None:
        status, why_not_sure = Status.SOLVED, None
        reason = (
            f"{len(inputs)} moves of length {path_length(inputs):.4g} end within {error:.2g} of all"
            " goals"
        )
        if simple and why_approachable(task) is not None:
            reason += ", which themselves can only be approached"
        if not problem.noisy and task.bounds is None:
            why_not_sure = why_sensitive(
                task.world, start, goal, inputs, problem.tolerance, problem.clearance
            )
        if why_not_sure is not None:
            near = simple and why_approachable(task) is not None
            status = Status.APPROACHABLE if near else Status.SENSITIVE
            reason += (
                f", but only in exact arithmetic: {why_not_sure} (the clearance is"
                f" {problem.clearance:g})"
            )
    elif why_never is not None:
        status, reason = Status.UNREACHABLE, why_never
    elif simple and (why_near := why_approachable(task)) is not None:
        status, reason = Status.APPROACHABLE, f"{why_near}; this plan comes within {error:.3g}"
    else:
        status, reason = Status.LIMIT, _why_not(problem, count, inputs, error)
    reason += f"; {remark}" if remark else ""
    bounded = simple and not outside.any() and not problem.gain and not problem.execution
    bounded = bounded and task.bounds is None
    return _Attempt(
        order, status, reason, inputs, states, error, task.lower_bound() if bounded else None
    )


def _why_not(problem: SteeringProblem, count: int, inputs: Points, error: float) -> str:
    """Return the reason why the moves of the planner do not solve the problem."""
    if count > problem.max_moves:
        return f"the plan that was found takes {count} moves, more than {problem.max_moves}"
    if not len(inputs):
        return "no plan was found"
    too_far = f"farther than the tolerance of {problem.tolerance:g}"
    if problem.noisy:
        missed = (
            f"after {len(inputs)} moves the particles are {error:.3g} from their goals, {too_far}"
        )
        advised = ADVISED * max(problem.execution, problem.measurement)
        return (
            f"{missed}; a tolerance of {advised:g}, ten times the noise, is easier to reach"
            if problem.tolerance < advised
            else missed
        )
    return f"the best plan of at most {problem.max_moves} moves comes within {error:.3g}, {too_far}"
