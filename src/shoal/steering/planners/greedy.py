"""Planner greedy: each cycle brings the position difference of the particles as near as possible to
the goals' difference.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from shoal.steering.contact.clearance import PLANNED
from shoal.steering.contact.world import ContactWorld, touched_normals
from shoal.steering.planners.chain_search import (
    Cycle,
    antipodal_chain,
    nearest_cycles,
    roadmap_chain,
    shortest_chain,
)
from shoal.steering.planners.chains import Chain, ChainQuery
from shoal.steering.planners.task import (
    PLANNERS,
    Planner,
    SteeringTask,
    choose,
    misses,
    plans_of,
    without_useless_moves,
)
from shoal.steering.workspaces.convex import Points

_PATIENCE = 4  # number of cycles over which the progress is measured
_SLOW = 16  # if more cycles remain at this progress, another chain is searched
# maximum number of moves; each move amplifies earlier errors, so a longer chain is replaced by a
# shorter one
_LONG = 24
_BACKWARD = 48  # cycles of a chain that is planned backwards
_EQUAL = (
    1e-9  # relative to the size: among cycles that come equally near, the shorter one is chosen
)


@PLANNERS.register("greedy")
class Greedy:
    """A planner in which each cycle brings the particles' position difference as near as possible
    to the goals' difference.

    In a cycle, one particle (the touching particle) moves to a point of a wall (the contact). Then
    the wall holds this particle while the other particle moves. Among equally good cycles, the
    planner chooses the cycle in which the touching particle has the shortest path via the contact
    to its goal. In three dimensions, the planner first makes a plan in the plane and then adds
    vertical components.

    Notes
    -----
    Source: algorithms 1 to 3 (corrected) and section IV.G of paper W.
    """

    name = "greedy"

    def plan(self, task: SteeringTask) -> Points | None:
        """Return the moves of a plan for ``task``; see the class `Planner`."""
        plans: list[Points] = []
        for first, query in task.departures():
            chain = greedy_chain(
                query,
                tolerance=task.tolerance / query.walls.scale / 4,
                cycles=(task.max_moves - 1) // 2,
            )
            whole = None if chain is None else choose(task, plans_of(task, first, chain, query))
            slipped = whole is not None and query.friction < inf and misses(task, whole)
            if whole is None or slipped or (len(whole) > _LONG and not query.walls.round):
                chain = any_chain(query, roadmap=slipped)
                few = None if chain is None else choose(task, plans_of(task, first, chain, query))
                whole = whole if few is None else few
            if whole is not None:
                plans.append(whole)
                if not misses(task, whole) and task.is_sure(whole):
                    break
        return choose(task, plans)


def greedy_chain(query: ChainQuery, *, tolerance: float, cycles: int) -> Chain | None:
    """Return the chain that algorithm 1 of paper W finds, or a chain that another search finds if
    algorithm 1 progresses slowly.

    The chain of algorithm 1 ends when the position difference is within ``tolerance`` of the goals'
    difference, or after ``cycles`` cycles. The result is None if algorithm 1 makes no progress and
    the other search finds no chain.
    """
    if query.walls.dimensions == 3:
        return _spatial_chain(query, tolerance=tolerance, cycles=cycles)
    touchers: list[int] = []
    walls: list[int] = []
    contacts: list[float] = []
    deltas: list[Points] = []
    state = query.start
    lefts = [inf] * _PATIENCE
    alone = False  # no other chain was found
    while len(touchers) < max(cycles, 1):
        delta = state[1] - state[0]
        left = float(np.linalg.norm(delta - query.after))
        if left <= tolerance and touchers:
            break
        step = _next_cycle(query, state)
        lefts.append(left)
        halted = step is None or not step[0].distance < left - 1e-12
        if (
            step is None
            or halted
            or (not alone and _is_slow(left, lefts[-1 - _PATIENCE], tolerance))
        ):
            # Without progress from this difference, because no reachable difference is nearer,
            # another chain may still lead past it.
            roadmap = halted or query.friction < inf
            other_chain = (
                None if alone and query.friction < inf else any_chain(query, roadmap=roadmap)
            )
            if other_chain is not None or step is None or halted:
                return other_chain
            alone = True
        cycle, along, contact = step
        touchers.append(cycle.toucher)
        walls.append(cycle.wall)
        contacts.append(along)
        deltas.append(cycle.after)
        other = contact + (cycle.after if cycle.toucher == 0 else -cycle.after)
        state = np.stack([contact, other] if cycle.toucher == 0 else [other, contact])
    if (
        query.friction < inf
        and not alone
        and float(np.linalg.norm(state[1] - state[0] - query.after)) > tolerance
    ):
        other_chain = any_chain(query)
        if other_chain is not None:
            return other_chain
    unknowns = np.concatenate([np.array(contacts), *deltas[:-1]])
    return Chain(np.array(touchers), np.array(walls), unknowns, inf, last=deltas[-1])


def _is_slow(left: float, before: float, tolerance: float) -> bool:
    """Return whether algorithm 1 needs more than 16 further cycles if each cycle reduces the error
    as the last four cycles did.
    """
    return (
        before < inf
        and left > tolerance
        and (left >= before or np.log(tolerance / left) * _PATIENCE < _SLOW * np.log(left / before))
    )


def any_chain(query: ChainQuery, *, roadmap: bool = True) -> Chain | None:
    """Return a chain that ends exactly with the position difference of the goals, or None if the
    search finds no chain.

    If ``roadmap`` is true, the search includes chains of more than three cycles from a roadmap.
    """
    if query.walls.round and query.friction == inf:
        backward = antipodal_chain(query, cycles=_BACKWARD)
        if backward is not None:
            return backward
    few = (1, 2) if query.friction < inf else (1, 2, 3)
    chain = shortest_chain(query, cycles=few, first_found=True)
    if chain is None and roadmap and query.walls.dimensions == 2:
        chain = roadmap_chain(query)
    return chain


def _next_cycle(query: ChainQuery, state: Points) -> tuple[Cycle, float, Points] | None:
    """Return the cycle that comes nearest to the goals' position difference, its contact's place on
    the wall, and the contact.

    Among equally good cycles, the function returns the cycle in which the touching particle has the
    shortest path to its goal.
    """
    cycles = nearest_cycles(query, state[1] - state[0], query.after)
    nearest = min((cycle.distance for cycle in cycles), default=inf)
    best, shortest = None, inf
    for cycle in cycles:
        if cycle.distance > nearest + _EQUAL:
            continue
        place, contact = cycle.contact(query.walls, state[cycle.toucher])
        length = float(
            np.linalg.norm(contact - state[cycle.toucher])
            + np.linalg.norm(query.goal[cycle.toucher] - contact)
        )
        if length < shortest:
            best, shortest = (cycle, place, contact), length
    return best


def _spatial_chain(query: ChainQuery, *, tolerance: float, cycles: int) -> Chain | None:
    """Return a chain in space, made from a chain in the plane by adding the heights of its
    contacts.

    If no feasible heights exist, the function returns the shortest chain of a search in space.
    """
    flat = query.flat()
    if (
        min(float(np.linalg.norm(flat.before)), float(np.linalg.norm(flat.before - flat.after)))
        > tolerance
    ):
        chain = greedy_chain(flat, tolerance=tolerance, cycles=cycles)
        if (
            chain is not None
            and chain.last is not None
            and float(np.linalg.norm(chain.last - flat.after)) <= tolerance
        ):
            m = chain.cycles
            guess = query.guess(m)
            guess[: 2 * m : 2] = chain.unknowns[:m]
            guess[1 : 2 * m : 2] = query.walls.height / 2
            guess[2 * m :].reshape(-1, 3)[:, :2] = chain.unknowns[m:].reshape(-1, 2)
            on = np.full(m, len(query.walls.normals)) if query.walls.round else chain.walls
            length = query.settle(guess, chain.touchers, on, rounds=np.empty(0))
            if length < inf:
                return Chain(chain.touchers, on, guess, length)
    return shortest_chain(query, first_found=True)


_LENGTHS = (0.2, 0.05)  # relative to the size: length of the last move
_NARROW_PUSH = 0.1  # least component of the last move into a wall, relative to its length
_DIRECTIONS = 16


def plan_with_clearance(task: SteeringTask, planner: Planner) -> Points | None:
    """Return the moves of the plan that ``planner`` finds for ``task``, or None if the planner
    finds no plan.

    If a translation solves the task, the function returns the translation. If the planning time is
    limited, the function also considers the plan that the planner greedy finds without a limit,
    which takes some milliseconds. Where there is no room for the clearance of the task, the
    function plans with smaller distances from walls, because such a plan may still stand all
    disturbances. With friction, and between places on walls, it also does so if it has found a plan
    already, because such a plan may be much shorter.
    """
    by_moves = getattr(planner, "prefers", "length") == "moves"
    simple = isinstance(task.world, ContactWorld) and len(task.start) == 2
    everywhere = simple and not getattr(planner, "general", False) and _needs_narrow(task)
    plans: list[Points | None] = []
    if task.deadline < inf and simple and planner.name != Greedy.name:
        plans.append(plan_with_clearance(replace(task, deadline=inf), Greedy()))
    best, sure = None, False
    for margin in dict.fromkeys((task.clearance, 0.0)):
        own = replace(task, margin=margin)
        shift = own.translation()
        solved = shift is not None and own.is_sure(shift)
        if not solved:
            plans.append(planner.plan(own))
            if simple and task.clearance and margin == 0.0 and not sure:
                plans.append(with_last_push(own, planner))
        plans.append(shift)
        best = choose(task, plans, by_moves=by_moves)
        sure = best is not None and not misses(task, best) and task.is_sure(best)
        if task.late or solved or (sure and not everywhere):
            break
    return without_useless_moves(task, best)


def _needs_narrow(task: SteeringTask) -> bool:
    """Return whether plans nearer to the walls than the clearance may be much shorter than plans
    that keep it.

    With friction, or between places on walls, the clearance excludes chains of contacts that stand
    all disturbances nevertheless.
    """
    room, near = task.world.room, PLANNED * task.clearance * task.world.room.size
    return bool(
        task.world.friction < inf
        or (room.depth(np.concatenate([task.start, task.goal])) <= near).any()
    )


def with_last_push(task: SteeringTask, planner: Planner) -> Points | None:
    """Return a plan that ends with a push into the walls at a goal, or None if the search finds
    none that stands disturbances.

    If both goals lie in corners, walls may hold both particles during a last translation that is
    shorter than the clearance. The search therefore plans to a goal of one particle on its wall,
    and to a place of the other particle away from all walls. The last move pushes the first
    particle into its wall and brings the other particle to its goal.
    """
    room = task.world.room
    if room.dimensions != 2:
        return None
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    towards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    plans: list[Points | None] = []
    for held in (0, 1):
        walls = touched_normals(room, task.goal[held], within=task.tolerance / room.size)
        for length in _LENGTHS if len(walls) else ():
            begins = task.aim[1 - held] - length * room.size * towards
            into = (walls @ towards.T).min(axis=0) < -_NARROW_PUSH
            depth = np.where(into, room.depth(begins), -np.inf)
            best = int(np.argmax(depth))
            if depth[best] <= 10 * task.clearance * room.size or task.late:
                continue
            goal = task.aim.copy()
            goal[1 - held] = begins[best]
            before = replace(
                task,
                goal=goal,
                tolerance=task.tolerance / 2,
                max_moves=task.max_moves - 1,
                margin=task.clearance,
            )
            moves = planner.plan(before)
            if moves is None:
                continue
            end = task.world.final(task.start, moves)
            whole = np.vstack([moves, task.aim[1 - held] - end[1 - held]])
            if not misses(task, whole) and task.is_sure(whole):
                plans.append(whole)
                break
    return choose(task, plans)
