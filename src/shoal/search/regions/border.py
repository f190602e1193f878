"""The border of an area, arranged so that lines of sight are tested quickly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.kernels.borders import CLEAR, DOUBTFUL, bins_of, find_way, look

_BINS = 4_000_000  # largest number of bins
_DOUBTS = 64  # lines of sight that are tested exactly at once
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
        found = np.empty(len(starts), dtype=np.int8)
        look(*self._bins, *map(np.ascontiguousarray, (starts, ends)), found)
        met: NDArray[np.bool_] = found != CLEAR
        doubtful = np.flatnonzero(found == DOUBTFUL)
        if len(doubtful):
            met[doubtful] = self._is_met_exactly(starts[doubtful], ends[doubtful])
        return met

    def way_round(
        self,
        places: NDArray[np.float64],
        sides: NDArray[np.float64],
        ends: NDArray[np.float64],
        most: float,
    ) -> NDArray[np.int64] | None:
        """Return the corners at which the shortest path that does not meet the border bends, as
        indices of ``places``; int64, shape (k,). If no path exists, return None.

        Parameters
        ----------
        places : ndarray of float64, shape (n, 2)
            The corners at which the path may bend, in metres.
        sides : ndarray of float64, shape (n, 4)
            Unit vectors from each corner to the corners of the border before and after it.
        ends : ndarray of float64, shape (2, 2)
            Start and end of the path.
        most : float
            Length in metres up to which paths count.
        """
        points = np.concatenate([places, ends])
        way = np.empty(len(places), dtype=np.int64)
        known, met = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
        doubts = np.empty(_DOUBTS, dtype=np.int64)
        while True:
            given = places, sides, ends, float(most), known, met
            bends, doubtful = find_way(*self._bins, *given, way, doubts)
            clear = False
            if doubtful:
                one, other = np.divmod(doubts[:doubtful], len(points))
                blocked = self._is_met_exactly(points[one], points[other])
                known, first = np.unique(np.append(known, doubts[:doubtful]), return_index=True)
                met = np.append(met, blocked)[first]
                clear = bool((~blocked).any()) or doubtful == _DOUBTS
            if not clear:
                return None if bends < 0 else way[:bends].copy()

    @property
    def _bins(self) -> tuple[Any, ...]:
        return self._lines, self._first, self._members, self._shape, self._corner, self._size

    def _is_met_exactly(
        self, starts: NDArray[np.float64], ends: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        import shapely

        lines = shapely.linestrings(np.stack([starts, ends], axis=1))
        return np.asarray(shapely.intersects(self._border, lines))
