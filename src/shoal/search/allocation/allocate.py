"""Allocation of a tour to robots. Each robot computes the same allocation from the same broadcast start positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.registry import configured
from shoal.search.allocation.allocators import ALLOCATORS, Indices
from shoal.search.allocation.arcs import Arc, numbers_of, way_to, work_time
from shoal.search.allocation.tour_cost import Floats, TourCost
from shoal.search.allocation.viewpoint_selection import gain_of, select_viewpoints
from shoal.search.cells.footprint import check_widths
from shoal.search.kernels.shares import Team


@dataclass(frozen=True, eq=False)
class Allocation:
    """The parts of a tour that the robots search, with the robots' completion times.

    Parameters
    ----------
    allocator : str
        Name of the rule that made the allocation.
    arcs : tuple of tuple of Arc
        The arcs that are assigned to each robot, in the order in which it searches them. A robot in reserve has no arcs.
    times : ndarray of float64, shape (m,)
        Completion time of each robot, including its path to the first cell. The unit is the time in which a robot of speed 1
        searches one cell.
    lower_bound : float
        Lower bound on the makespan of every allocation: the number of visits to cells that are necessary, divided by the sum of
        speed times footprint width over all robots.
    work : tuple of tuple of Arc
        All arcs that each robot searches. These are its own arcs and, if several robots must search each cell, also arcs of robots
        ahead.
    """

    allocator: str
    arcs: tuple[tuple[Arc, ...], ...]
    times: Floats
    lower_bound: float
    work: tuple[tuple[Arc, ...], ...]

    @property
    def makespan(self) -> float:
        """Completion time of the last robot."""
        return float(self.times.max())


def allocate(
    tour_cost: TourCost,
    starts: ArrayLike,
    *,
    allocator: str = "hop",
    rates: ArrayLike | None = None,
    places: ArrayLike | None = None,
    widths: ArrayLike | None = None,
) -> Allocation:
    """Divide the cells of a tour among robots.

    Parameters
    ----------
    tour_cost : TourCost
    starts : array_like of int, shape (m,)
        Tour index of each robot's start cell; m is at least 1. Several robots may start in the same cell.
    allocator : str
        "stay": each robot searches the cells from its start to the next robot's start (paper H). "common-shift": all robots first
        move along the tour by at most a common distance. "individual-shift": each robot first moves along the tour by its own
        distance. "two-way": each robot searches the cells behind and ahead of its start. "hop": each robot moves straight to the
        beginning of an arc. Or ``module:attribute``, a function with the arguments of the functions in
        `shoal.search.allocation.allocators`.
    rates : array_like of float, shape (m,), optional
        Relative speed of each robot, both in motion and in search. The default is 1 for all robots.
    places : array_like of float, shape (m, d), optional
        Positions of the robots in the units of `TourCost.points`. By default, each robot is at the viewpoint of its start cell.
    widths : array_like of int, shape (m,), optional
        Footprint width of each robot in cells, odd. The default is 1 for all robots. A robot with a wide footprint gets more cells
        (`gain_of`).

    Raises
    ------
    InvalidInputError
    UnknownNameError

    Notes
    -----
    "stay" is the rule of paper H, p. 5. The other rules answer an open question of this paper, how much time "slightly more initial
    configuration movement" saves.

    Examples
    --------
    >>> from shoal.search import make_tour
    >>> tour_cost = TourCost(make_tour("moore", (8, 8)))
    >>> allocate(tour_cost, [0, 1, 2, 3], allocator="stay").makespan
    61.0
    >>> allocate(tour_cost, [0, 1, 2, 3], allocator="hop").makespan < 24
    True
    """
    team, order = _team(tour_cost, starts, rates, places, widths)
    arcs = _shared(tour_cost, allocator, team, order)
    back = np.argsort(order)
    speeds, at, numbers = team.rates[back], team.places[back], team.starts[back]
    wide = np.ones(len(back), dtype=np.int64) if widths is None else np.asarray(widths)
    times = np.array(
        [
            time_of(tour_cost, work, place, int(start) if len(team.far) else None, int(width))
            for work, place, start, width in zip(arcs, at, numbers, wide, strict=True)
        ]
    )
    return Allocation(allocator, arcs, times / speeds, tour_cost.least / float((speeds * wide).sum()), arcs)


def arcs_of(
    tour_cost: TourCost, allocator: str, starts: ArrayLike, rates: ArrayLike, widths: ArrayLike
) -> tuple[tuple[Arc, ...], ...]:
    """Return the arcs that `allocate` assigns to each robot, without computing times."""
    return _shared(tour_cost, allocator, *_team(tour_cost, starts, rates, None, widths))


def _shared(tour_cost: TourCost, allocator: str, team: Team, order: Indices) -> tuple[tuple[Arc, ...], ...]:
    share = configured(ALLOCATORS, allocator)
    arcs: list[tuple[Arc, ...]] = [()] * len(order)
    try:
        for robot, work in zip(order, share(tour_cost, team), strict=True):
            arcs[robot] = tuple(arc for arc in work if arc.count > 0)
    except (Exception, SystemExit) as error:
        if ":" not in allocator:
            raise
        what = f"{type(error).__name__}: {shortened(str(error))}"
        raise InvalidInputError(f"allocation {allocator}: expected arcs for each of {len(order)} robots, got {what}") from error
    return tuple(arcs)


def _team(
    tour_cost: TourCost, starts: ArrayLike, rates: ArrayLike | None, places: ArrayLike | None, widths: ArrayLike | None
) -> tuple[Team, Indices]:
    """Return the robots, checked and sorted by their starts around the tour, and the order of sorting."""
    n = len(tour_cost)
    first = np.asarray(starts)
    if first.ndim != 1 or not len(first) or first.dtype.kind not in "iu" or (first < 0).any() or (first >= n).any():
        raise InvalidInputError(f"starts: expected one or more numbers of cells from 0 to {n - 1}, got {first.tolist()!r:.200}")
    first = first.astype(np.int64)
    speeds = np.ones(len(first)) if rates is None else np.asarray(rates, dtype=np.float64)
    if speeds.shape != first.shape or not (np.isfinite(speeds) & (speeds > 0)).all():
        raise InvalidInputError(f"rates: expected {len(first)} speeds above 0, got {speeds.tolist()!r:.200}")
    at = tour_cost.points[first] if places is None else np.asarray(places, dtype=np.float64)
    if at.shape != (len(first), tour_cost.points.shape[1]):
        raise InvalidInputError(f"places: expected shape ({len(first)}, {tour_cost.points.shape[1]}), got {at.shape}")
    wide = np.ones(len(first), dtype=np.int64) if widths is None else np.asarray(widths)
    check_widths(wide, len(first))
    order = np.argsort(first, kind="stable")  # of several robots in a cell, the last one searches on
    gains = np.array([gain_of(tour_cost, int(width)) for width in wide])
    return Team(first[order], speeds[order], at[order], gains[order], tour_cost.far(first[order])), order


def time_of(tour_cost: TourCost, work: Sequence[Arc], place: Floats, start: int | None, width: int) -> float:
    """Return the cost in cells of searching arcs with a footprint of ``width`` cells; see `work_time`."""
    if width == 1 or not work:
        return work_time(tour_cost, work, place, start)
    cells = numbers_of(work, len(tour_cost))
    stops, cost = select_viewpoints(tour_cost, width, cells)
    return cost + way_to(tour_cost, int(stops[0]), place, start)
