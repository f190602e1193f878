"""Strips: the division of cells into the fewest straight strips, along rows and columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MOST_CELLS = 30_000
"""Maximum number of cells that are divided; in larger regions, all strips are rows."""

_UNIT = 1000  # capacity of half a strip: capacities are whole numbers
_BIAS = 10  # for rows: columns must save strips


def fewest_strips(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the fewest strips that contain all True cells of a mask; int64, shape (S, 2, 2): first
    and last cell of each strip as (row, column).

    A strip is a sequence of neighbouring cells in a row or in a column. Let x_c be 1 if the strip
    of the cell c runs along its row, and 0 otherwise. Strips have as many cells as steps plus one,
    so their number is

        sum_c 1 - sum_(a, b) x_a x_b - sum_(a, d) (1 - x_a) (1 - x_d)

    over all neighbours (a, b) in a row and (a, d) in a column. The products enter with a minus, so
    a minimum cut finds the best x (Ramesh, Imeson, Fidan and Smith, "Optimal partitioning of
    non-convex environments for minimum turn coverage planning", RA-L 7, 2022, solve the same
    problem as a linear program).

    Examples
    --------
    >>> shape = np.array([[True, True, True], [True, False, False], [True, False, False]])
    >>> fewest_strips(shape).tolist()
    [[[0, 0], [0, 2]], [[1, 0], [2, 0]]]
    """
    along = mask if np.count_nonzero(mask) > MOST_CELLS else _along_rows(mask)
    across = np.ascontiguousarray((mask & ~along).T)
    return np.concatenate([runs_in(along), runs_in(across)[..., ::-1]])


def cells_of_strip(strip: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return all cells of a strip that is given by its first and last cell; int64, shape (k, 2)."""
    step = strip[1] - strip[0]
    return np.asarray(strip[0] + np.arange(np.abs(step).max() + 1)[:, None] * np.sign(step))


def _along_rows(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells whose strips run along their rows."""
    from shoal.search.kernels.cuts import source_side

    number = np.full(mask.shape, -1)
    count = np.count_nonzero(mask)
    number[mask] = np.arange(count)
    beside, below = mask[:, 1:] & mask[:, :-1], mask[1:] & mask[:-1]
    rows = np.stack([number[:, :-1][beside], number[:, 1:][beside]])
    columns = np.stack([number[:-1][below], number[1:][below]])
    # x_a x_b = (x_a + x_b - |x_a - x_b|) / 2: each step in a row rewards both of its cells for
    # being in a row, and each step between cells of different strips costs half a strip.
    gain = _UNIT * (
        np.bincount(rows.ravel(), minlength=count) - np.bincount(columns.ravel(), minlength=count)
    )
    gain += _BIAS
    first, second = np.concatenate([rows, columns], axis=1)
    begins, ends = np.concatenate([first, second]), np.concatenate([second, first])
    order = np.argsort(begins, kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    inside = source_side(
        np.searchsorted(begins[order], np.arange(count + 1)),
        ends[order],
        place[(order + len(first)) % max(1, len(order))],
        np.full(len(order), _UNIT),
        np.maximum(gain, 0),
        np.maximum(-gain, 0),
    )
    along = np.zeros(mask.shape, dtype=np.bool_)
    along[mask] = inside
    return along


def runs_in(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return first and last cell of all runs of a mask in reading order; int64, shape (R, 2, 2)."""
    padded = np.zeros((len(mask), mask.shape[1] + 2), dtype=np.bool_)
    padded[:, 1:-1] = mask
    before, after = padded[:, :-1], padded[:, 1:]
    row, first = np.nonzero(after & ~before)
    last = np.nonzero(before & ~after)[1] - 1
    return np.stack([row, first, row, last], axis=1).reshape(-1, 2, 2)
