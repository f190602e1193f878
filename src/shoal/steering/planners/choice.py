"""The choice between plans: plans that stand disturbances come first, and more moves must pay by their length."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from shoal.steering.planners.chains.chain import Chain, ChainQuery, refined
from shoal.steering.planners.task import TINY, SteeringTask, path_length
from shoal.steering.workspaces.convex_geometry import Points

WORTH = 1e-3
"""Fraction of its length by which a plan must be shorter than every plan with fewer moves."""

_EQUAL = 1e-6  # relative to the length: plans of as many moves that differ by less are equal
_STEP = 1e-9  # relative to the size: displacement of a start that measures how sensitive a plan is
_MOST = 100  # number of moves of a plan that is searched for useless moves
_RUN = 4  # largest number of consecutive moves that are left out or merged at once


def misses(task: SteeringTask, moves: Points) -> bool:
    """Return whether a plan has too many moves, or ends farther from the goals than the tolerance."""
    return len(moves) > task.max_moves or not task.reaches_goal(moves)


def choose(task: SteeringTask, plans: Iterable[Points | None], *, by_moves: bool = False) -> Points | None:
    """Return the best of some plans, or None if there is none.

    Plans that reach the goals in spite of disturbances come first, then plans that reach the goals, then all others. Among these,
    the best plan is the shortest plan that is shorter than each plan with fewer moves by at least 0.1 %. With ``by_moves``, it is
    the shortest of the plans with the fewest moves. Among equal plans, the least sensitive plan is the best one.
    """
    known = [moves for moves in plans if moves is not None]
    arriving = [moves for moves in known if not misses(task, moves)]
    best = [moves for moves in arriving if task.is_sure(moves)] or arriving or known
    if not best:
        return None
    sizes = [(len(moves), path_length(moves)) for moves in best]
    moves, length = sizes[worthwhile(sizes, by_moves=by_moves)]
    equal = [plan for plan, size in zip(best, sizes, strict=True) if size[0] == moves and size[1] <= length * (1 + _EQUAL)]
    return equal[0] if len(equal) == 1 else min(equal, key=lambda plan: _amplification(task, plan))


def worthwhile(sizes: Sequence[tuple[int, float]], *, by_moves: bool = False) -> int:
    """Return the index of the best of some plans, each given by its number of moves and its length.

    The best plan is the shortest plan that is shorter than each plan with fewer moves by at least 0.1 %. With ``by_moves``, it is
    the shortest of the plans with the fewest moves.

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
    step = _STEP * float(task.world.room.size)
    end, worst = task.world.final(task.start, moves), 0.0
    for particle, axis in np.ndindex(task.start.shape):
        for side in (-step, step):
            start = task.start.copy()
            start[particle, axis] += side
            worst = max(worst, float(np.linalg.norm(task.world.final(start, moves) - end, axis=1).max()) / step)
    return worst


def plans_of(task: SteeringTask, first: Sequence[Points], chain: Chain, query: ChainQuery) -> list[Points]:
    """Return the plans that make the moves ``first`` and then the moves of a chain, without useless moves.

    If a plan has tiny moves, which only lead to the distance from walls that the clearance asks for, the function also makes the
    plan of the same chain nearer to walls.
    """
    found = [task.moves_of(chain, query)]
    moves = found[0]
    if moves is not None and task.margin and (np.linalg.norm(moves, axis=1) <= TINY * task.world.room.size).any():
        near = replace(task, margin=0.0)
        close = replace(query, margin=near.chain_query().margin)
        found.append(near.moves_of(refined(close, chain), close))
    plans = [without_useless_moves(task, np.array([*first, *moves])) for moves in found if moves is not None]
    return [plan for plan in plans if plan is not None]


def without_useless_moves(task: SteeringTask, moves: Points | None) -> Points | None:
    """Return a plan without the moves that it does not need.

    The function leaves out moves, and merges consecutive moves, as long as the plan stands all disturbances. The plan never becomes
    longer.
    """
    if moves is None or len(moves) > _MOST or misses(task, moves) or not task.is_sure(moves):
        return moves
    changed = True
    while changed:
        changed = False
        for fewer in with_fewer_moves(moves):
            if task.reaches_goal(fewer) and task.is_sure(fewer):
                moves, changed = fewer, True
                break
    return moves


def with_fewer_moves(moves: Points) -> Iterator[Points]:
    """Yield plans that leave out one or a few consecutive moves, or merge a few consecutive moves to one.

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
                yield np.concatenate([before, moves[begun : begun + count].sum(axis=0)[None], after])
