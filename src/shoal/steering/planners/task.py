"""The task of a planner: world, starts, goals and tolerance; and the choice among its plans."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.dataclass import dataclass
from shoal.jit import working_time
from shoal.steering.contact.clearance import CLEARANCE, PLANNED, why_sensitive
from shoal.steering.contact.friction import friction_limit
from shoal.steering.contact.world import (
    ContactWorld,
    released_translation,
    separations,
    touched_normals,
)
from shoal.steering.planners.chains import (
    MARGIN,
    Chain,
    ChainQuery,
    StartAndGoal,
    lengths_over_walls,
    refine_chain,
)
from shoal.steering.workspaces.convex import EXACT_TOUCH, TOUCH, Points
from shoal.steering.workspaces.walls import normalize_walls

_SURE = 3e-9  # relative to the size: overshoot of a move to a wall, against rounding errors
_PUSH = 2e-9  # relative to the size: minimum component of an adjustment into the wall
_SLIGHT = 2e-7  # relative to the size: rounding errors that may move a particle off a wall
_ERROR = 0.05  # relative to the tolerance: error of an adjustment that a surer contact is worth
# least height of a lift before a move to a wall, relative to this move, because flat contacts are
# sensitive
_STEEP = 2e-4
# relative to the friction: distance of planned pushes from the edge of the cone, to allow for
# rounding errors
_CONE = 1 - 1e-4
TINY = 2e-5  # relative to the size: shorter moves can be left out
_ROUNDINGS = 1e-14  # relative to the size: difference between sums in another order
_WIDER = (1e-7, 1e-6, 1e-5, 1e-4, 3e-4, 1e-3)  # margins of chains with sensitive moves


@dataclass(frozen=True, eq=False)
class SteeringTask(StartAndGoal):
    """The task of a planner: to bring particles from their starts to their goals in a simulated
    world.

    Parameters
    ----------
    world : ContactWorld
        The simulated world, or another object with the attribute ``free_space`` and the methods ``step``
        and ``play``.
    start, goal : ndarray of float64, shape (n, d)
        Start positions of the particles, and the assigned goal of each particle.
    tolerance : float
        Maximum distance of each particle from its goal at the end.
    max_moves : int
        Maximum number of moves of a plan.
    seed : int
        Seed of the random numbers that some planners draw.
    deadline : float
        Time at which the planner must return the best plan so far, in seconds on ``clock``.
    clock : callable
        Returns seconds.
    clearance : float
        Fraction of the workspace's size: largest contact tolerance with which a plan must still
        reach the goals.
    margin : float
        Fraction of the workspace's size: the clearance for which plans leave room. It is smaller
        than ``clearance`` only where a plan with that much room does not exist.
    bounds : shoal.steering.planners.pressing.Bounds, optional
        Errors for which the plan must hold.
    """

    world: Any
    start: Points
    goal: Points
    tolerance: float
    max_moves: int = 100
    seed: int = 0
    deadline: float = inf
    clock: Callable[[], float] = working_time
    clearance: float = CLEARANCE
    margin: float = CLEARANCE
    bounds: Any = None

    @cached_property
    def aim(self) -> Points:
        """The goals of both particles, float64 of shape (2, d).

        A goal on a wall is shifted away from the wall by a part of the tolerance.
        """
        workspace = self.world.free_space
        aim = self.goal.copy()
        for row, point in enumerate(self.goal):
            away = float(np.linalg.norm(workspace.middle - point))
            if float(workspace.depth(point)) < 0.2 * self.tolerance and away > 0:
                aim[row] += min(0.45 * self.tolerance / away, 1.0) * (workspace.middle - point)
        return aim

    def chain_query(self, start: Points | None = None, aim: Points | None = None) -> ChainQuery:
        """Return the task as a query for chains of wall contacts, in the units of
        `NormalizedWalls`.
        """
        walls = normalize_walls(self.world.free_space)
        margin = (
            PLANNED * self.margin
            if self.margin
            else min(MARGIN, 0.02 * self.tolerance / walls.scale)
        )
        return ChainQuery(
            walls,
            walls.normalized(self.start if start is None else start),
            walls.normalized(self.aim if aim is None else aim),
            friction=float(self.world.friction) * _CONE,
            margin=max(margin, 2e-9),
            deadline=self.deadline,
            clock=self.clock,
        )

    def error(self, points: Points) -> float:
        """Return the largest distance between a particle at ``points`` and its goal."""
        return float(np.linalg.norm(points - self.goal, axis=1).max())

    def translation(self) -> Points | None:
        """Return the moves of a translation that solves the task, shape (moves, d), or None if no
        translation solves the task.
        """
        shifts = self.goal - self.start
        if float(np.linalg.norm(shifts - shifts.mean(axis=0), axis=1).max()) > self.tolerance * (
            1 - 1e-9
        ):
            return None
        if not isinstance(self.world, ContactWorld):
            return None  # around obstacles, a planner is necessary
        move = (self.goal - self.start).mean(axis=0)
        moves = self._plan_translation(self.start, move)
        if moves is None or not self.reaches_goal(moves):
            return None
        return np.array(moves)

    def _plan_translation(
        self, points: Points, move: Points, *, least: float = 0.0
    ) -> list[Points] | None:
        """Return one or two moves that translate the particles. If there is room, a lift is
        ``least`` times the size long.

        A plan without a margin may also translate particles that are nearer to walls than the
        clearance.
        """
        workspace = self.world.free_space
        steps = released_translation(workspace, points, move, clearance=self.clearance, least=least)
        if steps is None and self.clearance and not self.margin:
            steps = released_translation(workspace, points, move)
        return steps

    def moves_of(self, chain: Chain, query: ChainQuery) -> Points | None:
        """Return the moves of a chain, with a small move off a wall before each translation that
        starts on a wall.

        The result is None if a small move off a wall is necessary but impossible.

        The effect of rounding errors may exceed the tolerance of the goals, for example if a
        particle touches a wall close to a corner. In this case, the method optimizes the chain
        again with a larger distance from all walls.
        """
        start, moves = query.walls.restored(query.start), self._play_chain(chain, query)
        if moves is not None and self._stands(moves, start):
            return moves
        reaches = moves is not None and self.reaches_goal(moves, start)
        for margin in _WIDER:
            if reaches and margin > query.margin:
                wider = replace(query, margin=margin)
                surer = self._play_chain(refine_chain(wider, chain), wider)
                if surer is not None and self._stands(surer, start):
                    return surer
        if self.margin:  # contacts without an overshoot, nearer to walls
            close = replace(
                query, margin=max(min(MARGIN, 0.02 * self.tolerance / query.walls.scale), 2e-9)
            )
            surer = replace(self, margin=0.0)._play_chain(refine_chain(close, chain), close)
            if surer is not None and self._stands(surer, start):
                return surer
        return moves

    def _stands(self, moves: Points, start: Points) -> bool:
        return self.reaches_goal(moves, start) and self.is_sure(moves, start)

    def reaches_goal(self, moves: ArrayLike, start: Points | None = None) -> bool:
        """Return whether moves from ``start`` (default: the task's start) bring all particles
        within the tolerance of the goals.
        """
        return (
            self.error(self.world.final(self.start if start is None else start, np.asarray(moves)))
            <= self.tolerance
        )

    def is_sure(self, moves: Points, start: Points | None = None) -> bool:
        """Return whether a plan still succeeds with rounding errors at its start, and with every
        disturbance of its contacts.

        `shoal.steering.contact.clearance.why_sensitive` describes the disturbances.
        """
        begin = self.start if start is None else start
        steps = _ROUNDINGS * self.world.free_space.size * np.eye(begin.shape[1])
        if any(
            self.error(self.world.final(begin + step, moves)) > self.tolerance for step in steps
        ):
            return False
        return (
            why_sensitive(
                self.world,
                begin,
                self.goal,
                np.asarray(moves),
                self.tolerance,
                self.clearance or EXACT_TOUCH,
            )
            is None
        )

    def _play_chain(self, chain: Chain, query: ChainQuery) -> Points | None:
        """Return the moves of a chain, each planned from the simulated end of the previous move.

        The simulation of each move prevents an accumulation of rounding errors.
        """
        workspace, walls = self.world.free_space, query.walls
        state = walls.restored(query.start)
        moves: list[Points] = []
        contacts = walls.restored(chain.contacts(walls))
        deltas = chain.differences(query.before, query.after)[1:] * walls.scale
        for toucher, wall, contact, delta in zip(
            chain.touchers, chain.walls, contacts, deltas, strict=True
        ):
            approach = contact - state[toucher]
            length = float(np.linalg.norm(approach))
            sign = 1.0 if toucher == 0 else -1.0
            in_contact = length <= 2 * self.margin * workspace.size and self._touches(
                state[toucher], int(wall)
            )
            if length > 1e-12 * workspace.size and not in_contact:
                over = self._overshoot(
                    walls.inward(int(wall), contact),
                    approach / length,
                    sign * (delta - (state[1] - state[0])),
                )
                steps = self._plan_translation(
                    state, approach * (1 + over / length), least=_STEEP * length / workspace.size
                )
                if steps is None:
                    return None
                state = self._simulate(steps, state, moves)
            state = self._simulate(
                [self._push_into_wall(state[toucher], sign * (delta - (state[1] - state[0])))],
                state,
                moves,
            )
        steps = self._plan_translation(state, (walls.restored(query.goal) - state).mean(axis=0))
        if steps is None:
            return None
        self._simulate(steps, state, moves)
        return self.without_tiny_moves(
            self._without_last_moves(np.array(moves), len(steps), query),
            start=walls.restored(query.start),
        )

    def _without_last_moves(self, moves: Points, last: int, query: ChainQuery) -> Points:
        """Return a plan without the ``last`` moves if it ends within the tolerance without them and
        stands more disturbances.

        In goals that are nearer to walls than the clearance, walls may hold the particles during
        the last translation.
        """
        start, few = query.walls.restored(query.start), moves[: len(moves) - last]
        if (
            not len(few)
            or self.is_sure(moves, start)
            or not (self.reaches_goal(few, start) and self.is_sure(few, start))
        ):
            return moves
        return few

    def _touches(self, point: Points, wall: int) -> bool:
        """Return whether a particle touches the wall with an index of `NormalizedWalls`, in which
        the round wall comes last.
        """
        workspace = self.world.free_space
        flat = workspace.wall_distances(point)
        return bool(
            (flat[wall] if wall < len(flat) else workspace.circle_distance(point))
            <= TOUCH * workspace.size
        )

    def _overshoot(self, inward: Points, direction: Points, adjustment: Points) -> float:
        """Return by how much a move to a wall aims behind the wall, so that errors of the start do
        not prevent the contact.

        The overshoot also moves the other particle, which must not become nearer to the wall than
        the adjustment may bring it.
        """
        size, into = self.world.free_space.size, -float(inward @ direction)
        # with friction, the adjustment keeps its direction
        share = 0.5 if self.world.friction == inf else 1e-5
        slight = (
            min(_ERROR * self.tolerance, self.margin * size) if self.world.friction == inf else 0.0
        )
        most = max(share * -float(inward @ adjustment), slight) / max(into, 1e-9)
        return float(max(_SURE * size, min(self.margin * size, most)))

    def _push_into_wall(self, point: Points, move: Points) -> Points:
        """Return ``move`` with a minimum push into the wall, so that rounding errors do not release
        the held particle.
        """
        normals = touched_normals(self.world.free_space, point)
        if not len(normals):
            return move
        wall = normals[int(np.argmin(normals @ move))]
        size = self.world.free_space.size
        off = float(wall @ move) + min(_PUSH * size, 0.02 * self.tolerance)
        slight = max(_SLIGHT * size, 2 * _ERROR * self.tolerance)
        return np.asarray(move - off * wall) if 0 < off < slight else move

    def _simulate(self, steps: list[Points], state: Points, moves: list[Points]) -> Points:
        """Add the moves ``steps`` to the list ``moves``, and return the simulated state after
        ``steps``.
        """
        for step in steps:
            moves.append(step)
            state = self.world.step(state, step)
        return state

    def without_tiny_moves(self, moves: Points, *, start: Points) -> Points:
        """Return a plan without the tiny moves that slightly longer previous moves can replace.

        In a chain, the particle that touches no wall keeps a small margin from the walls. If this
        particle touches the nearby wall in the next cycle, its move to the wall is tiny.
        """
        size = self.world.free_space.size
        k = 1
        while k < len(moves):
            tiny = float(np.linalg.norm(moves[k]))
            before = float(np.linalg.norm(moves[k - 1]))
            if tiny <= TINY * size and before > tiny:
                shorter = np.delete(moves, k, axis=0)
                shorter[k - 1] *= 1 + 2 * tiny / before
                if self.error(
                    self.world.final(start, shorter)
                ) <= 0.5 * self.tolerance and self.is_sure(shorter, start):
                    moves = shorter
                    continue
            k += 1
        return moves

    def departures(self) -> list[tuple[list[Points], ChainQuery]]:
        """Return pairs (initial moves, chain query for the rest of the plan).

        There are no initial moves if a translation can lead both particles off their walls.
        Otherwise, the initial move of each pair is a small move of one particle off its walls.
        """
        workspace = self.world.free_space
        if self._plan_translation(self.start, np.zeros(workspace.dimensions)) is not None:
            return [([], self.chain_query())]
        apart = separations(workspace, self.start, clearance=self.clearance)
        return [([move], self.chain_query(start=after)) for move, after in apart]

    def lower_bound(self) -> float:
        """Return a lower bound on the length of all plans that end within the tolerance; see
        docs/concepts/steering/planners.md.
        """
        direct = float(np.linalg.norm(self.goal - self.start, axis=1).max())
        apart = float(np.linalg.norm(self.after - self.before))
        if apart <= 2 * self.tolerance:
            return max(direct - self.tolerance, 0.0)
        walls = normalize_walls(self.world.free_space)
        start, goal = walls.normalized(self.start), walls.normalized(self.goal)
        lengths = lengths_over_walls(start, goal, walls).min(axis=1) * walls.scale
        if self.world.friction < inf:  # a sliding toucher moves and changes Δ at once
            return max(
                direct - self.tolerance,
                float(lengths.min()) - self.tolerance,
                apart - 2 * self.tolerance,
                0.0,
            )
        single_toucher = float(lengths.min()) + apart - 3 * self.tolerance
        two_touchers = (float(lengths.sum()) + apart) / 2 - 2 * self.tolerance
        return max(min(single_toucher, two_touchers), direct - self.tolerance, 0.0)


def why_unreachable(task: SteeringTask) -> str | None:
    """Return the reason why no plan for the task exists, or None if a plan may exist."""
    workspace = task.world.free_space
    flat = float(np.hypot(*(task.before[:2])))
    if float(np.linalg.norm(task.after - task.before)) <= 2 * task.tolerance:
        return None
    if flat > TOUCH * workspace.size:
        # The difference of a final state within the tolerance may differ from the goal's by twice
        # the tolerance.
        return friction_limit(
            workspace, float(task.world.friction), task.before, task.after, near=2 * task.tolerance
        )
    if workspace.dimensions == 2:
        return "the particles start at one point, and a shared input never separates them"
    if workspace.open_ends:
        return (
            "the particles start above each other in an open tube: side walls stop both at once,"
            " and there is no end cap"
        )
    return None


def why_approachable(task: SteeringTask) -> str | None:
    """Return the reason why moves can approach the goals but never reach them, or None if moves may
    reach the goals.
    """
    workspace = task.world.free_space
    if float(np.linalg.norm(task.after - task.before)) <= 2 * task.tolerance:
        return None
    near = TOUCH * workspace.size
    if workspace.round:
        across = float(np.hypot(*task.after[:2]))
        if (
            across >= 2 * workspace.radius - near
            and float(np.max(workspace.circle_distance(task.goal))) <= near
        ):
            return (
                "the goals lie opposite each other on the round wall, and their distance can only"
                " be approached"
            )
    on = [np.flatnonzero(workspace.wall_distances(point) <= near) for point in task.goal]
    if (
        len(on[0]) == len(on[1]) == 1
        and float(workspace.normals[on[0][0]] @ workspace.normals[on[1][0]]) <= -1 + 1e-12
    ):
        circles = [float(workspace.circle_distance(point)) for point in task.goal]
        if min(circles) > near:
            return (
                "the goals lie on opposite parallel walls, neither in a corner: "
                "no wall can hold one particle while the other reaches its goal"
            )
    return None


def path_length(moves: Points) -> float:
    """Return the total length of all moves of a plan."""
    return float(np.linalg.norm(moves, axis=1).sum())


class Planner(Protocol):
    """An object that finds moves for a steering task.

    Attributes
    ----------
    name : str

    Notes
    -----
    A planner may have four optional attributes: ``general``, ``obstacles``, ``prefers`` and
    ``control``. The attribute ``general`` is true if the planner supports any number of particles,
    also in regions with obstacles. The attribute ``obstacles`` is true if the planner supports two
    particles in a region with obstacles. A planner with neither attribute gets only problems with
    two particles in a convex workspace.

    The attribute ``prefers`` is "length" or "moves", the measure by which Shoal compares the plans
    for different assignments of interchangeable goals. The method ``control(task, apparatus)`` runs
    a closed loop. The method sends moves and observes the particles instead of making a plan in
    advance. The argument ``apparatus`` is a `shoal.steering.simulation.Apparatus`.
    """

    name: str

    def plan(self, task: SteeringTask) -> Points | None:
        """Return moves that bring the particles to their goals, or near their goals; float64, shape
        (moves, d).

        The result is None if the planner finds no plan.
        """
        ...


WORTH = 1e-3
"""Fraction of its length by which a plan must be shorter than every plan with fewer moves."""

_EQUAL = 1e-6  # relative to the length: plans of as many moves that differ by less are equal
_STEP = 1e-9  # relative to the size: displacement of a start that measures how sensitive a plan is
_MOST = 100  # number of moves of a plan that is searched for useless moves
_RUN = 4  # largest number of consecutive moves that are left out or merged at once


def misses(task: SteeringTask, moves: Points) -> bool:
    """Return whether a plan has too many moves, or ends farther from the goals than the
    tolerance.
    """
    return len(moves) > task.max_moves or not task.reaches_goal(moves)


def choose(
    task: SteeringTask, plans: Iterable[Points | None], *, by_moves: bool = False
) -> Points | None:
    """Return the best of some plans, or None if there is none.

    Plans that reach the goals in spite of disturbances come first, then plans that reach the goals,
    then all others. Among these, the best plan is the shortest plan that is shorter than each plan
    with fewer moves by at least 0.1 %. With ``by_moves``, it is the shortest of the plans with the
    fewest moves. Among equal plans, the least sensitive plan is the best one.
    """
    candidates = [moves for moves in plans if moves is not None]
    arriving = [moves for moves in candidates if not misses(task, moves)]
    best = [moves for moves in arriving if task.is_sure(moves)] or arriving or candidates
    if not best:
        return None
    sizes = [(len(moves), path_length(moves)) for moves in best]
    moves, length = sizes[worthwhile(sizes, by_moves=by_moves)]
    equal = [
        plan
        for plan, size in zip(best, sizes, strict=True)
        if size[0] == moves and size[1] <= length * (1 + _EQUAL)
    ]
    return equal[0] if len(equal) == 1 else min(equal, key=lambda plan: _amplification(task, plan))


def worthwhile(sizes: Sequence[tuple[int, float]], *, by_moves: bool = False) -> int:
    """Return the index of the best of some plans, each given by its number of moves and its length.

    The best plan is the shortest plan that is shorter than each plan with fewer moves by at least
    0.1 %. With ``by_moves``, it is the shortest of the plans with the fewest moves.

    Examples
    --------
    >>> worthwhile([(7, 1.0), (3, 1.0005), (5, 1.2)]), worthwhile([(7, 1.0), (3, 1.002)])
    (1, 0)
    """
    order = sorted(range(len(sizes)), key=lambda k: sizes[k])
    best, shortest = order[0], sizes[order[0]][1]
    for k in [] if by_moves else order[1:]:
        moves, length = sizes[k]
        if moves > sizes[best][0] and length <= shortest * (1 - WORTH):
            best = k
        shortest = min(shortest, length)
    return best


def _amplification(task: SteeringTask, moves: Points) -> float:
    """Return by how much a plan enlarges a small displacement of the start of one particle."""
    step = _STEP * float(task.world.free_space.size)
    end, worst = task.world.final(task.start, moves), 0.0
    for particle, axis in np.ndindex(task.start.shape):
        for side in (-step, step):
            start = task.start.copy()
            start[particle, axis] += side
            worst = max(
                worst,
                float(np.linalg.norm(task.world.final(start, moves) - end, axis=1).max()) / step,
            )
    return worst


def plan_chain(
    task: SteeringTask, initial_moves: Sequence[Points], chain: Chain, query: ChainQuery
) -> list[Points]:
    """Return the plans that make ``initial_moves`` and then the moves of a chain, without useless
    moves.

    If a plan has tiny moves, which only lead to the distance from walls that the clearance asks
    for, the function also makes the plan of the same chain nearer to walls.
    """
    variants = [task.moves_of(chain, query)]
    moves = variants[0]
    if (
        moves is not None
        and task.margin
        and (np.linalg.norm(moves, axis=1) <= TINY * task.world.free_space.size).any()
    ):
        near = replace(task, margin=0.0)
        close = replace(query, margin=near.chain_query().margin)
        variants.append(near.moves_of(refine_chain(close, chain), close))
    plans = [
        without_useless_moves(task, np.array([*initial_moves, *moves]))
        for moves in variants
        if moves is not None
    ]
    return [plan for plan in plans if plan is not None]


def without_useless_moves(task: SteeringTask, moves: Points | None) -> Points | None:
    """Return a plan without the moves that it does not need.

    The function leaves out moves, and merges consecutive moves, as long as the plan stands all
    disturbances. The plan never becomes longer.
    """
    if moves is None or len(moves) > _MOST or misses(task, moves) or not task.is_sure(moves):
        return moves
    return remove_moves(task, moves)


def remove_moves(task: SteeringTask, moves: Points) -> Points:
    """Return a shorter plan, made by removing moves and merging consecutive moves as long as the
    plan reaches the goals. A plan that stands all disturbances still stands them afterwards.
    """
    sure = task.is_sure(moves)
    while True:
        for fewer in with_fewer_moves(moves):
            if task.reaches_goal(fewer) and (not sure or task.is_sure(fewer)):
                moves = fewer
                break
        else:
            return moves


def with_fewer_moves(moves: Points) -> Iterator[Points]:
    """Yield plans that leave out one or a few consecutive moves, or merge a few consecutive moves
    to one.

    Examples
    --------
    >>> [plan.ravel().tolist() for plan in with_fewer_moves(np.array([[1.0], [2.0]]))]
    [[2.0], [1.0], [3.0]]
    """
    for count in range(1, min(_RUN, len(moves)) + 1):
        for begun in range(len(moves) - count + 1):
            before, after = moves[:begun], moves[begun + count :]
            if count < len(moves):
                yield np.concatenate([before, after])
            if count > 1:
                yield np.concatenate(
                    [before, moves[begun : begun + count].sum(axis=0)[None], after]
                )
