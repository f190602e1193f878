"""Changes of a path that make it shorter or straighter, while a square that moves along the path
still passes over all targets.

A ``path`` (M, 2) has two fixed points at each end. The square moves from the second point to the
last but one. Each target is a box (left, low, right, high) around a point. The square passes over
the point if the centre of the square passes through the box.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel
from shoal.search.kernels.lanes import clip
from shoal.search.kernels.shortening.cell_exchanges import bends, distance

DELETE, TO_MIDDLE, TO_PREVIOUS, TO_NEXT, JOIN, BOTH_BACK = range(6)
"""The kinds of changes: see `changed`."""

_LESS = 1e-3  # minimum saving, divided by the cost of a turn


@in_place_kernel
def path_cost(path, count, turn):
    """Return the cost of a path of ``count`` points: its length between its fixed points, plus
    ``turn`` for each turn.
    """
    total = 0.0
    for k in range(1, count - 1):
        if k < count - 2:
            total += distance(path, k, k + 1)
        total += turn * np.int64(bends(path, k - 1, k, k + 1))
    return total


@in_place_kernel
def passes_over(path, count, boxes):
    """Return whether a path of ``count`` points passes through all boxes between its
    fixed points.
    """
    for target in range(len(boxes)):
        passed = False
        for k in range(1, count - 2):
            low, high = clip(
                path[k, 0],
                path[k, 1],
                path[k + 1, 0] - path[k, 0],
                path[k + 1, 1] - path[k, 1],
                boxes,
                target,
            )
            if low <= high:
                passed = True
                break
        if not passed:
            return False
    return True


@in_place_kernel
def slide(path, v, other, step, result):
    """Write to ``result`` the point v, moved by ``step`` towards point ``other``. Return False if v
    would reach this point.

    If ``step`` is negative, point v moves away from point ``other``.
    """
    length = distance(path, v, other)
    if length < 1e-9 or step >= length:
        return False
    for axis in range(2):
        result[v, axis] = path[v, axis] + (path[other, axis] - path[v, axis]) * step / length
    return True


@in_place_kernel
def join(path, v, result):
    """Write the crossing of the legs before point v and after point v + 1. Return whether both legs
    lead to this crossing.
    """
    x, y = path[v, 0] - path[v - 1, 0], path[v, 1] - path[v - 1, 1]
    u, w = path[v + 1, 0] - path[v + 2, 0], path[v + 1, 1] - path[v + 2, 1]
    across = u * y - x * w
    if abs(across) < 1e-9:
        return False
    far_x, far_y = path[v + 2, 0] - path[v - 1, 0], path[v + 2, 1] - path[v - 1, 1]
    one, other = (u * far_y - w * far_x) / across, (x * far_y - y * far_x) / across
    result[v, 0], result[v, 1] = path[v - 1, 0] + one * x, path[v - 1, 1] + one * y
    return one > 0 and other > 0


@in_place_kernel
def changed(path, count, v, kind, step, result):
    """Write the path after a change at point v. Return the path's number of points, or 0 if the
    change is impossible.

    The changes delete the point, move it half way to the middle of its neighbours, slide it along
    the leg to the previous or the next point, replace two points by the crossing of the legs beside
    them, or slide two points back along these legs.
    """
    for k in range(count):
        result[k, 0], result[k, 1] = path[k, 0], path[k, 1]
    last = count - 3  # the last point that may move
    if kind == DELETE or kind == JOIN:
        if kind == JOIN and (v + 1 > last or not join(path, v, result)):
            return 0
        for k in range(v + np.int64(kind == JOIN), count - 1):
            result[k, 0], result[k, 1] = path[k + 1, 0], path[k + 1, 1]
        return count - 1
    if kind == TO_MIDDLE:
        for axis in range(2):
            result[v, axis] = path[v, axis] / 2 + (path[v - 1, axis] + path[v + 1, axis]) / 4
        return count
    if kind == BOTH_BACK:
        good = (
            v < last
            and step > 0
            and slide(path, v, v - 1, step, result)
            and slide(path, v + 1, v + 2, step, result)
        )
        return count if good else 0
    return count if slide(path, v, v - 1 if kind == TO_PREVIOUS else v + 1, step, result) else 0


@kernel
def changed_paths(path, boxes, turn, steps, paths, counts, costs):
    """Write all changed paths that cost less than ``path`` and pass through all boxes. Return their
    number.

    ``paths``, ``counts`` and ``costs`` receive the points, the number of points and the cost of
    each changed path. ``steps`` are the distances by which points slide. ``paths`` (K, M, 2) has
    room for all changes.
    """
    count, found, result = len(path), 0, np.empty_like(path)
    most = path_cost(path, count, turn) - _LESS * turn
    for v in range(2, count - 2):
        for kind in range(6):
            slides = kind == TO_PREVIOUS or kind == TO_NEXT or kind == BOTH_BACK
            for k in range(len(steps) if slides else 1):
                size = changed(path, count, v, kind, steps[k], result)
                if size == 0:
                    continue
                cost = path_cost(result, size, turn)
                if cost < most and passes_over(result, size, boxes):
                    paths[found, :size], counts[found], costs[found] = result[:size], size, cost
                    found += 1
    return found
