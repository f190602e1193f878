"""Lanes of a search in compiled code: runs of cells, their order, and lines that stab them."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel

LOOK = 64
"""Maximum number of unvisited neighbours of a chain that the search compares."""


@kernel
def runs_of(mask):
    """Return (row, begin, end) of all runs in reading order; int64, shape (R, 3).

    ``end`` is the column after the last cell of a run.
    """
    height, width = mask.shape
    count = 0
    for row in range(height):
        for col in range(width):
            count += mask[row, col] and (col == 0 or not mask[row, col - 1])
    runs = np.empty((count, 3), dtype=np.int64)
    at = -1
    for row in range(height):
        for col in range(width):
            if mask[row, col]:
                if col == 0 or not mask[row, col - 1]:
                    at += 1
                    runs[at, 0], runs[at, 1] = row, col
                runs[at, 2] = col + 1
    return runs


@kernel
def overlaps(runs):
    """Return (above, below): the indices of all pairs of touching runs in consecutive rows, sorted
    by the lower run.
    """
    above, below = np.empty(2 * len(runs), dtype=np.int64), np.empty(2 * len(runs), dtype=np.int64)
    count, upper = 0, 0
    for lower in range(len(runs)):
        row, begin, end = runs[lower]
        while upper < lower and (
            runs[upper, 0] < row - 1 or (runs[upper, 0] == row - 1 and runs[upper, 2] <= begin)
        ):
            upper += 1
        k = upper
        while k < lower and runs[k, 0] == row - 1 and runs[k, 1] < end:
            above[count], below[count] = k, lower
            count += 1
            k += 1
    return above[:count], below[:count]


@kernel
def chains_of(runs, above, below):
    """Return (chain, first, last, following) for the chains of runs.

    ``chain`` contains the chain of each run. ``first`` and ``last`` contain the first and the last
    run of each chain. ``following`` contains, for each run, the next run of the chain, or -1 at the
    end of the chain.
    """
    n = len(runs)
    up, down, over = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.full(n, -1)
    for k in range(len(above)):
        down[above[k]] += 1
        up[below[k]] += 1
        over[below[k]] = above[k]
    chain, following = np.empty(n, dtype=np.int64), np.full(n, -1)
    first, last = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    count = 0
    for k in range(n):
        if up[k] == 1 and down[over[k]] == 1:
            chain[k] = chain[over[k]]
            following[over[k]] = k
        else:
            chain[k] = count
            first[count] = k
            count += 1
        last[chain[k]] = k
    return chain, first[:count], last[:count], following


@kernel
def neighbours_of(chain, count, above, below):
    """Return (offsets, others): the chains that touch each chain.

    The chains that touch chain k are ``others[offsets[k]:offsets[k + 1]]``.
    """
    offsets = np.zeros(count + 1, dtype=np.int64)
    for k in range(len(above)):
        a, b = chain[above[k]], chain[below[k]]
        if a != b:
            offsets[a + 1] += 1
            offsets[b + 1] += 1
    for k in range(count):
        offsets[k + 1] += offsets[k]
    others, fill = np.empty(offsets[count], dtype=np.int64), offsets.copy()
    for k in range(len(above)):
        a, b = chain[above[k]], chain[below[k]]
        if a != b:
            others[fill[a]], others[fill[b]] = b, a
            fill[a] += 1
            fill[b] += 1
    return offsets, others


@kernel
def nearest_end(runs, first, last, row, col):
    """Return (squared distance, from_last, from_right) of the end of a chain that is nearest to the
    cell (row, col).

    ``from_last`` tells whether the end lies in the last run of the chain. ``from_right`` tells
    whether the end is the right end of its run.
    """
    best, from_last, from_right = np.int64(2) ** 62, False, False
    for bottom in (False, True):
        run = runs[last if bottom else first]
        for right in (False, True):
            there = run[2] - 1 if right else run[1]
            away = (run[0] - row) ** 2 + (there - col) ** 2
            if away < best:
                best, from_last, from_right = away, bottom, right
    return best, from_last, from_right


@kernel
def sweep(runs, first, last, following, previous, from_last, from_right, cells, at):
    """Write the cells of a chain to ``cells``, back and forth from the given end. Return the index
    after the last row written.
    """
    run = last if from_last else first
    while run >= 0:
        row, begin, end = runs[run]
        for k in range(end - begin):
            cells[at, 0] = row
            cells[at, 1] = end - 1 - k if from_right else begin + k
            at += 1
        from_right = not from_right
        run = previous[run] if from_last else following[run]
    return at


@kernel
def sweep_all(mask, cells):
    """Write all cells of the mask to ``cells`` in the order of the sweep: (row, col), int64, shape
    (N, 2).
    """
    runs = runs_of(mask)
    above, below = overlaps(runs)
    chain, first, last, following = chains_of(runs, above, below)
    previous = np.full(len(runs), -1)
    for k in range(len(runs)):
        if following[k] >= 0:
            previous[following[k]] = k
    count = len(first)
    offsets, others = neighbours_of(chain, count, above, below)
    visited, stack = np.zeros(count, dtype=np.bool_), np.empty(count, dtype=np.int64)
    pointer = offsets.copy()
    at = 0
    for root in range(count):
        if visited[root]:
            continue
        visited[root] = True
        stack[0], top = root, 1
        at = sweep(runs, first[root], last[root], following, previous, False, False, cells, at)
        while top > 0:
            here = stack[top - 1]
            found, from_last, from_right = choose(
                runs,
                first,
                last,
                offsets,
                others,
                visited,
                pointer,
                here,
                cells[at - 1, 0],
                cells[at - 1, 1],
            )
            if found < 0:
                top -= 1
                continue
            visited[found] = True
            stack[top] = found
            top += 1
            at = sweep(
                runs,
                first[found],
                last[found],
                following,
                previous,
                from_last,
                from_right,
                cells,
                at,
            )


@kernel
def choose(runs, first, last, offsets, others, visited, pointer, here, row, col):
    """Among the unvisited chains that touch chain ``here``, return (chain, from_last, from_right)
    of the end nearest to (row, col).

    If all chains that touch chain ``here`` are visited, the first number is -1.
    """
    while pointer[here] < offsets[here + 1] and visited[others[pointer[here]]]:
        pointer[here] += 1
    found, nearest, from_last, from_right = -1, np.int64(2) ** 62, False, False
    for k in range(pointer[here], min(pointer[here] + LOOK, offsets[here + 1])):
        other = others[k]
        if not visited[other]:
            away, bottom, right = nearest_end(runs, first[other], last[other], row, col)
            if away < nearest:
                found, nearest, from_last, from_right = other, away, bottom, right
    return found, from_last, from_right


_LESS = 1e-9
_LONGEST = 3  # maximum number of runs that one exchange moves together
_SPAN = 50  # number of places in the order within which a disturbance exchanges two parts
_LINKS = 50_000  # maximum of the product: number of disturbances times number of runs


@in_place_kernel
def step(ends, one, out, other, into):
    """Return the distance from one end of a run to one end of another run. End 0 is the first cell,
    and end 1 is the last cell.
    """
    rows, cols = ends[one, out, 0] - ends[other, into, 0], ends[one, out, 1] - ends[other, into, 1]
    return np.sqrt(rows * rows + cols * cols)


@in_place_kernel
def link(ends, backwards, one, other):
    """Return the distance from the exit of a run to the entry of the next run."""
    return step(ends, one, 1 - backwards[one], other, backwards[other])


@in_place_kernel
def reverse(order, backwards, begin, end):
    """Reverse the order and the directions of the runs from place ``begin`` to place ``end`` of the
    order.
    """
    low, high = begin, end
    while low < high:
        order[low], order[high] = order[high], order[low]
        low += 1
        high -= 1
    for k in range(begin, end + 1):
        backwards[order[k]] = 1 - backwards[order[k]]


@in_place_kernel
def exchange_link(ends, order, backwards, active, k):
    """Replace link k and another link by two links with a smaller total length (2-opt), if such
    links exist.

    Return whether the tour has changed.
    """
    n = len(order)
    best, other = -_LESS, -1
    for j in range(n):
        if j == k:
            continue
        low, high = min(j, k), max(j, k)
        before, first, last, after = order[low - 1], order[low], order[high - 1], order[high]
        if before == last:
            continue
        now = link(ends, backwards, before, first) + link(ends, backwards, last, after)
        then = step(ends, before, 1 - backwards[before], last, 1 - backwards[last])
        then += step(ends, first, backwards[first], after, backwards[after])
        if then - now < best:
            best, other = then - now, j
    if other < 0:
        return False
    low, high = min(other, k), max(other, k)
    for place in (low - 1, low, high - 1, high):
        active[order[place]] = True
    reverse(order, backwards, low, high - 1)
    return True


@in_place_kernel
def move_runs(ends, order, backwards, active, rest, i, count):
    """Move the ``count`` runs that begin at place i of the order to another place, if the tour
    becomes shorter (Or-opt).

    Return whether the tour has changed.
    """
    n = len(order)
    first, last = order[i], order[(i + count - 1) % n]
    before, after = order[i - 1], order[(i + count) % n]
    saved = (
        link(ends, backwards, before, first)
        + link(ends, backwards, last, after)
        - link(ends, backwards, before, after)
    )
    best, place, turned = _LESS, -1, False
    for k in range(n - count - 1):
        one, other = order[(i + count + k) % n], order[(i + count + k + 1) % n]
        out, into = 1 - backwards[one], backwards[other]
        there = link(ends, backwards, one, other)
        ahead = step(ends, one, out, first, backwards[first]) + step(
            ends, last, 1 - backwards[last], other, into
        )
        back = step(ends, one, out, last, 1 - backwards[last]) + step(
            ends, first, backwards[first], other, into
        )
        if saved + there - min(ahead, back) > best:
            best, place, turned = saved + there - min(ahead, back), k, back < ahead
    if place < 0:
        return False
    for k in range(n):
        rest[k] = order[(i + k) % n]
    for run in (before, after, first, last, rest[count + place], rest[count + place + 1]):
        active[run] = True
    for k in range(n):
        order[k] = (
            rest[count + k]
            if k <= place
            else rest[k - place - 1]
            if k <= place + count
            else rest[k]
        )
    if turned:
        reverse(order, backwards, place + 1, place + count)
    return True


@kernel
def exchange(ends, order, backwards, active, rest):
    """Shorten a closed tour of runs until no exchange at an active run makes the tour shorter.

    An active run is a run at which an exchange may still shorten the tour. After the last exchange,
    no run is active.
    """
    n, helped = len(order), True
    while helped:
        helped = False
        for run in range(n):
            if not active[run]:
                continue
            active[run] = False
            i = 0
            while order[i] != run:
                i += 1
            found = exchange_link(ends, order, backwards, active, i) or exchange_link(
                ends, order, backwards, active, (i + 1) % n
            )
            for count in range(1, _LONGEST + 1):
                for back in (0, count - 1):
                    if not found:
                        found = move_runs(
                            ends, order, backwards, active, rest, (i - back) % n, count
                        )
            if found:
                active[run], helped = True, True


@in_place_kernel
def length(ends, order, backwards):
    """Return the total length of all links of a tour."""
    total = 0.0
    for k in range(len(order)):
        total += link(ends, backwards, order[k - 1], order[k])
    return total


@kernel
def shorten(ends, order, backwards, disturbances):
    """Shorten a closed tour of runs by exchanges and by up to ``disturbances`` random disturbances.

    A disturbance exchanges two neighbouring parts of the order, and then the exchanges shorten the
    disturbed tour. The kernel keeps a disturbed tour only if it is shorter than the best tour so
    far.
    """
    n = len(order)
    if n <= _LONGEST + 2:
        return
    active, rest = np.ones(n, dtype=np.bool_), np.empty(n, dtype=np.int64)
    exchange(ends, order, backwards, active, rest)
    best = length(ends, order, backwards)
    kept, kept_backwards = order.copy(), backwards.copy()
    state, span = np.uint64(1), min(n - 1, _SPAN)
    drawn = np.empty(3, dtype=np.int64)
    for _ in range(min(disturbances, _LINKS // n)):
        for k in range(3):  # G. Marsaglia, "Xorshift RNGs", 2003
            state ^= state << np.uint64(13)
            state ^= state >> np.uint64(7)
            state ^= state << np.uint64(17)
            drawn[k] = np.int64((state >> np.uint64(33)) % np.uint64(n if k == 0 else span))
        i, part, parts = drawn[0], min(drawn[1], drawn[2]), max(drawn[1], drawn[2]) + 1
        if part == 0:
            continue
        for k in range(parts):
            order[(i + k) % n] = kept[(i + (k + part) % parts) % n]
        if state & np.uint64(1):
            for k in range(parts - part):
                backwards[order[(i + k) % n]] = 1 - backwards[order[(i + k) % n]]
        for k in (-1, 0, parts - part - 1, parts - part, parts - 1, parts):
            active[order[(i + k) % n]] = True
        exchange(ends, order, backwards, active, rest)
        found = length(ends, order, backwards)
        if found < best - _LESS:
            best = found
            kept[:], kept_backwards[:] = order, backwards
        else:
            order[:], backwards[:] = kept, kept_backwards


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
