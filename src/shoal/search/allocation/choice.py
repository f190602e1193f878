"""Candidates for a plan, and the choice of the allocation with the shortest planned search time.

The planned search time includes the flights home to recharge.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.search.allocation.allocate import Allocation, allocate
from shoal.search.allocation.allocators import Indices
from shoal.search.allocation.arcs import numbers_of
from shoal.search.allocation.tour_cost import Floats, TourCost

_COMPARED = 100_000  # cells times robots: above this, only the first allocation is evaluated
_WIDE = 10_000  # the same limit for robots with wide footprints


@dataclass(frozen=True)
class Candidate:
    """One possible plan that the planner compares with other plans: an angle, a tour, possibly an allocation, and the search time.

    Parameters
    ----------
    angle : float
        Direction in which most of the tour's length runs, in degrees counter-clockwise from the x axis.
    tour : str
        Name of the tour.
    cells : float
        Search time, in units of the time in which a robot of speed 1 searches one cell. With an allocation, the search time is the
        time until all robots finish. Without an allocation, the search time is the time in which one robot follows the whole tour,
        including turns.
    allocation : str, optional
        Name of the allocator.
    seconds : float, optional
        Time until the last vehicle is back, if the problem names a vehicle; ``cells`` is then this time in cells.
    """

    angle: float
    tour: str
    cells: float
    allocation: str | None = None
    seconds: float | None = None

    def report(self) -> dict[str, Any]:
        """Return the candidate as a mapping that can be written as JSON."""
        told = {"angle_degrees": self.angle, "tour": self.tour, "cells": self.cells}
        told |= {} if self.allocation is None else {"allocation": self.allocation}
        return told | ({} if self.seconds is None else {"seconds": self.seconds})


def compared_allocations(
    tour_cost: TourCost,
    starts: Indices,
    allocators: Sequence[str],
    *,
    rates: Floats,
    places: Floats,
    widths: Indices,
    energy: float = inf,
    recharge: float = 0.0,
) -> list[tuple[Allocation, float]]:
    """Return the allocations of all compared allocators, each with the time until all robots finish, the fastest first.

    The unit of all times is the time in which a robot of speed 1 searches one cell.

    Parameters
    ----------
    tour_cost : TourCost
    starts, rates, places, widths : ndarray
        Start cells, speeds, positions and footprint widths of the robots, as in `allocate`.
    allocators : sequence of str
        Names of the allocators to compare. Of several equally fast allocations, the one whose allocator comes first is first.
    energy : float
        Time after which the battery of a robot is empty. Each robot must be back at its start by this time.
    recharge : float
        Time that a robot needs at its start to recharge its battery.

    Examples
    --------
    >>> from shoal.search import make_tour
    >>> tour_cost = TourCost(make_tour("moore", (8, 8)))
    >>> team = {"rates": np.ones(2), "places": tour_cost.points[[0, 30]], "widths": np.ones(2, dtype=np.int64)}
    >>> found = compared_allocations(tour_cost, np.array([0, 30]), ["hop", "stay"], **team)
    >>> [(allocation.allocator, time) for allocation, time in found]
    [('hop', 33.0), ('stay', 34.0)]
    """
    work = len(tour_cost) * len(starts)
    reckoned = allocators if work <= (_COMPARED if widths.max() == 1 else _WIDE) else allocators[:1]
    found = [allocate(tour_cost, starts, allocator=name, rates=rates, places=places, widths=widths) for name in reckoned]
    times = [time_with_sorties(one, tour_cost, places, energy=energy, recharge=recharge) for one in found]
    order = np.argsort(times, kind="stable")
    return [(found[k], times[k]) for k in order.tolist()]


def time_with_sorties(allocation: Allocation, tour_cost: TourCost, places: Floats, *, energy: float, recharge: float) -> float:
    """Return the approximate time until all robots finish, including flights home to recharge; see `compared_allocations`."""
    if energy == inf:
        return allocation.makespan
    latest = 0.0
    for time, arcs, place in zip(allocation.times.tolist(), allocation.arcs, places, strict=True):
        cells = numbers_of(arcs, len(tour_cost))
        away = float(np.linalg.norm(tour_cost.points[cells] - place, axis=1).mean()) if len(cells) else 0.0
        sorties = np.ceil(time / max(energy - 2 * away, 1.0)) - 1 if time + away > energy else 0.0
        latest = max(latest, time + float(sorties) * (2 * away + recharge))
    return latest
