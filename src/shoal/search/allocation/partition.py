"""Partition of a tour into one part for each robot, and the cost of searching a set of cells."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.search.allocation.allocate import Allocation, arcs_of, time_of
from shoal.search.allocation.arcs import Arc
from shoal.search.allocation.tour_cost import Floats, TourCost
from shoal.search.tours.bitset import runs


@dataclass(frozen=True, slots=True)
class Part:
    """The part of a tour that one robot searches: its arcs, and the bitset of the cells in these arcs.

    The attribute ``first`` is the first cell of the part along the tour. If a robot has no arcs, ``first`` is its start cell.
    """

    robot: int
    first: int
    arcs: tuple[Arc, ...]
    bits: int


@lru_cache(maxsize=256)
def partition(tour_cost: TourCost, allocator: str, robots: tuple[tuple[int, int, float, int], ...]) -> tuple[Part, ...]:
    """Return the parts of all robots, sorted by the first cell of each part on the tour.

    Parameters
    ----------
    tour_cost : TourCost
    allocator : str
        Name of the allocator, as in `allocate`.
    robots : tuple of (number, start, rate, width)
        The robots, sorted by number so that all robots compute equal partitions. The start is the tour index of a robot's start
        cell, the rate is the robot's speed, and the width is the width of the robot's footprint in cells.
    """
    n = len(tour_cost)
    _, starts, rates, widths = zip(*robots, strict=True)
    parts = []
    for (number, start, *_), arcs in zip(robots, arcs_of(tour_cost, allocator, starts, rates, widths), strict=True):
        bits, lows = 0, []
        for arc in arcs:
            bits |= arc.bits(n)
        # Two arcs of a robot meet at its start. The part begins with the run of cells that no other cell of the part precedes.
        lows = [first for first, _ in runs(bits, start, n) if not bits >> ((first - 1) % n) & 1]
        first = lows[0] if lows else start
        parts.append((first, bool(bits), number, Part(number, first, arcs, bits)))
    return tuple(part for *_, part in sorted(parts, key=lambda entry: entry[:3]))


def in_passes(
    tour_cost: TourCost, allocation: Allocation, robots: tuple[tuple[int, int, float, int], ...], places: Floats, count: int
) -> Allocation:
    """Return an allocation in which ``count`` different robots search each cell.

    After its own part, each robot also searches the parts of the next ``count`` - 1 robots along the tour.

    Parameters
    ----------
    tour_cost : TourCost
    allocation : Allocation
        The allocation in which one robot searches each cell.
    robots : tuple of (number, start, rate, width)
        The robots as in `partition`, numbered from 1.
    places : ndarray of float64, shape (m, d)
        Positions of the robots in cell sides, as in `TourCost.points`.
    count : int
        Number of different robots that search each cell.
    """
    parts = partition(tour_cost, allocation.allocator, robots)
    work = {
        part.robot: tuple(arc for k in range(count) for arc in (parts[k:] + parts[:k])[index].arcs)
        for index, part in enumerate(parts)
    }
    times = [
        time_of(tour_cost, work[number], place, start, width) / rate
        for (number, start, rate, width), place in zip(robots, places, strict=True)
    ]
    bound = count * allocation.lower_bound
    return replace(allocation, times=np.array(times), lower_bound=bound, work=tuple(work[number] for number, *_ in robots))


def cost_of_all(tour_cost: TourCost, wanted: int, here: int, fresh: bool, closed: int = 0) -> float:
    """Return the cost, in cells, of searching all cells of the bitset ``wanted`` in tour order, starting from the cell ``here``.

    The parameters ``fresh`` and ``closed`` have the same meaning as in `TourCost.way`.
    """
    total, n = 0.0, len(tour_cost)
    for first, count in runs(wanted, here, n):
        total += tour_cost.way(here, first, fresh=fresh, closed=closed)
        total += tour_cost.search_cost(first, count)
        here, fresh = (first + count - 1) % n, False
    return total
