"""Paths of few straight lines through windows, in compiled code."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel

_HAIR = 1e-6


@in_place_kernel
def clip(from_x, from_y, step_x, step_y, boxes, k):
    """Return the smallest and the largest fraction (low, high) of a step that lie in a box, or (1,
    0) if none lies in it.
    """
    low, high = 0.0, 1.0
    for axis in range(2):
        start, step = (from_x, step_x) if axis == 0 else (from_y, step_y)
        least, most = boxes[k, axis] - _HAIR, boxes[k, axis + 2] + _HAIR
        if abs(step) < 1e-12:
            if start < least or start > most:
                return 1.0, 0.0
            continue
        enter, leave = (least - start) / step, (most - start) / step
        if enter > leave:
            enter, leave = leave, enter
        low, high = max(low, enter), min(high, leave)
        if low > high:
            return 1.0, 0.0
    return low, high


@kernel
def fewest_links(points, starts, boxes, chains, unsolved, turn, reach, banned, nodes, counts):
    """For each unsolved chain of windows, find the cheapest path from the first window to the last.

    A path costs its length plus ``turn`` for each link. ``points`` (K, 2) contains the points of
    all windows. The points of window k have the indices from ``starts[k]`` to ``starts[k + 1] -
    1``. The array ``boxes`` (M, 4) contains the left, low, right and high border of each window.
    The windows of chain c have the indices from ``chains[c]`` to ``chains[c + 1] - 1``. Its first
    and its last window have one point each. A link leads at most ``reach`` windows ahead. The array
    ``banned`` contains forbidden links in increasing order, each as the number i * K + j for the
    link from point i to point j.

    The points of the path are written to ``nodes`` (M,), from ``chains[c]`` on, and their number to
    ``counts[c]``: 0 if no path exists.
    """
    count = len(points)
    cost = np.empty(count, dtype=np.float64)
    before = np.empty(count, dtype=np.int64)
    for c in unsolved:
        low_window, high_window = chains[c], chains[c + 1]
        first, goal = starts[low_window], starts[high_window] - 1
        cost[first : goal + 1] = np.inf
        cost[first] = 0.0
        before[first : goal + 1] = -1
        for i in range(low_window, high_window - 1):
            last = min(high_window - 1, i + reach)
            for p in range(starts[i], starts[i + 1]):
                if cost[p] >= cost[goal]:  # no path through it is the cheapest, or none leads to it
                    continue
                for j in range(i + 1, last + 1):
                    for q in range(starts[j], starts[j + 1]):
                        if cost[p] + turn >= cost[q]:
                            continue
                        step_x, step_y = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1]
                        total = cost[p] + np.sqrt(step_x * step_x + step_y * step_y) + turn
                        if total >= cost[q]:
                            continue
                        at, good = 0.0, True
                        for k in range(i + 1, j):
                            low, high = clip(points[p, 0], points[p, 1], step_x, step_y, boxes, k)
                            at = max(at, low)
                            if at > high:
                                good = False
                                break
                        if not good:
                            continue
                        code = p * count + q
                        place = np.searchsorted(banned, code)
                        if place < len(banned) and banned[place] == code:
                            continue
                        cost[q] = total
                        before[q] = p
        counts[c] = 0
        if cost[goal] == np.inf:
            continue
        node = goal
        while node >= 0:
            nodes[low_window + counts[c]] = node
            counts[c] += 1
            node = before[node]
        for k in range(counts[c] // 2):
            front, rear = low_window + k, low_window + counts[c] - 1 - k
            nodes[front], nodes[rear] = nodes[rear], nodes[front]
