"""TourCost: a tour with what it costs a robot to search along it."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from math import dist, inf

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.cells.distances import CellDistances, Distances
from shoal.search.cells.footprint import Footprint, MaskFootprint, Numbers
from shoal.search.flight.timing import STRAIGHT
from shoal.search.kernels.shares import TourArrays
from shoal.search.tours import Tour

Floats = NDArray[np.float64]
_RECKONED = 1_000_000  # cells times robots: ways between more are taken as straight


@dataclass(frozen=True, eq=False)
class TourCost:
    """The cost of a tour in cells: the unit is the time in which a robot of speed 1 searches a cell and goes on to its neighbour.

    Parameters
    ----------
    tour : Tour
        A robot follows it round and round, a closed one over its closing edge, an open one straight back to the beginning.
    points : array_like of float64, shape (N, d), optional
        Where a robot stands in each cell, in sides of a cell; the centres of the cells if they are not given.
    turn_cost : float
        What a change of direction costs, in cells.
    steps : array_like of float64, shape (N,), optional
        The length of the way from each cell to the next, where it is not the straight one; the last back to the first cell.
    distances : Distances, optional
        How far it is between any two cells; straight if not given.
    footprint : Footprint, optional
        What is seen from a cell with a footprint of several cells; all that is not behind what is no cell if not given.
    turns : array_like of float64, shape (N,), optional
        How often a robot changes its direction in each cell and on the way from there to the next; if not given, whether it does so
        by more than a degree in the cell.
    least : float, optional
        What searching all cells costs at the least, in cells; their number if not given.
    reckoned : bool
        Whether `allocate` asks the ways for the lengths of all that it compares; straight ones do otherwise.

    Raises
    ------
    InvalidInputError
    """

    tour: Tour
    points: Floats = None  # type: ignore[assignment]  # settled below
    turn_cost: float = 0.0
    steps: Floats = None  # type: ignore[assignment]  # settled below
    distances: Distances | None = None
    footprint: Footprint = None  # type: ignore[assignment]  # settled below
    turns: Floats = None  # type: ignore[assignment]  # settled below
    reckoned: bool = False
    least: float = 0.0

    def __post_init__(self) -> None:
        cells = self.tour.cells.astype(np.float64)
        if self.points is None:
            given = cells
        else:
            given = np.asarray(self.points, dtype=np.float64)
            if given.shape != cells.shape or not np.isfinite(given).all():
                raise InvalidInputError(f"points: expected finite numbers of shape {cells.shape}, got shape {given.shape}")
        if not (np.isfinite(self.turn_cost) and self.turn_cost >= 0):
            raise InvalidInputError(f"turn cost: expected a number of cells, 0 or more, got {self.turn_cost!r}")
        steps = np.linalg.norm(np.roll(given, -1, axis=0) - given, axis=1) if self.steps is None else np.asarray(self.steps)
        if steps.shape != (len(cells),) or not (steps >= 0).all():
            raise InvalidInputError(f"steps: expected {len(cells)} lengths, 0 or more, got shape {steps.shape}")
        turns = _turns(given) if self.turns is None else np.asarray(self.turns, dtype=np.float64)
        if turns.shape != (len(cells),) or not (turns >= 0).all():
            raise InvalidInputError(f"turns: expected {len(cells)} numbers, 0 or more, got shape {turns.shape}")
        if self.stepwise:
            steps = np.maximum(steps, self._lengths())
        if self.footprint is None:
            object.__setattr__(self, "footprint", MaskFootprint(self.tour))
        object.__setattr__(self, "least", self.least or float(len(cells)))
        object.__setattr__(self, "points", given)
        object.__setattr__(self, "turns", turns)
        object.__setattr__(self, "steps", steps.astype(np.float64))

    def _lengths(self) -> Floats:
        """Return how far it is from cell to cell from each to the next on the tour; 0 where there is no way."""
        n = len(self.tour)
        found = [0.0 if self.distances is None else self.distances.length(cell, (cell + 1) % n) for cell in range(n)]
        return np.where(np.isfinite(found), found, 0.0)

    def __len__(self) -> int:
        return self.n

    @cached_property
    def n(self) -> int:
        """How many cells there are."""
        return len(self.tour)

    @cached_property
    def costs(self) -> Floats:
        """What it costs to search each cell, having come from the one before; float64, shape (N,).

        One cell, more where the way from there is longer, and the turn in the one before.
        """
        before = np.maximum(np.roll(self.steps, 1), 1.0)
        return before + self.turn_cost * np.roll(self.turns, 1)

    @cached_property
    def ahead(self) -> Floats:
        """What it costs to search the cells before each one, from the first on, four times round; float64, shape (4 N + 1,)."""
        return np.concatenate([[0.0], np.cumsum(np.tile(self.costs, 4))])

    @cached_property
    def arrays(self) -> TourArrays:
        """What kernels take."""
        return TourArrays(self.ahead, self.points)

    @property
    def whole(self) -> float:
        """What it costs to go once round."""
        return float(self.ahead[len(self)])

    def search_cost(self, first: int, count: int, step: int = 1) -> float:
        """Return what it costs to search so many cells from one on, along the tour or, with step -1, against it.

        The first one costs one cell: how the robot came there is not a part of it.
        """
        if count <= 0:
            return 0.0
        low = (first if step > 0 else first - count + 1) % self.n
        return float(1.0 + self.ahead[low + count] - self.ahead[low + 1])

    @cached_property
    def _places(self) -> list[tuple[float, ...]]:
        return [tuple(point) for point in self.points.tolist()]

    @property
    def stepwise(self) -> bool:
        """Whether robots go from cell to cell and find obstacles on the way."""
        return self.distances is not None and self.distances.stepwise

    def way(self, here: int, cell: int, *, fresh: bool = False, closed: int = 0) -> float:
        """Return what it costs, beyond the one cell, to come from a cell to another to search it: directly or along the tour.

        ``fresh`` if the first one was not searched just now, so that not even a step to a neighbour is part of what a cell costs.
        ``closed`` are the cells, as bits, that are known to be obstructed; infinite if there is no way round them.
        """
        if here == cell:
            return 0.0
        n, free = self.n, 0.0 if fresh else 1.0
        if self.stepwise:
            return self._stepwise_way(here, cell, free, closed)[0]
        ahead, behind = (cell - here) % n, (here - cell) % n
        levels = self._levels
        onwards = levels[here + ahead + 1] - levels[here + 1] - free
        if ahead == 1:
            return onwards  # the way inside the region is known
        known = min(onwards, levels[cell + behind + 1] - levels[cell + 1] - free)
        if known <= max(self.between(here, cell) - free, 0.0) + self.turn_cost:
            return known  # nothing is shorter than straight
        return min(known, max(self.length(here, cell) - free, 0.0) + self.turn_cost)

    def through(self, here: int, cell: int, *, fresh: bool = False, closed: int = 0) -> tuple[int, ...]:
        """Return the cells that a robot enters on the way that `way` reckons with; none unless it goes from cell to cell."""
        if not isinstance(self.distances, CellDistances) or here == cell:
            return ()
        distances, along = self.distances, self._stepwise_way(here, cell, 0.0 if fresh else 1.0, closed)[1]
        return tuple(passed for one, other in pairwise(along) for passed in distances.cells(one, other, closed))

    def _stepwise_way(self, here: int, cell: int, free: float, closed: int) -> tuple[float, list[int]]:
        """Return what the cheapest way costs, and from where to where it leads: directly, or along the tour where that is open.

        Along the tour only what bends is a turn, so what others have searched there never makes the rest longer.
        """
        n, levels = self.n, self._levels
        direct = max(self.length(here, cell, closed) - free, 0.0) + self.turn_cost
        if direct == inf:
            return inf, [here, cell]
        ahead, behind = (cell - here) % n, (here - cell) % n
        onwards = levels[here + ahead + 1] - levels[here + 1] - free
        backwards = levels[cell + behind + 1] - levels[cell + 1] - free
        for cost, count, step in sorted([(onwards, ahead, 1), (backwards, behind, -1)]):
            if cost > direct:
                break
            along = [(here + step * k) % n for k in range(count + 1)]
            if all(self._follows(one, other, step, closed) for one, other in pairwise(along)):
                return cost, along
        return direct, [here, cell]

    def _follows(self, one: int, other: int, step: int, closed: int) -> bool:
        """Tell whether obstacles leave the way from a cell to the next on the tour, or the one before, as long as it was."""
        return bool(self.length(one, other, closed) <= self.steps[one if step > 0 else other] + 1e-9)

    def length(self, here: int, cell: int, closed: int = 0) -> float:
        """Return the length of the way between two cells given by their numbers on the tour, in sides of a cell."""
        return self.between(here, cell) if self.distances is None else self.distances.length(here, cell, closed)

    def seen(self, cell: int, width: int) -> Numbers:
        """Return the cells that a robot sees from one with a footprint of so many cells' width, as numbers on the tour, rising."""
        return self.footprint.seen(cell, width)

    def far(self, starts: NDArray[np.int64]) -> Floats:
        """Return how far it is from some cells to all; float64, shape (m, N), or (0, 0) where ways are taken as straight.

        They are where nothing is in the way, unless ``reckoned``, and for more than a million cells times robots.
        """
        if self.distances is None or not self.reckoned or len(starts) * self.n > _RECKONED:
            return np.zeros((0, 0))
        return np.array([self.distances.lengths(int(start)) for start in starts])

    @cached_property
    def _levels(self) -> list[float]:
        return [float(level) for level in self.ahead[: 2 * self.n + 2]]

    def between(self, one: int, other: int) -> float:
        """Return the straight distance between two cells given by their numbers on the tour, in sides of a cell."""
        return dist(self._places[one], self._places[other])


def _turns(points: Floats) -> Floats:
    """Return whether a robot changes its direction at each of some points round a tour: 0 or 1; float64, shape (N,)."""
    steps = np.roll(points, -1, axis=0) - points
    lengths = np.linalg.norm(steps, axis=1)
    moves = np.flatnonzero(lengths > 1e-9)
    ways = steps[moves] / lengths[moves, None]
    turns = np.zeros(len(points))
    turns[moves] = np.linalg.norm(ways - np.roll(ways, 1, axis=0), axis=1) > STRAIGHT
    return turns
