"""Distances between cells, along short paths inside a region or along steps between neighbouring
cells around obstacles.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.search.cells.graphs import Graph
from shoal.search.cells.routing import RegionPaths
from shoal.search.cells.visibility_graph import inside, length_of, pull_string
from shoal.search.tours import Tour
from shoal.search.tours.masks import array_to_bits, bits_to_array, bitset_of

_CACHED = 1 << 22  # maximum number of cached distances
_DIAGONAL = float(np.sqrt(2))
_SHORTEST = 1e-9  # cell sides: length of a path between parts that touch, and of a climb


class Distances(Protocol):
    """Interface of the objects that give `TourCost` the distances between the cells of a tour."""

    @property
    def stepwise(self) -> bool:
        """Whether robots move only from a cell to a neighbouring cell, and discover obstacles on
        their way.
        """

    def length(self, source: int, cell: int, closed: int = 0) -> float:
        """Return the length, in cell sides, of the path between two cells given as tour indices;
        infinity if no path exists.

        The argument ``closed`` is a bitset of cells that the path must not enter.
        """

    def lengths(self, source: int) -> NDArray[np.float64]:
        """Return approximate distances from a cell to all cells, in cell sides; float64, shape
        (N,), all values finite.
        """


@dataclass(frozen=True, eq=False)
class CellPlane:
    """The cells of one layer, and the possible steps between neighbouring cells.

    Parameters
    ----------
    position : ndarray of int64, shape (H, W)
        Tour index of each cell, and -1 for positions without a cell.
    doors_east, doors_south : ndarray of bool, shapes (H, W - 1) and (H - 1, W), optional
        Whether a robot can move from each cell to the next cell of the row, and from each cell to
        the cell below it. By default, a robot can move between any two neighbouring cells.
    size : float
        Length of a step to a neighbouring cell, in sides of the smallest cells of all layers.
    """

    position: NDArray[np.int64]
    doors_east: NDArray[np.bool_] | None = None
    doors_south: NDArray[np.bool_] | None = None
    size: float = 1.0

    def edges(self, open_: NDArray[np.bool_]) -> tuple[list[Any], list[Any], list[Any]]:
        """Return the steps between open cells as three lists of arrays: first cells, second cells,
        and lengths in cell sides.

        The array ``open_`` of shape (N,) tells for each tour index whether the cell is open.
        """
        position = self.position
        free = (position >= 0) & open_[position]
        east, south = free[:, :-1] & free[:, 1:], free[:-1] & free[1:]
        east = east if self.doors_east is None else east & self.doors_east
        south = south if self.doors_south is None else south & self.doors_south
        # Steps across a corner need both cells beside the corner.
        across = east[:-1] & east[1:] & south[:, :-1] & south[:, 1:]
        rows = [
            position[:, :-1][east],
            position[:-1][south],
            position[:-1, :-1][across],
            position[:-1, 1:][across],
        ]
        cols = [
            position[:, 1:][east],
            position[1:][south],
            position[1:, 1:][across],
            position[1:, :-1][across],
        ]
        return (
            rows,
            cols,
            [
                np.full(len(some), self.size * (_DIAGONAL if k > 1 else 1.0))
                for k, some in enumerate(rows)
            ],
        )


class CellDistances:
    """Lengths of shortest paths whose steps lead from a cell to a neighbouring cell.

    A diagonal step is possible if both cells beside the step are open.

    Parameters
    ----------
    tour : Tour
        The tour of a plane region, or the tour through several layers.
    planes : sequence of CellPlane, optional
        The cells and steps of each layer. By default, steps and climbs connect all neighbouring
        cells of the tour's grid.
    climbs : tuple of array_like, optional
        Climbs between layers, as three arrays: tour index of the first cell, tour index of the
        second cell, and length in cell sides.
    steps : array_like of float64, shape (N,), optional
        Length in cell sides of the path from each cell of the tour to the next cell. Robots use
        such a path only if no sequence of steps and climbs between neighbouring cells connects the
        two cells.

    Examples
    --------
    >>> from shoal.search.tours import make_tour
    >>> tour = make_tour("comb", (3, 3))
    >>> distances = CellDistances(tour)
    >>> source, between, cell = tour.position[0].tolist()
    >>> distances.length(source, cell), round(distances.length(source, cell, closed=1 << between), 3)
    (2.0, 4.0)
    """

    stepwise = True

    def __init__(
        self,
        tour: Tour,
        *,
        planes: Sequence[CellPlane] = (),
        climbs: tuple[Any, Any, Any] = ((), (), ()),
        steps: ArrayLike | None = None,
    ) -> None:
        position = tour.position
        if position.ndim == 3 and not planes:  # climbs are as long as steps
            planes, stacked = (
                [CellPlane(layer) for layer in position],
                (position[:-1] >= 0) & (position[1:] >= 0),
            )
            climbs = position[:-1][stacked], position[1:][stacked], np.ones(int(stacked.sum()))
        self._n, self._planes = len(tour), tuple(planes) or (CellPlane(position),)
        self._climbs = tuple(
            np.asarray(column, dtype=kind)
            for column, kind in zip(climbs, (np.int64, np.int64, float), strict=True)
        )
        # between two passes at one altitude: without a length, a path could go up and down forever
        self._climbs = (*self._climbs[:2], np.maximum(self._climbs[2], _SHORTEST))
        self._cells = tour.cells
        self._links: dict[tuple[int, int], float] = {}
        self._make_caches()
        if steps is not None:
            self._join(np.asarray(steps, dtype=np.float64))

    def _make_caches(self) -> None:
        size = max(_CACHED // self._n, 8)
        self._lengths_from = lru_cache(maxsize=size)(self._search)
        self._graph = lru_cache(maxsize=16)(self._open_graph)
        self._components_of = lru_cache(maxsize=size)(self._components)

    def _join(self, steps: NDArray[np.float64]) -> None:
        """Connect consecutive cells of the tour by paths of the lengths ``steps`` if no other path
        connects them.
        """
        labels = self._labels(0)
        for cell in np.flatnonzero(labels != np.roll(labels, -1)).tolist():
            other = (cell + 1) % self._n
            self._links[cell, other] = self._links[other, cell] = float(steps[cell]) or _SHORTEST
        self._make_caches()

    def __getstate__(self) -> dict[str, Any]:
        return {
            name: value
            for name, value in self.__dict__.items()
            if name not in ("_lengths_from", "_graph", "_components_of")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._make_caches()

    def length(self, source: int, cell: int, closed: int = 0) -> float:
        """Return the length of the shortest path between two cells, in cell sides; infinity if no
        path exists.
        """
        return float(self._lengths_from(source, closed)[cell])

    def lengths(self, source: int) -> NDArray[np.float64]:
        """Return the distances from the cell ``source`` to all cells of the tour, in cell sides.

        The distance to a cell that no path reaches is the number of cells of the tour.
        """
        return np.minimum(self._lengths_from(source, 0), float(self._n))

    def cells(self, source: int, cell: int, closed: int = 0) -> tuple[int, ...]:
        """Return the cells of the shortest path from the cell ``source`` to the cell ``cell``, as
        tour indices.

        Of several shortest paths it is the one that, seen from its end, comes from the cell with
        the lowest number. The result contains ``cell`` but not ``source``. If no path exists, the
        result is empty.
        """
        lengths = self._lengths_from(source, closed)
        return tuple(self._graph(closed & ~(1 << source)).path(lengths, cell)[1:].tolist())

    def beside(self, source: int, target: int) -> tuple[int, ...]:
        """Return the two cells beside a diagonal step, which must be open for this step. For any
        other step, return no cells.
        """
        (*layer, row, col), (*to_layer, to_row, to_col) = (
            self._cells[source].tolist(),
            self._cells[target].tolist(),
        )
        if layer != to_layer or row == to_row or col == to_col or (source, target) in self._links:
            return ()
        position = self._planes[layer[0] if layer else 0].position
        return int(position[row, to_col]), int(position[to_row, col])

    def crossed(self, source: int, through: tuple[int, ...]) -> int:
        """Return the bitset of cells that must be open for a path: the cells on the path, and the
        cells beside diagonal steps.
        """
        return bitset_of(
            cell
            for start, end in pairwise((source, *through))
            for cell in (end, *self.beside(start, end))
        )

    def reach(self, cell: int, closed: int = 0) -> int:
        """Return the bitset of cells that a robot can reach from a cell, always including this cell
        itself.
        """
        return self._components_of(closed & ~(1 << cell))[cell]

    def _search(self, source: int, closed: int) -> NDArray[np.float64]:
        """Return the distances from a cell to all cells."""
        return self._graph(closed & ~(1 << source)).distances(source)

    def _components(self, closed: int) -> list[int]:
        labels = self._labels(closed)
        sets = [array_to_bits(labels == label) for label in range(int(labels.max()) + 1)]
        return [sets[label] for label in labels.tolist()]

    def _labels(self, closed: int) -> NDArray[np.int64]:
        """Return the number of each cell's connected component; int64, shape (N,)."""
        return self._graph(closed).components()

    def _open_graph(self, closed: int) -> Graph:
        """Return the graph of open cells, with the length of each step and climb between
        neighbours.
        """
        open_ = ~bits_to_array(closed, self._n)
        edges = [plane.edges(open_) for plane in self._planes]
        free = open_[self._climbs[0]] & open_[self._climbs[1]]
        edges.append(([self._climbs[0][free]], [self._climbs[1][free]], [self._climbs[2][free]]))
        rows, cols, lengths = ([part for step in edges for part in step[k]] for k in range(3))
        links = [
            (*ends, length)
            for ends, length in self._links.items()
            if ends[0] < ends[1] and not any(closed >> end & 1 for end in ends)
        ]
        for some, values in zip((rows, cols, lengths), zip(*links, strict=True), strict=False):
            some.append(np.array(values))
        sources, targets, length = (
            np.concatenate(rows),
            np.concatenate(cols),
            np.concatenate(lengths),
        )
        return Graph.from_edges(sources, targets, length, self._n)

    def steps(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Return all steps between cells: the first step of each cell and one more, shape (N + 1,);
        of each step, the other cell, the length, and the two cells that must be open, too, or -1.
        """
        graph = self._graph(0)
        firsts = np.repeat(np.arange(self._n), np.diff(graph.first)).tolist()
        beside = [
            self.beside(source, target) or (-1, -1)
            for source, target in zip(firsts, graph.ends.tolist(), strict=True)
        ]
        return (
            graph.first,
            graph.ends,
            graph.lengths,
            np.array(beside, dtype=np.int64).reshape(-1, 2),
        )


class RegionDistances:
    """Distances between the viewpoints of cells, along paths inside a region.

    If the straight line between two viewpoints leaves the region, the distance is the length of a
    shortened path from cell to cell. A robot follows the path of `RegionPaths.leg`, which is never
    longer than the distance of `RegionDistances`. In a ring-shaped region, the robot's path is up
    to 5 % shorter than the distance of `RegionDistances`.

    Parameters
    ----------
    paths : RegionPaths
    tour : Tour
    cells : CellDistances
        Distances from cell to cell on the tour ``tour``.
    """

    stepwise = False

    def __init__(self, paths: RegionPaths, tour: Tour, cells: CellDistances) -> None:
        grid = paths.grid
        self._paths, self._cells, self._size = paths, cells, grid.size
        self._places = grid.viewpoints[grid.viewpoint_starts[grid.ordinals(tour.cells)]]
        self._rows_cols = tour.cells.astype(np.float64)
        self._cache: dict[tuple[int, int], float] = {}
        self._steps: dict[tuple[int, int], NDArray[np.float64]] = {}

    def length(self, source: int, cell: int, closed: int = 0) -> float:
        """Return the length of the path between two cells, in cell sides.

        The argument ``closed`` of `Distances.length` has no effect here.
        """
        key = (source, cell) if source < cell else (cell, source)
        length = self._cache.get(key)
        if length is None:
            length = self._cache[key] = self._measure(*key) / self._size
        return length

    def lengths(self, source: int) -> NDArray[np.float64]:
        """Return approximate distances from the cell ``source`` to all cells, in cell sides.

        Each distance is the straight distance plus the detour around walls. The detour is the
        length of the path from cell to cell, minus the length that this path would have without
        walls.
        """
        straight = np.hypot(*(self._places - self._places[source]).T) / self._size
        rows, cols = np.abs(self._rows_cols - self._rows_cols[source]).T
        free = np.maximum(rows, cols) + (_DIAGONAL - 1) * np.minimum(rows, cols)
        lengths = self._cells.lengths(source)
        return np.asarray(
            straight + np.where(lengths < len(lengths), np.maximum(lengths - free, 0.0), 0.0)
        )

    def measure_straight(self, source: int, cells: NDArray[np.int64]) -> None:
        """Measure those of the paths from a cell to several other cells that are straight, at once,
        for `length`.
        """
        pairs = np.column_stack([np.minimum(cells, source), np.maximum(cells, source)])
        ends = self._places[pairs]
        straight = inside(self._paths.grid.region, ends[:, 0], ends[:, 1])
        lengths = np.hypot(*(ends[straight, 1] - ends[straight, 0]).T) / self._size
        self._cache.update(zip(map(tuple, pairs[straight].tolist()), lengths.tolist(), strict=True))

    def _measure(self, source: int, cell: int) -> float:
        region, ends = self._paths.grid.region, self._places[[source, cell]]
        if inside(region, ends[:1], ends[1:])[0]:
            return length_of(ends)
        through = (source, *self._cells.cells(source, cell))
        if len(through) == 1:  # in another part of the region
            return self._paths.legs(ends).length
        path = np.concatenate(
            [self._places[[source]], *(self._step(*pair) for pair in pairwise(through))]
        )
        return length_of(pull_string(region, pull_string(region, path)[::-1]))

    def _step(self, source: int, cell: int) -> NDArray[np.float64]:
        """Return the points of the path from a cell to a neighbouring cell, without the first point
        of the path.
        """
        points = self._steps.get((source, cell))
        if points is None:
            points = self._steps[source, cell] = self._paths.legs(
                self._places[[source, cell]]
            ).points[1:]
        return points
