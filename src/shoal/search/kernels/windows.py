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
        one, other = (least - start) / step, (most - start) / step
        if one > other:
            one, other = other, one
        low, high = max(low, one), min(high, other)
        if low > high:
            return 1.0, 0.0
    return low, high


@kernel
def fewest_links(points, starts, boxes, turn, reach, banned, before):
    """For each point, find the cheapest path to the point, and write the previous point on this
    path to ``before``.

    A path costs its length plus ``turn`` for each link. ``points`` (K, 2) contains the points of
    all windows. The points of window k have the indices from ``starts[k]`` to ``starts[k + 1] -
    1``. The array ``boxes`` (M, 4) contains the left, low, right and high border of each window.
    The first and the last window have one point each. A link leads at most ``reach`` windows ahead.
    The array ``banned`` contains forbidden links in increasing order, each as the number i * K + j
    for the link from point i to point j.
    """
    count, windows = len(points), len(boxes)
    cost = np.full(count, np.inf)
    cost[0] = 0.0
    before[:] = -1
    for i in range(windows - 1):
        last = min(windows - 1, i + reach)
        for p in range(starts[i], starts[i + 1]):
            if cost[p] == np.inf:
                continue
            for j in range(i + 1, last + 1):
                for q in range(starts[j], starts[j + 1]):
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
