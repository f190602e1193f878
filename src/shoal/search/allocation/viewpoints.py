"""Viewpoints: the fewest places from which a footprint sees all cells."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from shoal.search.allocation.costs import TourCost

Flags = NDArray[np.bool_]
# in new cells: value of a searched cell, or of a position without a cell, beside the footprint
_EDGE = 0.15
_MEASURED = 32  # footprint areas per section of the tour on which the gain is measured
_STRETCHES = (1 / 7, 3 / 7, 5 / 7)  # relative to the tour: starts of these sections
_TRIED = 12  # number of stops whose exact path is computed


def best_viewpoint(
    tour_cost: TourCost,
    width: int,
    position: int,
    unseen: Flags,
    aim: int,
    cost: Callable[[int], float],
    shut: int = 0,
) -> int:
    """Return the stop with the largest n / c: the stop has n visible unseen cells, and c is the
    cost of moving to the stop.

    Parameters
    ----------
    tour_cost : TourCost
    width : int
        Width of the footprint, as an odd number of cells.
    position : int
        Tour index of the robot's cell.
    unseen : ndarray of bool, shape (N,)
        For each cell, whether the robot still has to see the cell.
    aim : int
        A cell that the robot still has to see. If no stop near the robot sees such a cell, the
        robot stops near the cell ``aim``.
    cost : callable
        Function that returns the cost of moving to a cell and searching it, or infinity if no path
        leads to the cell.
    shut : int
        Bitset of the cells in which the robot cannot stop at present.
    """
    for middle, reach in ((position, width), (aim, width // 2)):
        stop = _best_around(tour_cost, width, position, middle, reach, unseen, cost, shut)
        if stop is not None:
            return stop
    return aim


def _best_around(
    tour_cost: TourCost,
    width: int,
    position: int,
    middle: int,
    reach: int,
    unseen: Flags,
    cost: Callable[[int], float],
    shut: int,
) -> int | None:
    """Return the best stop within ``reach`` rows and columns of the cell ``middle``.

    The result is None if the robot sees no unseen cell from any stop near ``middle``.
    """
    *layer, row, col = tour_cost.tour.cells[middle].tolist()
    rim = width // 2 + 1
    window = _window(tour_cost.tour.position[tuple(layer)], row, col, reach + rim)
    inner = window[rim:-rim, rim:-rim]
    unseen_in_window = np.where(window >= 0, unseen[window], False)
    new = _sums(unseen_in_window[1:-1, 1:-1], width)  # assuming that nothing blocks the view
    usable = (inner >= 0) & (new > 0)
    if not usable.any():
        return None
    stops = inner[usable]
    bonus = _EDGE * ((width + 2) ** 2 - _sums(unseen_in_window, width + 2)[usable])
    places = tour_cost.points[stops] - tour_cost.points[position]
    bounds = (new[usable] + bonus) / np.maximum(np.sqrt((places * places).sum(axis=1)), 1.0)
    best, chosen, evaluated = 0.0, None, 0
    for k in np.lexsort((stops, -bounds)):
        if bounds[k] <= best or evaluated == _TRIED:
            break
        stop = int(stops[k])
        if shut >> stop & 1:
            continue
        sees, away = int(np.count_nonzero(unseen[tour_cost.visible_cells(stop, width)])), cost(stop)
        evaluated += 1
        if sees and (worth := (sees + float(bonus[k])) / away) > best:
            best, chosen = worth, stop
    return chosen


def _window(position: NDArray[np.int64], row: int, col: int, reach: int) -> NDArray[np.int64]:
    """Return the tour indices of a square of cells around a cell; int64, shape (2 reach + 1, 2
    reach + 1).

    Positions without a cell of the tour get -1.
    """
    numbers = np.full((2 * reach + 1, 2 * reach + 1), -1, dtype=np.int64)
    top, left = max(row - reach, 0), max(col - reach, 0)
    part = position[top : row + reach + 1, left : col + reach + 1]
    down, right = top - row + reach, left - col + reach
    numbers[down : down + part.shape[0], right : right + part.shape[1]] = part
    return numbers


def _sums(flags: Flags, side: int) -> NDArray[np.int64]:
    """Return the number of true values in each square of ``side`` rows and ``side`` columns."""
    total = np.zeros((flags.shape[0] + 1, flags.shape[1] + 1), dtype=np.int64)
    total[1:, 1:] = flags.cumsum(axis=0, dtype=np.int64).cumsum(axis=1)
    return total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]


def select_viewpoints(
    tour_cost: TourCost, width: int, cells: NDArray[np.int64], previous: int | None = None
) -> tuple[NDArray[np.int64], float]:
    """Return the tour indices of the stops from which a robot sees given cells, and the cost of
    searching from stop to stop.

    The cost is in cells, and does not contain the path to the first stop.

    Parameters
    ----------
    tour_cost : TourCost
    width : int
        Width of the footprint, as an odd number of cells.
    cells : ndarray of int64, shape (k,)
        Tour indices of one or more cells, in the order in which a robot with a footprint of one
        cell searches them.
    previous : int, optional
        Tour index of the robot's previous cell. By default, the previous cell is the first cell of
        ``cells``.
    """
    unseen = np.zeros(len(tour_cost), dtype=np.bool_)
    unseen[cells] = True
    at, total, fresh = int(cells[0]) if previous is None else previous, 0.0, True
    chosen: list[int] = []
    for aim in cells.tolist():
        while unseen[aim]:
            stop = best_viewpoint(
                tour_cost, width, at, unseen, aim, partial(_cost, tour_cost, at, fresh)
            )
            total += _cost(tour_cost, at, fresh, stop) if chosen else 1.0
            unseen[tour_cost.visible_cells(stop, width)] = False
            chosen.append(stop)
            at, fresh = stop, False
    return np.array(chosen, dtype=np.int64), total


def _cost(tour_cost: TourCost, position: int, fresh: bool, stop: int) -> float:
    return 1.0 + tour_cost.move_cost(position, stop, fresh=fresh)


@lru_cache(maxsize=256)
def gain_of(tour_cost: TourCost, width: int) -> float:
    """Return the search rate with a footprint of ``width`` cells, divided by the search rate with a
    footprint of one cell.

    The result is at least 1 and at most ``width``. The function simulates the search of three
    sections of the tour. All robots compute equal gains for equal widths.

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
