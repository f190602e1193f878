"""Costs of a tour: lengths and times of its parts, and the expected time until
something is found.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from math import dist, inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_array, check_integer, check_kind, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums
from shoal.search.cells.distances import CellDistances, Distances, RegionDistances
from shoal.search.cells.footprint import Footprint, MaskFootprint, Numbers
from shoal.search.flight.timing import STRAIGHT
from shoal.search.kernels.shares import TourArrays
from shoal.search.tours import Tour

Floats = NDArray[np.float64]
_RECKONED = 1_000_000  # cells times robots: above this, paths between cells count as straight


@dataclass(frozen=True, eq=False)
class TourCost:
    """The cost of searching along a tour.

    The unit of costs is the cell: the cost of moving to a neighbouring cell and searching this cell
    is 1.

    Parameters
    ----------
    tour : Tour
        The tour, which robots follow again and again. From the last cell, a robot moves to the
        first cell, even on an open tour.
    points : array_like of float64, shape (N, d), optional
        Viewpoint of each cell, in cell sides. By default, viewpoints are the centres of the cells.
    turn_cost : float
        Cost of a change of direction in cells.
    steps : array_like of float64, shape (N,), optional
        Length of the path from each cell to the next cell of the tour, in cell sides. The last
        entry belongs to the path from the last cell back to the first. By default, all paths along
        the tour are straight.
    distances : Distances, optional
        Distances between any two cells. By default, distances are the lengths of straight lines.
    footprint : Footprint, optional
        The cells that a robot with a wide footprint sees from each cell. By default, only positions
        without a cell block the view.
    turns : array_like of float64, shape (N,), optional
        Number of changes of direction in each cell and on the path to the next cell. By default,
        each cell in which the tour turns by more than one degree counts as one change.
    least : float, optional
        Minimum cost of searching all cells, in cells. By default, the minimum cost is the number of
        cells.
    reckoned : bool
        Whether the allocators use the lengths of paths around walls. If false, the allocators use
        straight distances.
    odds : array_like of float64, shape (N,), optional
        Probability that the search of each cell is the one that finds the single target. With
        probabilities, robots search likely cells early; see `shoal.search.allocation.likely`.
    at_most : float
        Longest time of the search with probabilities, divided by its time without; with 0, the
        probabilities change no order.
    break_cost : float
        What it costs in cells to leave the tour for a cell elsewhere, beyond the way there and one
        turn, where robots choose their order by probabilities.
    thorough : bool
        Whether the order by probabilities is one that random changes improve no more, and not only
        the first that no small change improves.
    turn_price : float
        What a turn costs in cells, beyond ``turn_cost``, where allocators share the tour among
        vehicles. It counts in no time of a robot.
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
    odds: Floats | None = None
    at_most: float = 1.25
    break_cost: float = 0.0
    thorough: bool = True
    turn_price: float = 0.0

    def __post_init__(self) -> None:
        cells = check_kind(self.tour, Tour, what="tour").cells.astype(np.float64)
        if self.points is None:
            points = cells
        else:
            points = check_array(
                self.points, expected=f"points: expected finite numbers of shape {cells.shape}"
            ).astype(np.float64, copy=False)
            if points.shape != cells.shape or not np.isfinite(points).all():
                raise InvalidInputError(
                    f"points: expected finite numbers of shape {cells.shape}, got shape"
                    f" {points.shape}"
                )
        check_number(self.turn_cost, what="turn cost", least=0)
        steps = (
            np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
            if self.steps is None
            else np.asarray(self.steps)
        )
        if steps.shape != (len(cells),) or not (steps >= 0).all():
            raise InvalidInputError(
                f"steps: expected {len(cells)} lengths, 0 or more, got shape {steps.shape}"
            )
        turns = _turns(points) if self.turns is None else np.asarray(self.turns, dtype=np.float64)
        if turns.shape != (len(cells),) or not (turns >= 0).all():
            raise InvalidInputError(
                f"turns: expected {len(cells)} numbers, 0 or more, got shape {turns.shape}"
            )
        if self.stepwise:
            steps = np.maximum(steps, self._lengths())
        if self.footprint is None:
            object.__setattr__(self, "footprint", MaskFootprint(self.tour))
        object.__setattr__(self, "least", self.least or float(len(cells)))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "turns", turns)
        object.__setattr__(self, "steps", steps.astype(np.float64))

    def _lengths(self) -> Floats:
        """Return the distance from each cell to the next cell of the tour. Cells without a path to
        the next cell get 0.
        """
        n = len(self.tour)
        lengths = [
            0.0 if self.distances is None else self.distances.length(cell, (cell + 1) % n)
            for cell in range(n)
        ]
        return np.where(np.isfinite(lengths), lengths, 0.0)

    def __len__(self) -> int:
        return self.n

    @cached_property
    def n(self) -> int:
        """Number of cells of the tour."""
        return len(self.tour)

    @cached_property
    def costs(self) -> Floats:
        """Cost, in cells, of moving from the previous cell of the tour to each cell and searching
        this cell; float64, shape (N,).

        The cost of a cell is max(1, l) plus the cost of turns on the path to the cell, where l is
        the length of this path in cell sides.
        """
        before = np.maximum(np.roll(self.steps, 1), 1.0)
        return before + self.turn_cost * np.roll(self.turns, 1)

    @cached_property
    def ahead(self) -> Floats:
        """Sum of the costs of the first k cells of four rounds of the tour, for k from 0 to 4 N;
        float64, shape (4 N + 1,).
        """
        return partial_sums(np.tile(self.costs, 4))

    @cached_property
    def priced(self) -> Floats:
        """The sums of `ahead` with `turn_price` for each turn."""
        return partial_sums(np.tile(self.costs + self.turn_price * np.roll(self.turns, 1), 4))

    @cached_property
    def odds_ahead(self) -> Floats:
        """Sum of the probabilities of the first k cells of two rounds of the tour, for k from 0 to
        2 N; float64, shape (2 N + 1,).
        """
        assert self.odds is not None
        return partial_sums(np.tile(self.odds, 2))

    @cached_property
    def orders(self) -> dict[Any, Any]:
        """Cache of the orders by probabilities that were found for teams of robots."""
        return {}

    @cached_property
    def arrays(self) -> TourArrays:
        """The costs and viewpoints of the tour as arrays for compiled functions."""
        return TourArrays(self.priced, self.points)

    @property
    def whole(self) -> float:
        """Cost of one whole round of the tour, in cells."""
        return float(self.ahead[len(self)])

    def search_cost(self, first: int, count: int, step: int = 1) -> float:
        """Return the cost, in cells, of searching ``count`` consecutive cells of the tour,
        beginning with the cell ``first``.

        The robot follows the tour forwards with ``step`` 1, and backwards with ``step`` -1. The
        cost does not contain the path to the cell ``first``.
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
        """Whether robots move only from a cell to a neighbouring cell, and discover obstacles on
        their way.
        """
        return self.distances is not None and self.distances.stepwise

    def move_cost(self, source: int, cell: int, *, fresh: bool = False, closed: int = 0) -> float:
        """Return the cost, in cells, of moving from the cell ``source`` to the cell ``cell``.

        The path is direct or follows the tour, whichever is cheaper. The function deducts the cost
        of one cell, because the cost of searching a cell already contains a move to a neighbouring
        cell.

        Parameters
        ----------
        source, cell : int
            Tour indices of the first and the last cell of the path.
        fresh : bool
            Whether the robot comes to the cell ``source`` without searching it. If true, the
            function does not deduct the cost of one cell.
        closed : int
            Bitset of cells that are known to be blocked. If all paths lead through blocked cells,
            the cost is infinite.
        """
        if source == cell:
            return 0.0
        n, free = self.n, 0.0 if fresh else 1.0
        if self.stepwise:
            return self._stepwise_path(source, cell, free, closed)[0]
        ahead, behind = (cell - source) % n, (source - cell) % n
        levels = self._levels
        onwards = levels[source + ahead + 1] - levels[source + 1] - free
        if ahead == 1:
            return onwards  # the path inside the region is known
        along_tour = min(onwards, levels[cell + behind + 1] - levels[cell + 1] - free)
        if along_tour <= max(self.between(source, cell) - free, 0.0) + self.turn_cost:
            return along_tour  # no path is shorter than the straight one
        return min(along_tour, max(self.length(source, cell) - free, 0.0) + self.turn_cost)

    def through(
        self, source: int, cell: int, *, fresh: bool = False, closed: int = 0
    ) -> tuple[int, ...]:
        """Return the cells that a robot enters on the path whose cost `move_cost` returns.

        The result is empty if ``source`` equals ``cell``, or if ``distances`` is not a
        `CellDistances`.
        """
        if not isinstance(self.distances, CellDistances) or source == cell:
            return ()
        distances, along = (
            self.distances,
            self._stepwise_path(source, cell, 0.0 if fresh else 1.0, closed)[1],
        )
        return tuple(
            entered
            for start, end in pairwise(along)
            for entered in distances.cells(start, end, closed)
        )

    def _stepwise_path(
        self, source: int, cell: int, free: float, closed: int
    ) -> tuple[float, list[int]]:
        """Return the cost of the cheapest path between two cells, and the cells at which its direct
        moves begin and end.

        The path follows the tour if the tour is not blocked and not more expensive than the direct
        path. The cost of a path along the tour contains only the turns of the tour. The cost of a
        direct path contains one turn. Therefore a robot that skips cells searched by other robots
        never has a higher cost than a robot that follows the tour.
        """
        n, levels = self.n, self._levels
        direct = max(self.length(source, cell, closed) - free, 0.0) + self.turn_cost
        if direct == inf:
            return inf, [source, cell]
        ahead, behind = (cell - source) % n, (source - cell) % n
        onwards = levels[source + ahead + 1] - levels[source + 1] - free
        backwards = levels[cell + behind + 1] - levels[cell + 1] - free
        for cost, count, step in sorted([(onwards, ahead, 1), (backwards, behind, -1)]):
            if cost > direct:
                break
            along = [(source + step * k) % n for k in range(count + 1)]
            if all(self._follows(start, end, step, closed) for start, end in pairwise(along)):
                return cost, along
        return direct, [source, cell]

    def _follows(self, source: int, target: int, step: int, closed: int) -> bool:
        """Return whether the path between two consecutive cells of the tour keeps its length
        despite closed cells.
        """
        return bool(
            self.length(source, target, closed) <= self.steps[source if step > 0 else target] + 1e-9
        )

    def length(self, source: int, cell: int, closed: int = 0) -> float:
        """Return the length, in cell sides, of the path between two cells that are given by tour
        indices.
        """
        return (
            self.between(source, cell)
            if self.distances is None
            else self.distances.length(source, cell, closed)
        )

    def lengths_from(self, source: int, cells: NDArray[np.int64]) -> list[float]:
        """Return the lengths, in cell sides, of the paths between a cell and several cells that are
        given by tour indices.
        """
        if isinstance(self.distances, RegionDistances):
            self.distances.measure_straight(source, cells)
        return [self.length(cell, source) for cell in cells.tolist()]

    def visible_cells(self, cell: int, width: int) -> Numbers:
        """Return the cells that a robot in ``cell`` sees with a footprint of ``width`` cells, as
        increasing tour indices.
        """
        return self.footprint.visible_cells(cell, width)

    def far(self, starts: NDArray[np.int64]) -> Floats:
        """Return the distances from m given cells to all N cells of the tour, in cell sides;
        float64, shape (m, N).

        If ``distances`` is None, ``reckoned`` is false, or m N is above 1 million, the result has
        shape (0, 0). Then the allocators use straight distances.
        """
        if self.distances is None or not self.reckoned or len(starts) * self.n > _RECKONED:
            return np.zeros((0, 0))
        return np.array([self.distances.lengths(int(start)) for start in starts])

    @cached_property
    def _levels(self) -> list[float]:
        return [float(level) for level in self.ahead[: 2 * self.n + 2]]

    def between(self, source: int, target: int) -> float:
        """Return the straight distance, in cell sides, between two cells that are given by tour
        indices.
        """
        return dist(self._places[source], self._places[target])


def _turns(points: Floats) -> Floats:
    """Return, for each point of a closed path, 1 if the direction changes at this point, or else 0;
    float64, shape (N,).
    """
    steps = np.roll(points, -1, axis=0) - points
    lengths = np.linalg.norm(steps, axis=1)
    moves = np.flatnonzero(lengths > 1e-9)
    directions = steps[moves] / lengths[moves, None]
    turns = np.zeros(len(points))
    turns[moves] = np.linalg.norm(directions - np.roll(directions, 1, axis=0), axis=1) > STRAIGHT
    return turns


_AT_ONCE = 2_000_000  # number of positions drawn per block


class ExpectedTime(NamedTuple):
    """The mean of many simulated search times, with its standard error.

    Parameters
    ----------
    mean : float
        Expected search time, divided by the search time of a single robot (in paper H: T_E/T_UB).
    error : float
        Standard error of the mean, in the same unit as the mean.
    """

    mean: float
    error: float


def expected_time(
    cells: int, robots: int, *, dead: int = 0, trials: int = 10_000, seed: int = 0
) -> ExpectedTime:
    """Return the expected search time if each robot searches from its own start to the start of the
    next working robot.

    Parameters
    ----------
    cells : int
        Number of cells of the closed tour.
    robots : int
        Number of robots, including dead robots. The robots start in independent random cells.
    dead : int
        Number of dead robots, which never start. The last working robot before a dead robot on the
        tour also searches the dead robot's part, without a delay.
    trials : int
        Number of random trials, at least 2.
    seed : int
        Seed of the random start cells.

    Notes
    -----
    On page 8 of paper H, T_UB is the search time of one robot, and T_LB = T_UB/m is the lower bound
    for m robots. The time of a trial is the makespan of ``allocate(..., allocator="stay")``. Robots
    first move to the centres of their cells, so each part consists of whole cells. If several
    robots start in the same cell, only one of these robots searches.

    For many cells, the mean approaches `stay_share`. With 64 cells and 50 robots, most robots share
    their start cell with another robot, and the exact mean is 0.6 % above `stay_share`
    (``tests/golden/test_search_figures.py``). With more robots than cells, the mean is far above
    `stay_share`, because the longest part has at least one whole cell.

    Examples
    --------
    >>> found = expected_time(1024, 20)
    >>> abs(found.mean - stay_share(20)) < 4 * found.error
    True
    """
    _check(robots, dead)
    check_integer(cells, what="cells", least=1)
    check_integer(trials, what="trials", least=2)
    rng = np.random.default_rng(seed)
    rows = max(1, _AT_ONCE // robots)
    longest = np.concatenate(
        [_longest(cells, robots, dead, min(rows, trials - k), rng) for k in range(0, trials, rows)]
    )
    return ExpectedTime(
        float(longest.mean()) / cells, float(longest.std(ddof=1)) / cells / trials**0.5
    )


def _longest(
    cells: int, robots: int, dead: int, trials: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return, for each trial, the largest distance in cells from one working robot to the next;
    int64, shape (trials,).
    """
    # all robots are equivalent, so the first ones are dead
    starts = rng.integers(cells, size=(trials, robots))[:, dead:]
    starts.sort(axis=1)
    around = starts[:, 0] + cells - starts[:, -1]
    return np.asarray(np.maximum(around, np.diff(starts, axis=1).max(axis=1, initial=0)))


def stay_share(robots: int, *, dead: int = 0) -> float:
    """Return the limit that the mean of `expected_time` approaches for many cells.

    For k working robots, the mean approaches H_k/k with the harmonic number H_k = 1 + 1/2 + ... +
    1/k. If k random points divide a circle of length 1 into k arcs, the longest arc has the mean
    length H_k/k.

    Examples
    --------
    >>> round(stay_share(20), 3), round(stay_share(20, dead=10), 3)
    (0.18, 0.293)
    """
    _check(robots, dead)
    alive = robots - dead
    return float((1.0 / np.arange(1, alive + 1)).sum()) / alive


def _check(robots: int, dead: int) -> None:
    check_integer(robots, what="robots", least=1)
    check_integer(dead, what="dead", least=0, most=robots - 1)  # one robot must work
