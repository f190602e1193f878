"""The border of an area, arranged so that lines of sight are tested quickly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.kernels.borders import CLEAR, DOUBTFUL, bins_of, look

_BINS = 4_000_000  # largest number of bins
_LINES = 2.0  # number of lines for each bin, if each had equally many


class Border:
    """The border of an area, and a grid of bins with the lines of the border that each touches.

    A bin is smaller the more lines the border has, so that a test of a segment takes little longer
    near a border of many corners.

    Parameters
    ----------
    area : Shapely polygon or multipolygon
    """

    def __init__(self, area: Any) -> None:
        import shapely

        self._border = shapely.boundary(area)
        shapely.prepare(self._border)
        points, line = shapely.get_coordinates(shapely.get_parts(self._border), return_index=True)
        same = line[1:] == line[:-1]
        begins, ends = points[:-1][same], points[1:][same]
        low = points.min(axis=0, initial=np.inf)
        wide = np.maximum(points.max(axis=0, initial=-np.inf) - low, 1e-9)
        bins = min(max(1.0, len(begins) / _LINES), _BINS)
        # at most that many bins, whatever the shape of the area
        self._size = max(float(np.sqrt(wide.prod() / bins)), float(wide.max()) / bins)
        self._shape = (int(wide[1] / self._size) + 1, int(wide[0] / self._size) + 1)
        self._corner = low
        self._lines = np.hstack([begins, ends])
        in_bins = np.hstack([begins - low, ends - low]) / self._size
        self._first, self._members = bins_of(in_bins, self._shape)

    def is_met(self, starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return, for each straight segment, whether it meets the border; bool, shape (n,).

        Parameters
        ----------
        starts, ends : ndarray of float64, shape (n, 2)
            Start and end of each segment in metres.
        """
        import shapely

        found = np.empty(len(starts), dtype=np.int8)
        bins = self._first, self._members, self._shape, self._corner, self._size
        look(self._lines, *bins, *map(np.ascontiguousarray, (starts, ends)), found)
        met: NDArray[np.bool_] = found != CLEAR
        doubtful = np.flatnonzero(found == DOUBTFUL)
        if len(doubtful):
            segments = np.stack([starts[doubtful], ends[doubtful]], axis=1)
            met[doubtful] = shapely.intersects(self._border, shapely.linestrings(segments))
        return met
