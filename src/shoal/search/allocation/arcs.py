"""Arcs: sequences of consecutive cells on a tour, and the cost of searching arcs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search.allocation.tour_cost import Floats, TourCost
from shoal.search.tours.bitset import arc_bits, runs, turned


@dataclass(frozen=True)
class Arc:
    """Consecutive cells of the tour that a robot searches in order.

    Parameters
    ----------
    first : int
        Tour index of the cell that the robot searches first.
    count : int
        Number of cells in the arc.
    step : int
        Direction of the search: 1 for forwards along the tour, -1 for backwards.
    """

    first: int
    count: int
    step: int = 1

    def bits(self, n: int) -> int:
        """Return the bitset of the arc's cells, for a tour of n cells."""
        return arc_bits((self.first if self.step > 0 else self.first - self.count + 1) % n, self.count, n)

    def stretches(self, wanted: int, n: int) -> list[tuple[int, int]]:
        """Return the sections of the arc whose cells are in the bitset ``wanted``, on a tour of n cells.

        A section is a pair: the tour index of the cell that the robot searches first, and the number of cells. The sections
        are in the order of the search.

        Examples
        --------
        >>> Arc(3, 4, -1).stretches(0b001101, 8)
        [(3, 2), (0, 1)]
        """
        low = self.first if self.step > 0 else self.first - self.count + 1
        found = list(runs(self.bits(n) & wanted, low, n))
        return found if self.step > 0 else [((first + count - 1) % n, count) for first, count in reversed(found)]

    def next_of(self, wanted: int, n: int) -> int | None:
        """Return the tour index of the arc's first cell that is in the bitset ``wanted``, for a tour of n cells.

        The first cell is the cell that the robot searches first. The result is None if no cell of the arc is in the bitset.

        Examples
        --------
        >>> Arc(3, 4, -1).next_of(0b100101, 8)
        2
        """
        if self.step > 0:
            here = turned(wanted, self.first, n) & ((1 << self.count) - 1)
            return ((here & -here).bit_length() - 1 + self.first) % n if here else None
        low = self.first - self.count + 1
        here = turned(wanted, low, n) & ((1 << self.count) - 1)
        return (here.bit_length() - 1 + low) % n if here else None


def way_to(tour_cost: TourCost, first: int, place: Floats, start: int | None) -> float:
    """Return the straight distance, in cell sides, from the position ``place`` to the cell ``first``.

    If a cell ``start`` is given, the function also computes the length of the path around walls from ``start`` to ``first``. The
    result is the larger of this length and the straight distance.
    """
    straight = float(np.linalg.norm(tour_cost.points[first] - place))
    return straight if start is None or start == first else max(straight, tour_cost.length(start, first))


def work_time(tour_cost: TourCost, arcs: Sequence[Arc], place: Floats, start: int | None = None) -> float:
    """Return the cost, in cells, of searching arcs one after another, for a robot at the position ``place``.

    The cost contains the path to the first arc, as computed by `way_to`.
    """
    total, n = 0.0, len(tour_cost)
    here: int | None = None
    for arc in arcs:
        first = arc.first % n
        total += way_to(tour_cost, first, place, start) if here is None else tour_cost.way(here, first)
        total += tour_cost.search_cost(arc.first, arc.count, arc.step)
        here = (arc.first + arc.step * (arc.count - 1)) % n
    return total


def numbers_of(arcs: Sequence[Arc], n: int) -> NDArray[np.int64]:
    """Return the cells of arcs in the order of the search, as indices on a tour of n cells; int64, shape (k,)."""
    found = [(arc.first + arc.step * np.arange(arc.count)) % n for arc in arcs]
    return np.concatenate([np.zeros(0, dtype=np.int64), *found])
