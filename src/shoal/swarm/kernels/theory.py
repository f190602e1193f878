"""Theory: costs of command sequences, and samples of the line."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import ONE, ZERO, has, lowest, put

FAR = 1 << 30


@in_place_kernel
def fewest_both_ways(free, offsets, required, particles, back, forth, costs, before, stack):
    """Return the smallest i + j for which i commands ``back`` and j commands ``forth`` are enough
    to reach every required cell.

    Commands other than ``back`` and ``forth`` cost nothing. The function tries each number i in
    turn. If the path to a required cell has at most i commands ``back``, the path needs a certain
    number of commands ``forth``. The number j is its maximum over all required cells.
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
            if required[cell]:
                most = max(most, costs[cell])
        best = min(best, a + most)
        a += 1
    return best


@in_place_kernel
def fewest_paid(free, offsets, barred, paid, costs, stack):
    """Reduce the entry of each cell in ``costs`` to the smallest cost of a path to the cell without
    the command ``barred``.

    The cost of a path is the initial cost of its first cell plus the number of commands ``paid`` on
    the path. If ``paid`` is -1, all commands count. If ``barred`` is -1, a path may use all
    commands. Before the call, the int64 array ``costs`` must contain the initial cost of each cell,
    or FAR if a path cannot begin at the cell.
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
                neighbour = cell + offsets[command]
                cost = level + (1 if command == paid or paid < 0 else 0)
                if cost < costs[neighbour]:
                    costs[neighbour] = cost
                    if cost == level and free[neighbour]:
                        stack[size] = neighbour
                        size += 1
        level += 1


@in_place_kernel
def ends_of(ahead, may_stay, free, required, cell, command, slides, ends):
    """Write where a particle can end after one command, and return how many ends there are. An end
    is 2 * cell, or 2 * cell + 1 if the particle has classified its required cell.
    """
    size, steps = 0, 0
    while True:
        if free[cell] and (may_stay[command, cell] or (steps == 1 and not slides)):
            ends[size] = 2 * cell
            size += 1
        if steps > 0 and required[cell]:
            ends[size] = 2 * cell + 1
            size += 1
        if not free[cell] or (steps == 1 and not slides) or ahead[command, cell] < 0:
            return size
        cell = ahead[command, cell]
        steps += 1


@in_place_kernel
def reach_pairs(
    ahead, may_stay, free, required, starts, several, slides, visited, queue, ends, fewest
):
    """Write the smallest number of commands for each pair of required cells to ``fewest``.

    A breadth-first search. In a state (x, y), the particles at x and y are both under way; in a
    state size + (x, y), the first has classified the required cell x, and the second is under way.
    ``ends`` holds the ends of both particles, and ``queue`` the states in the order of the search.
    """
    m = free.shape[0]
    size = m * m
    last = 0
    for i in range(starts.shape[0]):
        for j in range(starts.shape[0]):
            if several or i == j:
                state = starts[i] * m + starts[j]
                if not visited[state]:
                    visited[state] = True
                    queue[last] = state
                    last += 1
    first, commands = 0, 0
    while first < last:
        until = last
        commands += 1
        while first < until:
            state = queue[first]
            first += 1
            classified = state >= size
            x, y = (state % size) // m, state % m
            for command in range(ahead.shape[0]):
                first_count = 1
                if classified:
                    ends[0, 0] = 2 * x + 1
                else:
                    first_count = ends_of(
                        ahead, may_stay, free, required, x, command, slides, ends[0]
                    )
                second_count = ends_of(ahead, may_stay, free, required, y, command, slides, ends[1])
                for i in range(first_count):
                    for j in range(second_count):
                        end_a, end_b = ends[0, i], ends[1, j]
                        if end_b & 1 and not end_a & 1:
                            end_a, end_b = end_b, end_a
                        pair = (end_a >> 1) * m + (end_b >> 1)
                        if end_a & 1 and end_b & 1:
                            mirror = (end_b >> 1) * m + (end_a >> 1)
                            if fewest[pair] < 0:
                                fewest[pair] = commands
                            if fewest[mirror] < 0:
                                fewest[mirror] = commands
                            continue
                        if end_a & 1:
                            pair += size
                        if not visited[pair]:
                            visited[pair] = True
                            queue[last] = pair
                            last += 1


FIRST, LAST, GAP, SPREAD, BOUNDARY, COVERAGE, PRINTED = 0, 1, 2, 3, 4, 5, 6
COLUMNS = 7


@in_place_kernel
def place(draws, cells, words, complement):
    """Fill ``words`` with a random subset of the cells 0 .. cells-1 by Floyd's algorithm, or with
    the complement of the subset.

    The random number ``draws[i]`` must be uniform on 0 .. cells - draws.size + i. All subsets of
    ``draws.size`` cells are then equally likely.
    """
    for i in range(words.shape[0]):
        words[i] = ZERO
    lowest_limit = cells - draws.shape[0]
    for i in range(draws.shape[0]):
        cell = np.int64(draws[i])
        if has(words, 0, 0, cell):
            cell = lowest_limit + i
        put(words, 0, 0, cell)
    if complement:
        for i in range(words.shape[0]):
            words[i] = ~words[i]
        if cells & 63:
            words[-1] &= (ONE << np.uint64(cells & 63)) - ONE


@in_place_kernel
def measure(words, cells, row):
    """Write one table row with the numbers of moves and the gaps of a placement.

    The formulas are in ``docs/concepts/line.md``.
    """
    before, last, widest, most, bent = 0, 0, 0, 0, False
    for i in range(words.shape[0]):
        word = words[i]
        while word != ZERO:
            position = 64 * i + lowest(word) + 1
            word &= word - ONE
            if last == 0:
                before = position
            else:
                gap = position - last - 1
                widest = max(widest, gap)
                # The last move to the left also moves the particles to the right of the first gap,
                # so this gap becomes one cell smaller.
                if gap > 0 and not bent:
                    bent = True
                    gap -= 1
                most = max(most, gap)
            last = position
    after = cells - last
    back = before + after + (1 if bent else 0)
    row[FIRST], row[LAST] = before, after + 1
    row[GAP] = max(widest, before - 1, after)
    row[SPREAD] = last - before
    row[BOUNDARY] = before + back
    row[COVERAGE] = before + max(back, most)
    row[PRINTED] = before + 1 + max(before + after, widest)


@in_place_kernel
def trials(draws, cells, words, complement, table):
    """For each row of ``draws``, place the particles and measure the placement. Write each result
    to a row of ``table``.
    """
    for trial in range(draws.shape[0]):
        place(draws[trial], cells, words, complement)
        measure(words, cells, table[trial])
