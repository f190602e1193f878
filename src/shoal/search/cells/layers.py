"""Layers: one grid for cells at several altitudes or in several passes, and the paths and distances
between these cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import partial_sums
from shoal.search.cells.distances import CellDistances, CellPlane, Distances
from shoal.search.cells.footprint import Footprint
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.routing import RegionPaths, Route
from shoal.search.regions.outline import Points
from shoal.search.regions.region import SearchRegion
from shoal.search.tours import Tour

Numbers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LayeredGrid:
    """The cells of several layers over one region, with the same interface as `CellGrid`.

    Parameters
    ----------
    layers : tuple of CellGrid
        The layers from the lowest to the highest, and then those with some of their cells, which
        robots search again. Equal layers are one shared object.
    altitudes : ndarray of float64, shape (L,)
        Altitude of each layer in metres.
    climb : float
        Level distance in metres that a robot flies in the mean time of a climb by one metre and a
        descent by one metre.
    """

    layers: tuple[CellGrid, ...]
    altitudes: NDArray[np.float64]
    climb: float = 1.0

    @property
    def region(self) -> SearchRegion:
        """The region of the lowest layer, without the area that robots cannot see from the lowest
        layer.
        """
        return self.layers[0].region

    @cached_property
    def size(self) -> float:
        """Side of the smallest cells in metres. A path length in cells is the length divided by
        this side.
        """
        return min(layer.size for layer in self.layers)

    @property
    def footprint(self) -> float:
        """Side of a robot's footprint in the lowest layer, in metres."""
        return self.layers[0].footprint

    @property
    def angle(self) -> float:
        """Angle of the rows of cells in the lowest layer, in degrees counter-clockwise from the x
        axis.
        """
        return self.layers[0].angle

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the layered grid: the number of layers, the largest number of rows, and the
        largest number of columns.
        """
        rows, columns = np.max([layer.shape for layer in self.layers], axis=0).tolist()
        return len(self.layers), rows, columns

    @cached_property
    def starts(self) -> Numbers:
        """Index of each layer's first cell in `LayeredGrid.cells`, followed by the number of all
        cells; int64, shape (L + 1,).
        """
        return partial_sums([layer.n_cells for layer in self.layers])

    @property
    def n_cells(self) -> int:
        """Number of cells in all layers together."""
        return int(self.starts[-1])

    @cached_property
    def cells(self) -> Numbers:
        """The cells as triples (layer, row, column), sorted by layer; int64, shape (n_cells, 3)."""
        numbers = np.repeat(np.arange(len(self.layers)), np.diff(self.starts))
        return np.column_stack([numbers, np.concatenate([layer.cells for layer in self.layers])])

    @cached_property
    def viewpoints(self) -> Points:
        """Viewpoints of all layers, as in `CellGrid.viewpoints` but with altitudes; float64, shape
        (k, 3).
        """
        return np.concatenate(
            [
                at_altitude(layer.viewpoints, up)
                for layer, up in zip(self.layers, self.altitudes, strict=True)
            ]
        )

    @cached_property
    def viewpoint_starts(self) -> Numbers:
        """Index of each cell's first viewpoint, as in `CellGrid.viewpoint_starts`; int64, shape
        (n_cells + 1,).
        """
        before = partial_sums([len(layer.viewpoints) for layer in self.layers])
        starts = [
            layer.viewpoint_starts[:-1] + first
            for layer, first in zip(self.layers, before, strict=False)
        ]
        return np.concatenate([*starts, before[-1:]])

    def ordinals(self, cells: ArrayLike) -> Numbers:
        """Return, for cells given as (layer, row, column), their indices in `LayeredGrid.cells`;
        int64, shape (n,).
        """
        array = np.asarray(cells)
        return np.asarray(self._ordinal[array[:, 0], array[:, 1], array[:, 2]])

    @cached_property
    def _ordinal(self) -> Numbers:
        ordinals = np.full(self.shape, -1, dtype=np.int64)
        ordinals[tuple(self.cells.T)] = np.arange(self.n_cells)
        return ordinals

    def cell_of(self, points: ArrayLike, layer: int = 0) -> Numbers:
        """Return the cells (layer, row, column) of a given layer above points on the ground; int64,
        shape (n, 3).
        """
        cells = self.layers[layer].cell_of(points)
        return np.column_stack([np.full(len(cells), layer), cells])

    def __repr__(self) -> str:
        ups = ", ".join(f"{up:g}" for up in self.altitudes)
        return f"<LayeredGrid of {len(self.layers)} layers at {ups} m, {self.n_cells} cells>"


Grid = CellGrid | LayeredGrid


def layers_of(grid: Grid) -> tuple[CellGrid, ...]:
    """Return the layers of a grid from the lowest to the highest. A `CellGrid` counts as a single
    layer.
    """
    return (grid,) if isinstance(grid, CellGrid) else grid.layers


def at_altitude(points: Points, up: float | NDArray[np.float64]) -> Points:
    """Return two-dimensional points with the altitude ``up`` as third coordinate; float64, shape
    (n, 3).
    """
    return np.column_stack([points, np.broadcast_to(up, len(points))])


def with_climb_cost(grid: Grid, points: Points) -> Points:
    """Return points in metres with scaled altitudes: a climb becomes as long as a horizontal path
    of the same duration.

    In a `CellGrid`, points do not change. In a `LayeredGrid`, points without an altitude get the
    altitude of the lowest layer.
    """
    if isinstance(grid, CellGrid):
        return points
    whole = points if points.shape[1] == 3 else at_altitude(points, float(grid.altitudes[0]))
    return np.asarray(whole * (1.0, 1.0, grid.climb))


class LayeredPaths:
    """Paths through several layers: vertical climbs, horizontal paths by `RegionPaths`, and
    vertical descents.

    Parameters
    ----------
    grid : LayeredGrid
    layers : sequence of RegionPaths
        The paths inside each layer.
    """

    def __init__(self, grid: LayeredGrid, layers: Sequence[RegionPaths]) -> None:
        self.grid, self._layers = grid, layers

    def legs(self, stops: ArrayLike) -> Route:
        """Return the path through stops given as (x, y, altitude) in metres, or as (x, y) for stops
        in the lowest layer.
        """
        points = np.asarray(stops, dtype=np.float64)
        points = (
            points if points.shape[1] == 3 else at_altitude(points, float(self.grid.altitudes[0]))
        )
        flat = self._layers[0].legs(points[:, :2])
        if len(points) < 2:
            return Route(points.copy(), flat.stops, flat.transit)
        leg = np.clip(
            np.searchsorted(flat.stops, np.arange(len(flat.points)), side="right") - 1,
            0,
            len(points) - 2,
        )
        ups = np.maximum(points[leg, 2], points[leg + 1, 2])
        ups[flat.stops] = points[:, 2]
        change, moves = np.diff(points[:, 2]), np.diff(points[:, :2], axis=0).any(axis=1)
        rises, sinks = np.flatnonzero((change > 0) & moves), np.flatnonzero((change < 0) & moves)
        at = np.concatenate([flat.stops[rises] + 1, flat.stops[sinks + 1]])
        turns = np.concatenate(
            [
                at_altitude(points[rises, :2], points[rises + 1, 2]),
                at_altitude(points[sinks + 1, :2], points[sinks, 2]),
            ]
        )
        stops = flat.stops + np.searchsorted(np.sort(at), flat.stops, side="right")
        transit = np.insert(
            flat.transit, np.concatenate([flat.stops[rises], flat.stops[sinks + 1]]), False
        )
        return Route(np.insert(at_altitude(flat.points, ups), at, turns, axis=0), stops, transit)

    def route(self, cells: ArrayLike) -> Route:
        """Return the path through all viewpoints of the given cells (layer, row, column), cell by
        cell.
        """
        array = np.asarray(cells)
        borders = [0, *(np.flatnonzero(np.diff(array[:, 0])) + 1).tolist(), len(array)]
        points, stops, transit = (
            [np.zeros((0, 3))],
            [np.zeros(0, dtype=np.int64)],
            [np.zeros(0, dtype=np.bool_)],
        )
        count = 0
        for begin, end in pairwise(borders):
            layer = int(array[begin, 0])
            part = self._layers[layer].route(array[begin:end, 1:])
            layer_points = at_altitude(part.points, float(self.grid.altitudes[layer]))
            if count:
                climb = self.legs(np.stack([points[-1][-1], layer_points[0]]))
                points.append(climb.points[1:-1])
                transit.append(climb.transit)
                count += len(climb.points) - 2
            points.append(layer_points)
            stops.append(part.stops + count)
            transit.append(part.transit)
            count += len(layer_points)
        return Route(np.concatenate(points), np.concatenate(stops), np.concatenate(transit))


Paths = RegionPaths | LayeredPaths


@dataclass(frozen=True, eq=False)
class LayerNumbers:
    """Conversion between the index of a cell on the tour of its layer and its index on the tour
    through all layers.

    Parameters
    ----------
    tour : Tour
        The tour through all layers.
    layers : tuple of Tour
        The tour of each layer.
    """

    tour: Tour
    layers: tuple[Tour, ...]

    def whole(self, layer: int, cells: Numbers) -> Numbers:
        """Convert indices on the tour of one layer to indices on the tour through all layers."""
        return np.asarray(self.tour.position[layer][tuple(self.layers[layer].cells[cells].T)])

    def own(self, number: int) -> tuple[int, int]:
        """Return the layer of a cell, and the index of this cell on the tour of its layer."""
        layer, row, col = self.tour.cells[number].tolist()
        return layer, int(self.layers[layer].position[row, col])


class LayeredFootprint:
    """The cells that a robot sees from each cell of several layers. A robot sees only cells of its
    own layer.

    Parameters
    ----------
    numbers : LayerNumbers
    layers : sequence of Footprint
        The cells that a robot sees from each cell, for each layer.
    """

    def __init__(self, numbers: LayerNumbers, layers: Sequence[Footprint]) -> None:
        self.numbers, self._layers = numbers, layers

    def visible_cells(self, cell: int, width: int) -> Numbers:
        """Return the cells that a robot in ``cell`` sees with a footprint of ``width`` cells, as
        increasing tour indices.
        """
        layer, own = self.numbers.own(cell)
        return np.sort(self.numbers.whole(layer, self._layers[layer].visible_cells(own, width)))


class LayeredDistances:
    """Distances between the cells of all layers: the horizontal distance plus the cost of the climb
    or descent.

    Parameters
    ----------
    paths : LayeredPaths
    numbers : LayerNumbers
    layers : sequence of Distances
        For each layer, the distances between its cells. A layer with some cells of another needs
        none of its own. The sequence ``layers`` is empty if all horizontal paths are straight.
    """

    stepwise = False

    def __init__(
        self, paths: LayeredPaths, numbers: LayerNumbers, layers: Sequence[Distances] = ()
    ) -> None:
        self._paths, self._numbers, self._layers = paths, numbers, layers
        grid = paths.grid
        self._sizes = [layer.size / grid.size for layer in grid.layers]
        # the layer whose cells each layer has, or some of them
        self._bases = [grid.layers.index(layer.whole or layer) for layer in grid.layers]
        self._cache: dict[tuple[int, int], float] = {}

    @cached_property
    def _places(self) -> Points:
        grid = self._paths.grid
        return np.asarray(
            grid.viewpoints[grid.viewpoint_starts[grid.ordinals(self._numbers.tour.cells)]]
        )

    @cached_property
    def _ups(self) -> NDArray[np.float64]:
        return np.asarray(self._places[:, 2] * self._paths.grid.climb / self._paths.grid.size)

    def length(self, source: int, cell: int, closed: int = 0) -> float:
        """Return the length of the path between two cells, in cell sides.

        The argument ``closed`` of `Distances.length` has no effect here.
        """
        key = (min(source, cell), max(source, cell))
        length = self._cache.get(key)
        if length is None:
            length = self._cache[key] = self._measure(*key)
        return length

    def _measure(self, source: int, cell: int) -> float:
        places, size = self._places[[source, cell], :2], self._paths.grid.size
        up = abs(float(self._ups[source] - self._ups[cell]))
        if not self._layers:
            return float(np.hypot(*(places[1] - places[0]))) / size + up
        (layer, number), (other_layer, other_number) = self._own(source), self._own(cell)
        if layer == other_layer:
            return self._layers[layer].length(number, other_number) * self._sizes[layer]
        return self._paths.legs(places).length / size + up

    def _own(self, number: int) -> tuple[int, int]:
        """Return the first layer that has a cell, and the index of the cell on its tour."""
        layer, row, col = self._numbers.tour.cells[number].tolist()
        base = self._bases[layer]
        return base, int(self._numbers.layers[base].position[row, col])

    def lengths(self, source: int) -> NDArray[np.float64]:
        """Return approximate distances from the cell ``source`` to all cells, in cell sides.

        The horizontal distance to a cell of another layer begins in the cell of the other layer
        above or below ``source``.
        """
        grid, place = self._paths.grid, self._places[source]
        distances = np.hypot(*(self._places[:, :2] - place[:2]).T) / grid.size
        far: dict[int, NDArray[np.float64]] = {}
        for layer, base in enumerate(self._bases if self._layers else ()):
            own, cells = self._numbers.layers[base], self._numbers.layers[layer].cells
            if base not in far:
                row, col = grid.layers[base].cell_of(place[None, :2])[0]
                lengths = self._layers[base].lengths(int(own.position[row, col]))
                far[base] = lengths * self._sizes[base]
            numbers = self._numbers.whole(layer, np.arange(len(cells)))
            distances[numbers] = far[base][own.position[tuple(cells.T)]]
        return np.asarray(distances + np.abs(self._ups - self._ups[source]))


def plane_of(grid: CellGrid, position: Numbers, size: float = 1.0) -> CellPlane:
    """Return the cells of a grid, and the possible steps between them, in the form that
    `CellDistances` needs.

    Parameters
    ----------
    grid : CellGrid
    position : ndarray of int64, shape (H, W) or larger
        Tour index of each cell, and -1 for positions without a cell.
    size : float
        Length of a step to a neighbouring cell, in sides of the smallest cells of all layers.
    """
    rows, columns = grid.shape
    return CellPlane(position[:rows, :columns], grid.doors_east, grid.doors_south, size)


def cells_of_layers(grid: LayeredGrid, tour: Tour, steps: NDArray[np.float64]) -> CellDistances:
    """Return the distances for robots that move only to neighbouring cells of the same layer, or of
    the layer above or below. From a cell that they search again, they move to the same cell of its
    own layer, too.

    Parameters
    ----------
    grid : LayeredGrid
    tour : Tour
    steps : ndarray of float64, shape (N,)
        Length of the path from each cell of the tour to the next cell of the tour, in cell sides.
    """
    layers = grid.layers
    planes = [
        plane_of(layer, tour.position[number], layer.size / grid.size)
        for number, layer in enumerate(layers)
    ]
    places = with_climb_cost(grid, grid.viewpoints[grid.viewpoint_starts[:-1]]) / grid.size
    own = tour.position[tuple(grid.cells.T)]
    ends = [np.zeros((0, 2), dtype=np.int64)]
    for number in range(len(layers)):
        sources = np.flatnonzero(grid.cells[:, 0] == number)
        whole = layers[number].whole
        neighbours = (number - 1, number + 1) if whole is None else (layers.index(whole),)
        for second in neighbours:
            if 0 <= second < len(layers) and layers[second].whole is None:
                over = layers[second].cell_of(places[sources, :2] * grid.size)
                targets = grid.ordinals(np.column_stack([np.full(len(over), second), over]))
                ends.append(np.sort(np.column_stack([sources, targets]), axis=1))
    first, second = np.unique(np.concatenate(ends), axis=0).T
    apart = np.abs(places[first] - places[second])
    lengths = np.hypot(apart[:, 0], apart[:, 1]) + apart[:, 2]
    return CellDistances(
        tour, planes=planes, climbs=(own[first], own[second], lengths), steps=steps
    )
