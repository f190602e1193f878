"""Cycles of cells in compiled code: spanning trees and their joining to tours."""

from __future__ import annotations

import heapq

import numpy as np

from shoal.jit import kernel


@kernel
def find(parent, k):
    """Return the root of cell k in the union-find forest. The search halves the path to the root
    (path halving).
    """
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@kernel
def relink(links, k, old, new):
    links[k, 0 if links[k, 0] == old else 1] = new


@kernel
def merge(links, parent, c, d, a, b):
    """Merge two cycles: replace the edge c-d of one cycle and the edge a-b of the other cycle by
    the edges c-a and d-b.
    """
    relink(links, c, d, a)
    relink(links, d, c, b)
    relink(links, a, b, c)
    relink(links, b, a, d)
    parent[find(parent, a)] = find(parent, c)


@kernel
def ring(links, parent, k, width):
    """Make a cycle of the 2 x 2 cells whose upper left cell is k."""
    corners = (k, k + 1, k + width + 1, k + width)
    for i in range(4):
        links[corners[i], 0], links[corners[i], 1] = corners[i - 1], corners[(i + 1) % 4]
        parent[corners[i]] = k


@kernel
def tree_of_blocks(full, origin, width, along_rows, links, parent):
    """Make a cycle of each full block of 2 x 2 cells, and merge neighbouring cycles along a
    spanning tree by Kruskal's algorithm.

    ``full`` (h, w) marks full blocks, and ``origin`` is the upper left cell of the first block.
    Kruskal's algorithm first tries all links along the rows (along the columns if ``along_rows`` is
    false), and then all other links, line by line. The spanning tree consists of straight corridors
    and one spine across them, as far as the region permits. Around straight corridors, the tour has
    few turns.
    """
    rows, cols = full.shape
    for i in range(rows):
        for j in range(cols):
            if full[i, j]:
                ring(links, parent, origin + 2 * i * width + 2 * j, width)
    for turn in range(2):
        if (turn == 0) == along_rows:
            for i in range(rows):
                for j in range(cols - 1):
                    if full[i, j] and full[i, j + 1]:
                        k = origin + 2 * i * width + 2 * j + 1
                        join(links, parent, k, k + width, 1)
        else:
            for j in range(cols):
                for i in range(rows - 1):
                    if full[i, j] and full[i + 1, j]:
                        k = origin + (2 * i + 1) * width + 2 * j
                        join(links, parent, k, k + 1, width)


@kernel
def join(links, parent, c, d, across):
    if find(parent, c) != find(parent, c + across):
        merge(links, parent, c, d, c + across, d + across)


@kernel
def is_single(links, k):
    return links[k, 0] == k and links[k, 1] == k


@kernel
def border(mask, parent, listed):
    """List the cells that have a neighbour in another cycle. Return the number of listed cells."""
    height, width = mask.shape
    at_border = np.zeros(mask.size, dtype=np.bool_)
    for row in range(height):
        for col in range(width):
            if not mask[row, col]:
                continue
            k = row * width + col
            root = find(parent, k)
            if col + 1 < width and mask[row, col + 1] and find(parent, k + 1) != root:
                at_border[k] = at_border[k + 1] = True
            if row + 1 < height and mask[row + 1, col] and find(parent, k + width) != root:
                at_border[k] = at_border[k + width] = True
    count = 0
    for k in range(mask.size):
        if at_border[k]:
            listed[count] = k
            count += 1
    return count


@kernel
def grow(mask, links, parent, queue, queued, head, count, touched):
    """Merge the cycles of queued cells with the cells beside their edges, as long as no merge makes
    the tour longer.

    The kernel merges the cells a and b beside an edge c-d if a-b is an edge of another cycle, or if
    a and b are single cells. The array ``queue`` is a ring buffer. The kernel writes the changed
    cells to ``touched``, as far as the cells fit, and returns the number of changed cells. A cell
    may appear several times.
    """
    height, width = mask.shape
    n_touched = 0
    while count > 0:
        c = queue[head]
        head = head + 1 if head + 1 < len(queue) else 0
        count -= 1
        queued[c] = False
        if is_single(links, c):
            continue
        for end in range(2):
            for side in (-1, 1):
                d = links[c, end]
                a, b = beside(c, d, side, height, width)
                if a < 0 or not (mask[a // width, a % width] and mask[b // width, b % width]):
                    continue
                if is_single(links, a) and is_single(links, b):
                    links[a, 0] = links[a, 1] = b
                    links[b, 0] = links[b, 1] = a
                    parent[b] = a
                elif (links[a, 0] != b and links[a, 1] != b) or find(parent, a) == find(parent, c):
                    continue
                merge(links, parent, c, d, a, b)
                for k in (a, b, c, d):
                    if n_touched < len(touched):
                        touched[n_touched] = k
                    n_touched += 1
                    if not queued[k]:
                        queued[k] = True
                        queue[(head + count) % len(queue)] = k
                        count += 1
    return n_touched


@kernel
def beside(c, d, side, height, width):
    """Return the cell beside c and the cell beside d, on one of the two sides of the edge c-d. The
    sides are -1 and 1.

    If c and d are not neighbours, or if the side ``side`` of the edge is outside the grid, return
    (-1, -1).
    """
    row, col = c // width, c % width
    if abs(c - d) == 1 and row == d // width:
        row += side
        if row < 0 or row >= height:
            return -1, -1
        return c + side * width, d + side * width
    if abs(c - d) == width:
        col += side
        if col < 0 or col >= width:
            return -1, -1
        return c + side, d + side
    return -1, -1


@kernel
def grow_everywhere(mask, links, parent):
    """Grow all cycles, make a cycle of each square of 2 x 2 cells that are still single, and then
    grow all cycles again.
    """
    height, width = mask.shape
    queue, queued = np.empty(mask.size, dtype=np.int64), np.zeros(mask.size, dtype=np.bool_)
    nothing = np.empty(0, dtype=np.int64)
    for attempt in range(2):
        squares = 0
        if attempt == 1:
            for row in range(height - 1):
                for col in range(width - 1):
                    k = row * width + col
                    if not (
                        mask[row, col]
                        and mask[row, col + 1]
                        and mask[row + 1, col]
                        and mask[row + 1, col + 1]
                    ):
                        continue
                    if (
                        is_single(links, k)
                        and is_single(links, k + 1)
                        and is_single(links, k + width)
                        and is_single(links, k + width + 1)
                    ):
                        ring(links, parent, k, width)
                        squares += 1
        if attempt == 1 and squares == 0:
            break
        count = border(mask, parent, queue)
        queued[queue[:count]] = True
        grow(mask, links, parent, queue, queued, 0, count, nothing)


@kernel
def chains(links, width, members, starts, order):
    """Write the cells of all cycles to ``order``, one cycle after the other.

    ``members`` are the cells, sorted by cycle. ``starts`` contains the index in ``members`` of the
    first cell of each cycle, and then the number of all cells. The first cycle begins at its first
    cell in ``members``. Each later cycle begins at its cell nearest to the end of the previous
    cycle. At the cell where a cycle begins, the kernel removes the longer of the cell's two edges.
    If only one cycle exists, the kernel removes the shorter edge.
    """
    at, row, col = 0, -1, -1
    for number in range(len(starts) - 1):
        entry = members[starts[number]]
        if number > 0:
            nearest = np.int64(2) ** 62
            for k in range(starts[number], starts[number + 1]):
                member = members[k]
                away = (member // width - row) ** 2 + (member % width - col) ** 2
                if away < nearest:
                    nearest, entry = away, member
        first, second = links[entry, 0], links[entry, 1]
        longer = apart(entry, first, width) >= apart(entry, second, width)
        if len(starts) == 2:
            # a tour of one cycle stays closed, so its closing edge should be short
            longer = not longer
        before, cell, after = entry, entry, second if longer else first
        while True:
            order[at] = cell
            at += 1
            if after == entry or at == starts[number + 1]:
                break
            before, cell = cell, after
            after = links[cell, 1] if links[cell, 0] == before else links[cell, 0]
        row, col = cell // width, cell % width


@kernel
def apart(a, b, width):
    """Return the straight distance between two cells."""
    row, col = a // width - b // width, a % width - b % width
    return np.sqrt(float(row * row + col * col))


TOUCHED = 4096


@kernel
def best_exchange(links, c, a, width):
    """Return (cost, d, b) of the cheapest exchange that replaces the edges c-d and a-b by the edges
    c-a and d-b.

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
            change = new + apart(d, b, width) - old
            if change < cost - 1e-9 or (change < cost + 1e-9 and old > longest + 1e-9):
                cost, longest, best_d, best_b = min(change, cost), old, d, b
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
