"""Beam search over imagined commands: the best states of each depth are kept, each once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.foresight import advance, copy_state, digest, directions


class Beam(NamedTuple):
    """Work space: the states of two depths, which take turns."""

    states: NDArray[np.uint64]  # (2, width, boards, words)
    plans: NDArray[np.int8]  # (2, width, depth)
    values: NDArray[np.float64]  # (2, width): cells settled, discounted
    marks: NDArray[np.uint64]  # (2, width): hashes
    child: NDArray[np.uint64]  # a state


@kernel
def place_for(values, marks, size, value, mark):
    """Return where a child goes: a free place, that of the same state or of the worst if it is better; -1 if nowhere."""
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


@kernel
def search_beam(scene, root, beam, discount):
    """Search from a state; return (which of the two halves holds the leaves, how many they are, moves imagined)."""
    copy_state(root, beam.states[0, 0])
    beam.values[0, 0], beam.marks[0, 0] = 0.0, digest(root)
    depth, old, size, weight, imagined = beam.plans.shape[2], 0, 1, 1.0, 0
    for level in range(depth):
        new, count = 1 - old, 0
        for parent in range(size):
            for command in range(directions(scene)):
                copy_state(beam.states[old, parent], beam.child)
                value = beam.values[old, parent] + weight * advance(scene, beam.child, command)
                imagined += 1
                mark = digest(beam.child)
                if mark == beam.marks[old, parent]:  # nothing has moved
                    continue
                at = place_for(beam.values[new], beam.marks[new], count, value, mark)
                if at < 0:
                    continue
                count = max(count, at + 1)
                copy_state(beam.child, beam.states[new, at])
                beam.values[new, at], beam.marks[new, at] = value, mark
                for i in range(level):
                    beam.plans[new, at, i] = beam.plans[old, parent, i]
                beam.plans[new, at, level] = command
        if count == 0:
            return old, 0, imagined
        old, size = new, count
        weight *= discount
    return old, size, imagined


@kernel
def take_best(values, size):
    """Return the index of the best leaf, and forget its value so that the next call returns the next."""
    best = 0
    for i in range(1, size):
        if values[i] > values[best]:
            best = i
    values[best] = -1.0
    return best
