"""Viewpoint selection: where a robot with a wide footprint stops to see its part, which is neither in each cell nor in tour order.

It goes where it sees most that is new for the way there, and rather along the border of what is done than away from it, for strips
that are left over cost as much as wide ones. So it goes round and round in its part, whatever the tour.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from shoal.search.allocation.tour_cost import TourCost

Flags = NDArray[np.bool_]
_EDGE = 0.15  # of a new cell: what one beside the footprint is worth that is done, or none
_MEASURED = 32  # footprints' areas in each stretch on which a gain is measured
_STRETCHES = (1 / 7, 3 / 7, 5 / 7)  # of the tour: where these begin
_TRIED = 12  # stops whose way is looked up


def best_viewpoint(
    tour_cost: TourCost, width: int, here: int, wanted: Flags, aim: int, cost: Callable[[int], float], shut: int = 0
) -> int:
    """Return the cell from which a robot sees most for what it costs to go there; it sees something that is wanted.

    Parameters
    ----------
    tour_cost : TourCost
        A robot sees what lies in the layer in which it is.
    width : int
        Of the footprint, in cells, odd.
    here : int
        Where it is, as a number on the tour.
    wanted : ndarray of bool, shape (N,)
        What it is to see.
    aim : int
        One of these. It stops near that one if it sees none from where it is and around.
    cost : callable
        What it costs to come to a cell and search it; infinite if there is no way.
    shut : int
        Cells, as bits, in which it cannot stop now.
    """
    for middle, reach in ((here, width), (aim, width // 2)):
        stop = _best_around(tour_cost, width, here, middle, reach, wanted, cost, shut)
        if stop is not None:
            return stop
    return aim


def _best_around(
    tour_cost: TourCost,
    width: int,
    here: int,
    middle: int,
    reach: int,
    wanted: Flags,
    cost: Callable[[int], float],
    shut: int,
) -> int | None:
    """Return the best stop at most so many rows and columns away from a cell; None if nothing is seen from any."""
    *layer, row, col = tour_cost.tour.cells[middle].tolist()
    rim = width // 2 + 1
    window = _window(tour_cost.tour.position[tuple(layer)], row, col, reach + rim)
    inner = window[rim:-rim, rim:-rim]
    asked = np.where(window >= 0, wanted[window], False)
    new = _sums(asked[1:-1, 1:-1], width)  # were nothing in the way
    usable = (inner >= 0) & (new > 0)
    if not usable.any():
        return None
    stops = inner[usable]
    bonus = _EDGE * ((width + 2) ** 2 - _sums(asked, width + 2)[usable])
    places = tour_cost.points[stops] - tour_cost.points[here]
    hoped = (new[usable] + bonus) / np.maximum(np.sqrt((places * places).sum(axis=1)), 1.0)
    best, chosen, tried = 0.0, None, 0
    for k in np.lexsort((stops, -hoped)):
        if hoped[k] <= best or tried == _TRIED:
            break
        stop = int(stops[k])
        if shut >> stop & 1:
            continue
        sees, away = int(np.count_nonzero(wanted[tour_cost.seen(stop, width)])), cost(stop)
        tried += 1
        if sees and (worth := (sees + float(bonus[k])) / away) > best:
            best, chosen = worth, stop
    return chosen


def _window(position: NDArray[np.int64], row: int, col: int, reach: int) -> NDArray[np.int64]:
    """Return the numbers of the cells around one, -1 where there is none; int64, shape (2 reach + 1, 2 reach + 1)."""
    found = np.full((2 * reach + 1, 2 * reach + 1), -1, dtype=np.int64)
    top, left = max(row - reach, 0), max(col - reach, 0)
    part = position[top : row + reach + 1, left : col + reach + 1]
    down, right = top - row + reach, left - col + reach
    found[down : down + part.shape[0], right : right + part.shape[1]] = part
    return found


def _sums(flags: Flags, side: int) -> NDArray[np.int64]:
    """Return how many of each square of so many rows and columns are set."""
    total = np.zeros((flags.shape[0] + 1, flags.shape[1] + 1), dtype=np.int64)
    total[1:, 1:] = flags.cumsum(axis=0, dtype=np.int64).cumsum(axis=1)
    return total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]


def select_viewpoints(
    tour_cost: TourCost, width: int, cells: NDArray[np.int64], here: int | None = None
) -> tuple[NDArray[np.int64], float]:
    """Return where a robot stops to see some cells, as numbers on the tour, and what that costs it from the first stop on.

    Parameters
    ----------
    tour_cost : TourCost
    width : int
    cells : ndarray of int64, shape (k,)
        As numbers on the tour, in the order in which a robot searches them that sees one cell; k at least 1.
    here : int, optional
        Where it comes from; the first of the cells if not given.
    """
    wanted = np.zeros(len(tour_cost), dtype=np.bool_)
    wanted[cells] = True
    at, total, fresh = int(cells[0]) if here is None else here, 0.0, True
    found: list[int] = []
    for aim in cells.tolist():
        while wanted[aim]:
            stop = best_viewpoint(tour_cost, width, at, wanted, aim, partial(_cost, tour_cost, at, fresh))
            total += _cost(tour_cost, at, fresh, stop) if found else 1.0
            wanted[tour_cost.seen(stop, width)] = False
            found.append(stop)
            at, fresh = stop, False
    return np.array(found, dtype=np.int64), total


def _cost(tour_cost: TourCost, here: int, fresh: bool, stop: int) -> float:
    return 1.0 + tour_cost.way(here, stop, fresh=fresh)


@lru_cache(maxsize=256)
def gain_of(tour_cost: TourCost, width: int) -> float:
    """Return how many times as fast as one that sees a cell a robot searches a part of a tour, at least 1.

    Measured on a few stretches of the tour, which every robot can do for itself.

    Examples
    --------
    >>> from shoal.search.tours import make_tour
    >>> tour_cost = TourCost(make_tour("moore", (32, 32)))
    >>> gain_of(tour_cost, 1), 2 < gain_of(tour_cost, 3) < 3
    (1.0, True)
    """
    n = len(tour_cost)
    count = min(max(n // 4, 1), _MEASURED * width * width)
    if width == 1 or count == 1:
        return 1.0
    alone = seeing = 0.0
    for share in _STRETCHES:
        first = int(share * n)
        alone += tour_cost.search_cost(first, count)
        seeing += select_viewpoints(tour_cost, width, (first + np.arange(count)) % n)[1]
    return float(np.clip(alone / seeing, 1.0, width))
