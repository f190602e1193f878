"""Exchanges of cells that make a closed tour shorter, where each turn counts as additional length.

The array ``order`` (N) contains the cells in the order of the tour, and ``place`` (N) contains the
index of each cell in ``order``. The array ``points`` (N, 2) contains the viewpoints of the cells in
cell sides. Row k of ``beside`` (N, 9) contains the 3 x 3 cells around cell k, row by row, or -1
where no vehicle can move directly from cell k.

An exchange replaces up to three links of the tour. The rows of ``cut`` are the replaced links, and
the rows of ``new`` are the new links.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel

_LESS = 1e-7
_LONGEST = 3  # maximum number of consecutive cells that are moved together
_STRAIGHT = 0.01745  # sine of an angle of one degree


@in_place_kernel
def distance(points, one, other):
    """Return the distance between the viewpoints of two cells."""
    x, y = points[one, 0] - points[other, 0], points[one, 1] - points[other, 1]
    return np.sqrt(x * x + y * y)


@in_place_kernel
def bends(points, before, here, after):
    """Return whether the direction changes by more than one degree in the cell ``here``."""
    x, y = points[here, 0] - points[before, 0], points[here, 1] - points[before, 1]
    u, v = points[after, 0] - points[here, 0], points[after, 1] - points[here, 1]
    size = np.sqrt((x * x + y * y) * (u * u + v * v))
    return size > 1e-9 and (x * u + y * v <= 0 or abs(x * v - y * u) > _STRAIGHT * size)


@in_place_kernel
def added_cost(points, order, place, bent, turn, cut, new, count, most):
    """Return the added cost (length plus turns) of replacing ``count`` links, or infinity if this
    cost exceeds ``most``.

    ``bent`` (N) is 1 for each cell in which the tour turns, otherwise 0.
    """
    n, total, turns = len(order), 0.0, 0
    for k in range(count):
        total += distance(points, new[k, 0], new[k, 1]) - distance(points, cut[k, 0], cut[k, 1])
        turns += bent[cut[k, 0]] + bent[cut[k, 1]]
    if total - turn * turns > most:
        return np.inf
    for k in range(2 * count):
        here, known = cut[k // 2, k % 2], False
        for j in range(k):
            known = known or cut[j // 2, j % 2] == here
        if known:
            continue
        before, after = order[place[here] - 1], order[(place[here] + 1) % n]
        one, other, free_one, free_other = before, after, False, False
        for j in range(count):
            for side in range(2):
                if cut[j, side] == here and cut[j, 1 - side] == before and not free_one:
                    free_one = True
                elif cut[j, side] == here and cut[j, 1 - side] == after:
                    free_other = True
        for j in range(count):
            for side in range(2):
                if new[j, side] == here and free_one:
                    one, free_one = new[j, 1 - side], False
                elif new[j, side] == here and free_other:
                    other, free_other = new[j, 1 - side], False
        total += turn * (np.int64(bends(points, one, here, other)) - bent[here])
    return total


@in_place_kernel
def in_sight(cells, beside, one, other):
    """Return whether a vehicle can move from one cell to another along the cells on the straight
    line between the two cells.
    """
    rows, cols = cells[other, 0] - cells[one, 0], cells[other, 1] - cells[one, 1]
    steps, here = max(abs(rows), abs(cols)), one
    for k in range(1, steps + 1):
        row = np.int64(np.floor(cells[one, 0] + rows * k / steps + 0.5))
        col = np.int64(np.floor(cells[one, 1] + cols * k / steps + 0.5))
        here = beside[here, 3 * (row - cells[here, 0] + 1) + col - cells[here, 1] + 1]
        if here < 0:
            return False
    return True


@in_place_kernel
def reverse(order, place, first, last):
    """Reverse the tour from place ``first`` to place ``last``, across the end of ``order`` if
    ``first`` is after ``last``.
    """
    n = len(order)
    count = (last - first) % n + 1
    if 2 * count > n:
        first, last, count = (last + 1) % n, (first - 1) % n, n - count
    for _ in range(count // 2):
        one, other = order[first], order[last]
        order[first], order[last], place[one], place[other] = other, one, last, first
        first, last = (first + 1) % n, (last - 1) % n


@in_place_kernel
def move(order, place, first, count, behind, backwards, moved):
    """Move ``count`` consecutive cells, beginning with the cell at place ``first``, so that they
    follow the cell ``behind``.

    The kernel shifts the cells that lie between the old and the new place on the shorter way round
    the tour.
    """
    n = len(order)
    for k in range(count):
        moved[k] = order[(first + k) % n]
    ahead = (place[behind] - first - count + 1) % n
    step, base = (1, first) if 2 * ahead <= n else (-1, first + count - 1)
    passed = ahead if step > 0 else n - count - ahead
    for k in range(passed):
        cell, to = order[(base + step * (count + k)) % n], (base + step * k) % n
        order[to], place[cell] = cell, to
    begin = first + ahead if step > 0 else first - passed
    for k in range(count):
        cell, to = moved[count - 1 - k if backwards else k], (begin + k) % n
        order[to], place[cell] = cell, to


@in_place_kernel
def best_reversal(points, cells, beside, order, place, bent, turn, here, cut, new, found):
    """Write to ``found`` the best exchange of two links in which a new link joins the cell ``here``
    to a cell beside it.

    The first three entries of ``found`` are the saving, and the first and the last place of the
    reversed part of the tour.
    """
    n = len(order)
    for slot in range(9):
        other = beside[here, slot]
        if other < 0 or other == here:
            continue
        for side in (1, -1):
            next_here, next_other = (
                order[(place[here] + side) % n],
                order[(place[other] + side) % n],
            )
            if other == next_here or here == next_other:
                continue
            cut[0, 0], cut[0, 1], cut[1, 0], cut[1, 1] = here, next_here, other, next_other
            new[0, 0], new[0, 1], new[1, 0], new[1, 1] = here, other, next_here, next_other
            saved = -added_cost(points, order, place, bent, turn, cut, new, 2, -found[0])
            if saved > found[0] and in_sight(cells, beside, next_here, next_other):
                found[0], found[1], found[4] = saved, place[next_here if side > 0 else here], 0
                found[2] = place[other if side > 0 else next_other]


@in_place_kernel
def best_move(points, cells, beside, order, place, bent, turn, here, cut, new, found):
    """Write to ``found`` the best move of up to three consecutive cells to a place beside a
    neighbour of the cell ``here``.

    The moved cells begin or end with the cell ``here``. The entries of ``found`` are the saving,
    the first place of the moved cells, the cell that they follow after the move, 1 if their order
    is reversed, and the number of moved cells.
    """
    n = len(order)
    for k in range(18 * _LONGEST):
        slot, count = (
            k // (2 * _LONGEST),
            k // 2 % _LONGEST,
        )  # ``count`` is the number of moved cells minus 1
        other, first = beside[here, slot], (place[here] - k % 2 * count) % n
        if other < 0 or other == here or (place[other] - first) % n <= count:
            continue
        low, high = order[first], order[(first + count) % n]
        before, after, far = (
            order[first - 1],
            order[(first + count + 1) % n],
            high if here == low else low,
        )
        for side in (1, -1):
            beyond = order[(place[other] + side) % n]
            if (place[beyond] - first) % n <= count:
                continue
            cut[0, 0], cut[0, 1], cut[1, 0], cut[1, 1], cut[2, 0], cut[2, 1] = (
                before,
                low,
                high,
                after,
                other,
                beyond,
            )
            new[0, 0], new[0, 1], new[1, 0], new[1, 1], new[2, 0], new[2, 1] = (
                before,
                after,
                other,
                here,
                far,
                beyond,
            )
            saved = -added_cost(points, order, place, bent, turn, cut, new, 3, -found[0])
            if (
                saved > found[0]
                and in_sight(cells, beside, before, after)
                and in_sight(cells, beside, far, beyond)
            ):
                found[0], found[1], found[2] = saved, first, other if side > 0 else beyond
                found[3], found[4] = (here if side > 0 else far) != low, count + 1


@kernel
def shorten(points, cells, beside, order, turn):
    """Exchange links and move cells until no exchange at an active cell saves length or turns.
    ``turn`` is the cost of a turn.

    At first, each cell at a turn, or at a link whose length is not 1, is active together with the
    cells beside it. After each exchange, the cells at the ends of the new links become active.
    """
    n = len(order)
    if n < 8:
        return
    place, bent = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    for k in range(n):
        place[order[k]] = k
        bent[order[k - 1]] = bends(points, order[k - 2], order[k - 1], order[k])
    queue, active, head, count = np.empty(n, dtype=np.int64), np.zeros(n, dtype=np.bool_), 0, 0
    for k in range(n):
        cell, plain = order[k], not bent[order[k]]
        for other in (order[k - 1], order[(k + 1) % n]):
            plain = plain and abs(distance(points, cell, other) - 1.0) < _LESS
        for slot in range(0 if plain else 9):
            other = beside[cell, slot]
            if other >= 0 and not active[other]:
                active[other] = True
                queue[count] = other
                count += 1
    cut, new, found = (
        np.empty((3, 2), dtype=np.int64),
        np.empty((3, 2), dtype=np.int64),
        np.empty(5),
    )
    near, moved = np.empty(6, dtype=np.int64), np.empty(_LONGEST, dtype=np.int64)
    while count > 0:
        here = queue[head]
        head, count = (head + 1) % n, count - 1
        active[here] = False
        while True:
            found[0] = _LESS
            best_reversal(points, cells, beside, order, place, bent, turn, here, cut, new, found)
            best_move(points, cells, beside, order, place, bent, turn, here, cut, new, found)
            if found[0] == _LESS:
                break
            first, second, together = np.int64(found[1]), np.int64(found[2]), np.int64(found[4])
            last = first + together - 1 if together else second
            link = place[second] if together else second
            near[0], near[1], near[2] = order[first - 1], order[first], order[last % n]
            near[3], near[4], near[5] = order[(last + 1) % n], order[link], order[(link + 1) % n]
            if together:
                move(order, place, first, together, second, found[3] > 0, moved)
            else:
                reverse(order, place, first, second)
            for k in range(6):
                at = place[near[k]]
                bent[near[k]] = bends(points, order[at - 1], near[k], order[(at + 1) % n])
                if not active[near[k]]:
                    active[near[k]] = True
                    queue[(head + count) % n] = near[k]
                    count += 1
