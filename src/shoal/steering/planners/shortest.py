"""Planner shortest: chains of contacts, shooting, and shortening of what they give."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.contact.clearance import PLANNED
from shoal.steering.contact.world import ContactWorld
from shoal.steering.kernels import shooting
from shoal.steering.kernels import shortening as kernels
from shoal.steering.kernels.contact import Walls
from shoal.steering.planners.chains import Chain, ChainQuery
from shoal.steering.planners.greedy import Greedy, greedy_chain
from shoal.steering.planners.improvement import improved_chains
from shoal.steering.planners.task import (
    PLANNERS,
    Planner,
    SteeringTask,
    choose,
    path_length,
    plans_of,
    why_unreachable,
    without_useless_moves,
)
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.region import normalize_walls

# relative to the height: minimum distance of the particles from the end caps during the plan
_OFF_CAPS = 1e-4


def plan_from_base(task: SteeringTask, planner: Planner) -> Points | None:
    """Return the plan that a planner makes in the plane, with added vertical components, or None if
    no such plan is found.
    """
    below = planar_task(task)
    if why_unreachable(below) is not None:
        return None
    flat = below.translation()
    flat = planner.plan(below) if flat is None else flat
    return None if flat is None else with_vertical_moves(task, flat)


def planar_task(task: SteeringTask) -> SteeringTask:
    """Return the task in the base of the prism or cylinder: ``task`` without vertical coordinates,
    and with half the tolerance.
    """
    room = task.world.room
    world, start, goal = ContactWorld(room.base), task.start[:, :2], task.goal[:, :2]
    return replace(task, world=world, start=start, goal=goal, tolerance=task.tolerance / 2)


def with_vertical_moves(task: SteeringTask, flat: Points) -> Points | None:
    """Add a vertical component to each move of a plan in the plane, so that both particles reach
    the heights of their goals.

    The plan in the plane determines which fraction of each move a particle makes, because only the
    horizontal component of a move determines whether a side wall holds a particle. The final height
    of each particle is a linear function of the vertical components of the moves. A linear program
    minimizes the sum of the absolute vertical components.

    Parameters
    ----------
    task : SteeringTask
        A task in a prism or a cylinder.
    flat : ndarray of float64, shape (moves, 2)
        A plan for the result of `planar_task`, that is, for the task in the plane.

    Returns
    -------
    ndarray of float64, shape (moves, 3), or None
        The plan with vertical components, or None if no vertical components solve the task, for
        example because a wall holds one particle during all moves except one.

    Notes
    -----
    The method is an addition by Shoal. Section IV.G of paper W corrects the heights with separate
    moves while a wall holds one particle. Shoal combines the corrections of the heights with the
    moves of the plan in the plane.
    """
    room = task.world.room
    states = ContactWorld(room.base).play(task.start[:, :2], flat)
    squares = np.einsum("ij,ij->i", flat, flat)
    shares = (
        np.einsum("ipj,ij->ip", np.diff(states, axis=0), flat)
        / np.where(squares > 0, squares, 1.0)[:, None]
    )
    upwards = _least_vertical_moves(shares, task.start[:, 2], task.aim[:, 2], room.height)
    if upwards is None:
        return None
    moves = np.column_stack([flat, upwards])
    return moves if task.reaches_goal(moves) else None


def _least_vertical_moves(
    shares: NDArray[np.float64],
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    height: float,
) -> NDArray[np.float64] | None:
    """Return the vertical moves of the smallest total length that lead from the heights ``start``
    to ``goal``, or None.

    ``shares`` holds the fraction of each move that each particle makes. Between the moves, all
    particles stay between floor and ceiling.
    """
    from scipy.optimize import linprog

    count = len(shares)
    sums = np.tril(np.ones((count, count)))
    risen = [
        sums * shares[:, particle] for particle in range(2)
    ]  # height gained by each particle after each move
    nothing, eye = np.zeros((count, count)), np.eye(count)
    least, most = _OFF_CAPS * height, (1 - _OFF_CAPS) * height
    rows, limits = (
        [np.hstack([eye, -eye]), np.hstack([-eye, -eye])],
        [np.zeros(count), np.zeros(count)],
    )
    for particle, sum_ in enumerate(risen):
        rows += [np.hstack([sum_, nothing])[:-1], np.hstack([-sum_, nothing])[:-1]]
        limits += [
            np.full(count - 1, most - start[particle]),
            np.full(count - 1, start[particle] - least),
        ]
    found = linprog(
        np.concatenate([np.zeros(count), np.ones(count)]),
        A_ub=np.vstack(rows),
        b_ub=np.concatenate(limits),
        A_eq=np.vstack([np.hstack([sum_[-1], np.zeros(count)]) for sum_ in risen]),
        b_eq=goal - start,
        bounds=(None, None),
    )
    return np.asarray(found.x[:count]) if found.success else None


@PLANNERS.register("shortest")
class Shortest:
    """A planner that returns the shortest of many chains of wall contacts and adjustments.

    Without a time limit, the plan is less than 0.1 % longer than the plan of the planner greedy, or
    shorter. A plan with more moves than another is returned only if it is shorter by at least 0.1
    %.

    In a cycle, one particle touches a wall. Then the other particle moves (adjustment) while the
    wall holds the first particle. For chains of one, two or three cycles, the planner tries all
    sequences of touching particles and walls. From the shortest chains, the planner makes shorter
    chains by inserting and removing cycles.

    Notes
    -----
    Source: section V of paper W. Shoal limits contacts to their feasible range, and extends the
    method to several cycles.
    """

    name = "shortest"

    def plan(self, task: SteeringTask) -> Points | None:
        """Return the moves of a plan for ``task``; see the class `Planner`."""
        plans: list[Points | None] = [Greedy().plan(task)]
        for first, query in task.departures():
            for chain in improved_chains(query, _greedy_seeds(query, task)):
                plans += plans_of(task, first, chain, query)
        if task.world.room.dimensions == 3 and not task.late:
            plans.append(without_useless_moves(task, plan_from_base(task, self)))
        return choose(task, plans)


def _greedy_seeds(query: ChainQuery, task: SteeringTask) -> list[Chain]:
    """Return a list with the chain of the planner `greedy`, or an empty list if `greedy` finds no
    chain.
    """
    chain = greedy_chain(
        query, tolerance=task.tolerance / query.walls.scale / 4, cycles=(task.max_moves - 1) // 2
    )
    return [] if chain is None else [chain]


SHARES = np.array([0.0, 0.02, 0.06, 0.12, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 0.97, 1.0])
DIRECTIONS = {2: 180, 3: 900}
# factor for the number of directions, if the first directions give no plan of three moves in the
# plane
DENSE = 4
NUDGE = 1e-6  # of the size, at least
NARROW = 1e-8  # of the size: distance of the other particle from walls without a clearance
REPAIRS = {
    4: (400, 10),
    5: (400, 10),
    6: (250, 10),
}  # for plans of each number of moves: attempts, and random plans per attempt
PARTS = 20  # order of the attempts if time is limited
ENOUGH = 4  # number of plans of which the shortest is used
_ALL = 1_000_000


def shooting_plan(task: SteeringTask, count: int) -> Points | None:
    """Return a plan of ``count`` moves (2 to 6), float64 of shape (count, d), or None if the
    simulations find no plan.
    """
    walls = normalize_walls(task.world.room)
    d = walls.dimensions
    start, goal = walls.normalized(task.start), walls.normalized(task.aim)
    between = Walls(
        walls.normals,
        walls.offsets,
        walls.circle,
        1.0,
        float(task.world.friction),
        np.eye(d + 1)[0],
    )
    clear = max(PLANNED * task.margin, NARROW)
    if count == 2:
        two = _of_two(start, goal, between, clear)
        return None if two is None else two * walls.scale
    nudges = max(NUDGE, clear) * np.vstack([np.eye(d), -np.eye(d)])
    moves = np.zeros((count, d))
    if count == 3:
        found = shooting.search(
            start, goal, directions(d, DIRECTIONS[d]), SHARES, nudges, _ALL, between, clear, moves
        )
        if not found and d == 2:
            found = shooting.search(
                start,
                goal,
                directions(d, DENSE * DIRECTIONS[d]),
                SHARES,
                nudges,
                1,
                between,
                clear,
                moves,
            )
    else:
        picks = np.random.default_rng(0).integers(0, 2**31, (*REPAIRS[count], count - 2, 2))
        dense = directions(d, DENSE * DIRECTIONS[d])
        found = 0
        for some in [picks] if task.deadline == inf else np.array_split(picks, PARTS):
            if found == 0 and not task.late:
                found = shooting.search_guided(
                    start, goal, dense, SHARES, some, nudges, ENOUGH, between, clear, moves
                )
    if not found:
        return None
    shooting.improve(start, goal, count - 2, 0.05, nudges, between, clear, moves)
    return moves * walls.scale


def _of_two(start: Points, goal: Points, between: Walls, clear: float) -> Points | None:
    """Return the shorter of the two possible plans with two moves (one plan for each touching
    particle), or None.
    """
    found = []
    for toucher in (0, 1):
        two = np.zeros_like(start)
        error = shooting.finish(start, goal, toucher, between, clear, two)
        if error <= shooting.EXACT:
            found.append(two)
    return min(found, key=path_length, default=None)


def directions(d: int, count: int) -> Points:
    """Return ``count`` unit vectors with evenly distributed directions in ``d`` dimensions."""
    if d == 2:
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)
    turns, heights = (
        np.arange(count) * np.pi * (3 - np.sqrt(5)),
        1 - (2 * np.arange(count) + 1) / count,
    )  # a golden spiral
    flat = np.sqrt(1 - heights**2)
    return np.stack([flat * np.cos(turns), flat * np.sin(turns), heights], axis=1)


MOST_STEPS = 32
STAGES = (
    (40, 2_000),
    (5, 25_000),
)  # how many of the shortest plans go on, and the number of changes of each
ODDS = {
    "targets": 0.7,
    "a step less": 0.1,
    "another toucher": 0.06,
    "a hand-over": 0.07,
    "a contact more": 0.05,
    "a bend": 0.02,
}
_ALIKE = 1e-4  # relative to the length: plans that differ by less are one
_EXACT = (
    1e-9  # relative to a move: distance that a particle may fall behind without counting as held
)
_NOTHING = 1e-12  # relative to the size: length of a move that is left out
QUIET = kernels.Noise(np.zeros((0, 2, 2)), np.zeros((0, 0, 2)), 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan as a sequence of steps: translations, contacts and adjustments.

    Parameters
    ----------
    steps : shoal.steering.kernels.shortening.Steps
    count : int
        Number of steps in the plan.
    cost : float
        Without noise, the length of the plan; with noise, the mean number of moves in simulations.
        Without noise, the cost of a plan that misses the goals is infinite.
    """

    steps: kernels.Steps
    count: int
    cost: float = np.inf


class Shortening:
    """Random changes that shorten plans for one task."""

    def __init__(self, task: SteeringTask, world: Any, rng: np.random.Generator) -> None:
        self.task, self.world, self.rng = task, world, rng
        self._most, self._room = min(task.max_moves, MOST_STEPS), new_steps()
        odds = np.cumsum(np.fromiter(ODDS.values(), dtype=np.float64))
        self._odds = odds / odds[-1]
        self._ends = task.start, np.ascontiguousarray(task.goal), task.tolerance, self._most

    def shortest(self, found: list[Points]) -> list[Points]:
        """Return the plans ``found`` and the shortest plans that random changes make from them.

        In a first stage, the method changes up to 40 plans at random. In a second stage, the method
        changes only the 5 shortest plans.

        Parameters
        ----------
        found : list of ndarray of float64, shape (moves, 2)
        """
        plans = self._distinct(
            [self.changed(steps_of(self.task, moves), changes=0) for moves in found]
        )
        for number, changes in STAGES:
            plans = self._distinct(
                [
                    plan if self.task.late else self.changed(plan, changes=changes)
                    for plan in plans[:number]
                ]
            )
        nothing = _NOTHING * float(self.task.world.room.size)
        made = [plan.steps.moves[: plan.count] for plan in plans]
        return [*(moves[np.hypot(*moves.T) > nothing] for moves in made), *found]

    def changed(self, plan: Plan, *, changes: int, noise: Any = QUIET) -> Plan:
        """Return the best plan that random changes make from ``plan``.

        Without noise, the best plan is the shortest plan. With noise, the best plan has the
        smallest mean number of moves.
        """
        if plan.count > MOST_STEPS:
            return plan
        best = new_steps()
        few, cost = kernels.anneal(
            copy_of(plan).steps,
            plan.count,
            *self._ends,
            changes,
            self._odds,
            noise,
            self.world,
            self.rng,
            self._room,
            best,
        )
        return Plan(best, int(few), float(cost))

    @staticmethod
    def _distinct(plans: list[Plan]) -> list[Plan]:
        """Return the plans that reach the goals, the shortest first, with only one plan of each
        length.
        """
        found: list[Plan] = []
        for plan in sorted(
            (plan for plan in plans if plan.cost < np.inf), key=lambda plan: plan.cost
        ):
            if not found or plan.cost > (1 + _ALIKE) * found[-1].cost:
                found.append(plan)
        return found


def copy_of(plan: Plan, first: int = 0) -> Plan:
    """Return a copy of a plan without the steps before the index ``first``."""
    steps, count = new_steps(), plan.count - first
    for new, old in zip(steps, plan.steps, strict=True):
        new[:count] = old[first : plan.count]
    return Plan(steps, count)


def new_steps() -> kernels.Steps:
    """Return empty arrays for the steps of a plan."""
    kinds, particles = np.zeros((2, MOST_STEPS), dtype=np.int64)
    return kernels.Steps(kinds, particles, *np.zeros((3, MOST_STEPS, 2)))


def steps_of(task: SteeringTask, moves: Points) -> Plan:
    """Return the plan with given moves as a sequence of steps (translations, contacts and
    adjustments).

    If the plan has more than ``MOST_STEPS`` steps, the arrays of the result hold only the first
    ``MOST_STEPS`` steps. The attribute ``count`` is nevertheless the number of all steps.
    """
    parts, state = [], task.start
    for move in moves[np.hypot(*moves.T) > 0]:
        after = task.world.step(state, move)
        shares = np.linalg.norm(after - state, axis=1) / float(np.linalg.norm(move))
        held = int(np.argmin(shares))
        first, last = float(shares[held]), float(shares[1 - held])
        if first > 1 - _EXACT:
            parts.append((kernels.TRANSLATION, 0, after.mean(axis=0), np.zeros(2)))
        else:
            if first > _EXACT:
                parts.append(
                    (
                        kernels.CONTACT,
                        held,
                        after[held],
                        _direction_at(task.world.room, after[held]),
                    )
                )
            if last - first > _EXACT:
                parts.append((kernels.ADJUSTMENT, held, after[1] - after[0], np.zeros(2)))
        state = after
    if not parts or parts[-1][0] != kernels.TRANSLATION:
        parts.append((kernels.TRANSLATION, 0, task.goal.mean(axis=0), np.zeros(2)))
    steps = new_steps()
    for k, part in enumerate(parts[:MOST_STEPS]):
        steps.kinds[k], steps.particles[k], steps.targets[k], steps.along[k] = part
    return Plan(steps, len(parts))


def _direction_at(room: Any, point: Points) -> Points:
    """Return the direction of the wall nearest to ``point``, as a unit vector with the inside of
    the workspace on its right.
    """
    if room.round:
        outward = point - room.center
        return np.array([outward[1], -outward[0]]) / max(float(np.hypot(*outward)), 1e-300)
    ends = room.edges
    along = ends[:, 2:] - ends[:, :2]
    lengths = np.hypot(*along.T)
    along = along / lengths[:, None]
    places = np.clip(np.sum((point - ends[:, :2]) * along, axis=1), 0, lengths)
    away = np.linalg.norm(ends[:, :2] + places[:, None] * along - point, axis=1)
    return np.asarray(-along[int(np.argmin(away))])
