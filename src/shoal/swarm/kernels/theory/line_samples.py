"""Random placements of particles on a line, and the numbers of moves for each placement."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO, has, lowest, put

FIRST, LAST, GAP, SPREAD, BOUNDARY, COVERAGE, PRINTED = 0, 1, 2, 3, 4, 5, 6
COLUMNS = 7


@in_place_kernel
def place(draws, cells, words, complement):
    """Fill ``words`` with a random subset of the cells 0 .. cells-1 by Floyd's algorithm, or with the complement of the subset.

    The random number ``draws[i]`` must be uniform on 0 .. cells - draws.size + i. All subsets of ``draws.size`` cells are then
    equally likely.
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
                # The last move to the left also moves the particles to the right of the first gap, so this gap becomes one cell
                # smaller.
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
    """For each row of ``draws``, place the particles and measure the placement. Write each result to a row of ``table``."""
    for trial in range(draws.shape[0]):
        place(draws[trial], cells, words, complement)
        measure(words, cells, table[trial])
