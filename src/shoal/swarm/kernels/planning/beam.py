"""Beam search over simulated commands. The search keeps the best states at each depth, without
duplicates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.prediction.forward_model import (
    advance,
    copy_state,
    digest,
    immediate_gains,
)


class Beam(NamedTuple):
    """Working memory of the beam search: the states at two successive depths.

    The search uses the two halves of each array alternately.
    """

    states: NDArray[np.uint64]  # (2, width, boards, words)
    plans: NDArray[np.int8]  # (2, width, depth)
    values: NDArray[np.float64]  # (2, width): discounted numbers of classified cells
    marks: NDArray[np.uint64]  # (2, width): hashes of the states
    child: NDArray[np.uint64]  # the state after one more command


@in_place_kernel
def place_for(values, marks, size, value, mark):
    """Return the place in the beam for a new state, or -1 if the beam rejects the new state.

    If the beam contains an equal state, the new state replaces the equal state only if the new
    state has a higher value. If the beam has a free place, the new state takes the free place. In a
    full beam, the new state replaces the worst state only if the new state has a higher value.
    """
    for i in range(size):
        if marks[i] == mark:
            return i if value > values[i] else -1
    if size < values.shape[0]:
        return size
    worst = 0
    for i in range(1, size):
        if values[i] < values[worst]:
            worst = i
    return worst if value > values[worst] else -1


@in_place_kernel
def lowest_value(values, size):
    """Return the value that a new state must exceed: the worst value in a full beam, or -1 if the
    beam has a free place.
    """
    if size < values.shape[0]:
        return -1.0
    worst = values[0]
    for i in range(1, size):
        worst = min(worst, values[i])
    return worst


@in_place_kernel
def search_beam(scene, root, beam, gains, discount, width, depth):
    """Search from the state ``root``. Return (index of the half of ``beam`` with the leaves, number
    of leaves, simulated moves).

    The leaves are the states at the last depth. The search ranks states by the discounted number of
    classified cells.
    """
    copy_state(root, beam.states[0, 0])
    beam.values[0, 0], beam.marks[0, 0] = 0.0, digest(root)
    old, size, weight, simulated = 0, np.int64(1), 1.0, 0
    child = beam.child
    for level in range(depth):
        new, count = 1 - old, np.int64(0)
        values, marks = beam.values[new, :width], beam.marks[new]
        for parent in range(size):
            immediate_gains(scene, beam.states[old, parent], gains)
            for command in range(gains.shape[0]):
                value = beam.values[old, parent] + weight * gains[command]
                if value <= lowest_value(values, count):
                    continue
                copy_state(beam.states[old, parent], child)
                advance(scene, child, np.int64(command))
                simulated += 1
                mark = digest(child)
                if mark == beam.marks[old, parent]:  # the command has moved nothing
                    continue
                at = place_for(values, marks, count, value, mark)
                if at < 0:
                    continue
                count = max(count, at + 1)
                copy_state(child, beam.states[new, at])
                values[at], marks[at] = value, mark
                for i in range(level):
                    beam.plans[new, at, i] = beam.plans[old, parent, i]
                beam.plans[new, at, level] = command
        if count == 0:
            return old, 0, simulated
        old, size = new, count
        weight *= discount
    return old, size, simulated


@in_place_kernel
def take_best(values, size):
    """Return the index of the best leaf, and clear the value of this leaf, so that the next call
    returns the next best leaf.
    """
    best = 0
    for i in range(1, size):
        if values[i] > values[best]:
            best = i
    values[best] = -1.0
    return best
