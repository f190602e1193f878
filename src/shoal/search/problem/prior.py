"""Priors: where a target is how likely, before anything was searched."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from math import ceil, floor, inf, tau
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import (
    check_file,
    check_number,
    check_text,
    count_text,
    parse_json,
    read_text,
    shortened,
)
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, import_extra
from shoal.core.notices import tell_once
from shoal.search.cells.layers import Grid, LayeredGrid, layers_of
from shoal.search.problem.target import Drift, Ground, MovingGround, Tracks
from shoal.search.regions.builder import list_of
from shoal.search.regions.formats.geodata import crs_name
from shoal.search.regions.outline import Points
from shoal.search.regions.projection import conversion
from shoal.search.regions.region import SearchRegion
from shoal.search.tours import Tour

Floats = NDArray[np.float64]

LARGEST_PRIOR = 256 * 2**20
"""Maximum size of a prior file in bytes."""

_MOST_NUMBERS = 100_000_000 // 4  # of an array
_FINE, _COARSE = 4, 2  # samples along the side of a cell, in most and in large searches
_SMALL = 200_000  # cells
_ENOUGH, _FINEST = 25_600, 32  # samples that few cells have, and along the side of one at most
_AT_ONCE = 200_000  # samples
_MOST_LOOKED = 4_000_000  # samples of the ground that was seen before
_CERTAIN = 1.0 - 1e-6
_COUNTED_TWICE = 0.01  # of the probability
_CORNERS = 64  # of a part of a shape
_WIDEST = 2**31  # squares
_TRIES = 100  # of finding a place in the area
_UPRIGHT = 1e-12  # share of the box around a rectangle along the axes that it may miss
_ROUNDED = 1e-9  # pixels: rounding error of a border
_NEAR = 8.0  # sides of a square from the middle of a ring, within which its mass is exact
_FALLS = 16  # times to 1 / e, beyond which a ring has nothing left
_FALL_STEPS = 8  # of a distribution function that falls to 1 / e
_SPREADS = 6.0  # standard deviations beyond which a spread point counts as nothing
_DRIFT = re.compile(r"([^,:]+),([^,:]+)(?::([^,:]+))?")
_UNITS = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "day": 86400.0}  # of times, in seconds
_RING = re.compile(r"ring:(?P<x>[^,:]+),(?P<y>[^,:]+):(?P<quantiles>.+)")
_WEIGHTED = re.compile(r"(?P<weight>\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+)\*(?P<what>.+)")
_TRACKS = ".nc"
_FILES = (".npy", ".tif", ".tiff", ".asc", ".geojson", ".json", _TRACKS)
_FASTEST = 1_000.0  # metres per second
_PARTICLES = 8_000  # that stand for a moving target


@dataclass(frozen=True, eq=False)
class Raster:
    """A density on a grid.

    Parameters
    ----------
    values : ndarray of float64, shape (rows, columns)
        Probability of each pixel, with rows from north to south. Together, they are 1.
    west, north : float
        North-west corner in metres.
    sides : tuple of float
        Width and height of a pixel in metres.
    """

    values: Floats
    west: float
    north: float
    sides: tuple[float, float]

    def density(self, points: Points, side: float) -> Floats:
        """Return the mean probability per square metre in squares (see `Density`)."""
        width, height = self.sides
        places = np.column_stack(
            [(points[:, 0] - self.west) / width, (self.north - points[:, 1]) / height]
        )
        mean = _mean_pixel(self.values, places, side / width, side / height)
        return mean / (width * height)

    def covered(self, points: Points, side: float) -> Floats:
        """Return the share of each square in the grid; float64, shape (n,)."""
        height, width = self.values.shape
        across, down = self.sides
        low = np.array([self.west, self.north - height * down])
        high = np.array([self.west + width * across, self.north])
        return _shares_in_box(points, side, low, high)


@dataclass(frozen=True, eq=False)
class GeoRaster:
    """A density in a file with its own coordinates on Earth.

    Parameters
    ----------
    grid : Terrain
        The file, whose numbers stand for probabilities.
    region : SearchRegion
    """

    grid: Any
    region: SearchRegion

    def density(self, points: Points, side: float) -> Floats:
        """Return the mean probability per square metre in squares (see `Density`), which count as if
        they lay along the pixels.
        """
        places, sides, scale = self._pixels(points, side)
        return _mean_pixel(self.grid.heights, places, *sides) * scale

    def covered(self, points: Points, side: float) -> Floats:
        """Return the share of each square in the grid; float64, shape (n,)."""
        places, sides, _ = self._pixels(points, side)
        size = np.array(self.grid.heights.shape[::-1])
        return _shares_in_box(places, sides, np.zeros(2), size)

    def _pixels(self, points: Points, side: float) -> tuple[Points, Floats, float]:
        """Return the middles of squares in pixels from the corner, the squares' sides in pixels, and
        the number of pixels in a square metre.
        """
        places = self.grid.grid_points(points, self.region.frame) + 0.5
        # metres of the frame to pixels, in the middle of the points
        middle = points.mean(axis=0)
        corners = self.grid.grid_points(
            middle + np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]), self.region.frame
        )
        (a, b), (c, d) = corners[1:] - corners[0]
        sides = side * np.array([np.hypot(a, c), np.hypot(b, d)])
        return places, sides, float(abs(a * d - b * c))


@dataclass(frozen=True, eq=False)
class DistanceRing:
    """A density around a last known point, whose distribution of distances has given quantiles.

    Between two quantiles, the distribution function of the distance is a straight line. Beyond the
    last one, it approaches 1 exponentially, at first as fast as before.

    Parameters
    ----------
    middle : ndarray of float64, shape (2,)
        The last known point in metres.
    shares : ndarray of float64, shape (k,)
        Increasing probabilities above 0 and below or equal to 1.
    distances : ndarray of float64, shape (k,)
        For each probability, the distance within which the target is, in metres.
    """

    middle: Floats
    shares: Floats
    distances: Floats

    def density(self, points: Points, side: float) -> Floats:
        """Return the mean probability per square metre in squares (see `Density`).

        It is exact near the middle, where 1 / r is far from straight or infinite, and where the
        distribution function bends. Elsewhere, its slope at the middle of a square counts.
        """
        away = np.linalg.norm(points - self.middle, axis=1)
        shares, radii = self.distribution
        ends = np.interp(away + side / 2, radii, shares), np.interp(away - side / 2, radii, shares)
        density = np.asarray((ends[0] - ends[1]) / (side * tau * np.maximum(away, side)))
        exact = away < _NEAR * side
        for bend in self.distances:
            exact |= np.abs(away - bend) < side
        last, end = self.distances[-1], radii[-1]
        if last < end < last + _FALLS * side:
            exact |= (away > last) & (away < end + side)
        density[exact] = self._exact(points[exact] - self.middle, side)
        return density

    @cached_property
    def distribution(self) -> tuple[Floats, Floats]:
        """Values of the distribution function, and their distances, between which it is a straight
        line.
        """
        shares, distances = np.append(0.0, self.shares), np.append(0.0, self.distances)
        rest = 1.0 - shares[-1]
        if rest > 0:
            # the distance in which what is left falls to 1 / e
            fall = rest * (distances[-1] - distances[-2]) / (shares[-1] - shares[-2])
            past = np.linspace(0.0, _FALLS, _FALL_STEPS * _FALLS + 1)[1:]
            distances = np.concatenate([distances, distances[-1] + fall * past])
            shares = np.concatenate([shares, 1.0 - rest * np.exp(-past[:-1]), [1.0]])
        return shares, distances

    def _exact(self, offsets: Points, side: float) -> Floats:
        """Return the mean in squares at offsets from the middle: the slope of the distribution
        function, times the integral of 1 / (2 pi r) over the part of the square between two
        distances, summed over all pairs of them, and divided by the square's area.
        """
        shares, radii = self.distribution
        total, away = np.zeros(len(offsets)), np.linalg.norm(offsets, axis=1)
        for (low, high), share in zip(pairwise(radii.tolist()), np.diff(shares), strict=True):
            there = np.flatnonzero((away > low - side) & (away < high + side))
            if len(there):
                own = offsets[there]
                part = _integral(own, side, high) - _integral(own, side, low)
                total[there] += share / (high - low) * np.maximum(part, 0.0)
        return total / (tau * side**2)


def _integral(middles: Points, side: float, radius: float) -> Floats:
    """Return the integral of 1 / r over the part of squares within a radius of the origin.

    In polar coordinates, that of a rectangle between the origin and a corner is the integral over
    the angle of the distance to the rectangle's border or to the circle, whichever is nearer. A
    square is the sum of four such rectangles with signs.
    """
    total = np.zeros(len(middles))
    if not radius:
        return total
    for right, up in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        x, y = (middles + np.array([right, up]) * (side / 2)).T
        signs = right * up * np.sign(x) * np.sign(y)
        for near, far in ((abs(x), abs(y)), (abs(y), abs(x))):
            angle = np.arctan2(far, near)  # of the corner, from the axis that meets this side
            leaves = np.minimum(np.arccos(np.minimum(near / radius, 1.0)), angle)
            # up to there, the border is at near / cos(angle), and beyond it the circle is nearer
            total += signs * (near * np.arcsinh(np.tan(leaves)) + radius * (angle - leaves))
    return total


@dataclass(frozen=True, eq=False)
class Spread:
    """Normal distributions around points.

    Parameters
    ----------
    points : ndarray of float64, shape (k, 2)
        Positions in metres.
    spreads : ndarray of float64, shape (k,)
        Standard deviation of the distance along each axis, in metres.
    weights : ndarray of float64, shape (k,)
        Probability of each point. Together, they are 1.
    """

    points: Points
    spreads: Floats
    weights: Floats

    def density(self, points: Points, side: float) -> Floats:
        """Return the mean probability per square metre in squares (see `Density`)."""
        from scipy.special import ndtr

        total = np.zeros(len(points))
        for place, spread, weight in zip(self.points, self.spreads, self.weights, strict=True):
            offsets = points - place
            near = (np.abs(offsets) <= _SPREADS * spread + side / 2).all(axis=1)
            # between the ends along both axes; from the upper tail, which has more digits
            inner = np.abs(offsets[near]) - side / 2
            shares = ndtr(-inner / spread) - ndtr(-(inner + side) / spread)
            total[near] += weight * shares.prod(axis=1) / side**2
        return total


@dataclass(frozen=True, eq=False)
class Segments:
    """Areas with a probability each, which is the same everywhere in an area.

    Parameters
    ----------
    shapes : tuple of shapely Polygon or MultiPolygon
        Areas in metres.
    weights : ndarray of float64, shape (k,)
        Probability of each area. Together, they are 1.
    """

    shapes: tuple[Any, ...]
    weights: Floats

    def density(self, points: Points, side: float) -> Floats:
        """Return the mean probability per square metre in squares (see `Density`)."""
        total = np.zeros(len(points))
        for shape, weight in zip(self.shapes, self.weights, strict=True):
            if weight:
                total += weight / shape.area * _shares(shape, points, side)
        return total

    def inside(self, area: Any) -> Segments:
        """Return the parts of the areas in an area."""
        import shapely

        parts = [shapely.intersection(shape, area) for shape in self.shapes]
        weights = [
            weight * part.area / shape.area
            for shape, part, weight in zip(self.shapes, parts, self.weights, strict=True)
        ]
        return Segments(tuple(parts), np.array(weights))


Density = Raster | GeoRaster | DistanceRing | Spread | Segments
"""What a part of a prior says: its method ``density(points, side)`` returns the mean probability per
square metre in squares with a given side, in metres, along the axes, around points of a lattice with
that side; float64, shape (n,). Together, squares that do not overlap have no more probability than the whole, however
narrow a peak is beside them.
"""


@dataclass(frozen=True, eq=False)
class Prior:
    """The probability that a single target is at each place.

    Parameters
    ----------
    parts : tuple of (float, density)
        Weights and densities. Together, the weights and ``elsewhere`` are 1.
    elsewhere : float
        Share of the probability that is the same everywhere in the region.
    detection : float
        Probability that an earlier look at a place (`SearchRegion.looks`) would have found a target
        there.
    tracks : Tracks, optional
        Tracks of particles, in place of parts.
    """

    parts: tuple[tuple[float, Density], ...]
    elsewhere: float = 0.0
    detection: float = 1.0
    tracks: Tracks | None = None

    def moving(
        self, grid: Grid, tour: Tour, drift: tuple[float, float, float]
    ) -> tuple[MovingGround, float]:
        """Return particles of a target that moves, and the probability that it is in the area of
        the region at the start.

        Parameters
        ----------
        grid, tour
        drift : tuple of float
            Mean velocity along both axes, and the standard deviation of the velocity along each
            axis, in metres per second. Tracks do not need it.
        """
        import shapely

        region = layers_of(grid)[0].region
        area = region.area
        if region.looks:
            raise InvalidInputError(
                "searched: expected a target that stands still together with a prior, because the"
                " tracks saw where it was before, got one that moves"
            )
        if self.tracks is not None:
            shapely.prepare(area)
            places = self.tracks.at(np.zeros(1))[0]
            there = shapely.contains_xy(area, *places.T)
            if not there.any():
                raise InvalidInputError(
                    f"prior: expected a particle in the region {grid.region.name!r} at the start,"
                    f" got {len(places)} elsewhere"
                )
            motion = Tracks(self.tracks.times, self.tracks.points[there])
            count = int(there.sum())
            ground = MovingGround(np.full(count, 1.0 / count), motion, grid, tour)
            return ground, count / len(places)
        # more squares than particles tell nothing more
        step, samples = self._samples(layers_of(grid)[0], enough=_PARTICLES)
        points, _, weights = map(np.concatenate, zip(*samples, strict=True))
        ahead, rng = np.cumsum(weights), np.random.default_rng(_PARTICLES)
        if not ahead[-1] > 0:
            raise InvalidInputError(
                f"prior: expected some probability in the region {grid.region.name!r}, got none"
            )
        # equally spaced quantiles: fewer particles tell as much as many random ones
        wanted = (np.arange(_PARTICLES) + 0.5) / _PARTICLES * ahead[-1]
        middles = points[np.searchsorted(ahead, wanted)]
        chosen = middles + step * (rng.random(middles.shape) - 0.5)
        for _ in range(_TRIES):  # squares on the border are partly outside
            out = ~shapely.contains_xy(area, *chosen.T)
            if not out.any():
                break
            chosen[out] = middles[out] + step * (rng.random((int(out.sum()), 2)) - 0.5)
        velocities = np.array(drift[:2]) + drift[2] * rng.normal(size=chosen.shape)
        masses = np.full(_PARTICLES, 1.0 / _PARTICLES)
        ground = MovingGround(masses, Drift(chosen, velocities), grid, tour)
        return ground, _checked(float(ahead[-1]))

    def ground(self, grid: Grid, tour: Tour) -> tuple[Ground, float, float]:
        """Return the ground in the cells along a tour, the probability that the target is in the
        area of the region at all, and that with which earlier looks would have found it.

        The probability of a place belongs to the cell whose footprint contains the place. Layers of
        a box are different places: the target is in each with a probability in proportion to the
        number of the layer's cells. All other layers show the same ground.

        What was seen before changes these probabilities by Bayes: at a place that k tracks have
        seen, the target was missed with the probability (1 - detection)^k.

        Raises
        ------
        InvalidInputError
            If the target is in no cell.
        """
        layers = layers_of(grid)
        before = self._found_before(layers[0])
        position = tour.position if tour.position.ndim == 3 else tour.position[None]
        heights = np.zeros(len(layers))
        if grid.region.height and isinstance(grid, LayeredGrid):
            heights = grid.altitudes
        counts = np.array([0 if layer.whole else layer.n_cells for layer in layers])
        masses, cells, inside = [], [], 0.0
        known: dict[Any, tuple[Any, Floats, float]] = {}
        for height in np.unique(heights):
            group = np.flatnonzero(heights == height).tolist()
            bases = {up: layers[up].whole or layers[up] for up in group}
            grids = tuple(dict.fromkeys(bases.values()))
            if grids not in known:
                known[grids] = self._pieces(grids)
            flat, weights, whole = known[grids]
            share = counts[group].sum() / counts.sum()
            seen = np.full((len(flat), len(layers)), -1, dtype=np.int64)
            for up, base in bases.items():
                rows, columns = np.divmod(flat[:, grids.index(base)], base.shape[1])
                seen[:, up] = position[up, rows, columns]
            masses.append(share * weights)
            cells.append(seen)
            inside += share * whole
        together = np.concatenate(masses)
        total = float(together.sum())
        if not total > 0:
            raise InvalidInputError(
                f"prior: expected some probability in the region {grid.region.name!r}, got none"
            )
        return (
            Ground(together / total, np.concatenate(cells)),
            _checked(inside / (1.0 - before)),
            before,
        )

    def _pieces(self, grids: Sequence[Any]) -> tuple[NDArray[np.int64], Floats, float]:
        """Return the pieces of the ground that one cell of each lattice shows: the numbers of these
        cells, row by row; int64, shape (G, L); the probability of each piece; and that of all
        together.
        """
        found = [(np.zeros((0, len(grids)), dtype=np.int64), np.zeros(0))]
        for points, _, weights in self._samples(grids[0])[1]:
            numbers = []
            for grid in grids:
                rows, columns = grid.cell_of(points).T
                numbers.append(rows * grid.shape[1] + columns)
            found.append(_summed(np.column_stack(numbers), weights))
        flat, masses = _summed(*map(np.concatenate, zip(*found, strict=True)))
        return flat, masses, float(masses.sum())

    def _samples(
        self, grid: Any, enough: int = _ENOUGH
    ) -> tuple[float, Iterator[tuple[Points, Floats, Floats]]]:
        """Return the side of the sample squares that cover the area of a grid, in metres, and these
        squares (see `_looked`). They lie inside the cells, unless these are turned. Few cells have
        ``enough`` of them together.
        """
        fine = _FINE if grid.n_cells <= _SMALL else _COARSE
        fine = max(fine, min(_FINEST, ceil((enough / grid.n_cells) ** 0.5)))
        step = grid.size / fine
        corner = None if grid.angle else grid.corner
        return step, self._looked(grid.region, grid.region.area, step, corner)

    def _looked(
        self,
        region: SearchRegion,
        area: Any,
        step: float,
        corner: tuple[float, float] | None = None,
    ) -> Iterator[tuple[Points, Floats, Floats]]:
        """Yield the middles of squares of side ``step`` that cover an area, strip by strip, with the
        probability of the part of each square in the area before and after the earlier looks at the
        region. A corner of one square may be given.
        """
        import shapely

        looks = [shapely.intersection(look, area) for look in region.looks]
        whole = _with_searched(region)
        parts = list(self.parts)
        if self.elsewhere:
            parts.append((self.elsewhere, Segments((whole,), np.ones(1))))
        parts = [
            (weight, density.inside(area) if isinstance(density, Segments) else density)
            for weight, density in parts
        ]
        west, south, east, north = area.bounds
        if corner is not None:
            west, south = (
                first + step * floor((low - first) / step + _ROUNDED)
                for first, low in zip(corner, (west, south), strict=True)
            )
        across, along = (
            low + step * (np.arange(ceil((high - low) / step - _ROUNDED)) + 0.5)
            for low, high in ((west, east), (south, north))
        )
        strip = max(1, _AT_ONCE // len(across))
        for low in range(0, len(along), strip):
            x, y = np.meshgrid(across, along[low : low + strip])
            points = np.column_stack([x.ravel(), y.ravel()])
            shares = _shares(area, points, step)
            points, shares = points[shares > 0], shares[shares > 0]
            if not len(points):
                continue
            density = np.zeros(len(points))
            for weight, part in parts:
                own = weight * part.density(points, step)
                if isinstance(part, Raster | GeoRaster):
                    # what is outside the grid counts as 0 in the mean already
                    covered = np.maximum(part.covered(points, step), shares)
                    own *= shares / covered
                elif not isinstance(part, Segments):
                    own *= shares
                density += own
            weights = step**2 * density
            missed = np.ones(len(points))
            for look in looks:
                missed *= 1.0 - self.detection * np.minimum(
                    _shares(look, points, step) / shares, 1.0
                )
            yield points, weights, weights * missed

    def _found_before(self, grid: Any) -> float:
        """Return the probability that the earlier looks at a region would have found the target.

        Raises
        ------
        InvalidInputError
            If they would have found it wherever it may be.
        """
        import shapely

        region = grid.region
        if not region.looks or not self.detection:
            return 0.0
        seen = shapely.union_all(region.looks)
        west, south, east, north = seen.bounds
        step = max(grid.size / _FINE, ((east - west) * (north - south) / _MOST_LOOKED) ** 0.5)
        found = sum(
            float((before - after).sum()) for _, before, after in self._looked(region, seen, step)
        )
        if found > _CERTAIN:
            raise InvalidInputError(
                "searched: expected tracks that leave some probability to what they did not see, got"
                " tracks that saw all places where the target may be"
            )
        return found


def _checked(probability: float) -> float:
    """Return the probability of the region, which rounding may lift beyond 1.

    Raises
    ------
    InvalidInputError
        If squares along the pixels of a turned raster count a peak twice.
    """
    if probability > 1.0 + _COUNTED_TWICE:
        raise InvalidInputError(
            "prior: expected probabilities that cells can tell apart, which together are 1 at most,"
            f" got {probability:.4g}; a raster with wider pixels or a narrower footprint helps"
        )
    return min(float(probability), 1.0)


def _with_searched(region: SearchRegion) -> Any:
    """Return the area of a region with what robots need not see again, as a Shapely geometry."""
    import shapely

    whole = region.area
    if region.searched is not None:
        whole = whole.union(region.searched.intersection(region.outline))
    shapely.prepare(whole)
    return whole


def _summed(rows: NDArray[np.int64], weights: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return different rows of numbers, and the sum of the weights of each."""
    key = rows[:, 0]
    for column in rows.T[1:]:
        key = np.unique(key, return_inverse=True)[1] * (column.max(initial=0) + 1) + column
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    sums = np.bincount(inverse, weights, minlength=len(first)).astype(np.float64)
    return rows[first], sums


def _shares(shape: Any, points: Points, side: float) -> Floats:
    """Return the share of each square around points of a lattice that is in a shape; float64, shape
    (n,).
    """
    import shapely

    low, high = np.reshape(shape.bounds, (2, 2))
    if shape.area >= (1.0 - _UPRIGHT) * (high - low).prod():
        return _shares_in_box(points, side, low, high)
    shares = np.zeros(len(points))
    there = np.flatnonzero((np.abs(2 * points - low - high) < high - low + side).all(axis=1))
    if not len(there):
        return shares
    points = points[there]
    if shape.geom_type == "GeometryCollection":  # areas that also touch along a line
        shape = shapely.multipolygons([part for part in shapely.get_parts(shape) if part.area])
    shapely.prepare(shape)
    found = shapely.contains_xy(shape, *points.T).astype(np.float64)
    # a quarter of a side apart, so that the border misses no more than the corner of a square
    border = shapely.get_coordinates(shapely.segmentize(shape.boundary, side / 4))
    squares, crossings = (
        np.rint((places - points[0]) / side).astype(np.int64) @ (1, _WIDEST)
        for places in (points, border)
    )
    crossed = np.flatnonzero(np.isin(squares, np.unique(crossings)))
    boxes = shapely.box(*(points[crossed] - side / 2).T, *(points[crossed] + side / 2).T)
    parts = _subdivided(shape)
    square, part = shapely.STRtree(parts).query(boxes)
    areas = shapely.area(shapely.intersection(boxes[square], np.array(parts)[part]))
    found[crossed] = np.bincount(square, areas, minlength=len(crossed)) / side**2
    shares[there] = np.minimum(found, 1.0)
    return shares


def _shares_in_box(points: Points, sides: ArrayLike, low: Floats, high: Floats) -> Floats:
    """Return the share of each rectangle around points, with given sides, between two corners of a
    box; float64, shape (n,).
    """
    half = np.broadcast_to(sides, 2) / 2
    inner = np.minimum(points + half, high) - np.maximum(points - half, low)
    return np.asarray(np.maximum(inner, 0.0).prod(axis=1) / (2 * half).prod())


def _subdivided(shape: Any) -> list[Any]:
    """Return parts of a shape, each with few corners, which are quickly intersected."""
    import shapely

    if shapely.get_num_coordinates(shape) <= _CORNERS:
        return [shape]
    low, high = np.reshape(shape.bounds, (2, 2))
    axis = int(np.argmax(high - low))
    first, second = high.copy(), low.copy()
    first[axis] = second[axis] = (low[axis] + high[axis]) / 2
    halves = [shapely.intersection(shape, shapely.box(*low, *first))]
    halves.append(shapely.intersection(shape, shapely.box(*second, *high)))
    return [part for half in halves if half.area for part in _subdivided(half)]


def _mean_pixel(values: Floats, places: Points, across: float, down: float) -> Floats:
    """Return the mean of an array's pixels in boxes, with 0 outside the array; float64, shape (n,).

    ``places`` are the middles of the boxes, in columns and rows from the array's corner, and
    ``across`` and ``down`` the sides of the boxes in pixels. Missing numbers count as 0.
    """
    height, width = values.shape
    total = np.zeros(len(places))
    west, north = (places - (across / 2, down / 2)).T
    for i in range(ceil(across) + 1):
        columns = np.floor(west).astype(np.int64) + i
        wide = np.minimum(west + across, columns + 1.0) - np.maximum(west, columns)
        for j in range(ceil(down) + 1):
            rows = np.floor(north).astype(np.int64) + j
            high = np.minimum(north + down, rows + 1.0) - np.maximum(north, rows)
            there = np.flatnonzero(
                (wide > _ROUNDED)
                & (high > _ROUNDED)
                & (rows >= 0)
                & (rows < height)
                & (columns >= 0)
                & (columns < width)
            )
            part = np.nan_to_num(values[rows[there], columns[there]], nan=0.0)
            total[there] += part * wide[there] * high[there]
    return total / (across * down)


def check_priors(value: Any) -> tuple[Any, ...]:
    """Check the parts of a prior without opening files, and return them as texts, or as mappings
    with the contents of files.
    """
    found: list[Any] = []
    for part in list_of(value):
        if isinstance(part, dict) and set(part) - {"system"} == {"weight", "name", "data"}:
            check_number(part["weight"], what="prior: weight", above=0)
            name = check_text(part["name"], what="prior: name")
            if Path(name).suffix.lower() not in _FILES:
                raise InvalidInputError(
                    f"prior: expected a file {', '.join(_FILES)}, got {shortened(name)}"
                )
            check_text(part["data"], what="prior: data")
            check_text(part.get("system", ""), what="prior: system")
            found.append(part)
            continue
        text = check_text(str(part) if isinstance(part, Path) else part, what="prior")
        _weight, what = _split(text)
        if what.startswith("ring:"):
            _quantiles(what)
        elif Path(what).suffix.lower() not in _FILES:
            raise InvalidInputError(
                f"prior: expected ring:X,Y:SHARE=METRES,... or a file {', '.join(_FILES)}, got"
                f" {shortened(what)}"
            )
        found.append(text)
    return tuple(found)


def open_prior(parts: Sequence[Any], elsewhere: float, region: SearchRegion) -> Prior:
    """Return the prior that the fields ``prior`` and ``elsewhere`` of a problem describe.

    Raises
    ------
    InvalidInputError
        If a file is missing, damaged, or holds no probabilities.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> ring = open_prior(["ring:50,50:0.5=20,0.9=40"], 0.1, open_region("square:100"))
    >>> [round(weight, 2) for weight, _ in ring.parts], ring.elsewhere
    ([0.9], 0.1)
    """
    if any(map(is_tracks, parts)):
        return Prior((), tracks=_open_tracks(parts[0], region))
    found: list[tuple[float, Density]] = []
    for part in parts:
        if isinstance(part, dict):
            content, source = io.BytesIO(_contents(part)), Path(part["name"])
            density = _read(source, content, region, part.get("system"))
            found.append((float(part["weight"]), density))
            continue
        weight, what = _split(part)
        if what.startswith("ring:"):
            found.append((weight, _ring(what, region)))
            continue
        source = Path(what)
        check_file(source, what="prior", most=LARGEST_PRIOR)
        found.append((weight, _read(source, source, region)))
    weights = _normalised("prior", np.array([weight for weight, _ in found]))
    return Prior(
        tuple(
            (float(weight) * (1.0 - elsewhere), density)
            for weight, (_, density) in zip(weights, found, strict=True)
        ),
        elsewhere,
    )


def _contents(part: dict[str, Any]) -> bytes:
    """Return the contents of a file that a problem holds."""
    from base64 import b64decode
    from binascii import Error

    try:
        content = b64decode(part["data"], validate=True)
        if Path(part["name"]).suffix.lower() in (".geojson", ".json"):
            content.decode()
    except (Error, ValueError):
        raise InvalidInputError(
            f"prior: {part['name']}: expected its contents in base 64, got others"
        ) from None
    return content


def is_tracks(part: Any) -> bool:
    """Return whether a part of a prior is a file of tracks."""
    name = part["name"] if isinstance(part, dict) else _split(str(part))[1]
    return Path(name).suffix.lower() == _TRACKS


def parse_drift(text: str) -> tuple[float, ...]:
    """Parse VX,VY or VX,VY:SPREAD from the command line."""
    match = _DRIFT.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        return tuple(float(word) for word in match.groups("0"))
    except ValueError:
        raise ValueError(f"expected VX,VY or VX,VY:SPREAD in m/s, got {text[:80]!r}") from None


def check_drift(value: Any) -> tuple[float, float, float]:
    """Check a mean velocity along both axes and the standard deviation of the velocity, in m/s."""
    numbers = list_of(value)
    if len(numbers) not in (2, 3):
        raise InvalidInputError(
            f"drift: expected two velocities and a standard deviation, got {shortened(value)}"
        )
    east, north = (
        check_number(number, what="drift", least=-_FASTEST, most=_FASTEST) for number in numbers[:2]
    )
    spread = numbers[2] if len(numbers) == 3 else 0.0
    return east, north, check_number(spread, what="drift: spread", least=0, most=_FASTEST)


def _open_tracks(part: Any, region: SearchRegion) -> Tracks:
    """Return the tracks of particles in a file of NetCDF, as OpenDrift writes it: ``lon`` and
    ``lat`` in degrees along the dimensions ``trajectory`` and ``time``, with numbers that are
    missing before a particle is released and after it is taken out, and ``time`` in a unit since
    some date. The search begins at the first time; particles that are released later do not count.
    """
    if isinstance(part, dict):
        source, content = Path(part["name"]), _contents(part)
    else:
        source = Path(_split(part)[1])
        check_file(source, what="prior", most=LARGEST_PRIOR)
        content = source.read_bytes()
    if region.frame is None:
        raise InvalidInputError(
            f"{source}: expected a region on Earth for tracks of particles, got {region.name!r}"
        )
    try:
        times, degrees = _variables(content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise InvalidInputError(
            f"{source}: expected a NetCDF file with lon, lat and time, got {shortened(str(error))}"
        ) from None
    degrees = degrees[np.isfinite(degrees[:, 0]).all(axis=1)]
    good = len(times) and np.isfinite(times).all() and (np.diff(times) > 0).all()
    if not good or not len(degrees):
        raise InvalidInputError(
            f"{source}: expected increasing times and particles at the first of them, got"
            f" {len(times)} times and {len(degrees)} particles"
        )
    # a particle that is taken out, such as on a beach, stays where it was last
    known = np.isfinite(degrees).all(axis=2)
    last = np.maximum.accumulate(np.where(known, np.arange(len(times)), 0), axis=1)
    degrees = np.take_along_axis(degrees, last[:, :, None], axis=1)
    if not ((np.abs(degrees) <= (360.0, 90.0)).all()):
        raise InvalidInputError(f"{source}: expected degrees, got numbers beyond")
    points = region.frame.to_metres(degrees.reshape(-1, 2)).reshape(degrees.shape)
    return Tracks(times - times[0], points)


def _variables(content: bytes) -> tuple[Floats, Floats]:
    """Return the times in seconds, shape (T,), and the longitudes and latitudes, shape (M, T, 2),
    of a file of NetCDF.
    """
    names = ("time", "lon", "lat")
    if content[:3] == b"CDF":
        from scipy.io import netcdf_file

        file: Any = netcdf_file(io.BytesIO(content), mmap=False)
        variables: Any = file.variables
        attributes = [vars(variables[name])["_attributes"] for name in names]
        dimensions = variables["lon"].dimensions
    else:
        h5py = import_extra("h5py", "tracks in a NetCDF file of version 4 need h5py", extra="envs")
        variables = h5py.File(io.BytesIO(content), "r")
        attributes = [dict(variables[name].attrs) for name in names]
        dimensions = tuple(
            Path(scale[0].name).name if len(scale) else "" for scale in variables["lon"].dims
        )
    arrays = []
    for name, about in zip(names, attributes, strict=True):
        values = np.array(variables[name][:], dtype=np.float64)
        for missing in ("_FillValue", "missing_value"):
            if missing in about:
                values[values == np.float64(np.ravel(about[missing])[0])] = np.nan
        arrays.append(values)
    time, *degrees = arrays
    if dimensions == ("time", "trajectory"):
        degrees = [one.T for one in degrees]
    if time.ndim != 1 or any(one.ndim != 2 or one.shape[1] != len(time) for one in degrees):
        raise ValueError(f"shapes {[one.shape for one in arrays]} of time, lon and lat")
    units = attributes[0].get("units", "seconds")
    unit = (units.decode() if isinstance(units, bytes) else str(units)).split()[0]
    return time * _UNITS[unit.rstrip("s")], np.stack(degrees, axis=2)


def with_contents(parts: Sequence[Any]) -> tuple[Any, ...]:
    """Return the parts of a prior with the contents of files in place of their names."""
    from base64 import b64encode

    from shoal.search.flight.terrain import system_file

    found: list[Any] = []
    for part in parts:
        if isinstance(part, dict) or _split(part)[1].startswith("ring:"):
            found.append(part)
            continue
        weight, what = _split(part)
        content = b64encode(Path(what).read_bytes()).decode()
        beside = system_file(Path(what))
        system = (
            {}
            if beside is None
            else {"system": read_text(beside, what="coordinate reference system")}
        )
        found.append({"weight": weight, "name": Path(what).name, "data": content} | system)
    return tuple(found)


def _split(text: str) -> tuple[float, str]:
    """Return the weight and the rest of a part such as ``2*ring:0,0:0.5=100``."""
    match = _WEIGHTED.fullmatch(text)
    if match is None:
        return 1.0, text
    weight = check_number(float(match["weight"]), what="prior: weight", above=0)
    return weight, match["what"]


def _quantiles(text: str) -> tuple[Floats, Floats, Floats]:
    """Return the last known point as it is given, and the shares and distances of a ring."""
    expected = (
        "ring:X,Y:SHARE=METRES,... with increasing shares above 0 and up to 1, and increasing"
        " distances above 0"
    )
    match = _RING.fullmatch(text)
    place, quantiles = np.full(2, np.nan), np.zeros((0, 2))
    if match is not None:
        try:
            place = np.array([float(match["x"]), float(match["y"])])
            pairs = [pair.split("=") for pair in match["quantiles"].split(",")]
            quantiles = np.array([[float(share), float(away)] for share, away in pairs])
        except ValueError:
            pass  # refused below
    if not (
        len(quantiles)
        and np.isfinite(quantiles).all()
        and np.isfinite(place).all()
        and (np.diff(quantiles, axis=0, prepend=0.0) > 0).all()
        and quantiles[-1, 0] <= 1
    ):
        raise InvalidInputError(f"prior: expected {expected}, got {shortened(text)}")
    return place, quantiles[:, 0], quantiles[:, 1]


def _ring(text: str, region: SearchRegion) -> DistanceRing:
    place, shares, distances = _quantiles(text)
    if region.frame is not None:
        place = region.frame.to_metres(place[None])[0]
    return DistanceRing(place, shares, distances)


def _read(source: Path, file: Any, region: SearchRegion, system: str | None = None) -> Density:
    """Return the density in a file, or in its contents. ``system`` is the text of the file that gives
    its coordinate reference system.
    """
    suffix = source.suffix.lower()
    if suffix == ".npy":
        return _array(source, file, region)
    if suffix in (".geojson", ".json"):
        text = (
            file.read().decode() if isinstance(file, io.BytesIO) else read_text(file, what="prior")
        )
        return _features(source, parse_json(text, where=str(source)), region)
    return _georaster(source, file, region, system)


def _array(source: Path, file: Any, region: SearchRegion) -> Raster:
    """Return the numbers of an array as probabilities. The array spans the bounding box of the
    region, with row 0 in the north.
    """
    try:
        values = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError, MemoryError) as error:
        raise InvalidInputError(
            f"{source}: expected an array of numbers as NumPy saves it, got {shortened(str(error))}"
        ) from None
    if (
        not isinstance(values, np.ndarray)
        or values.ndim != 2
        or values.dtype.kind not in "fiub"
        or not 0 < values.size <= _MOST_NUMBERS
    ):
        shape = getattr(values, "shape", None)
        raise InvalidInputError(
            f"{source}: expected numbers in rows and columns, at most {_MOST_NUMBERS}, got the shape"
            f" {shape} of {getattr(values, 'dtype', type(values).__name__)}"
        )
    west, south, east, north = region.outline.bounds
    rows, columns = values.shape
    density = Raster(
        _normalised(source, values.astype(np.float64)),
        west,
        north,
        ((east - west) / columns, (north - south) / rows),
    )
    if not _fits(values.shape, (north - south, east - west)):
        turned = _fits(values.shape[::-1], (north - south, east - west))
        tell_once(
            f"prior: {source}: its {count_text(rows, 'row')} of {count_text(columns, 'number')} span"
            f" the {east - west:.4g} m by {north - south:.4g} m of the region, so that each number"
            f" stands for {density.sides[0]:.4g} m by {density.sides[1]:.4g} m"
            + "; with rows and columns exchanged, for squares"
            * turned
        )
    return density


def _fits(counts: tuple[int, ...], lengths: tuple[float, float]) -> bool:
    """Return whether some square divides both lengths into the given counts, rounded: then the
    numbers of an array stand for squares, as far as its shape can tell.
    """
    least = max(length / (count + 0.5) for count, length in zip(counts, lengths, strict=True))
    most = min(length / (count - 0.5) for count, length in zip(counts, lengths, strict=True))
    return least < most * _CERTAIN


def _normalised(source: Path | str, values: Floats) -> Floats:
    with np.errstate(over="ignore"):  # a sum beyond the largest number is scaled below
        total = float(values.sum())
    if not np.isfinite(values).all() or (values < 0).any() or not total > 0:
        wrong = values[~(values >= 0) | ~np.isfinite(values)]
        got = f"{wrong.flat[0]:g}" if wrong.size else "zeros only"
        raise InvalidInputError(
            f"{source}: expected probabilities, 0 or more and not all 0, got {got}"
        )
    if total == inf:
        values = values / values.max()
        total = float(values.sum())
    return np.asarray(values / total)


def _georaster(source: Path, file: Any, region: SearchRegion, system: str | None) -> GeoRaster:
    from shoal.search.flight.terrain import open_grid

    if isinstance(file, io.BytesIO):
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / source.name
            path.write_bytes(file.getvalue())
            if system is not None:
                path.with_suffix(".prj").write_text(system, encoding="utf-8")
            grid = open_grid(path, what="probabilities")
    else:
        grid = open_grid(source, what="probabilities")
    values = np.nan_to_num(grid.heights, nan=0.0)
    return GeoRaster(replace(grid, heights=_normalised(source, values)), region)


def _features(source: Path, data: Any, region: SearchRegion) -> Density:
    """Return the density of a GeoJSON file: of polygons with a property ``probability``, or of
    points with a property ``spread_m`` and, if they differ, ``probability``.
    """
    import shapely

    features = data.get("features") if isinstance(data, dict) else None
    if not isinstance(features, list) or not features:
        raise InvalidInputError(
            f"{source}: expected a FeatureCollection of GeoJSON with one feature or more, got"
            f" {shortened(data)}"
        )
    # as in regions, an old member "crs" names another system than WGS84
    system, convert = crs_name(data, str(source)), None
    if system is not None:
        geographic, convert = conversion(system, str(source))
        if geographic != (region.frame is not None):
            units = ["metres", "degrees"]
            raise InvalidInputError(
                f"{source}: expected {units[not geographic]}, as the region {region.name!r} has, got"
                f' the "crs" {shortened(system)}'
            )
    shapes, spreads, weights = [], [], []
    for number, feature in enumerate(features, start=1):
        where = f"{source}: feature {number}"
        try:
            shape = shapely.from_geojson(_json(feature["geometry"]))
            properties = dict(feature.get("properties") or {})
        except (KeyError, TypeError, ValueError, AttributeError, shapely.errors.GEOSException):
            raise InvalidInputError(
                f"{where}: expected a geometry and properties, got {shortened(feature)}"
            ) from None
        if shape is None or shape.is_empty:
            raise InvalidInputError(f"{where}: expected a geometry, got an empty one")
        if convert is not None:
            shape = shapely.transform(shape, convert)
        if region.frame is not None:
            frame = region.frame
            shape = shapely.transform(shape, frame.to_metres)
        kind = shape.geom_type
        if kind in ("Polygon", "MultiPolygon"):
            if not shape.is_valid or not shape.area > 0:
                raise InvalidInputError(
                    f"{where}: expected a valid polygon, got {kind} that is not"
                )
            if "probability" not in properties:
                raise InvalidInputError(f"{where}: expected a property probability, got none")
            spreads.append(0.0)
        elif kind == "Point":
            if "spread_m" not in properties:
                raise InvalidInputError(f"{where}: expected a property spread_m, got none")
            spreads.append(check_number(properties["spread_m"], what=f"{where}: spread_m", above=0))
        else:
            raise InvalidInputError(f"{where}: expected a Polygon or a Point, got a {kind}")
        shapes.append(shape)
        weight = properties.get("probability", 1.0)
        weights.append(check_number(weight, what=f"{where}: probability", least=0))
    points = [shape.geom_type == "Point" for shape in shapes]
    if any(points) and not all(points):
        raise InvalidInputError(
            f"{source}: expected polygons or points, got both; give two files, each with its weight"
        )
    shares = _normalised(source, np.array(weights))
    if all(points):
        return Spread(shapely.get_coordinates(shapes), np.array(spreads), shares)
    return Segments(tuple(shapes), shares)


def _json(geometry: Any) -> str:
    return json.dumps(geometry)
