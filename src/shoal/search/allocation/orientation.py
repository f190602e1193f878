"""Orientation: the choice of a tour, and of the angle and shift of its rows, so that one round takes the least time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.search.allocation.layers import Grid, LayeredGrid, LayeredPaths, Paths, at_altitude, with_climb_cost
from shoal.search.cells.clipping import rotated_shape
from shoal.search.cells.grid import cells_of
from shoal.search.cells.routing import RegionPaths, Route
from shoal.search.cells.straightening import along_tour
from shoal.search.flight.timing import turns_of
from shoal.search.regions.region import SearchRegion
from shoal.search.tours import Tour, make_tour
from shoal.search.tours.layers import TIE, joined

ON_ROWS = ("boustrophedon",)
"""Tours that follow the rows of cells, and for which the viewpoints of border cells lie on a path with few bends."""

TURN = 1.0
"""Cost of a turn in cells that Shoal assumes, when it compares orientations, for vehicles that turn in no time."""

_STEP = 10.0  # degrees between compared angles, besides the angles of the outline's long sides
_SIDES = 3
_SHIFTS = (0.0, 0.25, 0.5, 0.75)  # shift relative to a row
_TRIED = 4  # number of orientations that are planned in full
_WORK = 200_000  # total number of cells that are planned in full, over all orientations
_ROWS = 120  # maximum number of rows for an estimate


@dataclass(frozen=True)
class Candidate:
    """One possible plan that the planner compares with others: an angle, a tour, possibly an allocation, and the search time.

    Parameters
    ----------
    angle : float
        Angle of the rows of cells in degrees, counter-clockwise from the x axis.
    tour : str
        Name of the tour.
    cells : float
        Search time. A robot of speed 1 searches one cell per unit of time. With an allocation, the search time is the time until
        all robots finish. Without an allocation, the search time is the time in which one robot follows the whole tour, including
        turns.
    allocation : str, optional
        Name of the allocator.
    """

    angle: float
    tour: str
    cells: float
    allocation: str | None = None

    def report(self) -> dict[str, Any]:
        """Return the candidate as a mapping that can be written as JSON."""
        told = {"angle_degrees": self.angle, "tour": self.tour, "cells": self.cells}
        return told | ({} if self.allocation is None else {"allocation": self.allocation})


@dataclass(frozen=True, eq=False)
class GridTour:
    """A region divided into cells, and a tour through these cells.

    Parameters
    ----------
    grid : CellGrid or LayeredGrid
    tour : Tour
    paths : RegionPaths or LayeredPaths
    compared : tuple of Candidate
        The compared candidates, from the fastest to the slowest, or an empty tuple if the planner compared nothing.
    layers : tuple of GridTour
        The cells and the tour of each layer, if the search has several layers. Equal layers are one shared object.
    """

    grid: Grid
    tour: Tour
    paths: Paths
    compared: tuple[Candidate, ...] = ()
    layers: tuple[GridTour, ...] = ()

    @cached_property
    def route(self) -> Route:
        """The closed path of one round of the tour, from the first cell back to the first cell."""
        return self.paths.route(np.concatenate([self.tour.cells, self.tour.cells[:1]]))

    def once_round(self, turn_cost: float) -> float:
        """Return the cost, in cells, of one round of the tour: the length of the path plus the cost of its turns."""
        return self.route.length / self.grid.size + turn_cost * int(turns_of(self.route.points).sum())


def grid_tour(
    region: SearchRegion,
    size: float,
    tour: str,
    *,
    angle: float,
    offset: float = 0.0,
    turn_cost: float = 0.0,
    stepwise: bool = False,
    transit: bool = False,
) -> GridTour:
    """Divide a region into cells whose rows have a given angle, and compute a tour through these cells.

    Parameters
    ----------
    region : SearchRegion
    size : float
        Side of a cell in metres.
    tour : str
        Name of the tour for `make_tour`.
    angle : float
        Angle of the rows of cells in degrees, counter-clockwise from the x axis.
    offset : float
        Shift of the rows of cells across their direction, as a fraction of the row width.
    turn_cost : float
        Cost of a turn in cells. The function replaces a cost of 0 by `TURN`.
    stepwise : bool
        Whether robots move only from a cell to a neighbouring cell. Robots that move from cell to cell look at each cell from
        inside it.
    transit : bool
        Whether paths may lead outside the region from one of its parts to another, as in `RegionPaths`.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> grid_tour(open_region("rectangle:40x20"), 10, "boustrophedon", angle=90).grid
    <CellGrid 4x2, 8 cells of 10 m, 8 viewpoints>
    """
    on_rows = tour in ON_ROWS and not stepwise
    grid = cells_of(region, size, angle=angle, offset=(0.0, offset), on_rows=on_rows)
    made = make_tour(tour, grid.mask)
    if on_rows:
        grid = along_tour(grid, made.cells, turn_cost or TURN)
    return GridTour(grid, made, RegionPaths(grid, transit=transit))


def in_layers(
    first: GridTour, altitudes: Sequence[float], passes: int, sizes: Sequence[float], tour: str, *, climb: float, **given: Any
) -> GridTour:
    """Divide a region into the cells of several layers, and compute one tour through all layers.

    A search with one altitude and one pass keeps the cells and the tour of ``first``.

    Parameters
    ----------
    first : GridTour
        The cells and the tour of the first pass in the lowest layer. All layers take over the region and the angle of ``first``.
    altitudes : sequence of float
        Altitudes of the search in metres, in increasing order.
    passes : int
        Number of passes at each altitude. In every second pass, the rows of cells are rotated by 90 degrees.
    sizes : sequence of float
        Side of the cells at each altitude, in metres.
    tour : str
        Name of the tour for `make_tour`.
    climb : float
        Horizontal distance in metres that takes as long as a climb or descent of one metre, as in `LayeredGrid`.
    given
        The arguments ``turn_cost``, ``stepwise`` and ``transit`` of `grid_tour`.
    """
    if len(altitudes) * passes == 1:
        return first
    size, angle, area = sizes[0], first.grid.angle, first.paths.grid.region
    known = {(size, angle): first}
    layers: list[GridTour] = []
    for side in sizes:
        for number in range(passes):
            key = side, (angle + 90.0 * (number % 2)) % 180.0
            if key not in known:
                known[key] = grid_tour(area, side, tour, angle=key[1], **given)
            layers.append(known[key])
    grids = tuple(one.grid for one in layers if not isinstance(one.grid, LayeredGrid))
    grid = LayeredGrid(grids, np.repeat(np.asarray(altitudes, dtype=np.float64), passes), climb)
    points = [
        with_climb_cost(grid, at_altitude(one.viewpoints[one.viewpoint_starts[one.ordinals(laid.tour.cells)]], up)) / grid.size
        for one, laid, up in zip(grids, layers, grid.altitudes.tolist(), strict=True)
    ]
    whole = joined([one.tour for one in layers], points, turn=max(given.get("turn_cost", 0.0), TIE))
    paths = LayeredPaths(grid, [one.paths for one in layers if isinstance(one.paths, RegionPaths)])
    return GridTour(grid, whole, paths, first.compared, tuple(layers))


def best_grid_tour(
    region: SearchRegion,
    size: float,
    tours: Sequence[str],
    *,
    turn_cost: float,
    angle: float | None = None,
    stepwise: bool = False,
    transit: bool = False,
) -> GridTour:
    """Choose the angle and the shift of the rows of cells, and the tour, for which one round costs least.

    The function estimates the cost of each pair of an angle and a shift from the number and the lengths of the rows. Only for the
    four pairs with the lowest estimated cost (in large regions, for fewer pairs), the function computes complete tours.

    Parameters
    ----------
    region : SearchRegion
    size : float
        Side of a cell in metres.
    tours : sequence of str
        Names of the tours to compare.
    turn_cost : float
        Cost of a turn in cells. The function replaces a cost of 0 by `TURN`.
    angle : float, optional
        Angle of the rows of cells in degrees. With a given angle, the function compares only tours.
    stepwise, transit : bool
        The arguments ``stepwise`` and ``transit`` of `grid_tour`.
    """
    turn = turn_cost or TURN
    tried = max(1, min(_TRIED, int(_WORK * size**2 / region.area_m2)))
    chosen = [(angle, 0.0)] if angle is not None else _estimated(region.area, size, turn)[:tried]
    given: dict[str, Any] = {"stepwise": stepwise, "transit": transit, "turn_cost": turn}
    found = [
        (laid := grid_tour(region, size, tour, angle=way, offset=offset, **given), laid.once_round(turn))
        for way, offset in chosen
        for tour in tours
    ]
    found.sort(key=lambda one: one[1])
    best = found[0][0]
    compared = {laid.tour.name: Candidate(laid.grid.angle, laid.tour.name, cost) for laid, cost in reversed(found)}
    chosen_among = sorted(compared.values(), key=lambda one: one.cells) if angle is None or len(tours) > 1 else ()
    kept = replace(best, compared=tuple(chosen_among))
    vars(kept)["route"] = best.route  # known already
    return kept


def _estimated(area: Any, size: float, turn: float) -> list[tuple[float, float]]:
    """Return pairs (angle, shift) for the rows of cells, sorted by the estimated cost of the search."""
    simple = area.simplify(size / 4)
    angles = {*np.arange(0.0, 180.0, _STEP).tolist(), *_long_sides(simple)}
    costs = []
    for angle in sorted(angles):
        flat = rotated_shape(simple, -angle)
        costs += [(_cost_of_rows(flat, size, turn, shift), angle, shift) for shift in _SHIFTS]
    return [(angle, shift) for _, angle, shift in sorted(costs)]


def _long_sides(area: Any) -> list[float]:
    """Return the directions of the longest sides of an outline, and the perpendicular directions, in degrees from 0 to 180."""
    import shapely

    found: dict[float, float] = {}
    for ring in shapely.get_rings(shapely.get_parts(area)):
        sides = np.diff(shapely.get_coordinates(ring), axis=0)
        ways = np.round(np.degrees(np.arctan2(sides[:, 1], sides[:, 0])) % 90.0, 1)
        for way, length in zip(ways.tolist(), np.hypot(*sides.T).tolist(), strict=True):
            found[way % 90.0] = found.get(way % 90.0, 0.0) + length
    best = sorted(found, key=lambda way: -found[way])[:_SIDES]
    return [way + quarter for way in best for quarter in (0.0, 90.0)]


def _cost_of_rows(area: Any, size: float, turn: float, shift: float) -> float:
    """Return the estimated cost, in cells, of driving along all rows of cells.

    The estimate is the sum of three terms: the lengths of all rows, the transfers between rows, and two turns for each row. A
    transfer between two rows costs one row width, or more where the border slants.
    """
    import shapely

    left, low, right, high = area.bounds
    count = max(1, int(np.ceil((high - low) / size - 1e-9))) + (shift > 0)
    first = (low + high - count * size) / 2 + ((shift - 0.5) * size if shift > 0 else 0.0)
    looked_at = min(count, _ROWS)
    chosen = ((np.arange(looked_at) + 0.5) * count / looked_at).astype(np.int64)
    # A row counts if it contains any part of the region. This is tested along its centre line and near both of its sides.
    y = first + (chosen[:, None] + np.array([0.5, 0.02, 0.98])) * size
    ends = np.stack([np.full_like(y, left - 1), y, np.full_like(y, right + 1), y], axis=-1).reshape(*y.shape, 2, 2)
    cut = shapely.intersection(shapely.linestrings(ends.reshape(-1, 2, 2)), area).reshape(y.shape)
    runs = np.where(shapely.is_empty(cut), 0, shapely.get_num_geometries(cut)).max(axis=1)
    bounds = shapely.bounds(cut)[..., [0, 2]] / size
    slants = np.nan_to_num(np.abs(bounds[:, 1] - bounds[:, 2]))
    lengths = shapely.length(cut).max(axis=1) / size + slants.sum(axis=1) / 2
    links = np.hypot(1.0, slants).mean(axis=1) - 1.0
    return float((lengths + links + runs * (1.0 + 2.0 * turn)).sum() * count / looked_at)
