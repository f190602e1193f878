"""Sweep: cells that follow one another on a tour, and what it costs to search some."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shoal.search.allocation.tour_cost import Course, Floats
from shoal.search.tours.bitset import turned


@dataclass(frozen=True)
class Sweep:
    """Cells to search one after another: ``count`` of them from number ``first`` of the tour on, forwards (1) or backwards (-1)."""

    first: int
    count: int
    step: int = 1

    def next_of(self, wanted: int, n: int) -> int | None:
        """Return the first of its cells that is in a set, given as bits, of a tour of n cells; None if none is.

        Examples
        --------
        >>> Sweep(3, 4, -1).next_of(0b100101, 8)
        2
        """
        if self.step > 0:
            here = turned(wanted, self.first, n) & ((1 << self.count) - 1)
            return ((here & -here).bit_length() - 1 + self.first) % n if here else None
        low = self.first - self.count + 1
        here = turned(wanted, low, n) & ((1 << self.count) - 1)
        return (here.bit_length() - 1 + low) % n if here else None


def way_to(course: Course, first: int, place: Floats, start: int | None) -> float:
    """Return how far it is from a place to a cell: straight, or as far as from the cell ``start`` if that is given and farther."""
    straight = float(np.linalg.norm(course.points[first] - place))
    return straight if start is None or start == first else max(straight, course.length(start, first))


def work_time(course: Course, sweeps: Sequence[Sweep], place: Floats, start: int | None = None) -> float:
    """Return what sweeps cost a robot at a place; it goes straight to the first, or as the ways are from the cell ``start``."""
    total, n = 0.0, len(course)
    here: int | None = None
    for sweep in sweeps:
        first = sweep.first % n
        total += way_to(course, first, place, start) if here is None else course.way(here, first)
        total += course.search_cost(sweep.first, sweep.count, sweep.step)
        here = (sweep.first + sweep.step * (sweep.count - 1)) % n
    return total


def numbers_of(sweeps: Sequence[Sweep], n: int) -> NDArray[np.int64]:
    """Return the cells of sweeps in the order of the visit, as numbers on a tour of n cells; int64, shape (k,)."""
    found = [(sweep.first + sweep.step * np.arange(sweep.count)) % n for sweep in sweeps]
    return np.concatenate([np.zeros(0, dtype=np.int64), *found])
