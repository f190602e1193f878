"""Terrain: heights of the ground above sea level, and paths that follow the terrain."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline_checks import Points, text_of
from shoal.search.regions.projection import LocalFrame

Floats = NDArray[np.float64]

UNSAID = ""
_FINE = 8  # minimum number of samples per grid cell
_FINEST = 128
_MOST_SAMPLES = 20_000_000
_SHARE = 0.98  # fraction of the requested error that is used; the rest is for rounding in files


@dataclass(frozen=True, eq=False)
class Terrain:
    """Ground heights on a grid, with bilinear interpolation between the grid points.

    Parameters
    ----------
    heights : ndarray of float64, shape (rows, columns)
        Heights in metres above sea level, with rows from north to south. Missing heights are NaN.
    west, north : float
        Coordinates of the north-west grid point, in the coordinate reference system.
    steps : tuple of float
        Distance between neighbouring columns, and distance between neighbouring rows, as positive numbers.
    crs : str or None
        Coordinate reference system in PROJ notation, or None for metres without a position on Earth. With `UNSAID`, the coordinates
        are longitude and latitude for a region on Earth, and metres for any other region.
    name : str
        Name of the terrain in error messages.

    Examples
    --------
    >>> slope = Terrain(np.array([[0.0, 10.0], [0.0, 10.0]]), 0.0, 100.0, (100.0, 100.0), None)
    >>> slope.at([(25.0, 50.0), (100.0, 0.0)], None).tolist()
    [2.5, 10.0]
    """

    heights: Floats
    west: float
    north: float
    steps: tuple[float, float]
    crs: str | None
    name: str = "terrain"

    def at(self, points: ArrayLike, frame: LocalFrame | None) -> Floats:
        """Return the ground heights in metres at points given in metres of a local frame; float64, shape (n,).

        Raises
        ------
        InvalidInputError
            If a height is missing, or if the grid has a position on Earth and the points have none, or the reverse.
        """
        places = check_points(points, what="points", dimensions=2)
        return self._heights_at(self.grid_points(places, frame), places)

    def grid_points(self, points: Points, frame: LocalFrame | None) -> Points:
        """Convert points in metres of a local frame to fractional coordinates (column, row) of the grid."""
        if self.crs != UNSAID and (frame is None) != (self.crs is None):
            kinds = ("metres without a position on Earth", "a position on Earth")
            raise InvalidInputError(
                f"{self.name}: expected {kinds[frame is not None]}, as in the region, got {kinds[self.crs is not None]}"
            )
        placed = points
        if frame is not None and self.crs is not None:
            placed = frame.to_degrees(points)
            transformer = _transformer(self.crs or "EPSG:4326")
            if transformer is not None:
                placed = np.stack(transformer.transform(placed[:, 0], placed[:, 1]), axis=1)
        return np.stack([(placed[:, 0] - self.west) / self.steps[0], (self.north - placed[:, 1]) / self.steps[1]], axis=1)

    def _cells(self, places: Points) -> tuple[Any, Any]:
        """Return the column and the row of the grid cell that contains each point."""
        rows, columns = self.heights.shape
        cells = np.floor(np.where(np.isfinite(places), places, -1.0)).astype(np.int64)
        return np.clip(cells[:, 0], 0, max(columns - 2, 0)), np.clip(cells[:, 1], 0, max(rows - 2, 0))

    def _heights_at(self, places: Points, points: Points) -> Floats:
        rows, columns = self.heights.shape
        column, row = self._cells(places)
        right, down = places[:, 0] - column, places[:, 1] - row
        near = 1e-9 * max(rows, columns)
        inside = (np.abs(places - (columns - 1) / 2)[:, 0] <= (columns - 1) / 2 + near) & (
            np.abs(places - (rows - 1) / 2)[:, 1] <= (rows - 1) / 2 + near
        )
        corners = [self.heights[np.minimum(row + j, rows - 1), np.minimum(column + i, columns - 1)] for j in (0, 1) for i in (0, 1)]
        weights = [(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down]
        found = sum(np.where(weight == 0, 0.0, weight * corner) for weight, corner in zip(weights, corners, strict=True))
        lost = ~inside | ~np.isfinite(found)
        if lost.any():
            place = text_of(points[int(np.argmax(lost))])
            raise InvalidInputError(f"{self.name}: expected heights of the ground under the whole path, got none at {place}")
        return np.asarray(found, dtype=np.float64)

    def twist(self, places: Points) -> float:
        """Return the largest deviation from a plane, in metres, of the grid cells that contain the given points.

        The deviation of a grid cell is the vertical distance of one corner from the plane through the other three corners.
        """
        column, row = self._cells(places)
        one = np.minimum(column + 1, self.heights.shape[1] - 1), np.minimum(row + 1, self.heights.shape[0] - 1)
        bends = self.heights[row, column] - self.heights[row, one[0]] - self.heights[one[1], column] + self.heights[one[1], one[0]]
        return float(np.nanmax(np.abs(bends), initial=0.0))


@lru_cache(maxsize=8)
def _transformer(crs: str) -> Any:
    """Return the transformation from longitude and latitude to a coordinate reference system, or None for WGS84 itself."""
    from pyproj import CRS, Transformer

    system = CRS.from_user_input(crs)
    wgs84 = CRS.from_epsg(4326)
    if system.equals(wgs84, ignore_axis_order=True):
        return None
    return Transformer.from_crs(wgs84, system, always_xy=True)


@dataclass(frozen=True, eq=False)
class Profile:
    """The height of the ground below a path, sampled so densely that the ground is almost straight between samples.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 2)
        Sample positions along the path in metres, including the path's vertices.
    heights : ndarray of float64, shape (n,)
        Ground height of each sample in metres above sea level.
    vertices : ndarray of int64, shape (k,)
        Indices of the path's vertices among the samples.
    rough : float
        Maximum deviation of the ground from straight lines between samples, in metres.
    """

    points: Points
    heights: Floats
    vertices: NDArray[np.int64]
    rough: float


def profile_of(terrain: Terrain, way: Points, frame: LocalFrame | None, *, error: float) -> Profile:
    """Return ground heights below a path: at the path's vertices, at every crossed grid line, and at points in between.

    Parameters
    ----------
    terrain : Terrain
    way : ndarray of float64, shape (k, 2)
        Vertices of the path in metres.
    frame : LocalFrame or None
    error : float
        Allowed error of the height above ground, in metres. Between two samples, the ground deviates from a straight line by at
        most an eighth of ``error``, unless the terrain is too rough.

    Raises
    ------
    InvalidInputError
    """
    ends = terrain.grid_points(way, frame)
    spans = np.abs(np.diff(ends, axis=0)).max(axis=1, initial=0.0)
    fine = _FINE
    while True:
        counts = np.maximum(np.ceil(spans * fine), 1).astype(np.int64)
        if not np.isfinite(spans).all() or counts.sum() > _MOST_SAMPLES:
            raise InvalidInputError(
                f"{terrain.name}: expected a path over at most {_MOST_SAMPLES // fine} cells of the grid, got {spans.sum():.3g}"
            )
        legs = np.repeat(np.arange(len(counts)), counts)
        shares = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[legs]
        places = terrain.grid_points(_along(way, legs, shares), frame)
        rough = terrain.twist(places) / (4 * fine * fine)
        if rough <= error / 8 or fine >= _FINEST:
            break
        fine *= 2
    along = np.concatenate([legs + shares, [float(len(counts))], _crossings(legs + shares, np.vstack([places, ends[-1:]]))])
    along = np.unique(along)
    legs = np.minimum(along.astype(np.int64), len(counts) - 1)
    points = _along(way, legs, along - legs)
    vertices = np.searchsorted(along, np.arange(len(way)))
    points[vertices] = way
    return Profile(points, terrain.at(points, frame), vertices, rough)


def _along(way: Points, legs: NDArray[np.int64], shares: Floats) -> Points:
    return np.asarray(way[legs] + shares[:, None] * (way[legs + 1] - way[legs]))


def _crossings(along: Floats, places: Points) -> Floats:
    """Return the positions along a path at which the path crosses a grid line between two samples.

    A position is the index of a leg plus the passed fraction of this leg. Between two samples, the path crosses at most one
    vertical and one horizontal grid line.
    """
    along = np.append(along, np.ceil(along[-1] + 1e-12))
    found = []
    for axis in (0, 1):
        cell = np.floor(places[:, axis])
        crosses = np.flatnonzero(cell[:-1] != cell[1:])
        line = np.maximum(cell[:-1], cell[1:])[crosses]
        step = places[crosses + 1, axis] - places[crosses, axis]
        share = np.clip((line - places[crosses, axis]) / step, 0.0, 1.0)
        found.append(along[crosses] + share * (along[crosses + 1] - along[crosses]))
    return np.concatenate(found)


def limited_climbs(heights: Floats, climbs: Floats, sinks: Floats) -> Floats:
    """Return the lowest heights along a path that keep to limits of climb and descent, and are nowhere below given heights.

    Where the given heights rise or fall too steeply, the path climbs earlier, or descends later, than the given heights.

    Parameters
    ----------
    heights : ndarray of float64, shape (n,)
        Given height at each point of the path, in metres.
    climbs, sinks : ndarray of float64, shape (n - 1,)
        Largest climb and largest descent on each leg, in metres.

    Examples
    --------
    >>> limited_climbs(np.array([0.0, 0.0, 10.0, 0.0]), np.full(3, 6.0), np.full(3, 8.0)).tolist()
    [0.0, 4.0, 10.0, 2.0]
    """
    up, down = (np.concatenate([[0.0], np.cumsum(most)]) for most in (climbs, sinks))
    raised = np.maximum.accumulate((heights - up)[::-1])[::-1] + up
    return np.asarray(np.maximum.accumulate(raised + down) - down)


def followed(profile: Profile, clearance: float, error: float) -> Floats:
    """Return a path with a nearly constant height above the ground. The function adds points between the path's vertices.

    Parameters
    ----------
    profile : Profile
    clearance : float
        Height above the ground in metres.
    error : float
        Maximum deviation of the height above ground from ``clearance``, in metres, also between waypoints.

    Returns
    -------
    ndarray of float64, shape (m, 3)
        Points of the path as metres east, metres north, and metres above sea level.

    Examples
    --------
    >>> hill = Profile(np.array([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)]), np.array([0.0, 20.0, 0.0]), np.array([0, 2]), 0.0)
    >>> followed(hill, 30.0, 2.0).tolist()
    [[0.0, 0.0, 30.0], [50.0, 0.0, 50.0], [100.0, 0.0, 30.0]]
    """
    wanted = profile.heights + clearance
    most = max(_SHARE * error - profile.rough, 0.0)
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(profile.points, axis=0).T))])
    chosen = np.zeros(len(far), dtype=np.bool_)
    chosen[profile.vertices] = True
    while True:
        kept = np.flatnonzero(chosen)
        away = np.abs(np.interp(far, far[kept], wanted[kept]) - wanted)
        begins = kept[:-1]
        worst = np.maximum.reduceat(away, begins) if len(begins) else np.zeros(0)
        wrong = np.flatnonzero(worst > most)
        if not len(wrong):
            return np.column_stack([profile.points[kept], wanted[kept]])
        for stretch in wrong.tolist():
            begin, end = kept[stretch], kept[stretch + 1]
            chosen[begin + int(np.argmax(away[begin:end]))] = True
