"""Merging of cycles that cannot merge without additional length of the tour.

Of all pairs of neighbouring cells in different cycles, the kernel always takes the pair whose cycles merge with the least
additional length.
"""

from __future__ import annotations

import heapq

import numpy as np

from shoal.jit import kernel
from shoal.search.kernels.cycles import apart, border, find, grow, merge

TOUCHED = 4096


@kernel
def best_exchange(links, c, a, width):
    """Return (cost, d, b) of the cheapest exchange that replaces the edges c-d and a-b by the edges c-a and d-b.

    Among exchanges of equal cost, the result is the exchange that removes the longest edges.
    """
    cost, longest, best_d, best_b = np.inf, -1.0, c, a
    new = apart(c, a, width)
    for i in range(2):
        d = links[c, i]
        first = apart(c, d, width)
        for j in range(2):
            b = links[a, j]
            old = first + apart(a, b, width)
            here = new + apart(d, b, width) - old
            if here < cost - 1e-9 or (here < cost + 1e-9 and old > longest + 1e-9):
                cost, longest, best_d, best_b = min(here, cost), old, d, b
    return cost, best_d, best_b


@kernel
def offer(heap, mask, links, parent, c):
    """Add to the heap the exchanges between cell c and its neighbouring cells in other cycles."""
    height, width = mask.shape
    row, col = c // width, c % width
    for dr, dc in ((-1, 0), (0, -1), (0, 1), (1, 0)):
        r, q = row + dr, col + dc
        if 0 <= r < height and 0 <= q < width and mask[r, q]:
            a = r * width + q
            if find(parent, a) != find(parent, c):
                cost, _, _ = best_exchange(links, c, a, width)
                heapq.heappush(heap, (cost, c, a))


@kernel
def attach(mask, links, parent):
    """Merge all cycles of a connected component into one cycle by the cheapest exchanges.

    After each exchange, the kernel calls `grow`, which merges more cells without additional length.
    """
    width = mask.shape[1]
    queue, queued = np.empty(mask.size, dtype=np.int64), np.zeros(mask.size, dtype=np.bool_)
    touched = np.empty(TOUCHED, dtype=np.int64)
    heap = [(0.0, np.int64(0), np.int64(0))]
    heap.clear()
    for k in queue[: border(mask, parent, queue)].copy():
        offer(heap, mask, links, parent, k)
    while len(heap) > 0:
        cost, c, a = heapq.heappop(heap)
        if find(parent, c) == find(parent, a):
            continue
        now, d, b = best_exchange(links, c, a, width)
        if now > cost + 1e-9:
            heapq.heappush(heap, (now, c, a))
            continue
        merge(links, parent, c, d, a, b)
        count = 0
        for k in (c, d, a, b):
            if not queued[k]:
                queue[count] = k
                queued[k] = True
                count += 1
        n_touched = grow(mask, links, parent, queue, queued, 0, count, touched)
        for k in (c, d, a, b):
            offer(heap, mask, links, parent, k)
        for i in range(min(n_touched, TOUCHED)):
            offer(heap, mask, links, parent, touched[i])
