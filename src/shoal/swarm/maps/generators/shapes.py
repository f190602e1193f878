"""The plainest maps: a straight line and a rectangle without walls inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def draw_line(count: int) -> NDArray[np.bool_]:
    """Return a straight corridor one cell wide: ndarray, bool, shape (1, count), all True.

    Source: paper M, Fig. 7 (map "linear", count 5000).
    """
    return np.ones((1, count), dtype=np.bool_)


def draw_rectangle(rows: int, columns: int) -> NDArray[np.bool_]:
    """Return an empty room: ndarray, bool, shape (rows, columns), all True.

    Source: paper M, Fig. 7 (map "empty rectangle", 50 rows, 100 columns).
    """
    return np.ones((rows, columns), dtype=np.bool_)
