"""The minimum number of commands of one direction, or of two opposite directions, that particles need to reach cells.

These minimum numbers give lower bounds on the number of moves.

The grids are flat arrays with a rim: the index of the next cell is the index of a cell plus an offset. A particle may try to enter
a wall, which classifies the wall, but no path continues from a wall.
"""

from __future__ import annotations

from shoal.jit import in_place_kernel

FAR = 1 << 30


@in_place_kernel
def fewest_both_ways(free, offsets, wanted, particles, back, forth, costs, before, stack):
    """Return the smallest i + j for which i commands ``back`` and j commands ``forth`` are enough to reach every wanted cell.

    Commands other than ``back`` and ``forth`` cost nothing. The function tries each number i in turn. If the path to a wanted cell
    has at most i commands ``back``, the path needs a certain number of commands ``forth``. The number j is the maximum of this
    number over all wanted cells.
    """
    best = FAR
    for cell in range(costs.shape[0]):
        costs[cell] = 0 if particles[cell] else FAR
    a = 0
    while a < best:
        if a > 0:
            for cell in range(costs.shape[0]):
                before[cell] = costs[cell]
            for cell in range(costs.shape[0]):
                if free[cell] and before[cell] < costs[cell + offsets[back]]:
                    costs[cell + offsets[back]] = before[cell]
        fewest_paid(free, offsets, back, forth, costs, stack)
        most = 0
        for cell in range(costs.shape[0]):
            if wanted[cell]:
                most = max(most, costs[cell])
        best = min(best, a + most)
        a += 1
    return best


@in_place_kernel
def fewest_paid(free, offsets, barred, paid, costs, stack):
    """Reduce the entry of each cell in ``costs`` to the smallest cost of a path to the cell without the command ``barred``.

    The cost of a path is the initial cost of its first cell plus the number of commands ``paid`` on the path. If ``paid`` is -1,
    all commands count. If ``barred`` is -1, a path may use all commands. Before the call, the int64 array ``costs`` must contain
    the initial cost of each cell, or FAR if a path cannot begin at the cell.
    """
    level = 0
    while True:
        size, higher = 0, False
        for cell in range(costs.shape[0]):
            if costs[cell] == level and free[cell]:
                stack[size] = cell
                size += 1
            elif level < costs[cell] < FAR:
                higher = True
        if size == 0 and not higher:
            return
        while size > 0:
            size -= 1
            cell = stack[size]
            for command in range(offsets.shape[0]):
                if command == barred:
                    continue
                there = cell + offsets[command]
                cost = level + (1 if command == paid or paid < 0 else 0)
                if cost < costs[there]:
                    costs[there] = cost
                    if cost == level and free[there]:
                        stack[size] = there
                        size += 1
        level += 1
