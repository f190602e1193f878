"""How long a search takes on average if robots stay where they are (paper H, p. 8, Fig. 5): Monte Carlo, and theory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer

_AT_ONCE = 2_000_000  # positions that are drawn at once


class ExpectedTime(NamedTuple):
    """A mean, and how far off it may be.

    Parameters
    ----------
    mean : float
        T_E/T_UB: the time until all is searched as a share of what one robot needs.
    error : float
        Standard error of the mean.
    """

    mean: float
    error: float


def expected_time(cells: int, robots: int, *, dead: int = 0, trials: int = 10_000, seed: int = 0) -> ExpectedTime:
    """Return the expected time of a search in which each robot searches from its start to that of the next one that lives.

    Parameters
    ----------
    cells : int
        Of the tour, which is closed.
    robots : int
        In independent random cells.
    dead : int
        How many of them never start. The robot behind goes on into what a dead one leaves; how long it waits before is not counted.
    trials : int
        Two or more.
    seed : int

    Raises
    ------
    InvalidInputError

    Notes
    -----
    Paper H, p. 8: T_UB is the time of one robot, T_LB = T_UB/m. The time is that of ``allocate(..., allocator="stay")``: robots
    move to the middles of their cells, so that stretches are whole cells, and of several robots in a cell only one goes on.

    `stay_share` is the limit of many cells. With 64 cells and 50 robots, where most share a cell with another, the mean is 0.6 %
    above it, counted exactly (``tests/golden/test_search_figures.py``). With more robots than cells it is far above: no stretch is
    shorter than a cell.

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
    """Return the longest way from a robot that lives to the next one, in cells; int64, shape (trials,)."""
    starts = rng.integers(cells, size=(trials, robots))[:, dead:]  # all are alike: let the first ones be dead
    starts.sort(axis=1)
    around = starts[:, 0] + cells - starts[:, -1]
    return np.asarray(np.maximum(around, np.diff(starts, axis=1).max(axis=1, initial=0)))


def stay_share(robots: int, *, dead: int = 0) -> float:
    """Return what `expected_time` tends to: H_k/k for the k robots that live, H_k the sum of 1/1 to 1/k.

    The mean of the longest of the k stretches into which k random places cut a circle.

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
    check_integer(dead, what="dead", least=0, most=robots - 1)  # one robot must live
