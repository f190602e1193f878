"""Numbers of moves for given placements of particles on a line, computed from arrays of sorted positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import InvalidInputError


def check_positions(positions: ArrayLike, cells: int) -> NDArray[np.int64]:
    """Return the positions of n particles on a line as an int64 array of shape (..., n).

    Raises
    ------
    InvalidInputError
        Raised if the positions are not strictly increasing whole numbers from 1 to ``cells``.
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
    """Return the number of moves until the particles have found both ends of the line. The particles first move to the left.

    For particles at sorted positions p_1 to p_n, the number of moves is ``2 p_1 + cells - p_n + 1``. If the particles have no gaps
    between them, the number of moves is one less, because no particle moves in the last move to the left.

    Parameters
    ----------
    positions : array_like of int, shape (..., n)
        Positions of the n particles, from 1 to ``cells``, in increasing order along the last axis.
    cells : int

    Returns
    -------
    ndarray of int64, shape (...)

    Raises
    ------
    InvalidInputError
        Raised if the positions are not strictly increasing whole numbers from 1 to ``cells``.

    Notes
    -----
    Source: paper M, section III.A.2. The last term of equation 2 in paper M accounts for particles without gaps between them.

    Examples
    --------
    >>> boundary_moves([[3, 5], [3, 4]], cells=6).tolist()
    [8, 8]
    """
    p = check_positions(positions, cells)
    first, last = p[..., 0], p[..., -1]
    return np.asarray(2 * first + cells - last + 1 - (last - first == p.shape[-1] - 1))


def coverage_moves(positions: ArrayLike, *, cells: int) -> NDArray[np.int64]:
    """Return the number of moves until the particles, moving first to the left, have visited every cell and found both ends.

    The number of moves to the left equals the position p_1 of the first particle. Particle number i at the position p_i moves
    ``min(p_1, p_i - i)`` cells to the left. On the way to the right, the last particle needs one move more than the number of
    cells to its right. Each particle except the last needs one move to the right for each cell of the gap to the next particle.
    The total number of moves is p_1 plus the largest number of moves that a particle needs to the right.

    Parameters
    ----------
    positions : array_like of int, shape (..., n)
        Positions of the n particles, from 1 to ``cells``, in increasing order along the last axis.
    cells : int

    Returns
    -------
    ndarray of int64, shape (...)

    Raises
    ------
    InvalidInputError
        Raised if the positions are not strictly increasing whole numbers from 1 to ``cells``.

    Notes
    -----
    The formula for full coverage corrects paper M, section III.A.2. Paper M ignores that the moves to the left have already reduced
    one gap.

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
