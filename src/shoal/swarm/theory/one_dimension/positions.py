"""Number of moves for given placements on a line: formulas over arrays of sorted positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import InvalidInputError


def check_positions(positions: ArrayLike, cells: int) -> NDArray[np.int64]:
    """Return positions as an int64 array of shape (..., n).

    Raises
    ------
    InvalidInputError
        If the positions are not strictly increasing whole numbers in 1 .. cells.
    """
    given = np.asarray(positions)
    if given.ndim < 1 or given.shape[-1] < 1 or not np.issubdtype(given.dtype, np.integer):
        raise InvalidInputError(
            f"positions: expected whole numbers, at least one per line, got {given.dtype} of shape {given.shape}"
        )
    array = given.astype(np.int64)
    if array.size and not 1 <= int(array.min()) <= int(array.max()) <= cells:
        raise InvalidInputError(f"positions: expected 1 to {cells}, got {array.min()} to {array.max()}")
    if (np.diff(array, axis=-1) <= 0).any():
        where = np.argwhere(np.diff(array, axis=-1) <= 0)[0]
        pair = array[(*where[:-1], slice(where[-1], where[-1] + 2))]
        raise InvalidInputError(f"positions: expected each larger than the one before, got {pair[0]} and then {pair[1]}")
    return array


def boundary_moves(positions: ArrayLike, *, cells: int) -> NDArray[np.int64]:
    """Return the number of moves until both ends of the line are found, if the particles first move to the left.

    The number is ``2 p_1 + cells - p_n + 1`` for sorted positions p_1 to p_n. The number is one less if the particles form one
    clump, because then no particle moves in the last move to the left.

    Parameters
    ----------
    positions : array_like of int, shape (..., n)
        Positions in 1 .. cells, in increasing order along the last axis.
    cells : int

    Returns
    -------
    ndarray of int64, shape (...)

    Raises
    ------
    InvalidInputError
        If the positions are invalid.

    Notes
    -----
    Source: paper M, section III.A.2. The last term of eq. 2 in this paper is the correction for the clump.

    Examples
    --------
    >>> boundary_moves([[3, 5], [3, 4]], cells=6).tolist()
    [8, 8]
    """
    p = check_positions(positions, cells)
    first, last = p[..., 0], p[..., -1]
    return np.asarray(2 * first + cells - last + 1 - (last - first == p.shape[-1] - 1))


def coverage_moves(positions: ArrayLike, *, cells: int) -> NDArray[np.int64]:
    """Return the number of moves until every cell was visited and both ends are found, if the particles first move to the left.

    Particle i at the position p_i moves ``L_i = min(p_1, p_i - i)`` cells to the left. Then ``R = cells - (p_n - L_n) + 1`` moves
    to the right find the other end, and ``p_{i+1} - p_i - 1 - (L_{i+1} - L_i)`` moves close the gap behind particle i. The total is
    p_1 plus the largest of these numbers of moves.

    Parameters
    ----------
    positions : array_like of int, shape (..., n)
        Positions in 1 .. cells, in increasing order along the last axis.
    cells : int

    Returns
    -------
    ndarray of int64, shape (...)

    Raises
    ------
    InvalidInputError
        If the positions are invalid.

    Notes
    -----
    The formula corrects paper M, section III.A.2, which ignores that the moves to the left have already reduced the first gap.

    Examples
    --------
    >>> coverage_moves([2, 9], cells=10).tolist()
    7
    """
    p = check_positions(positions, cells)
    left = np.minimum(p[..., :1], p - np.arange(1, p.shape[-1] + 1))
    most = cells - (p[..., -1] - left[..., -1]) + 1
    if p.shape[-1] > 1:
        most = np.maximum(most, (np.diff(p) - 1 - np.diff(left)).max(axis=-1))
    return np.asarray(p[..., 0] + most)
