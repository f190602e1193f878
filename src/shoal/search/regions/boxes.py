"""Boxes: what of a shape lies in each of many, and what they leave of one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.regions.outline import Points

_FEW_BOXES, _FEW_CORNERS = 4, 64


def clip_to_boxes(shape: Any, low: Points, high: Points) -> Any:
    """Return the part of a Shapely polygon or line inside each of many boxes; Shapely geometries,
    shape (n,).

    The function divides the boxes recursively into halves, and cuts the shape to the bounds of each
    half. So the time for a box does not grow with the number of the shape's corners.

    Parameters
    ----------
    shape : Shapely geometry
    low, high : ndarray of float64, shape (n, 2)
        Lower left and upper right corner of each box.
    """
    import shapely

    pieces = np.full(len(low), None, dtype=object)
    stack = [(shape, np.arange(len(low)))]
    while stack:
        part, boxes = stack.pop()
        if len(boxes) <= _FEW_BOXES or shapely.get_num_coordinates(part) <= _FEW_CORNERS:
            pieces[boxes] = shapely.intersection(part, shapely.box(*low[boxes].T, *high[boxes].T))
            continue
        middles = low[boxes] + high[boxes]
        order = boxes[np.argsort(middles[:, np.argmax(np.ptp(middles, axis=0))], kind="stable")]
        for half in np.array_split(order, 2):
            least, most = low[half].min(axis=0), high[half].max(axis=0)
            # wider, so that what touches a box on its side is cut by this box only
            some = 0.01 * (most - least)
            bounds = shapely.box(*(least - some), *(most + some))
            stack.append((_keep_dimension(shapely.intersection(part, bounds), shape), half))
    return pieces


def _keep_dimension(cut: Any, shape: Any) -> Any:
    """Return the parts of a cut shape that have the dimension of the whole ``shape``."""
    import shapely

    if cut.geom_type != "GeometryCollection":
        return cut
    parts = shapely.get_parts(cut)
    alike = parts[shapely.get_dimensions(parts) == shapely.get_dimensions(shape)]
    return shapely.union_all(alike)


def uncovered(
    rectangles: NDArray[np.float64], box: NDArray[np.float64], gap: float
) -> NDArray[np.float64]:
    """Return the parts of a box that upright rectangles do not cover, apart from gaps up to twice
    the width ``gap``, as boxes; float64, shape (k, 4).

    All are given by their bounds (left, low, right, high). All sides together divide the box into
    a table of fields, and each field lies in a rectangle or in none.

    Examples
    --------
    >>> uncovered(np.array([(0.0, 0.0, 3.0, 4.0)]), np.array([0.0, 0.0, 5.0, 4.0]), 0.0).tolist()
    [[3.0, 0.0, 5.0, 4.0]]
    """
    lines, places = [], []
    for axis in (0, 1):
        low, high = rectangles[:, axis] - gap, rectangles[:, axis + 2] + gap
        ends = np.clip(np.array([low, high]), box[axis], box[axis + 2])
        sides, place = np.unique(np.append(ends, box[axis::2]), return_inverse=True)
        lines.append(sides)
        places.append(place[:-2].reshape(2, -1))
    (x, y), (cols, rows) = lines, places
    # how many rectangles cover each field: sums of what changes at their corners
    counts = np.zeros((len(y), len(x)), dtype=np.int64)
    for row, sign in zip(rows, (1, -1), strict=True):
        np.add.at(counts, (row, cols[0]), sign)
        np.add.at(counts, (row, cols[1]), -sign)
    counts = counts.cumsum(axis=0).cumsum(axis=1)
    # beside each other in a row, fields are one box
    free = np.zeros((len(y) - 1, len(x) + 1), dtype=np.int8)
    free[:, 1:-1] = counts[:-1, :-1] == 0
    changes = np.diff(free, axis=1)
    row, begin = np.nonzero(changes == 1)
    end = np.nonzero(changes == -1)[1]
    return np.column_stack([x[begin], y[row], x[end], y[row + 1]])
