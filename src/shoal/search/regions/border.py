"""The border of an area, arranged so that lines of sight are tested quickly."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.kernels.borders import (
    CLEAR,
    DOUBTFUL,
    BinnedLines,
    bins_of,
    find_bends,
    find_path,
    look,
    pull,
)

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
        size = max(float(np.sqrt(wide.prod() / bins)), float(wide.max()) / bins)
        shape = int(wide[1] / size) + 1, int(wide[0] / size) + 1
        first, members = bins_of(np.hstack([begins - low, ends - low]) / size, shape)
        self._lines = BinnedLines(np.hstack([begins, ends]), first, members, shape, low, size)

    def is_met(self, starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return, for each straight segment, whether it meets the border; bool, shape (n,).

        Parameters
        ----------
        starts, ends : ndarray of float64, shape (n, 2)
            Start and end of each segment in metres.
        """
        codes = np.empty(len(starts), dtype=np.int8)
        look(self._lines, *map(np.ascontiguousarray, (starts, ends)), codes)
        met: NDArray[np.bool_] = codes != CLEAR
        doubtful = np.flatnonzero(codes == DOUBTFUL)
        if len(doubtful):
            met[doubtful] = self._is_met_exactly(starts[doubtful], ends[doubtful])
        return met

    def path_around(
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
        bend_of = np.empty(len(places), dtype=np.int64)

        def find(*doubts: Any) -> tuple[int, int]:
            answered, met, unclear = doubts
            arguments = places, sides, ends, float(most), answered, met
            outcome: tuple[int, int] = find_path(self._lines, *arguments, bend_of, unclear)
            return outcome

        bends = self._resolve_doubts(find, partial(_segments_between, points))
        return None if bends < 0 else bend_of[:bends].copy()

    def pull(self, path: NDArray[np.float64], ahead: int) -> NDArray[np.int64]:
        """Return the indices of those points of a path from each of which the last visible one of
        the next ``ahead`` points is kept, too; int64, shape (k,). The last point is among them.

        Parameters
        ----------
        path : ndarray of float64, shape (n, 2)
            The path in metres, with legs that do not meet the border.
        ahead : int
        """
        points, indices = np.ascontiguousarray(path), np.empty(len(path), dtype=np.int64)

        def find(answered: Any, met: Any, unclear: Any) -> tuple[int, int]:
            outcome: tuple[int, int] = pull(
                self._lines, points, ahead, answered, met, indices, unclear
            )
            return outcome

        return indices[: self._resolve_doubts(find, partial(_segments_between, points))]

    def with_fewer_bends(
        self, path: NDArray[np.float64], lengths: NDArray[np.float64], price: float
    ) -> NDArray[np.float64]:
        """Return the bends of the path that `shoal.search.cells.bends.with_fewer_bends` describes;
        float64, shape (k, 2).

        Parameters
        ----------
        path : ndarray of float64, shape (n, 2)
            A path in metres, with legs that do not meet the border.
        lengths : ndarray of float64, shape (n - 1,)
            The lengths of its legs, above 0.
        price : float
            Length in metres that a bend may cost.
        """
        bends, ends = np.empty((len(lengths) - 1, 2)), np.empty((_DOUBTS, 4))
        arguments = np.ascontiguousarray(path), lengths, float(price)

        def find(answered: Any, met: Any, unclear: Any) -> tuple[int, int]:
            outcome: tuple[int, int] = find_bends(
                self._lines, *arguments, answered, met, bends, unclear, ends
            )
            return outcome

        count = self._resolve_doubts(find, lambda codes: ends[: len(codes)])
        return bends[:count][::-1]

    def _resolve_doubts(
        self,
        find: Callable[..., tuple[int, int]],
        segments: Callable[[NDArray[np.int64]], NDArray[np.float64]],
    ) -> int:
        """Return what a kernel finds, called again as long as it took a segment for blocked that is
        not.

        Parameters
        ----------
        find : callable
            Function that calls the kernel with the arguments ``answered``, ``met`` and ``doubts``
            of `shoal.search.kernels.borders`, and returns its result and the number of doubts.
        segments : callable
            Function that returns the ends (x, y, x, y) of the segments with given numbers.
        """
        answered, met = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
        doubts = np.empty(_DOUBTS, dtype=np.int64)
        while True:
            result, doubtful = find(answered, met, doubts)
            if not doubtful:
                return result
            ends = segments(doubts[:doubtful])
            blocked = self._is_met_exactly(ends[:, :2], ends[:, 2:])
            answered, first = np.unique(np.append(answered, doubts[:doubtful]), return_index=True)
            met = np.append(met, blocked)[first]
            if blocked.all() and doubtful < _DOUBTS:
                return result

    def _is_met_exactly(
        self, starts: NDArray[np.float64], ends: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        import shapely

        lines = shapely.linestrings(np.stack([starts, ends], axis=1))
        return np.asarray(shapely.intersects(self._border, lines))


def _segments_between(points: NDArray[np.float64], codes: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the segments (x, y, x, y) between points i and j of n, which have the numbers i n + j."""
    return np.hstack([points[ends] for ends in np.divmod(codes, len(points))])
