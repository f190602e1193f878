"""Orientation: the choice of a tour, and of the angle and shift of its rows, so that one round of
the tour takes the least time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from math import inf
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import angles_of, partial_sums
from shoal.search.allocation.allocate import Allocation, Indices, allocate, numbers_of
from shoal.search.allocation.costs import Floats, TourCost
from shoal.search.cells.clipping import lattice_over, rotate, rotate_shape
from shoal.search.cells.grid import CellGrid, cells_of
from shoal.search.cells.lanes import LineLattice, cells_along
from shoal.search.cells.layers import (
    Grid,
    LayeredGrid,
    LayeredPaths,
    Paths,
    at_altitude,
    with_climb_cost,
)
from shoal.search.cells.routing import RegionPaths, Route
from shoal.search.cells.visibility_graph import leg_lengths
from shoal.search.cells.windows import along_tour
from shoal.search.flight.timing import turn_shares, turns_of
from shoal.search.planning.choosing import one_by_one
from shoal.search.problem import TURN_PRICES
from shoal.search.regions.region import SearchRegion
from shoal.search.tours import Tour, TourMaker, make_tour
from shoal.search.tours.curves import TIE, join_layers
from shoal.search.tours.headland import HeadlandTour
from shoal.search.tours.rows import (
    BoustrophedonTour,
    CombTour,
    SpanningTreeTour,
    StripsTour,
)

_COMPARED = 100_000  # cells times robots: above this, only the first allocation is evaluated
_WIDE = 10_000  # the same limit for robots with wide footprints


@dataclass(frozen=True)
class Candidate:
    """One possible plan that the planner compares with other plans: an angle, a tour, possibly an
    allocation, and the search time.

    Parameters
    ----------
    angle : float
        Direction in which most of the tour's length runs, in degrees counter-clockwise from the x
        axis.
    tour : str
        Name of the tour.
    cells : float
        Search time, in units of the time in which a robot of speed 1 searches one cell. With an
        allocation, the search time is the time until all robots finish. Without an allocation, the
        search time is the time in which one robot follows the whole tour, including turns.
    allocation : str, optional
        Name of the allocator.
    seconds : float, optional
        Time until all robots are done or, of vehicles, back, if whole plans were compared; ``cells``
        is then this time in cells.
    """

    angle: float
    tour: str
    cells: float
    allocation: str | None = None
    seconds: float | None = None

    def report(self) -> dict[str, Any]:
        """Return the candidate as a mapping that can be written as JSON."""
        summary = {"angle_degrees": self.angle, "tour": self.tour, "cells": self.cells}
        summary |= {} if self.allocation is None else {"allocation": self.allocation}
        return summary | ({} if self.seconds is None else {"seconds": self.seconds})


def compared_allocations(
    tour_cost: TourCost,
    starts: Indices,
    allocators: Sequence[str],
    *,
    rates: Floats,
    places: Floats,
    widths: Indices,
    energy: float = inf,
    recharge: float = 0.0,
) -> list[tuple[Allocation, float]]:
    """Return the allocations of all compared allocators, each with the time until all robots
    finish, the fastest first.

    The unit of all times is the time in which a robot of speed 1 searches one cell.

    Parameters
    ----------
    tour_cost : TourCost
    starts, rates, places, widths : ndarray
        Start cells, speeds, positions and footprint widths of the robots, as in `allocate`.
    allocators : sequence of str
        Names of the allocators to compare. Of several equally fast allocations, the one whose
        allocator comes first is first.
    energy : float
        Time after which the battery of a robot is empty. Each robot must be back at its start by
        this time.
    recharge : float
        Time that a robot needs at its start to recharge its battery.

    Examples
    --------
    >>> from shoal.search import make_tour
    >>> tour_cost = TourCost(make_tour("moore", (8, 8)))
    >>> team = {"rates": np.ones(2), "places": tour_cost.points[[0, 30]], "widths": np.ones(2, dtype=np.int64)}
    >>> found = compared_allocations(tour_cost, np.array([0, 30]), ["hop", "stay"], **team)
    >>> [(allocation.allocator, time) for allocation, time in found]
    [('hop', 33.0), ('stay', 34.0)]
    """
    work = len(tour_cost) * len(starts)
    names = allocators if work <= (_COMPARED if widths.max() == 1 else _WIDE) else allocators[:1]
    allocations = [
        allocate(tour_cost, starts, allocator=name, rates=rates, places=places, widths=widths)
        for name in names
    ]
    times = [
        time_with_sorties(allocation, tour_cost, places, energy=energy, recharge=recharge)
        for allocation in allocations
    ]
    order = np.argsort(times, kind="stable")
    return [(allocations[k], times[k]) for k in order.tolist()]


def time_with_sorties(
    allocation: Allocation, tour_cost: TourCost, places: Floats, *, energy: float, recharge: float
) -> float:
    """Return the approximate time until all robots finish, including flights home to recharge; see
    `compared_allocations`.
    """
    if energy == inf:
        return allocation.makespan
    latest = 0.0
    for time, arcs, place in zip(allocation.times.tolist(), allocation.arcs, places, strict=True):
        cells = numbers_of(arcs, len(tour_cost))
        away = (
            float(np.linalg.norm(tour_cost.points[cells] - place, axis=1).mean())
            if len(cells)
            else 0.0
        )
        sorties = np.ceil(time / max(energy - 2 * away, 1.0)) - 1 if time + away > energy else 0.0
        latest = max(latest, time + float(sorties) * (2 * away + recharge))
    return latest


_TURNABLE: dict[str, type[SpanningTreeTour | CombTour]] = {
    "spanning-tree": SpanningTreeTour,
    "comb": CombTour,
}
"""Tours that can run along or across the rows of cells."""

STRAIGHT: dict[str, type[BoustrophedonTour | StripsTour]] = {
    "boustrophedon": BoustrophedonTour,
    "strips": StripsTour,
    "headland": HeadlandTour,
}
"""Tours of long straight rows, whose order depends on the cost of a turn."""

_STEP = 10.0  # degrees between compared angles, besides the angles of the outline's long sides
_SIDES = 3
_SHIFTS = (0.0, 0.25, 0.5, 0.75)  # shifts of the rows, relative to the width of a row
_PARALLEL = 0.5  # degrees between rows and sides of the outline along which rows may begin
_OTHER = 0.05  # shift from those of `_SHIFTS`, from which on another one is worth a look
_LONG = 3.0  # cells: length of such sides
_TRIED = 4  # number of orientations that are planned in full
_ROUGH = 12  # number of orientations, the best estimated ones, for which rough tours are made
_ROUGH_TOURS = ("boustrophedon", "strips")  # the path along a headland has other bends than cells
_ROUGH_DISTURBANCES = 20
_ROUGH_WORK = 4_000  # total number of cells of rough tours, which larger regions do without
_HOLLOW = 0.01  # of its area, by which the convex hull of a region with arms or holes is larger
_ARMED = 2  # so many times the rough and complete tours in such regions, of which rows tell less
_NEXT_BEST = 2  # number of angles by their estimates that are tried if a vehicle has no room
_ALL_AROUND = (0.0, 90.0)  # degrees: the angles that are tried then besides
_WORK = 200_000  # total number of cells that are planned in full, over all orientations
_CORNER = 5.0  # number of cells inside the region that take as long as one corner of its border
_BENT = 0.3  # bends at the end of a row where the border slants by less than 45 degrees to the row
_ROWS = 120  # maximum number of rows for an estimate


@dataclass(frozen=True, eq=False)
class GridTour:
    """A region divided into cells, and a tour through these cells.

    Parameters
    ----------
    grid : CellGrid or LayeredGrid
    tour : Tour
    paths : RegionPaths or LayeredPaths
    compared : tuple of Candidate
        The compared candidates, from the fastest to the slowest, or an empty tuple if the planner
        compared nothing.
    layers : tuple of GridTour
        The cells and the tour of each layer, if the search has several layers. Equal layers are one
        shared object.
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

    def once_round(self, turn_cost: float, reach: float = 0.0) -> float:
        """Return the cost, in cells, of one round of the tour: the length of the path plus the cost
        of its turns.

        The argument ``reach`` is that of `turn_shares`, for vehicles that pass gentle bends without
        a stop.
        """
        shares = turn_shares(self.route.points, reach=reach)
        return self.route.length / self.grid.size + turn_cost * float(shares.sum())


def grid_tour(
    region: SearchRegion,
    size: float,
    tour: str,
    *,
    angle: float,
    offset: float = 0.0,
    turn_cost: float = TURN_PRICES["time"],
    stepwise: bool = False,
    transit: bool = False,
    along_rows: bool | None = None,
) -> GridTour:
    """Divide a region into cells whose rows have a given angle, and compute a tour through these
    cells.

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
        Cost of a turn in cells.
    stepwise : bool
        Whether robots move only from a cell to a neighbouring cell. Such robots see each cell from
        a viewpoint inside the cell.
    transit : bool
        Whether paths may lead outside the region from one of its parts to another, as in
        `RegionPaths`.
    along_rows : bool, optional
        Direction of a tour that can run along or across the rows: true for along, and false for
        across. By default, the tour maker decides.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> grid_tour(open_region("rectangle:40x20"), 10, "boustrophedon", angle=90).grid
    <CellGrid 4x2, 8 cells of 10 m, 8 viewpoints>
    """
    grid = cells_of(region, size, angle=angle, offset=(0.0, offset))
    return _through(
        grid,
        tour,
        turn_cost=turn_cost,
        stepwise=stepwise,
        transit=transit,
        along_rows=along_rows,
    )


def _through(
    grid: CellGrid,
    tour: str,
    *,
    turn_cost: float,
    stepwise: bool,
    transit: bool,
    along_rows: bool | None,
    priced: Mapping[str, GridTour] = MappingProxyType({}),
) -> GridTour:
    """Compute a tour through the cells of a grid. The arguments are those of `grid_tour`.

    The argument ``priced`` gives known tours by name. If one of them visits the cells in the same
    order, along the same viewpoints, its path is known.
    """
    cell_tour = make_tour(_maker(tour, along_rows, turn_cost), grid.mask)
    for name, other in priced.items():
        if (name in STRAIGHT) == (tour in STRAIGHT) and np.array_equal(
            other.tour.cells, cell_tour.cells
        ):
            same = replace(other, tour=cell_tour)
            vars(same)["route"] = other.route
            return same
    if (
        tour in STRAIGHT and not stepwise and not isinstance(grid.lattice, LineLattice)
    ):  # long rows have few bends at their ends
        grid = along_tour(grid, cell_tour.cells, turn_cost)
    return GridTour(grid, cell_tour, RegionPaths(grid, transit=transit))


def _maker(name: str, along_rows: bool | None, turn: float) -> str | TourMaker:
    """Return a tour's name, or a tour maker for the direction ``along_rows`` if the tour can run
    along or across the rows, or for turns that cost ``turn`` cells.
    """
    if name in STRAIGHT:
        return STRAIGHT[name](turn)
    return name if along_rows is None or name not in _TURNABLE else _TURNABLE[name](along_rows)


def in_layers(
    first: GridTour,
    altitudes: Sequence[float],
    passes: int,
    sizes: Sequence[float],
    tour: str,
    *,
    climb: float,
    **options: Any,
) -> GridTour:
    """Divide a region into the cells of several layers, and compute one tour through all layers.

    A search with one altitude and one pass keeps the cells and the tour of ``first``.

    Parameters
    ----------
    first : GridTour
        The cells and the tour of the first pass in the lowest layer. All layers take over the
        region and the angle of ``first``.
    altitudes : sequence of float
        Altitudes of the search in metres, in increasing order.
    passes : int
        Number of passes at each altitude. In every second pass, the rows of cells are rotated by 90
        degrees.
    sizes : sequence of float
        Side of the cells at each altitude, in metres.
    tour : str
        Name of the tour for `make_tour`.
    climb : float
        The parameter ``climb`` of `LayeredGrid`.
    options
        The arguments ``turn_cost``, ``stepwise`` and ``transit`` of `grid_tour`.
    """
    if len(altitudes) * passes == 1:
        return first
    size, angle, area = sizes[0], first.grid.angle, first.paths.grid.region
    tour_of = {(size, angle): first}
    # so that the rows of the passes cross
    options |= {"along_rows": first.tour.runs_along_rows} if passes > 1 else {}
    layers: list[GridTour] = []
    for side in sizes:
        for number in range(passes):
            key = side, (angle + 90.0 * (number % 2)) % 180.0
            if key not in tour_of:
                tour_of[key] = grid_tour(area, side, tour, angle=key[1], **options)
            layers.append(tour_of[key])
    return through_layers(
        layers,
        np.repeat(np.asarray(altitudes, dtype=np.float64), passes),
        climb=climb,
        turn=options.get("turn_cost", 0.0),
        compared=first.compared,
    )


def through_layers(
    layers: Sequence[GridTour],
    altitudes: Floats,
    *,
    climb: float,
    turn: float,
    compared: tuple[Candidate, ...] = (),
) -> GridTour:
    """Join the tours of several layers at given altitudes in metres to one tour.

    The argument ``climb`` is that of `LayeredGrid`, and ``turn`` the cost of a turn in cells.
    """
    grids = tuple(layer.grid for layer in layers if not isinstance(layer.grid, LayeredGrid))
    grid = LayeredGrid(grids, altitudes, climb)
    points = [
        with_climb_cost(
            grid,
            at_altitude(
                cells.viewpoints[cells.viewpoint_starts[cells.ordinals(layer.tour.cells)]], altitude
            ),
        )
        / grid.size
        for cells, layer, altitude in zip(grids, layers, grid.altitudes.tolist(), strict=True)
    ]
    joined_tour = join_layers([layer.tour for layer in layers], points, turn=max(turn, TIE))
    paths = LayeredPaths(
        grid, [layer.paths for layer in layers if isinstance(layer.paths, RegionPaths)]
    )
    return GridTour(grid, joined_tour, paths, compared, tuple(layers))


def ranked_grid_tours(
    region: SearchRegion,
    size: float,
    tours: Sequence[str],
    *,
    turn_cost: float,
    reach: float = 0.0,
    angle: float | None = None,
    line: NDArray[np.float64] | None = None,
    stepwise: bool = False,
    transit: bool = False,
    along_rows: bool | None = None,
    cache: dict[Any, Any] | None = None,
) -> list[GridTour]:
    """Return the cells and the tours of all compared names, angles and shifts of the rows, that with
    the lowest cost of one round first. The first one knows the best candidate of each name.

    For each pair of an angle and a shift, the function estimates the cost of one round from the
    number and the lengths of the rows. In regions of up to 800 cells, it makes rough tours for up
    to twelve pairs with the lowest estimated cost. It computes complete tours only for the four best
    pairs, in small regions with arms or holes for the eight best ones, and in large regions or along
    borders of many corners for fewer pairs.

    Parameters
    ----------
    region : SearchRegion
    size : float
        Side of a cell in metres.
    tours : sequence of str
        Names of the tours to compare.
    turn_cost : float
        Cost of a turn in cells; see `SearchProblem.turn_price`.
    reach : float
        The argument of `turn_shares` in metres: 0 if each turn costs as much, however gentle.
    angle : float, optional
        Angle of the rows of cells in degrees. If an angle is given, the shift is 0, and the
        function compares only the tours.
    line : ndarray of float64, shape (k, 2), optional
        Line in metres that the rows follow, in place of an angle.
    stepwise, transit, along_rows
        Arguments of `grid_tour`.
    cache : dict, optional
        Cache of cells and of tours with their costs, for calls that differ in ``tours`` and
        ``turn_cost`` alone.
    """
    import shapely

    if line is not None:
        angle = 0.0
    cache = {} if cache is None else cache
    if turn_cost not in cache:
        # cells on the border take longer than cells inside, and a corner makes a cell of the border
        work = region.area_m2 / size**2 + _CORNER * shapely.get_num_coordinates(region.area)
        estimated = (
            [(angle, 0.0)] if angle is not None else _estimated(region.area, size, turn_cost)
        )
        # rough tours look at a simpler outline
        corners = int(shapely.get_num_coordinates(_simple_rings(region.area, size)).sum())
        rough_work = region.area_m2 / size**2 + _CORNER * corners
        hollow = region.area.convex_hull.area - region.area_m2 > _HOLLOW * region.area_m2
        rough_count = min(_ROUGH, int(_ROUGH_WORK * (_ARMED if hollow else 1) / rough_work))
        many = hollow and rough_count == _ROUGH
        complete_count = max(1, min(_TRIED * (_ARMED if many else 1), int(_WORK / work)))
        if angle is None and rough_count > complete_count:
            likeliest = estimated[:rough_count]
            estimated = _ranked_by_tours(
                region.area, size, tours, turn_cost, likeliest, complete_count, cache
            )
        cache[turn_cost] = estimated[:complete_count]
    priced = []
    choices = list(product(cache[turn_cost], tours))
    with one_by_one(choices, "tours") as each:
        for (direction, offset), tour in each:
            if (direction, offset) not in cache:
                cache[direction, offset] = (
                    cells_of(region, size, angle=direction, offset=(0.0, offset))
                    if line is None
                    else cells_along(region, size, line)
                )
            key = (direction, offset, turn_cost)
            if (*key, tour) not in cache:
                candidate = _through(
                    cache[direction, offset],
                    tour,
                    turn_cost=turn_cost,
                    stepwise=stepwise,
                    transit=transit,
                    along_rows=along_rows,
                    priced={
                        other: cache[*key, other][0] for other in tours if (*key, other) in cache
                    },
                )
                cache[*key, tour] = candidate, candidate.once_round(turn_cost, reach)
            priced.append(cache[*key, tour])
    ranked = sorted(priced, key=lambda pair: pair[1])
    compared = {
        candidate.tour.name: Candidate(
            candidate.tour.row_angle(candidate.grid.angle), candidate.tour.name, cost
        )
        for candidate, cost in reversed(ranked)
    }
    chosen_among = (
        sorted(compared.values(), key=lambda candidate: candidate.cells)
        if angle is None or len(tours) > 1
        else ()
    )
    best, *others = (candidate for candidate, _ in ranked)
    chosen: GridTour = replace(best, compared=tuple(chosen_among))
    vars(chosen)["route"] = best.route  # known already
    return [chosen, *others]


def _ranked_by_tours(
    area: Any,
    size: float,
    tours: Sequence[str],
    turn: float,
    orientations: list[tuple[float, float]],
    count: int,
    cache: dict[Any, Any],
) -> list[tuple[float, float]]:
    """Return ``count`` orientations to plan in full: the best estimated one, and those of the next
    ones with the best rough tours, from centre to centre of the cells.

    The number and the length of rows do not tell how far it is from one arm of a region to another.
    The argument ``cache`` is that of `ranked_grid_tours`.
    """
    import shapely

    makers = [STRAIGHT[name](turn, _ROUGH_DISTURBANCES) for name in tours if name in _ROUGH_TOURS]
    if not makers or count < 2:
        return orientations
    simple = shapely.simplify(area, size / 4)
    if not simple.is_valid or simple.is_empty:
        return orientations
    costs = []
    for angle, shift in orientations:
        if ("rough", angle, shift) not in cache:
            cache["rough", angle, shift] = _rough_cells(simple, size, angle, shift)
        mask = cache["rough", angle, shift]
        if not mask.any():
            return orientations
        costs.append(
            (
                min(_rough_cost(maker, mask, turn) for maker in makers),
                angle,
                shift,
            )
        )
    ranked = [(angle, shift) for _, angle, shift in sorted(costs)]
    return list(dict.fromkeys([orientations[0], *ranked]))[:count]


def _rough_cells(area: Any, size: float, angle: float, shift: float) -> NDArray[np.bool_]:
    """Return which cells of rows at an angle an area has, without those of which it has less than a
    fiftieth of a row: these are not worth one.
    """
    import shapely

    flat = rotate_shape(area, -angle)
    lattice = lattice_over(flat, size, angle, (0.0, shift))
    left, low, right, high = shapely.bounds(
        lattice.boxes(*np.indices(lattice.shape).reshape(2, -1))
    ).T
    border = size / 50
    boxes = shapely.box(left + border, low + border, right - border, high - border)
    shapely.prepare(flat)
    found: NDArray[np.bool_] = shapely.intersects(flat, boxes)
    return found.reshape(lattice.shape)


def _rough_cost(maker: TourMaker, mask: NDArray[np.bool_], turn: float) -> float:
    cells = make_tour(maker, mask).cells
    path = np.concatenate([cells, cells[:2]]).astype(np.float64)
    return float(leg_lengths(path[:-1]).sum()) + turn * float(turns_of(path).sum())


def longest_angle(area: Any) -> float:
    """Return the direction of the longer side of the smallest rectangle around an area, in degrees."""
    import shapely

    box = shapely.minimum_rotated_rectangle(area)
    sides = np.diff(shapely.get_coordinates(box)[:3], axis=0)
    x, y = sides[np.argmax(np.hypot(*sides.T))]
    return float(np.degrees(np.arctan2(y, x)) % 180.0)


def other_angles(region: SearchRegion, size: float, turn_cost: float) -> list[float]:
    """Return the angles of rows that are tried if no vehicle can fly at the best one: those with
    the lowest estimated cost of one round, and along both axes.

    The arguments are those of `ranked_grid_tours`.
    """
    estimated = _estimated(region.area, size, turn_cost)
    best = list(dict.fromkeys(angle for angle, _ in estimated))[:_NEXT_BEST]
    return list(dict.fromkeys([*best, *_ALL_AROUND]))


def _estimated(area: Any, size: float, turn: float) -> list[tuple[float, float]]:
    """Return pairs (angle, shift) for the rows of cells, sorted by the estimated cost of one round
    of a tour.
    """
    import shapely

    # A hole is a polygon too: a line passes from inside to outside at each crossing, whatever ring
    # it crosses.
    rings = _simple_rings(area, size)
    angles = {*np.arange(0.0, 180.0, _STEP).tolist(), *_long_sides(rings)}
    points, ring = shapely.get_coordinates(rings, return_index=True)
    sides_of_rings = np.flatnonzero(ring[1:] == ring[:-1])
    costs = []
    for angle in sorted(angles):
        flat = rotate(points, -angle)
        sides = flat[sides_of_rings], flat[sides_of_rings + 1]
        shifts = {*_SHIFTS, *_flush_shift(*sides, size)}
        costs += [(_cost_of_rows(*sides, size, turn, shift), angle, shift) for shift in shifts]
    return [(angle, shift) for _, angle, shift in sorted(costs)]


def _simple_rings(area: Any, size: float) -> Any:
    """Return the rings of an area without bends below a quarter of a cell. Ring by ring, this takes
    a time in proportion to their corners.
    """
    import shapely

    return shapely.simplify(shapely.get_rings(shapely.get_parts(area)), size / 4)


def _flush_shift(
    begins: NDArray[np.float64], ends: NDArray[np.float64], size: float
) -> list[float]:
    """Return the shift at which a row begins along the longest sides of an outline that are
    parallel to the rows, if there are such sides. The arguments are those of `_cost_of_rows`.
    """
    steps = ends - begins
    lengths = np.hypot(*steps.T)
    slope = np.tan(np.radians(_PARALLEL))
    flat = np.flatnonzero(
        (np.abs(steps[:, 1]) < slope * np.abs(steps[:, 0])) & (lengths > _LONG * size)
    )
    low, high = begins[:, 1].min(), begins[:, 1].max()
    rows = max(1, int(np.ceil((high - low) / size - 1e-9)))
    y = (begins[flat, 1] + ends[flat, 1]) / 2
    shifts = np.round(((y - (low + high) / 2) / size + rows / 2) % 1.0, 3) % 1.0
    shares: dict[float, float] = {}
    for shift, length in zip(shifts.tolist(), lengths[flat].tolist(), strict=True):
        shares[shift] = shares.get(shift, 0.0) + length
    best = sorted(shares, key=lambda shift: -shares[shift])[:1]
    return [shift for shift in best if abs((shift + 0.125) % 0.25 - 0.125) > _OTHER]


def _long_sides(rings: Any) -> list[float]:
    """Return angles in degrees from 0 to below 180: the directions of the longest sides of an
    outline with given rings, and perpendicular directions.
    """
    import shapely

    costs: dict[float, float] = {}
    for ring in rings:
        sides = np.diff(shapely.get_coordinates(ring), axis=0)
        directions = np.round(np.degrees(angles_of(sides)) % 90.0, 1)
        for direction, length in zip(directions.tolist(), np.hypot(*sides.T).tolist(), strict=True):
            costs[direction % 90.0] = costs.get(direction % 90.0, 0.0) + length
    best = sorted(costs, key=lambda direction: -costs[direction])[:_SIDES]
    return [direction + quarter for direction in best for quarter in (0.0, 90.0)]


def _cost_of_rows(
    begins: NDArray[np.float64], ends: NDArray[np.float64], size: float, turn: float, shift: float
) -> float:
    """Return the estimated cost, in cells, of driving along all rows of cells of an area with given
    sides, each from one of ``begins`` (n, 2) to one of ``ends``.

    The estimate is the sum of four terms: the lengths of all rows, the transfers between rows, two
    turns for each row, and `_BENT` bends at each end of a row where the border slants by less than
    45 degrees to the row. A transfer between two rows costs one row width, or more where the border
    slants.
    """
    low, high = begins[:, 1].min(), begins[:, 1].max()
    count = max(1, int(np.ceil((high - low) / size - 1e-9))) + (shift > 0)
    first = (low + high - count * size) / 2 + ((shift - 0.5) * size if shift > 0 else 0.0)
    sampled = min(count, _ROWS)
    chosen = ((np.arange(sampled) + 0.5) * count / sampled).astype(np.int64)
    # A row counts if it contains any part of the region. This is tested along its centre line and
    # near both of its sides.
    y = first + (chosen[:, None] + np.array([0.5, 0.02, 0.98])) * size
    runs, outer, far = (rows.reshape(*y.shape, -1) for rows in _chords(begins, ends, y.ravel()))
    slants = np.nan_to_num(np.abs(outer[:, 1] - outer[:, 2])) / size
    lengths = far.max(axis=(1, 2)) / size + slants.sum(axis=1) / 2
    links = np.hypot(1.0, slants).mean(axis=1) - 1.0
    bends = _BENT * (slants > 1.0).sum(axis=1)
    turns = 2.0 * runs.max(axis=(1, 2)) + bends
    return float((lengths + links + runs.max(axis=(1, 2)) + turn * turns).sum() * count / sampled)


def _chords(
    begins: NDArray[np.float64], ends: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return, for each horizontal line, the number of its sections in an area with given sides,
    their two outer ends (or NaN) and total length.
    """
    # each side is met by the lines from its lower end, without those at its upper end
    order = np.argsort(y, kind="stable")
    low, high = np.sort([begins[:, 1], ends[:, 1]], axis=0)
    first, last = (np.searchsorted(y[order], side) for side in (low, high))
    edge = np.repeat(np.arange(len(begins)), last - first)
    line = order[
        np.arange(len(edge)) + np.repeat(first - partial_sums(last - first)[:-1], last - first)
    ]
    (x, high), (far, low) = begins[edge].T, ends[edge].T
    crossed = x + (y[line] - high) * (far - x) / (low - high)
    order = np.lexsort((crossed, line))
    line, crossed = line[order], crossed[order]
    counts = np.bincount(line, minlength=len(y))
    first = np.cumsum(counts) - counts
    signs = np.where((np.arange(len(line)) - first[line]) % 2, 1.0, -1.0)
    outer: NDArray[np.float64] = np.full((len(y), 2), np.nan)
    outer[counts > 0] = np.stack(
        [crossed[first[counts > 0]], crossed[(first + counts - 1)[counts > 0]]], axis=1
    )
    return counts / 2, outer, np.bincount(line, crossed * signs, len(y)).astype(np.float64)
