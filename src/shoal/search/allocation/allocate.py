"""Division of a tour among robots. All robots know the start cells of all robots, and therefore compute equal allocations."""

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
    """The part of a tour that each robot searches, and the time at which each robot finishes.

    Parameters
    ----------
    allocator : str
        Name of the allocator that divided the tour.
    arcs : tuple of tuple of Arc
        Arcs of the tour for each robot, in the order in which the robot searches them. A robot may have no arcs.
    times : ndarray of float64, shape (m,)
        Completion time of each robot, including its path to its first cell. The unit of time is the time in which a robot of speed
        1 searches one cell.
    lower_bound : float
        Lower bound on the completion time of any allocation: the number of necessary cell visits divided by the sum of all search
        rates. The search rate of a robot is its speed times its footprint width in cells.
    work : tuple of tuple of Arc
        All arcs that each robot searches, in the order of the search. If several robots must search each cell, a robot first
        searches its own arcs. Then the robot searches the arcs of the next robots along the tour.
    """

    allocator: str
    arcs: tuple[tuple[Arc, ...], ...]
    times: Floats
    lower_bound: float
    work: tuple[tuple[Arc, ...], ...]

    @property
    def makespan(self) -> float:
        """Time at which the last robot finishes."""
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
        Tour index of each robot's start cell, for at least one robot. Several robots may start in the same cell.
    allocator : str
        "stay": each robot searches the cells from its start to the next robot's start (paper H). "common-shift": each robot first
        moves along the tour, and the upper limit of the distance is equal for all robots. "individual-shift": each robot first
        moves along the tour, by a distance chosen for this robot. "two-way": each robot searches cells behind its start and cells
        ahead of its start. "hop": each robot moves straight to the first cell of its arc. A text of the form ``module:attribute``
        names a function with the same arguments as the functions in `shoal.search.allocation.allocators`.
    rates : array_like of float, shape (m,), optional
        Speed of each robot, for motion and search alike. By default, all robots have the speed 1.
    places : array_like of float, shape (m, d), optional
        Positions of the robots in cell sides, as in `TourCost.points`. By default, each robot is at the viewpoint of its start
        cell.
    widths : array_like of int, shape (m,), optional
        Footprint width of each robot, as an odd number of cells. By default, all footprints are one cell wide. A robot with
        a wide footprint gets about `gain_of` times as many cells as an equally fast robot with a footprint of one cell.

    Raises
    ------
    InvalidInputError
    UnknownNameError

    Notes
    -----
    The allocator "stay" follows page 5 of paper H. All allocators except "stay" answer an open question of paper H: how much time
    does "slightly more initial configuration movement" save?

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
    """Return the arcs that `allocate` assigns to each robot, without computing completion times."""
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
    """Check the robots. Return the robots in the order of their start cells, and the given index of each of these robots."""
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
    order = np.argsort(first, kind="stable")  # if several robots start in a cell, ``stay`` gives cells only to the last one
    gains = np.array([gain_of(tour_cost, int(width)) for width in wide])
    return Team(first[order], speeds[order], at[order], gains[order], tour_cost.far(first[order])), order


def time_of(tour_cost: TourCost, work: Sequence[Arc], place: Floats, start: int | None, width: int) -> float:
    """Return the cost, in cells, of the path to the first arc and of the search of all arcs, with a footprint of ``width`` cells.

    The arguments ``place`` and ``start`` have the same meaning as in `way_to`.
    """
    if width == 1 or not work:
        return work_time(tour_cost, work, place, start)
    cells = numbers_of(work, len(tour_cost))
    stops, cost = select_viewpoints(tour_cost, width, cells)
    return cost + way_to(tour_cost, int(stops[0]), place, start)
