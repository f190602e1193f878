"""The choice of a search region from the energy of the robots and their extreme positions."""

from __future__ import annotations

from math import ceil, hypot

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.checks import check_integer, check_list, check_number, check_points
from shoal.core.errors import InvalidInputError

Rectangle = tuple[tuple[float, float], tuple[float, float]]


def affordable_rectangle(
    starts: ArrayLike, ranges: ArrayLike, *, footprint: float, losses: int = 0
) -> Rectangle:
    """Return the largest rectangle around the extreme robots that the robots can search together.

    The rectangle has the same margin on all four sides of the smallest rectangle that contains all
    starts. Paper H, section Further Research, asks for a region from the energy stores and the
    initial positions of the extreme robots.

    Parameters
    ----------
    starts : array_like of float, shape (m, 2)
        Positions of the robots in metres.
    ranges : array_like of float, shape (m,)
        Distance in metres that each robot can travel with its energy.
    footprint : float
        Side of a cell in metres.
    losses : int
        Number of robots that may fail, those with the longest ranges first.

    Returns
    -------
    tuple
        The lower left and the upper right corner, in metres.

    Raises
    ------
    InvalidInputError
        If the robots cannot search even the smallest rectangle that contains all starts.

    Notes
    -----
    Let the rectangle have N cells of side s and the diagonal d. A closed tour of steps between
    neighbours is at most (N + 1) s long, or 2 N s in a single row of cells. A robot with the range r comes to any place of the tour
    and back within 2 d, so that it can search r - 2 d of the tour. The rectangle is affordable if
    these lengths of the remaining robots add up to the length of the tour.

    Examples
    --------
    >>> affordable_rectangle([(0, 0), (100, 60)], [4000, 4000], footprint=10)
    ((-85.0, -85.0), (185.0, 145.0))
    """
    points = check_points(starts, what="starts", dimensions=2)
    side = check_number(footprint, what="footprint", above=0)
    lengths = [
        check_number(value, what="ranges", least=0) for value in check_list(ranges, what="ranges")
    ]
    if not len(points) or len(lengths) != len(points):
        raise InvalidInputError(
            f"ranges: expected one or more starts and as many ranges, got {len(points)} starts and"
            f" {len(lengths)} ranges"
        )
    losses = check_integer(losses, what="losses", least=0, most=len(points) - 1)
    surviving_lengths = sorted(lengths)[: len(points) - losses]
    low, high = points.min(axis=0), points.max(axis=0)

    def missing(steps: int) -> float:
        """Return how many metres the robots lack for a margin of ``steps`` half cells."""
        width, height = np.maximum(high - low + steps * side, side)
        columns, rows = ceil(width / side - 1e-9), ceil(height / side - 1e-9)
        cells = columns * rows
        tour = (cells + 1 if min(columns, rows) > 1 else 2 * cells) * side
        searched = sum(max(value - 2 * hypot(width, height), 0.0) for value in surviving_lengths)
        return float(tour - searched)

    if missing(0) > 0:
        raise InvalidInputError(
            "ranges: expected enough for the rectangle around the extreme robots, got"
            f" {missing(0):.0f} m too little"
        )
    steps = 0
    while missing(steps + 1) <= 0:
        steps += 1
    # a single robot, or robots in a row, still get one cell
    grown = np.maximum((high - low + steps * side) / 2, side / 2)
    middle = (low + high) / 2
    first, last = (middle - grown).tolist(), (middle + grown).tolist()
    return (first[0], first[1]), (last[0], last[1])
