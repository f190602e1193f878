"""Expected search time of robots that start in random cells of a tour (figure 5 of paper H): Monte Carlo estimate and theory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer

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


def expected_time(cells: int, robots: int, *, dead: int = 0, trials: int = 10_000, seed: int = 0) -> ExpectedTime:
    """Return the expected search time if each robot searches from its own start to the start of the next working robot.

    Parameters
    ----------
    cells : int
        Number of cells of the closed tour.
    robots : int
        Number of robots, including dead robots. The robots start in independent random cells.
    dead : int
        Number of dead robots, which never start. The last working robot before a dead robot on the tour also searches the dead
        robot's part, without a delay.
    trials : int
        Number of random trials, at least 2.
    seed : int
        Seed of the random start cells.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    On page 8 of paper H, T_UB is the search time of one robot, and T_LB = T_UB/m is the lower bound for m robots. The time of a
    trial is the makespan of ``allocate(..., allocator="stay")``. Robots first move to the centres of their cells, so each part
    consists of whole cells. If several robots start in the same cell, only one of these robots searches.

    For many cells, the mean approaches `stay_share`. With 64 cells and 50 robots, most robots share their start cell with another
    robot, and the exact mean is 0.6 % above `stay_share` (``tests/golden/test_search_figures.py``). With more robots than cells,
    the mean is far above `stay_share`, because the longest part has at least one whole cell.

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
    """Return, for each trial, the largest distance in cells from one working robot to the next; int64, shape (trials,)."""
    starts = rng.integers(cells, size=(trials, robots))[:, dead:]  # all robots are equivalent, so the first ones are dead
    starts.sort(axis=1)
    around = starts[:, 0] + cells - starts[:, -1]
    return np.asarray(np.maximum(around, np.diff(starts, axis=1).max(axis=1, initial=0)))


def stay_share(robots: int, *, dead: int = 0) -> float:
    """Return the limit that the mean of `expected_time` approaches for many cells.

    For k working robots, the mean approaches H_k/k with the harmonic number H_k = 1 + 1/2 + ... + 1/k. If k random points divide a
    circle of length 1 into k arcs, the longest arc has the mean length H_k/k.

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
