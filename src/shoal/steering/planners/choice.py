"""The choice between plans: plans that stand disturbances come first, and more moves must pay by their length."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from shoal.steering.planners.task import SteeringTask, path_length
from shoal.steering.workspaces.convex_geometry import Points

WORTH = 1e-3
"""Fraction of its length by which a plan must be shorter than every plan with fewer moves."""

_EQUAL = 1e-6  # relative to the length: plans of as many moves that differ by less are equal
_STEP = 1e-9  # relative to the size: displacement of a start that measures how sensitive a plan is
_MOST = 40  # number of moves of a plan that is searched for useless moves


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


def without_useless_moves(task: SteeringTask, moves: Points | None) -> Points | None:
    """Return a plan without the moves that it does not need.

    The function leaves out single moves and merges pairs of consecutive moves, as long as the plan stands all disturbances and
    becomes longer by less than 0.1 % altogether.
    """
    if moves is None or len(moves) > _MOST or misses(task, moves) or not task.is_sure(moves):
        return moves
    most, changed = path_length(moves) * (1 + WORTH), True
    while changed:
        changed = False
        for shorter in _with_one_less(moves):
            if path_length(shorter) < most and task.reaches_goal(shorter) and task.is_sure(shorter):
                moves, changed = shorter, True
                break
    return moves


def _with_one_less(moves: Points) -> Iterable[Points]:
    """Yield plans with one move less."""
    for index in range(len(moves) if len(moves) > 1 else 0):
        yield np.delete(moves, index, axis=0)
        if index:
            both = moves[index - 1 : index + 1].sum(axis=0)[None]
            yield np.concatenate([moves[: index - 1], both, moves[index + 1 :]])
