"""Partition of a tour: the part of each robot, takeovers, and the cost of the remaining cells."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.search.allocation.allocate import Allocation, Arc, arcs_of, time_of
from shoal.search.allocation.tour_cost import Floats, TourCost
from shoal.search.tours.bitset import runs


@dataclass(frozen=True, slots=True)
class Part:
    """The part of one robot: its arcs, and the same cells as a bitset. It starts at ``first``. A robot in reserve has no arcs."""

    robot: int
    first: int
    arcs: tuple[Arc, ...]
    bits: int


@lru_cache(maxsize=256)
def partition(tour_cost: TourCost, allocator: str, robots: tuple[tuple[int, int, float, int], ...]) -> tuple[Part, ...]:
    """Return the parts of all robots in the order of the tour. In this order, the position of a robot in reserve is its start.

    Parameters
    ----------
    tour_cost : TourCost
    allocator : str
    robots : tuple of (number, start, rate, width)
        The robots in increasing order of their numbers, so that all robots compute the same partition.
    """
    n = len(tour_cost)
    _, starts, rates, widths = zip(*robots, strict=True)
    parts = []
    for (number, start, *_), arcs in zip(robots, arcs_of(tour_cost, allocator, starts, rates, widths), strict=True):
        bits, lows = 0, []
        for arc in arcs:
            bits |= arc.bits(n)
        # Two arcs meet at the start. The part begins at the arc that has no arc of the part before it.
        lows = [first for first, _ in runs(bits, start, n) if not bits >> ((first - 1) % n) & 1]
        first = lows[0] if lows else start
        parts.append((first, bool(bits), number, Part(number, first, arcs, bits)))
    return tuple(part for *_, part in sorted(parts, key=lambda entry: entry[:3]))


def in_passes(
    tour_cost: TourCost, allocation: Allocation, robots: tuple[tuple[int, int, float, int], ...], places: Floats, count: int
) -> Allocation:
    """Return an allocation in which each cell is searched by ``count`` different robots.

    After its own part, each robot also searches the next parts along the tour.

    Parameters
    ----------
    robots : tuple of (number, start, rate, width)
        As in `partition`, numbered from 1.
    places : ndarray of float64, shape (m, d)
        Positions of the robots in the units of `TourCost.points`.
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
    """Return the cost of searching the cells of the bitset ``wanted`` along the tour from ``here``, avoiding ``closed`` cells."""
    total, n = 0.0, len(tour_cost)
    for first, count in runs(wanted, here, n):
        total += tour_cost.way(here, first, fresh=fresh, closed=closed)
        total += tour_cost.search_cost(first, count)
        here, fresh = (first + count - 1) % n, False
    return total
