"""Expected search time if robots do not move before the search (paper H, p. 8, Fig. 5): Monte Carlo estimate and theory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer

_AT_ONCE = 2_000_000  # number of positions drawn per block


class ExpectedTime(NamedTuple):
    """A mean with its standard error.

    Parameters
    ----------
    mean : float
        T_E/T_UB: the expected search time as a fraction of the time of a single robot.
    error : float
        Standard error of the mean.
    """

    mean: float
    error: float


def expected_time(cells: int, robots: int, *, dead: int = 0, trials: int = 10_000, seed: int = 0) -> ExpectedTime:
    """Return the expected time of a search in which each robot searches up to the start of the next working robot.

    Parameters
    ----------
    cells : int
        Number of cells of the closed tour.
    robots : int
        Number of robots. The robots start in independent random cells.
    dead : int
        Number of robots that never start. The part of a dead robot is searched by the robot behind it, without any waiting time.
    trials : int
        Number of random trials, at least 2.
    seed : int

    Raises
    ------
    InvalidInputError

    Notes
    -----
    Paper H, p. 8: T_UB is the time of one robot, T_LB = T_UB/m. The time is that of ``allocate(..., allocator="stay")``. Robots
    first move to the centres of their cells, so each part consists of whole cells. If several robots start in the same cell, only
    one of them searches on.

    `stay_share` is the limit for many cells. With 64 cells and 50 robots, most robots share a cell, and the exact mean is 0.6 %
    above the limit (``tests/golden/test_search_figures.py``). With more robots than cells, the mean time is far above the limit,
    because a part has at least one whole cell.

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
    longest = np.concatenate([_longest(cells, robots, dead, min(rows, trials - k), rng) for k in range(0, trials, rows)])
    return ExpectedTime(float(longest.mean()) / cells, float(longest.std(ddof=1)) / cells / trials**0.5)


def _longest(cells: int, robots: int, dead: int, trials: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the largest distance in cells from a working robot to the next working robot; int64, shape (trials,)."""
    starts = rng.integers(cells, size=(trials, robots))[:, dead:]  # all robots are equivalent, so the first ones are dead
    starts.sort(axis=1)
    around = starts[:, 0] + cells - starts[:, -1]
    return np.asarray(np.maximum(around, np.diff(starts, axis=1).max(axis=1, initial=0)))


def stay_share(robots: int, *, dead: int = 0) -> float:
    """Return the limit of `expected_time` for many cells.

    For k working robots, the limit is H_k/k, where H_k is the sum of 1/1 to 1/k. The limit is the mean length of the longest of the
    k arcs into which k random points divide a circle of length 1.

    Raises
    ------
    InvalidInputError

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
