"""Planner greedy: each cycle brings the position difference of the particles as near as possible to
the goals' difference.
"""

from __future__ import annotations

from math import inf

import numpy as np

from shoal.steering.planners.chain_search import (
    Cycle,
    antipodal_chain,
    nearest_cycles,
    roadmap_chain,
    shortest_chain,
)
from shoal.steering.planners.chains import Chain, ChainQuery
from shoal.steering.planners.task import (
    SteeringTask,
    choose,
    misses,
    plan_chain,
)
from shoal.steering.workspaces.convex import Points

_PATIENCE = 4  # number of cycles over which the progress is measured
_SLOW = 16  # if more cycles remain at this progress, another chain is searched
# maximum number of moves; each move amplifies earlier errors, so a longer chain is replaced by a
# shorter one
_LONG = 24
_BACKWARD = 48  # cycles of a chain that is planned backwards
# relative to the size: among cycles that come equally near, the shorter one is chosen
_EQUAL = 1e-9


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
        for initial_moves, query in task.departures():
            chain = greedy_chain(
                query,
                tolerance=task.tolerance / query.walls.scale / 4,
                cycles=(task.max_moves - 1) // 2,
            )
            moves = (
                None
                if chain is None
                else choose(task, plan_chain(task, initial_moves, chain, query))
            )
            slipped = moves is not None and query.friction < inf and misses(task, moves)
            if moves is None or slipped or (len(moves) > _LONG and not query.walls.round):
                chain = exact_chain(query, roadmap=slipped)
                few = (
                    None
                    if chain is None
                    else choose(task, plan_chain(task, initial_moves, chain, query))
                )
                moves = moves if few is None else few
            if moves is not None:
                plans.append(moves)
                if not misses(task, moves) and task.is_sure(moves):
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
    distances = [inf] * _PATIENCE
    alone = False  # no other chain was found
    while len(touchers) < max(cycles, 1):
        delta = state[1] - state[0]
        distance = float(np.linalg.norm(delta - query.after))
        if distance <= tolerance and touchers:
            break
        step = _next_cycle(query, state)
        distances.append(distance)
        halted = step is None or not step[0].distance < distance - 1e-12
        if (
            step is None
            or halted
            or (not alone and _is_slow(distance, distances[-1 - _PATIENCE], tolerance))
        ):
            # Without progress from this difference, because no reachable difference is nearer,
            # another chain may still lead past it.
            roadmap = halted or query.friction < inf
            alternative = (
                None if alone and query.friction < inf else exact_chain(query, roadmap=roadmap)
            )
            if alternative is not None or step is None or halted:
                return alternative
            alone = True
        cycle, along, contact = step
        touchers.append(cycle.toucher)
        walls.append(cycle.wall)
        contacts.append(along)
        deltas.append(cycle.after)
        partner = contact + (cycle.after if cycle.toucher == 0 else -cycle.after)
        state = np.stack([contact, partner] if cycle.toucher == 0 else [partner, contact])
    if (
        query.friction < inf
        and not alone
        and float(np.linalg.norm(state[1] - state[0] - query.after)) > tolerance
    ):
        alternative = exact_chain(query)
        if alternative is not None:
            return alternative
    unknowns = np.concatenate([np.array(contacts), *deltas[:-1]])
    return Chain(np.array(touchers), np.array(walls), unknowns, inf, last=deltas[-1])


def _is_slow(distance: float, before: float, tolerance: float) -> bool:
    """Return whether algorithm 1 needs more than 16 further cycles if each cycle reduces the error
    as the last four cycles did.
    """
    return (
        before < inf
        and distance > tolerance
        and (
            distance >= before
            or np.log(tolerance / distance) * _PATIENCE < _SLOW * np.log(distance / before)
        )
    )


def exact_chain(query: ChainQuery, *, roadmap: bool = True) -> Chain | None:
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
            length = query.optimize(guess, chain.touchers, on, rounds=np.empty(0))
            if length < inf:
                return Chain(chain.touchers, on, guess, length)
    return shortest_chain(query, first_found=True)
