"""Search for plans whose contacts hold for all friction above a bound; the planner conformant."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, hypot, inf
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.steering.contact.world import RegionWorld
from shoal.steering.kernels import pressing as kernels
from shoal.steering.kernels.pressing import Pressing
from shoal.steering.planners.bounds import CERTAIN, OWN, Bounds
from shoal.steering.planners.greedy import Greedy
from shoal.steering.planners.sampling import world_of
from shoal.steering.planners.task import SteeringTask, why_unreachable
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.region import Region

NODES = 6_000  # maximum number of nodes of one tree
CELLS = 64  # of a table of differences, along each axis
NEAR = 0.02  # relative to the size: error of a difference that the table allows
STEEPEST = 5.0  # friction, more of which counts as this in the table
SAMPLES, TRIED = 3_000, 24  # random manoeuvres, and how many of them are tried with errors
STAY = 1.0  # moves that another manoeuvre must save, so that one that has begun is given up
SPACING = 1 / 10  # relative to the size: distance of the places at which walls hold a particle
ROUND_PLACES = 48  # number of them on a round wall


class PressingSearch:
    """A random tree search for plans that press particles into walls, so that the walls hold them.

    Parameters
    ----------
    world : ContactWorld or RegionWorld
    pressing : Pressing
    rng : Generator
    tables : dict, optional
        Tables of differences that searches in the same workspace share.
    """

    def __init__(
        self,
        world: Any,
        pressing: Pressing,
        rng: Generator,
        tables: dict[tuple[float, ...], kernels.Values] | None = None,
    ) -> None:
        walls = world_of(world)
        self.world = walls._replace(
            edges=walls.edges._replace(friction=float(pressing.friction)),
            walls=walls.walls._replace(friction=float(pressing.friction)),
            flat=not world.free_space.round,
        )
        self.pressing, self.rng = pressing, rng
        self._space, self._tables = world.free_space, {} if tables is None else tables
        ints = [np.zeros(NODES, dtype=np.int64) for _ in range(4)]
        self._nodes = kernels.Nodes(
            np.zeros((NODES, 2, 2)),
            ints[0],
            np.zeros((NODES, kernels.STEPS, 2)),
            ints[1],
            ints[2],
            np.zeros(NODES),
            ints[3],
        )

    def plans(
        self,
        start: Points,
        goal: Points,
        *,
        tolerance: float,
        moves: int,
        rounds: int,
        most: int,
        shorter: bool = False,
    ) -> list[Points]:
        """Return at most ``most`` plans (float64, shape (moves, 2)) that end within the tolerance
        if there are no errors. With ``shorter``, no plan has more moves than the plan before it.
        """
        nodes, total, ending = self._nodes, 1, np.zeros((kernels.STEPS, 2))
        nodes.states[0], nodes.tries[0] = start, 0
        goal = np.ascontiguousarray(goal, dtype=np.float64)
        direct = self.translation(start, goal, tolerance)
        plans = [] if direct is None or len(direct) > moves else [direct]
        if plans and shorter:
            return plans
        values = self.values(goal)
        x, y = kernels.missing_change(nodes.states[0], goal, self.pressing)
        nodes.keys[0] = hypot(x, y) / self.world.walls.size
        nodes.keys[0] += kernels.LEFT * kernels.moves_left_of(nodes.states[0], values)
        while rounds > 0 and len(plans) < most and total < NODES:
            total, rounds, count = kernels.grow(
                nodes,
                total,
                rounds,
                goal,
                tolerance,
                moves,
                self.pressing,
                self.world,
                values,
                self.rng,
                ending,
            )
            if count >= 0:
                plans.append(np.concatenate([self._path(total - 1), ending[:count]]))
                moves = min(moves, len(plans[-1])) if shorter else moves
        return plans

    def translation(self, start: Points, goal: Points, tolerance: float) -> Points | None:
        """Return the moves that lead to the goals without a press, or None if they end farther."""
        x, y = kernels.missing_change(start, goal, self.pressing)
        if hypot(x, y) > kernels.WIDE * tolerance:
            return None
        state = np.array(start, dtype=np.float64, order="C")
        moves = np.zeros((kernels.STEPS, 2))
        count = kernels.finish(state, goal, tolerance, self.pressing, self.world, moves, 0)
        return moves[:count] if count >= 0 else None

    def values(self, goal: Points) -> kernels.Values:
        """Return how many moves lead from each difference of the particles to that of the goals."""
        size, friction = float(self.world.walls.size), round(float(self.pressing.friction), 2)
        difference = goal[1] - goal[0]
        key = (*difference.tolist(), friction)
        if key not in self._tables:
            self._tables[key] = kernels.Values(np.zeros((CELLS, CELLS)), 2.2 * size / CELLS)
            kernels.find_values(
                difference,
                NEAR * size,
                min(friction, STEEPEST),
                *holding_places(self._space),
                self.world,
                self._tables[key],
            )
        return self._tables[key]

    def moves_left(self, state: Points, goal: Points) -> float:
        """Return about how many moves are left until the particles differ as their goals do;
        `kernels.MOST_LEFT` if no presses lead there.
        """
        return float(kernels.moves_left_of(state, self.values(goal)))

    def best_manoeuvre(
        self,
        start: Points,
        goal: Points,
        tolerance: float,
        scenarios: tuple[Any, Any, Any],
        begun: Points | None = None,
    ) -> tuple[Points, float]:
        """Return the moves of the manoeuvre after which the fewest moves are left in the mean over
        scenarios of errors, and the number of all moves; infinite if there is none. What is left of
        the manoeuvre that has ``begun`` is preferred, unless another saves a move.
        """
        manoeuvres = np.zeros((TRIED, kernels.STEPS, 2))
        counts, values = np.zeros(TRIED, dtype=np.int64), self.values(goal)
        goal = np.ascontiguousarray(goal, dtype=np.float64)
        kernels.try_manoeuvres(
            start,
            goal,
            SAMPLES,
            tolerance,
            self.pressing,
            self.world,
            values,
            self.rng,
            manoeuvres,
            counts,
        )
        best, least = manoeuvres[0, :0], inf
        candidates = [
            moves[:count] for moves, count in zip(manoeuvres, counts, strict=True) if count
        ]
        for moves in [*candidates, begun]:
            if moves is None or not len(moves):
                continue
            ends = self.ends(start, moves, scenarios)
            cost = float(kernels.AHEAD * len(moves) + kernels.mean_moves_left(ends, values))
            if cost < least or (moves is begun and cost < least + STAY):
                best, least = moves, cost
        return best, least

    def _path(self, node: int) -> Points:
        """Return the moves from the start to a node of the tree."""
        nodes, parts = self._nodes, [np.zeros((0, 2))]
        while node:
            parts.append(nodes.moves[node, : nodes.counts[node]].copy())
            node = int(nodes.parents[node])
        return np.concatenate(parts[::-1])

    def ends(
        self, start: Points, moves: Points, scenarios: tuple[Any, Any, Any]
    ) -> NDArray[np.float64]:
        """Return where the particles end in all scenarios; float64, shape (scenarios, 2, 2)."""
        ends = np.zeros((len(scenarios[2]), 2, 2))
        starts = np.ascontiguousarray(start[None] if start.ndim == 2 else start)
        kernels.play_scenarios(starts, np.ascontiguousarray(moves), *scenarios, self.world, ends)
        return ends


SCALE = 0.05  # relative to the size: error that counts as 1 in the cost of a plan
MOST = 9.0  # largest cost of one scenario
CONFIGURATIONS = ((2.0, 2.0), (1.0, 1.5), (0.4, 1.0))  # of pressing angles and of contacts
ROUNDS, WANTED = 30_000, 40  # manoeuvres and plans of one tree
AIMS = (0.1, 0.4, 0.8)  # shares of the tolerance within which plans end without errors
TREES = 4  # of each aim and configuration, until one has found a plan
SCENARIOS, JUDGED = 48, 400  # in which plans are improved, and in which they are judged
REFINED, CHANGES = 4, 800  # of the best plans, so many changes each
LONG = 20  # moves: longer plans are changed less often, which takes as long
MARGINS = (4e-3, 1e-3)  # distances from walls of chains, relative to the size
FINE = 0.2  # cost of a plan that needs no further improvement


class Conformant:
    """A planner for plans without observations that hold for all friction above a bound, and in
    spite of errors of angles and lengths.

    A tree of simulated manoeuvres gives plans that push particles into walls inside the friction
    cone, with room for the errors, and behind the walls. The planner simulates the plans in many
    scenarios of errors, and changes the best of them at random, as long as the mean squared error
    at the end becomes smaller.
    """

    name = "conformant"
    obstacles = True

    def plan(self, task: SteeringTask) -> Points | None:
        """Return the moves of a plan for ``task``, which is the best that the planner found even if
        it often misses the goals; or None.
        """
        if task.world.free_space.dimensions != 2:
            raise InvalidInputError(
                "planner conformant: expected a plane workspace, got a"
                f" {task.world.free_space.kind}"
            )
        bounds = task.bounds or Bounds(task.world.friction)
        size, rng = float(task.world.free_space.size), np.random.default_rng(task.seed)
        best, least, tables = None, inf, dict[tuple[float, ...], kernels.Values]()
        scale = max(min(task.tolerance, SCALE * size), 1e-3 * size)
        for aim in AIMS:
            near = aim * scale
            for certain, sure in CONFIGURATIONS:
                pressing = pressing_of(bounds, size, certain=certain, sure=sure)
                if _is_proved(task, pressing.friction, near):
                    continue
                search = PressingSearch(task.world, pressing, rng, tables)
                plans = self._chains(task, pressing.friction, near)
                for _ in range(TREES):  # a tree that begins with the wrong walls is full in vain
                    plans += search.plans(
                        task.start,
                        task.goal,
                        tolerance=near,
                        moves=task.max_moves,
                        rounds=ROUNDS,
                        most=WANTED,
                    )
                    if plans or task.late:
                        break
                costs = [self._cost(task, search, bounds, plan, scale) for plan in plans]
                for k in np.argsort(costs)[:REFINED]:
                    cost = costs[k]
                    if least > FINE and not task.late:
                        self._improve(task, search, bounds, plans[k], scale)
                        cost = self._cost(task, search, bounds, plans[k], scale)
                    if cost < least:
                        best, least = plans[k], cost
                if least < FINE or task.late:
                    return best
        return best

    def _chains(self, task: SteeringTask, friction: float, near: float) -> list[Points]:
        """Return the plans of the planner greedy with a narrower friction cone, in a convex
        workspace.
        """
        if isinstance(task.world.free_space, Region):
            return []
        plans = []
        for margin in MARGINS:
            own = replace(
                task,
                world=replace(task.world, friction=friction),
                tolerance=near,
                margin=margin,
            )
            plan = None if why_unreachable(own) else Greedy().plan(own)
            if plan is not None and 0 < len(plan) <= task.max_moves:
                plans.append(plan)
        return plans

    def _cost(
        self, task: SteeringTask, search: PressingSearch, bounds: Bounds, plan: Points, scale: float
    ) -> float:
        scenarios = bounds.scenarios(JUDGED, len(plan), np.random.default_rng(0))
        ends = search.ends(task.start, plan, scenarios)
        return float(kernels.mean_cost(ends, np.ascontiguousarray(task.goal), scale, MOST))

    def _improve(
        self, task: SteeringTask, search: PressingSearch, bounds: Bounds, plan: Points, scale: float
    ) -> None:
        """Change the moves of a plan in place so that its mean squared error becomes smaller."""
        goal, size = np.ascontiguousarray(task.goal), float(task.world.free_space.size)
        scenarios = bounds.scenarios(SCENARIOS, len(plan), search.rng)
        kernels.refine(
            np.ascontiguousarray(task.start[None]),
            goal,
            plan,
            max(1, CHANGES * LONG // max(LONG, len(plan))),
            0.02 * size,
            1e-3 * size,
            scale,
            MOST,
            scenarios,
            search.world,
            np.zeros((SCENARIOS, 2, 2)),
            search.rng,
        )


def holding_places(space: Any, spacing: float = SPACING) -> tuple[Points, Points]:
    """Return places on the walls, ``spacing`` sizes apart where they are straight, and the inward
    normals there; float64, shape (places, 2).
    """
    if space.round:
        angles = 2 * np.pi * np.arange(ROUND_PLACES) / ROUND_PLACES
        normals = -np.column_stack([np.cos(angles), np.sin(angles)])
        return np.asarray(space.center) - space.radius * normals, normals
    region = space if isinstance(space, Region) else Region(space.vertices, ())
    edges = RegionWorld(region).edges
    at: list[Points] = []
    inward: list[Points] = []
    for (a, b, c, d), normal in zip(edges.ends, edges.normals, strict=True):
        count = max(1, ceil(hypot(c - a, d - b) / (spacing * space.size)))
        share = (np.arange(count)[:, None] + 0.5) / count
        at.append((1 - share) * [a, b] + share * [c, d])
        inward.append(np.tile(normal, (count, 1)))
    return np.concatenate(at), np.concatenate(inward)


def pressing_of(
    bounds: Bounds,
    size: float,
    *,
    certain: float = CERTAIN,
    sure: float = CERTAIN,
    gains: NDArray[np.float64] = OWN,
    apart: float = 0.0,
) -> Pressing:
    """Return how surely plans press particles into walls, for given errors.

    ``certain`` and ``sure`` are the numbers of standard deviations that pressing angles and contacts
    allow for.
    """
    spread = max(bounds.spread, 1e-3)
    return Pressing(
        np.ascontiguousarray(gains, dtype=np.float64),
        bounds.cone(certain),
        0.25 * sure * spread * size,
        sure * spread,
        max(0.5 * sure * spread, 0.004) * size,
        0.003 * size,
        apart,
    )


def holding_share(
    task: SteeringTask, moves: Points, *, within: float, scenarios: int = 1000, seed: int = 0
) -> float:
    """Return the share of simulations with errors within the bounds of a task in which all
    particles end within a distance from their goals.
    """
    bounds = task.bounds or Bounds(task.world.friction)
    search = PressingSearch(
        task.world, pressing_of(bounds, float(task.world.free_space.size)), np.random.default_rng(0)
    )
    drawn = bounds.scenarios(scenarios, len(moves), np.random.default_rng([seed, 9]))
    ends = search.ends(task.start, moves, drawn)
    errors = np.linalg.norm(ends - task.goal, axis=2).max(axis=1)
    return float(np.mean(errors <= within))


def unreachable_share(task: SteeringTask, *, draws: int = 200, seed: int = 0) -> float | None:
    """Return the share of random goals of both particles in the workspace that provably no plan
    reaches from the starts of a task with the least friction; None with obstacles, where no proof
    is known.
    """
    if isinstance(task.world.free_space, Region):
        return None
    rng, space = np.random.default_rng([seed, 8]), task.world.free_space
    low, high = space.bounds
    count = 0
    for _ in range(draws):
        goal: list[Points] = []
        while len(goal) < 2:
            point = rng.uniform(low, high)
            if space.contains(point):
                goal.append(point)
        count += (
            why_unreachable(with_least_friction(replace(task, goal=np.array(goal)))) is not None
        )
    return count / draws


def _is_proved(task: SteeringTask, friction: float, near: float) -> bool:
    """Return whether presses in the cone of a friction provably never end within a distance of the
    goals; with obstacles, no proof is known.
    """
    if isinstance(task.world.free_space, Region):
        return False
    world = replace(task.world, friction=friction)
    return why_unreachable(replace(task, world=world, tolerance=near)) is not None


def with_least_friction(task: SteeringTask) -> SteeringTask:
    """Return a task in the world with the least friction for which its plan must hold."""
    if task.bounds is None:
        return task
    return replace(task, world=replace(task.world, friction=task.bounds.friction))
