"""Connected components of a grid of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.jit.entry import in_place_kernel


def connected_parts(
    free: NDArray[np.bool_], *, corners: bool = False
) -> tuple[NDArray[np.int32], int]:
    """Label the connected components of the free cells. Return the labels of all cells and the
    number of components.

    The result equals the result of `scipy.ndimage.label`. The function does not use SciPy, because
    the import of `scipy.ndimage` takes longer than a whole command of Shoal should take.

    Parameters
    ----------
    free : ndarray of bool, shape (H, W) or (D, H, W)
        Map with True for free cells.
    corners : bool
        Whether two cells that share only a corner are connected.

    Returns
    -------
    labels : ndarray of int32, the shape of ``free``
        Component labels 1, 2, ... in row-major order of the first cell of each component. Obstacles
        have the label 0.
    number : int
        Number of components.

    Examples
    --------
    >>> connected_parts(np.eye(2, dtype=bool))[0].tolist()
    [[1, 0], [0, 2]]
    """
    padded = np.pad(free, 1)
    steps = np.indices((3,) * free.ndim).reshape(free.ndim, -1).T - 1
    steps = steps[steps.any(axis=1) if corners else np.abs(steps).sum(axis=1) == 1]
    labels = np.zeros(padded.shape, dtype=np.int32)
    stack = np.empty(np.count_nonzero(free), dtype=np.int32)
    number = label_parts(padded.ravel(), steps @ padded.strides, labels.ravel(), stack)
    return np.ascontiguousarray(labels[(slice(1, -1),) * free.ndim]), int(number)


@in_place_kernel
def label_parts(free, offsets, labels, stack):
    """Label the connected components of the free cells with 1, 2, 3 and so on. Return the number of
    components.

    The labels have the order of the first cells of the components. All entries of ``labels`` must
    be 0. The array ``stack`` must have space for all free cells. No cell at the border of the grid
    may be free.
    """
    parts = 0
    for first in range(free.shape[0]):
        if not free[first] or labels[first] != 0:
            continue
        parts += 1
        labels[first], stack[0], size = parts, first, 1
        while size > 0:
            size -= 1
            cell = stack[size]
            for offset in offsets:
                neighbour = cell + offset
                if free[neighbour] and labels[neighbour] == 0:
                    labels[neighbour] = parts
                    stack[size] = neighbour
                    size += 1
    return parts
