"""Orientation: the angle and shift of the rows, and the tour, for which going once round takes the least time, turns included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from shoal.dataclass import dataclass
from shoal.search.cells.clipping import rotated_shape
from shoal.search.cells.grid import CellGrid, cells_of
from shoal.search.cells.routing import RegionPaths, Route
from shoal.search.cells.straightening import along_tour
from shoal.search.flight.timing import turns_of
from shoal.search.regions.region import SearchRegion
from shoal.search.tours import Tour, make_tour

ON_ROWS = ("boustrophedon",)
"""Tours that follow rows: with them, cells on the border are seen from places on a way that bends seldom."""

TURN = 1.0
"""Cells: what a turn counts for, when orientations are compared, in a search where turns cost nothing."""

_STEP = 10.0  # degrees between angles that are compared, besides those of the outline's long sides
_SIDES = 3
_SHIFTS = (0.0, 0.25, 0.5, 0.75)  # of a row
_TRIED = 4  # orientations that are planned in full
_WORK = 200_000  # cells that are planned in full, of all orientations together
_ROWS = 120  # at most so many rows are looked at for an estimate


@dataclass(frozen=True)
class Candidate:
    """A way to search that was compared with others, and its time.

    Parameters
    ----------
    angle : float
        Of the rows, degrees.
    tour : str
    cells : float
        The time of one robot once round, turns included, or with an allocation that of all robots; in that of a cell.
    allocation : str, optional
    """

    angle: float
    tour: str
    cells: float
    allocation: str | None = None

    def report(self) -> dict[str, Any]:
        """Return it for JSON."""
        told = {"angle_degrees": self.angle, "tour": self.tour, "cells": self.cells}
        return told | ({} if self.allocation is None else {"allocation": self.allocation})


@dataclass(frozen=True, eq=False)
class GridTour:
    """A region cut into cells, and the tour through them.

    Parameters
    ----------
    grid : CellGrid
    tour : Tour
    paths : RegionPaths
    compared : tuple of Candidate
        What was laid and compared, the best first; empty if nothing was to be chosen.
    """

    grid: CellGrid
    tour: Tour
    paths: RegionPaths
    compared: tuple[Candidate, ...] = ()

    @cached_property
    def route(self) -> Route:
        """The way once round, from the first cell to the first."""
        return self.paths.route(np.concatenate([self.tour.cells, self.tour.cells[:1]]))

    def once_round(self, turn_cost: float) -> float:
        """Return what it costs to go once round, in cells: the way, and each of its bends."""
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
    """Cut a region into cells at an angle and lay a tour through them.

    Parameters
    ----------
    region : SearchRegion
    size : float
        Side of a cell, metres.
    tour : str
        As `make_tour` takes it.
    angle : float
        Of the rows, degrees counter-clockwise from the x axis.
    offset : float
        By how much of a row the rows are shifted across.
    turn_cost : float
        Of a turn, in cells; 0 counts as `TURN`.
    stepwise : bool
        Whether robots go from cell to cell: then each cell is seen from inside of it.
    transit : bool
        As `RegionPaths` takes it.

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
    """Return the cells and the tour for which going once round costs least, over angles, shifts of the rows and tours.

    All angles are estimated by the number of rows and their lengths; the best few are planned in full, fewer in large regions.

    Parameters
    ----------
    region : SearchRegion
    size : float
        Side of a cell, metres.
    tours : sequence of str
        Those to choose from.
    turn_cost : float
        Of a turn, in cells; 0 counts as `TURN`.
    angle : float, optional
        Of the rows, where only the tour is to be chosen.
    stepwise, transit : bool
        As `grid_tour` takes them.
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
    chosen = replace(best, compared=tuple(sorted(compared.values(), key=lambda one: one.cells)))
    vars(chosen)["route"] = best.route  # known already
    return chosen


def _estimated(area: Any, size: float, turn: float) -> list[tuple[float, float]]:
    """Return angles and shifts, those first for which rows cost least."""
    simple = area.simplify(size / 4)
    angles = {*np.arange(0.0, 180.0, _STEP).tolist(), *_long_sides(simple)}
    costs = []
    for angle in sorted(angles):
        flat = rotated_shape(simple, -angle)
        costs += [(_cost_of_rows(flat, size, turn, shift), angle, shift) for shift in _SHIFTS]
    return [(angle, shift) for _, angle, shift in sorted(costs)]


def _long_sides(area: Any) -> list[float]:
    """Return the angles along and across which the outline is longest, degrees below 180."""
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
    """Return about what it costs to drive all rows, in cells.

    Their lengths, as far as any of their widths reaches; at the end of each a row's width, more along a slanting border; and two
    turns.
    """
    import shapely

    left, low, right, high = area.bounds
    count = max(1, int(np.ceil((high - low) / size - 1e-9))) + (shift > 0)
    first = (low + high - count * size) / 2 + ((shift - 0.5) * size if shift > 0 else 0.0)
    looked_at = min(count, _ROWS)
    chosen = ((np.arange(looked_at) + 0.5) * count / looked_at).astype(np.int64)
    # A row is there if it holds any of the region: looked for in its middle and near both of its sides.
    y = first + (chosen[:, None] + np.array([0.5, 0.02, 0.98])) * size
    ends = np.stack([np.full_like(y, left - 1), y, np.full_like(y, right + 1), y], axis=-1).reshape(*y.shape, 2, 2)
    cut = shapely.intersection(shapely.linestrings(ends.reshape(-1, 2, 2)), area).reshape(y.shape)
    runs = np.where(shapely.is_empty(cut), 0, shapely.get_num_geometries(cut)).max(axis=1)
    bounds = shapely.bounds(cut)[..., [0, 2]] / size
    slants = np.nan_to_num(np.abs(bounds[:, 1] - bounds[:, 2]))
    lengths = shapely.length(cut).max(axis=1) / size + slants.sum(axis=1) / 2
    links = np.hypot(1.0, slants).mean(axis=1) - 1.0
    return float((lengths + links + runs * (1.0 + 2.0 * turn)).sum() * count / looked_at)
