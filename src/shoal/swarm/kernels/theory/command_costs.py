"""Minimum numbers of commands of each direction that a particle needs to reach cells: the parts of lower bounds.

Cells are plain arrays, row by row with a rim: cell + offset is the next cell. A wall may be entered, which probes it, but no path
continues from there.
"""

from __future__ import annotations

from shoal.jit import in_place_kernel

FAR = 1 << 30


@in_place_kernel
def fewest_both_ways(free, offsets, wanted, particles, back, forth, costs, before, stack):
    """Return the smallest a + b for which a commands ``back`` and b commands ``forth`` (and any others) reach every wanted cell.

    For each a in turn, b is the largest number of commands ``forth`` that any cell needs with at most a commands ``back``.
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
    """Lower ``costs``, int64, to the fewest commands ``paid`` with which each cell can be reached without the command ``barred``.

    ``costs`` contains each cell's initial cost, FAR if a path cannot begin there. Other commands cost nothing. A ``paid`` of -1
    means all commands, a ``barred`` of -1 none.
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
