"""The plan of a search: cells, tour, allocation, routes and flights."""

from __future__ import annotations

from bisect import insort
from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise
from math import inf
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer, check_kind
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums
from shoal.core.notices import listeners, tell_once
from shoal.search.allocation.allocate import (
    Allocation,
    Arc,
    allocate,
    approach_cost,
    in_passes,
    numbers_of,
    time_of,
)
from shoal.search.allocation.costs import TourCost
from shoal.search.allocation.viewpoints import select_viewpoints
from shoal.search.cells.distances import CellDistances, RegionDistances
from shoal.search.cells.footprint import RegionFootprint, cell_side, widths_of
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.lanes import LineLattice
from shoal.search.cells.layers import (
    Grid,
    LayeredDistances,
    LayeredFootprint,
    LayeredGrid,
    LayeredPaths,
    LayerNumbers,
    Paths,
    at_altitude,
    cells_of_layers,
    layers_of,
    plane_of,
    with_climb_cost,
)
from shoal.search.cells.routing import LaunchDistances, RegionPaths, Route, Transits
from shoal.search.cells.visibility_graph import leg_lengths
from shoal.search.flight.dubins import LINK, Airspace, NoRoomError, least_length
from shoal.search.flight.flight import Flight
from shoal.search.flight.legs import merge_straight_legs
from shoal.search.flight.sorties import Sorties
from shoal.search.flight.timing import (
    trajectory,
    turn_cells,
    turn_shares,
    turns_of,
    working_seconds,
)
from shoal.search.flight.vehicle import Vehicle
from shoal.search.planning.choosing import one_by_one
from shoal.search.planning.orientation import (
    Candidate,
    GridTour,
    compared_allocations,
    in_layers,
    longest_angle,
    other_angles,
    ranked_grid_tours,
    through_layers,
)
from shoal.search.problem import TOUR, TURN_PRICES, SearchProblem
from shoal.search.problem.prior import Prior
from shoal.search.problem.target import Ground, Looks, MovingGround, looks_from
from shoal.search.regions.coverage import (
    TURNING,
    UNSEEN,
    Image,
    check_footprints,
    coverage_check,
)
from shoal.search.regions.margin import grow, with_margin, without_margin
from shoal.search.regions.places import places_of, read_points
from shoal.search.regions.region import TOUCH, SearchRegion
from shoal.search.tours import Tour

LAYOUTS = ("random", "clustered", "line")
_CLUSTER = 0.05  # relative to the larger side: standard deviation of clustered starts


def start_points(problem: SearchProblem, grid: CellGrid, rng: Generator) -> Points:
    """Return the robots' start positions in metres; float64, shape (robots, 2).

    Parameters
    ----------
    problem : SearchProblem
        The problem, whose fields ``launch`` and ``starts`` define the start positions.
    grid : CellGrid
        The cells of the lowest layer.
    rng : Generator
        Generator of random numbers for the layouts ``random`` and ``clustered``.

    Raises
    ------
    InvalidInputError
        If a start position lies outside the region. Launch points may lie outside the region.
    """
    region, robots, starts = grid.region, problem.robots, problem.starts
    if problem.launch is not None:
        return places_of(problem.launch, region, robots, what="launch")
    if not isinstance(starts, str):
        return region.check_inside(starts, what="starts")
    if starts not in LAYOUTS:
        return region.check_inside(
            read_points(Path(starts), region, what="starts", count=robots), what=starts
        )
    middles = grid.waypoints()
    if starts == "random":
        return np.asarray(middles[rng.integers(0, len(middles), size=robots)])
    if starts == "clustered":
        middle = middles[rng.integers(len(middles))]
        spread = max(_CLUSTER * max(np.ptp(middles, axis=0)), grid.size)
        positions = middle + rng.normal(0, spread, size=(robots, 2))
    else:
        low, high = middles.min(axis=0), middles.max(axis=0)
        positions = np.column_stack([np.full(robots, low[0]), np.linspace(low[1], high[1], robots)])
    return np.asarray(
        middles[shapely.STRtree(shapely.points(middles)).nearest(shapely.points(positions))]
    )


Points = NDArray[np.float64]
SortieTimes = tuple[tuple[float, float], ...]
"""The start and the duration of each sortie of a robot, in seconds."""

Durations = tuple[tuple[float, float], ...] | InvalidInputError
"""The duration of each of a robot's flights, and what the climb of its return adds, in seconds; or, if
the robot cannot fly its path, the reason.
"""

MERGED = 0.001
"""Maximum distance in metres of an omitted point of a path from the straight leg that
replaces it.
"""

_NARROWER = 0.5
"""Margin that is tried for vehicles without room, as a share of the default margin."""

ALTERNATIVES = 2
"""Number of plans whose missions are compared with those of the fastest plan."""

_MEMORY = 1990  # waypoints: those of the larger autopilot
# cells times robots: above this, allocations and tours are compared by their costs in cells alone
_FLOWN = 3_000
_TEAM = 2.5  # price of the turns of all vehicles on average, relative to the price of turns
_PLANNED = 3  # number of tours that are planned in full, for each price of a turn, of any name
_LOOSE = 1e-3  # share of a route's time by which flights may be faster: they merge and cut corners
_NARROWED = 6  # number of compared widths of the rows of a camera
_LOOKED = 20_000  # cells: in larger plans, images are not compared with the region
_ROUNDED = 1e-9  # cells: rounding error of a number of cells
_MUCH_SLOWER = 1.2  # times as long as straight rows: along a line
_LITTLE = 1e-3  # share of a row for which another one is not worth while
_HOLLOW = 1e-9  # share of its area that a convex region may lack because of rounding


@dataclass(frozen=True, eq=False)
class SearchPlan:
    """The plan of a search: cells, tour, allocation and start positions.

    Parameters
    ----------
    grid : CellGrid or LayeredGrid
    tour_cost : TourCost
        The tour, and the cost of searching along the tour, in cells.
    places : ndarray of float64, shape (m, 2)
        Start positions of the robots in metres, inside or outside the region.
    starts : ndarray of int64, shape (m,)
        Tour index of each robot's start cell.
    rates : ndarray of float64, shape (m,)
        Speed of each robot, divided by the vehicle's speed.
    allocation : Allocation
    footprints : ndarray of float64, shape (m,)
        Side of each robot's square footprint in the lowest layer, in metres.
    transit : bool
        Whether paths may lead outside the region from one of its parts to another.
    landing : ndarray of float64, shape (m, 2), optional
        Landing positions of the robots in metres. By default, robots land at their start positions.
    vehicle : Vehicle
        Description of the vehicle. All robots have equal vehicles.
    delays : ndarray of float64, shape (m,)
        Delay of each robot's departure in seconds. By default, all robots depart at the same time.
    compared : tuple of Candidate
        The compared tours from the fastest to the slowest, and then the compared allocations from
        the fastest to the slowest, of vehicles those that were flown: a plan is not flown if its
        route alone takes longer than the best. The tuple is empty if the planner compared nothing.
    stay_inside : bool
        Whether paths between the region and launch or landing points outside it cross the border of
        the region only once, at the place nearest to the point.
    flies : bool
        Whether the problem names a vehicle. If so, times are those of the vehicles' flights, from
        the start of the search until the last vehicle is back on the ground, and otherwise the
        times of the search alone.
    ending : "return", "land" or "loiter", optional
        Ending of all flights, if missions determine it. By default, that of missions with the
        default options; see `flight_ending`.
    schedule : tuple of tuple of (float, float), optional
        For each robot, the start time and the duration of each sortie in seconds, if missions with
        altitude layers and staggered starts determine them. By default, each robot starts after its
        delay, and again as soon as it is back and recharged.
    image : Image, optional
        Image of the vehicles' camera. By default, robots see squares along the rows of cells.
    reach : float
        Metres that images lack at the ends of paths for the reserve that they have beside rows.
        Vehicles fly so much beyond their first and their last cell, but not fixed wings, which would
        fly other curves. At bends, images of the next leg see what lacks.
    airspace : Airspace
        Where vehicles may fly, with the known curves of fixed wings, which all compared plans and
        the missions share.
    ground : Ground or MovingGround, optional
        Where the target of a prior may be.
    prior_inside : float
        Probability that the target of a prior is in the area of the region.
    prior_before : float
        Probability with which earlier looks along tracks would have found the target.
    plain : SearchPlan, optional
        The plan without the prior and without delays, or None without a prior.
    alternatives : tuple of SearchPlan
        The next best of the compared plans, which may be better once vehicles are kept apart.
    flown : dict
        Cache of the durations of flights, which all compared allocations of one tour share.
    """

    grid: Grid
    tour_cost: TourCost
    places: Points
    starts: NDArray[np.int64]
    rates: NDArray[np.float64]
    allocation: Allocation
    footprints: NDArray[np.float64]
    transit: bool = False
    landing: Points | None = None
    vehicle: Vehicle = Vehicle(preset="ideal")
    delays: NDArray[np.float64] = None  # type: ignore[assignment]  # settled below
    compared: tuple[Candidate, ...] = ()
    stay_inside: bool = False
    flies: bool = False
    ending: str | None = None
    schedule: tuple[SortieTimes, ...] | None = None
    image: Image | None = None
    reach: float = 0.0
    airspace: Airspace = field(default=None, repr=False)  # type: ignore[assignment]  # settled below
    ground: Ground | MovingGround | None = field(default=None, repr=False)
    prior_inside: float = 1.0
    prior_before: float = 0.0
    plain: SearchPlan | None = field(default=None, repr=False)
    alternatives: tuple[SearchPlan, ...] = field(default=(), repr=False)
    flown: dict[Any, Durations] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if self.delays is None:
            object.__setattr__(self, "delays", np.zeros(len(self.places)))
        if self.airspace is None:
            region = self.grid.region
            cache = region.for_paths  # all plans of the region share it
            if "blocked" not in cache:
                cache["blocked"] = grow(region.no_go, region.margin)
            blocked = cache["blocked"]
            object.__setattr__(self, "airspace", Airspace(blocked, free=region.free))

    @property
    def tour(self) -> Tour:
        """The tour through all cells."""
        return self.tour_cost.tour

    @property
    def layer_tours(self) -> tuple[Tour, ...]:
        """The tour of each layer, from the lowest layer to the highest."""
        footprint = self.tour_cost.footprint
        return footprint.numbers.layers if isinstance(footprint, LayeredFootprint) else (self.tour,)

    @property
    def row_angle(self) -> float:
        """Direction in degrees in which most of the tour's length in the lowest layer runs; see
        `Tour.row_angle`.
        """
        return self.tour.row_angle(self.grid.angle, 0)

    @property
    def facing(self) -> float | str:
        """Angle of the footprints' sides in degrees, or `TURNING` along a line."""
        return (
            TURNING if isinstance(layers_of(self.grid)[0].lattice, LineLattice) else self.grid.angle
        )

    @property
    def plain_seconds(self) -> float | None:
        """Planned time in seconds without the prior and without delays, or None without a prior."""
        return None if self.plain is None else self.plain.planned_seconds

    @property
    def cell_seconds(self) -> float:
        """Time in seconds that a robot of speed 1 needs for one cell, as the mean over both
        directions of a row.
        """
        return self.grid.size / self.vehicle.mean_speed(self.row_angle)

    def seconds(self, cells: float) -> float:
        """Convert a search time in cells to seconds, and add the time of the climb from the ground
        to the lowest layer.
        """
        return cells * self.cell_seconds + float(self.vehicle.vertical_seconds(self.vehicle.height))

    def cells(self, seconds: float) -> float:
        """Convert a time in seconds to a search time in cells, as the inverse of `seconds`."""
        return (seconds - self.seconds(0.0)) / self.cell_seconds

    @cached_property
    def sorties(self) -> tuple[SortieTimes, ...]:
        """For each robot, the start time and the duration of each of its sorties, in seconds."""
        if self.schedule is not None:
            return self.schedule
        times = self.allocation.times - self.delays / self.cell_seconds
        return tuple(
            self.sorties_along(robot, self.stops(robot), cells=float(cells))
            for robot, cells in enumerate(times.tolist())
        )

    @cached_property
    def refusal(self) -> InvalidInputError | None:
        """The reason why a vehicle cannot fly its path, or None if all vehicles can.

        A battery may be too small, or there may be no room for a turn.
        """
        if not self.flies or self.schedule is not None:
            return None
        durations = (
            self._durations(robot, stops)
            for robot in range(len(self.places))
            if len(stops := self.stops(robot))
        )
        return next((duration for duration in durations if not isinstance(duration, tuple)), None)

    @cached_property
    def flight_ending(self) -> str:
        """How all flights end. By default, as missions with the default options: multirotors land,
        rovers return, and fixed wings loiter, or land if they have landing points or if one of them
        flies several sorties.
        """
        if self.ending is not None:
            return self.ending
        if self.landing is not None or self.vehicle.kind == "multirotor":
            return "land"
        if not self.vehicle.radius:
            return "return"
        loitering = replace(self, ending="loiter")
        for robot in np.argsort(-self.allocation.times, kind="stable").tolist():
            if len(stops := self.stops(robot)):
                own = loitering._durations(robot, stops)
                if isinstance(own, tuple) and len(own) > 1:
                    return "land"
        return "loiter"

    def _durations(
        self, robot: int, stops: ArrayLike, detours: Sequence[Sequence[int]] = ()
    ) -> Durations:
        """Return the `Durations` of a robot's flights."""
        landing = None if self.landing is None else self.landing[robot].tobytes()
        place = self.places[robot].tobytes()
        own = (self.rates[robot], self.footprints[robot], place, landing, self.flight_ending)
        key = (robot, self.vehicle, own, np.asarray(stops).tobytes(), tuple(map(tuple, detours)))
        if key not in self.flown:
            try:
                sorties = self.flown_sorties(robot, stops, detours)
                seconds = [flight.duration for flight in sorties.trajectories()]
                self.flown[key] = tuple(zip(seconds, sorties.returns(), strict=True))
            except InvalidInputError as error:
                self.flown[key] = error.with_traceback(None)
        return self.flown[key]

    def sorties_along(
        self,
        robot: int,
        stops: ArrayLike,
        detours: Sequence[Sequence[int]] = (),
        *,
        cells: float = 0.0,
    ) -> SortieTimes:
        """Return the start time and the duration of each sortie in which robot ``robot`` (counted
        from 0) makes the given stops.

        If the vehicle cannot fly the path, because its battery is too small or it has no room for a
        turn, the duration is that of ``cells`` cells. A return begins with a climb, after which the
        next sortie starts.
        """
        start, sorties = float(self.delays[robot]), []
        if not len(np.asarray(stops)):
            return ()
        durations = self._durations(robot, stops, detours)
        flights = durations if isinstance(durations, tuple) else ((self.seconds(cells), 0.0),)
        for seconds, climb in flights:
            sorties.append((start, seconds))
            start += seconds + climb + self.vehicle.recharge_seconds
        return tuple(sorties)

    def flown_sorties(
        self, robot: int, stops: ArrayLike, detours: Sequence[Sequence[int]] = ()
    ) -> Sorties:
        """Return the flights of a robot, as its missions contain them: out, along the stops, and
        home, with turns and climbs.
        """
        out, route = self.flown_route(robot, stops, detours)
        ending = self.flight_ending
        landing = self.places if ending == "land" and self.landing is None else self.landing
        flight = Flight(
            self.vehicle,
            self.places[robot],
            landing=None if landing is None else landing[robot],
            ending=ending,
            airspace=self.airspace,
            rate=float(self.rates[robot]),
            link=float(self.footprints[robot]) * LINK,
        )
        approach, search_path = (
            merge_straight_legs(route[: out + 1], MERGED)[:-1],
            merge_straight_legs(route[out:], MERGED),
        )
        return Sorties(
            np.vstack([approach, search_path]), flight, _MEMORY, self.leg, robot + 1, len(approach)
        )

    def flown_route(
        self, robot: int, stops: ArrayLike, detours: Sequence[Sequence[int]] = ()
    ) -> tuple[int, Points]:
        """Return the path that a robot flies along the given stops, without its home, and the
        number of points on the way out.
        """
        route = self.route(robot, stops, detours)
        out = int(route.stops[1])
        begin = min(1, out)
        # without home, above which it climbs anyway
        return out - begin, self._reach_ends(route.points, out)[begin:]

    def _reach_ends(self, points: Points, out: int) -> Points:
        """Return a path whose search, which begins at the point ``out``, reaches beyond both ends by
        ``reach``, where the region has room.
        """
        if not self.reach or self.vehicle.radius or len(points) < out + 2:
            return points
        points, free = points.copy(), self.grid.region.free
        shapely.prepare(free)
        for end, inner, way in (
            (out, out + 1, points[max(out - 1, 0) : out]),
            (-1, -2, points[:0]),
        ):
            ahead = points[end, :2] - points[inner, :2]
            length = float(np.hypot(*ahead))
            if length:
                beyond = points[end, :2] + self.reach / length * ahead
                around = np.vstack([way[:, :2], beyond, points[inner, :2]])
                if free.covers(shapely.linestrings(around)):
                    points[end, :2] = beyond
        return points

    @property
    def planned_seconds(self) -> float:
        """Time of the whole search in seconds: until the last vehicle is back or, without a
        vehicle, until all is searched.
        """
        if not self.flies:
            return self.seconds(self.allocation.makespan)
        return max((end_of(sorties) for sorties in self.sorties), default=0.0)

    @cached_property
    def least_seconds(self) -> float:
        """Lower bound in seconds on the duration of the search, for any cells, tour and allocation.

        Let A be the area that robots must see, s_r the side of the square footprint of robot r and
        v_r its speed. A square that moves by a distance l newly covers at most sqrt(2) s_r l, and
        covers s_r^2 before it moves. Therefore A <= sum_r (s_r^2 + sqrt(2) s_r v_r t) in a time t.
        Along a line across a part of the region, robot r sees at most its way along the line and
        the diagonal of its footprint. Of a vehicle that returns to its start, only half of the
        flight leads away from it. So L <= sum_r (sqrt(2) s_r + v_r t / h), for the length L of the
        part along the line, and h = 2 if vehicles return to their starts, or else 1. The farthest
        point of the region takes h times the way from the nearest robot, up to s_r / sqrt(2).
        Without a vehicle, each stop also takes at least the time of one cell, and a robot sees at
        most w_r^2 cells from one stop, where w_r is the width of its footprint in cells.
        """
        n = len(self.tour_cost)
        visits = sum(arc.count for work in self.allocation.work for arc in work) / n
        layers = layers_of(self.grid)
        areas = np.array([layer.region.area_m2 for layer in layers])
        sides = np.array([layer.size for layer in layers])
        # A path from layer to layer sees no more of one layer than its projection to this layer.
        footprints = self.footprints * (sides / sides[0])[:, None]
        fastest = self.rates * (
            self.vehicle.cruise if self.flies else self.grid.size / self.cell_seconds
        ) + (self.vehicle.wind if self.flies else 0.0)
        beyond = visits * areas - (footprints**2).sum(axis=1)
        moving = max(0.0, float((beyond / (2**0.5 * footprints @ fastest)).max()))
        returns = 2.0 if self.flies and self.landing is None else 1.0
        beyond_ends = self._longest_extent - 2**0.5 * float(self._widest_views.sum())
        moving = max(
            moving, returns * beyond_ends / float(fastest.sum()), returns * self._far(fastest)
        )
        climb = self.seconds(0.0)
        if self.flies:  # fixed wings may climb on their way
            return max(moving, climb) if self.vehicle.radius else moving + climb
        cells = min(float(n), float(np.ceil(areas / sides**2 - _ROUNDED).sum()))
        stopping = visits * cells / float(self.rates @ self.widths.astype(np.float64) ** 2)
        return max(moving + climb, self.seconds(stopping))

    @property
    def _widest_views(self) -> NDArray[np.float64]:
        """Longest side of what each robot sees at once, in metres, in any layer."""
        sides = np.array([layer.size for layer in layers_of(self.grid)])
        longest = 1.0 if self.image is None else max(1.0, self.image.across, self.image.along)
        return np.asarray(self.footprints * longest * float(sides.max() / sides[0]))

    @property
    def _longest_extent(self) -> float:
        """Length in metres of the part of the region that is longest along one line."""
        parts = shapely.get_parts([layer.region.area for layer in layers_of(self.grid)])
        return max(
            float(leg_lengths(shapely.get_coordinates(box)).max())
            for box in shapely.minimum_rotated_rectangle(parts)
        )

    def _far(self, speeds: NDArray[np.float64]) -> float:
        """Return the shortest time in seconds in which a robot sees the farthest point of the
        region.
        """
        shape = shapely.union_all([layer.region.area for layer in layers_of(self.grid)])
        corners = shapely.get_coordinates(shape.convex_hull)
        distances = (
            np.linalg.norm(corners[:, None] - self.places[None], axis=2)
            - self._widest_views / 2**0.5
        )
        return float((distances / speeds).min(axis=1).max())

    @cached_property
    def paths(self) -> Paths:
        """The object that computes paths inside the region."""
        paths_of = {
            layer: RegionPaths(layer, transit=self.transit) for layer in layers_of(self.grid)
        }
        paths = [paths_of[layer] for layer in layers_of(self.grid)]
        return paths[0] if isinstance(self.grid, CellGrid) else LayeredPaths(self.grid, paths)

    @cached_property
    def widths(self) -> NDArray[np.int64]:
        """Effective width of each robot's footprint in cells, as in `widths_of`; int64,
        shape (m,).
        """
        return widths_of(self.footprints, layers_of(self.grid)[0].size)

    def positions(self, numbers: ArrayLike) -> Points:
        """Return the first viewpoint of each cell with the given tour indices, as (x, y) or (x, y,
        altitude) in metres.
        """
        index = self.grid.ordinals(self.tour.cells[np.asarray(numbers, dtype=np.int64)])
        return np.asarray(self.grid.viewpoints[self.grid.viewpoint_starts[index]])

    def leg_lengths(self, path: Points) -> NDArray[np.float64]:
        """Return the lengths of a path's legs in metres; float64, shape (k - 1,).

        The length of a climb is the length of a horizontal path of the same duration.
        """
        return leg_lengths(with_climb_cost(self.grid, path))

    @property
    def altitudes(self) -> list[float]:
        """Altitude of each layer in metres, from the lowest layer to the highest."""
        return (
            [self.vehicle.height]
            if isinstance(self.grid, CellGrid)
            else self.grid.altitudes.tolist()
        )

    def _home(self, robot: int) -> Points:
        """Return a robot's start position, at the altitude of the lowest layer if the search has
        several layers.
        """
        home = self.places[robot]
        return np.asarray(
            home
            if isinstance(self.grid, CellGrid)
            else at_altitude(home[None], self.altitudes[0])[0]
        )

    def numbers(self, arcs: Sequence[Arc]) -> NDArray[np.int64]:
        """Return the cells of arcs in the order of the search, as tour indices; int64,
        shape (k,).
        """
        return numbers_of(arcs, len(self.tour_cost))

    def stops(self, robot: int) -> NDArray[np.int64]:
        """Return the stops from which robot number ``robot`` (counted from 0) sees its part, as
        tour indices; int64, shape (k,).
        """
        cells = self.numbers(self.allocation.work[robot])
        width = int(self.widths[robot])
        return (
            cells
            if width == 1 or not len(cells)
            else select_viewpoints(self.tour_cost, width, cells)[0]
        )

    def visible_cells(self, robot: int, stops: ArrayLike) -> list[NDArray[np.int64]]:
        """Return the cells that robot number ``robot`` (counted from 0) sees from each of its
        stops, as tour indices.
        """
        width = int(self.widths[robot])
        return [self.tour_cost.visible_cells(int(stop), width) for stop in np.asarray(stops)]

    def times_by_cost(self, robot: int, stops: ArrayLike) -> NDArray[np.float64]:
        """Return when robot number ``robot`` (counted from 0) is at each of its stops, in seconds, by
        the costs of cells; float64, shape (k,). Times of vehicles are in proportion to those of the
        whole plan.
        """
        numbers = np.asarray(stops, dtype=np.int64).tolist()
        if not numbers:
            return np.zeros(0)
        cost, start = self.tour_cost, int(self.starts[robot])
        costs = [approach_cost(cost, numbers[0], cost.points[start], start)]
        costs += [cost.move_cost(source, target) for source, target in pairwise(numbers)]
        cells = np.cumsum(np.array(costs) + 1.0) / self.rates[robot] + _lateness(
            self, robot, numbers[0]
        )
        if self.flies:
            return np.asarray(cells * (self.planned_seconds / self.allocation.makespan))
        return np.asarray(self.seconds(0.0) + cells * self.cell_seconds)

    def route(self, robot: int, numbers: ArrayLike, detours: Sequence[Sequence[int]] = ()) -> Route:
        """Return the path of robot ``robot`` (counted from 0) from its start through the cells with
        the given tour indices.

        The argument ``detours`` lists, for each given cell, the cells that the robot crosses on its
        way to the given cell.
        """
        if any(detours):
            return self._route_with_detours(robot, np.asarray(numbers, dtype=np.int64), detours)
        cells = self.tour.cells[np.asarray(numbers, dtype=np.int64)]
        home = self._home(robot)
        if not len(cells):
            return Route(
                home[None].copy(), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.bool_)
            )
        return self._with_approach(home, self.paths.route(cells))

    def _with_approach(self, home: Points, searched: Route) -> Route:
        """Return a route extended at its beginning by the path from a robot's start position."""
        if self.grid.region.contains(home[None, :2])[0]:
            first = self.paths.legs(np.stack([home, searched.points[0]]))
        else:
            path = self._path_in(home[:2], searched.points[0, :2])
            if len(home) == 3:  # climb above home to the first cell's altitude, and then fly level
                path = np.vstack([home, at_altitude(path, searched.points[0, 2])])
            first = Route(
                path, np.array([0, len(path) - 1]), np.ones(len(path) - 1, dtype=np.bool_)
            )
        return Route(
            np.concatenate([first.points[:-1], searched.points]),
            np.concatenate([[0], searched.stops + len(first.points) - 1]),
            np.concatenate([first.transit, searched.transit]),
        )

    @cached_property
    def _transits(self) -> Transits:
        return Transits(self.grid.region, self.places, self.landing)

    @cached_property
    def launch_distances(self) -> LaunchDistances | None:
        """Distances from launch points outside the region to the cells, or None if all robots start
        inside the region.
        """
        outside = np.flatnonzero(~self.grid.region.contains(self.places)).tolist()
        if not outside:
            return None
        launches = {robot + 1: self.places[robot] for robot in outside}
        return LaunchDistances(
            self._path_in, launches, self.tour_cost.points * self.grid.size, self.grid.size
        )

    def leg(self, start: ArrayLike, end: ArrayLike) -> Points:
        """Return the path between a launch or landing point and a point of a route, in either
        direction; float64, shape (k, 2).

        If both end points lie inside the region, the path stays inside the region.
        """
        ends = np.stack([np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)])[
            :, :2
        ]
        inside = bool(self.grid.region.contains(ends).all())
        if inside:
            return self.paths.legs(ends).points[:, :2]
        return (
            self._path_in(*ends)
            if not self.grid.region.contains(ends[:1])[0]
            else self._path_in(*ends[::-1])[::-1]
        )

    def _path_in(self, place: Points, stop: Points) -> Points:
        """Return the path from a place outside the region to a point, in metres; float64, shape (k,
        2).
        """
        if not (self.stay_inside and self.grid.region.contains(stop[None])[0]):
            return self._transits.path(place, stop)
        part = min(
            self.grid.region.parts,
            key=lambda polygon: float(polygon.distance(shapely.points(stop))),
        )
        entry = shapely.get_coordinates(shapely.shortest_line(part, shapely.points(place)))[0]
        return np.vstack(
            [self._transits.path(place, entry)[:-1], self._inner_paths.leg(entry, stop)]
        )

    @cached_property
    def _inner_paths(self) -> RegionPaths:
        return RegionPaths(layers_of(self.grid)[0])

    def outside_lengths(self, robot: int) -> tuple[float, float]:
        """Return the length of a robot's paths outside the region, in metres: from its launch
        point, and to its landing point.

        The landing point is the launch point, unless the plan has landing points. The paths of a
        fixed wing are those that it flies, with its turns and circles.
        """
        stops = self.stops(robot)
        if not len(stops):
            return 0.0, 0.0
        if self.vehicle.radius and isinstance(self._durations(robot, stops), tuple):
            flights = self.flown_sorties(robot, stops).searching()
            (first, begin, _), (last, _, end) = flights[0], flights[-1]
            # a climb may end outside, beyond the place where the search begins
            out = self._until_inside(first.points, int((first.times <= begin).sum()))
            back = self._until_inside(last.points[::-1], int((last.times >= end).sum()))
            return self._length_outside(out), self._length_outside(back)
        end = self.places[robot] if self.landing is None else self.landing[robot]
        first, last = self.positions(stops[[0, -1]])[:, :2]
        return self._outside_length(self.places[robot], first), self._outside_length(last, end)

    def _outside_length(self, start: Points, end: Points) -> float:
        """Return the length of the path of `leg` outside the region, in metres."""
        if not self.transit and self.grid.region.contains([start, end]).all():
            return 0.0
        return self._length_outside(self.leg(start, end))

    def _until_inside(self, path: Points, count: int) -> Points:
        """Return the first ``count`` points of a path, or more until the path is in the region."""
        inside = shapely.intersects_xy(self._allowed, *path[:, :2].T)
        inside[: max(count - 1, 0)] = False
        return path[: int(np.argmax(inside)) + 1] if inside.any() else path

    def _length_outside(self, path: Points) -> float:
        """Return the length of a path outside the region, in metres."""
        if len(path) < 2:
            return 0.0
        # leg by leg: where a line crosses itself, a difference counts one of the two
        legs = np.stack([path[:-1, :2], path[1:, :2]], axis=1)
        outside = shapely.difference(shapely.linestrings(legs), self._allowed)
        return float(shapely.length(outside).sum())

    @cached_property
    def _allowed(self) -> Any:
        return self.grid.region.outline.buffer(TOUCH)

    def _route_with_detours(
        self, robot: int, numbers: NDArray[np.int64], detours: Sequence[Sequence[int]]
    ) -> Route:
        grid = self.grid
        index = grid.ordinals(self.tour.cells)
        begins, ends = grid.viewpoint_starts[index], grid.viewpoint_starts[index + 1]
        stops = []
        for cell, passed in zip(numbers.tolist(), detours, strict=True):
            stops += [
                grid.viewpoints[begins[list(passed)]],
                grid.viewpoints[begins[cell] : ends[cell]],
            ]
        return self._with_approach(self._home(robot), self.paths.legs(np.concatenate(stops)))


def end_of(sorties: SortieTimes) -> float:
    """Return the time in seconds at which a robot is back from its last sortie, or 0 for a robot
    without sorties.
    """
    return max((start + duration for start, duration in sorties), default=0.0)


def plan_search(problem: SearchProblem, *, seed: int = 0) -> SearchPlan:
    """Plan the search that a problem describes.

    Parameters
    ----------
    problem : SearchProblem
        The search problem. If the robots' footprints differ, `cell_side` chooses the cell size, and
        `widths_of` gives the footprint widths in cells.
    seed : int
        Seed for random start positions.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If the robots cannot search the region as the problem demands.

    Examples
    --------
    >>> plan = plan_search(SearchProblem("square:100", robots=4, footprint=10), seed=1)
    >>> len(plan.tour_cost), plan.allocation.makespan >= 100 / 4
    (100, True)
    """
    check_kind(problem, SearchProblem, what="problem")
    region: SearchRegion = problem.place
    first = None
    for rotated_rows, margin in attempts(problem, region.margin):
        try:
            if margin < region.margin:
                narrow_region = with_margin(
                    without_margin(region), margin, barriers=region.barriers, pointed=region.pointed
                )
                attempt = problem.replaced(margin=margin).at_place(narrow_region)
            else:
                attempt = problem
            plan = plan_at_margin(attempt, seed, rotated_rows=rotated_rows)
        except InvalidInputError:
            if first is None:
                raise
            continue
        if not isinstance(plan.refusal, NoRoomError):
            if margin < region.margin:
                tell_once(narrower_margin_text(margin, region.margin))
            tell_if_straight_rows_are_faster(plan, attempt, seed)
            _tell_if_a_row_is_for_little(plan, problem)
            return _report_refusal(plan)
        first = plan if first is None else first
    assert first is not None
    return _report_refusal(first)


_TRIES = 6  # of a price of breaks
_DEARER = 0.2  # share by which the price rises at least
_LOOKS = 5  # at one cell at most
# shares of the time of the plan, after which a target that moves is where robots look first
_LATER = (0.0, 0.02, 0.04, 0.06, 0.08, 0.11, 0.15, 0.2)
_THINNED = 4  # of so many particles, planning follows one
_ROUNDS = 4  # of mixing these probabilities with those at the times of the looks
# shares of the time beyond that of the plan without a prior, that second looks may take
_REVISITS = (0.15, 0.3, 0.45, 0.6, 0.75)


def _with_prior(plan: SearchPlan, problem: SearchProblem) -> SearchPlan:
    """Return a plan in which robots search the cells early that are likely by the prior of the
    problem, along the same tour, and some of them again if a search may miss the target.

    The planned time is at most `SearchProblem.longest_order` times as long.
    """
    prior = problem.open_prior()
    if prior is None:
        return plan
    informed = _with_prior_odds(plan, problem, prior)
    ground = informed.ground
    informed = replace(informed, plain=plan, alternatives=(), flown={})
    if problem.order == TOUR:
        return informed
    if isinstance(ground, MovingGround):
        rough = _with_future_odds(replace(informed, ground=ground.thinned(_THINNED)), problem)
        informed = replace(rough, ground=ground)
    layouts = [informed]
    if 0 < problem.chosen_detection < 1:
        budget = (problem.longest_order - 1.0) * plan.tour_cost.least
        more = [_with_revisits(informed, round(share * budget), problem) for share in _REVISITS]
        layouts += [layout for layout in more if layout is not None]
    if len(layouts) > 1:
        layouts = _by_expected_time(layouts, informed, problem)
    for layout in layouts:
        ordered = _in_likely_order(layout, informed, problem)
        if ordered is not None:
            return ordered
    tell_once(
        "prior: robots search in the order of the plan without it, because no other order that was"
        f" tried takes at most {problem.longest_order:g} times as long; --at-most sets another limit"
    )
    return informed


def with_prior_odds(plan: SearchPlan, problem: SearchProblem) -> SearchPlan:
    """Return a plan that knows where the target of the problem's prior may be, with its own order
    of cells.
    """
    prior = problem.open_prior()
    return plan if prior is None else _with_prior_odds(plan, problem, prior)


def _with_prior_odds(plan: SearchPlan, problem: SearchProblem, prior: Prior) -> SearchPlan:
    ground: Ground | MovingGround
    if problem.moves:
        ground, inside = prior.moving(plan.grid, plan.tour, problem.drift or (0.0, 0.0, 0.0))
        standing, before = ground.still(0.0), 0.0
    else:
        ground, inside, before = prior.ground(plan.grid, plan.tour)
        standing = ground
    odds = standing.shares(len(plan.tour), _detection(problem))
    return replace(
        plan,
        tour_cost=replace(plan.tour_cost, odds=odds, at_most=0.0),
        ground=ground,
        prior_inside=inside,
        prior_before=before,
        flown={},
    )


def _detection(problem: SearchProblem) -> float:
    """Return the probability that a search of a cell finds a target there, by all robots that must
    search the cell.
    """
    return 1.0 - (1.0 - problem.chosen_detection) ** problem.multiplicity


def _by_expected_time(
    layouts: Sequence[SearchPlan], plain: SearchPlan, problem: SearchProblem
) -> list[SearchPlan]:
    """Return plans with different numbers of second looks, the best first, as far as orders tell
    that are quickly found.
    """
    times: list[float] = []
    for layout in layouts:
        rough = replace(layout, tour_cost=replace(layout.tour_cost, thorough=False))
        ordered = _in_likely_order(rough, plain, problem)
        times.append(inf if ordered is None else _expected_time(ordered, problem))
    return [layouts[k] for k in np.argsort(times, kind="stable").tolist()]


def _in_likely_order(
    plan: SearchPlan, plain: SearchPlan, problem: SearchProblem
) -> SearchPlan | None:
    """Return a plan whose robots search likely cells early, or None if no order that was tried
    keeps the limit beside the plain plan.

    Where a robot leaves the tour, vehicles need more time for their turns than the cost in cells
    tells: what they need more is then counted for each such break of the tour, as long as the plan
    does not keep the limit, or finds the target earlier for it.
    """
    limit, price = problem.longest_order, 0.0
    best: SearchPlan | None = None
    earliest = inf
    least = plan.allocation.makespan / plain.allocation.makespan
    for _ in range(_TRIES):
        cost = replace(plan.tour_cost, at_most=max(limit / least, 1e-9), break_cost=price)
        along = replace(plan, tour_cost=cost)
        trial = _reallocate(along, plan.allocation, problem, plan.allocation.arcs)
        seconds, refused = trial.planned_seconds, trial.refusal is not None
        if seconds <= limit * plain.planned_seconds * (1 + 1e-9) and (
            not refused or plain.refusal is not None
        ):
            if not trial.flies:
                return trial
            time = _expected_time(trial, problem)
            if time >= earliest:
                break
            best, earliest = trial, time
        # what the time by cells leaves out, for each break of the tour
        beyond = seconds / plain.planned_seconds
        beyond -= trial.allocation.makespan / plain.allocation.makespan
        breaks = max(len(work) for work in trial.allocation.work)
        dearer = beyond * plain.allocation.makespan / breaks
        if best is not None and dearer <= _DEARER * price:
            break
        price += max(dearer, _DEARER * (price + 1.0))
    return best


def _with_revisits(plan: SearchPlan, cells: int, problem: SearchProblem) -> SearchPlan | None:
    """Return a plan in which robots search some cells once more, where further looks find the target
    most probably in the time of so many of the smallest cells, or None if there are none.

    Further looks are layers of their own, which hold some of the cells of another layer at the same
    altitude. Where several layers show the same ground, it is that with the widest cells.
    """
    layers, ground = layers_of(plan.grid), plan.ground
    assert plan.tour_cost.odds is not None
    assert ground is not None
    own = plan.tour.cells[:, 0] if len(layers) > 1 else np.zeros(len(plan.tour), dtype=np.int64)
    pieces = ground if isinstance(ground, Ground) else _pieces(plan.tour_cost.odds, own)
    again = _cells_of_revisits(plan, pieces, own)
    # probability, per time of a cell, that the look after all others finds the target
    missed = (1.0 - _detection(problem)) ** (
        np.arange(_LOOKS - 1)[:, None] + (pieces.cells >= 0).sum(axis=1)
    )
    sides = np.array([layer.size / plan.grid.size for layer in layers])[own]
    gains = np.array(
        [np.bincount(again, pieces.masses * share, minlength=len(own)) / sides for share in missed]
    )
    likeliest = np.argsort(-gains, axis=None, kind="stable")[: np.count_nonzero(gains)]
    spent = np.cumsum(sides[likeliest % len(own)])
    chosen = np.zeros(gains.size, dtype=np.bool_)
    chosen[likeliest[spent <= cells + _ROUNDED]] = True
    if not chosen.any():
        return None
    tours = plan.layer_tours
    paths_of = {layer: RegionPaths(layer, transit=plan.transit) for layer in layers}
    looks = [
        GridTour(layer, tour, paths_of[layer]) for layer, tour in zip(layers, tours, strict=True)
    ]
    altitudes = list(plan.altitudes)
    for further in chosen.reshape(gains.shape):
        for up in np.unique(own[further]).tolist():
            mask = np.zeros(layers[up].shape, dtype=np.bool_)
            mask[tuple(plan.tour.cells[further & (own == up), -2:].T)] = True
            part = layers[up].subset(mask)
            tour = replace(tours[up], cells=tours[up].cells[mask[tuple(tours[up].cells.T)]])
            looks.append(GridTour(part, tour, RegionPaths(part, transit=plan.transit)))
            altitudes.append(plan.altitudes[up])
    whole = through_layers(
        looks,
        np.array(altitudes),
        climb=plan.grid.climb if isinstance(plan.grid, LayeredGrid) else 1.0,
        turn=plan.tour_cost.turn_cost,
    )
    cost = _tour_cost(whole, plan.tour_cost.turn_cost, stepwise=problem.stepwise)
    same = pieces.along(plan.tour, whole.grid, whole.tour, again)
    odds = same.shares(len(whole.tour), _detection(problem))
    more = replace(
        plan,
        grid=whole.grid,
        tour_cost=replace(cost, odds=odds, at_most=0.0),
        starts=whole.tour.position[tuple(whole.grid.cell_of(plan.places).T)],
        ground=(
            same
            if isinstance(ground, Ground)
            else replace(ground, grid=whole.grid, tour=whole.tour)
        ),
        flown={},
    )
    return _reallocate(more, plan.allocation, problem)


def _pieces(odds: NDArray[np.float64], layers: NDArray[np.int64]) -> Ground:
    """Return a piece of ground for each cell of a tour, which is seen from this cell alone, with the
    probability of the cell. The argument ``layers`` gives the layer of each cell.
    """
    numbers = np.arange(len(odds))
    cells = np.full((len(odds), int(layers.max()) + 1), -1, dtype=np.int64)
    cells[numbers, layers] = numbers
    return Ground(odds, cells)


def _cells_of_revisits(
    plan: SearchPlan, pieces: Ground, own: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the cell from which robots look at each piece of the ground again, as a tour index;
    int64, shape (G,). The argument ``own`` gives the layer of each cell.
    """
    layers = layers_of(plan.grid)
    # layers of a box show different places
    heights = np.array(plan.altitudes) * (plan.grid.region.height > 0)
    widest = [
        max(np.flatnonzero(heights == up).tolist(), key=lambda k: (layers[k].size, -k))
        for up in heights
    ]
    first = pieces.cells[np.arange(len(pieces.cells)), (pieces.cells >= 0).argmax(axis=1)]
    base = np.array(widest)[own[first]]
    again = pieces.cells[np.arange(len(pieces.cells)), base]
    for up in np.unique(base[again < 0]).tolist():
        these = (again < 0) & (base == up)
        over = layers[up].cell_of(plan.positions(first[these])[:, :2])
        again[these] = plan.tour.position[(up, *over.T)]
    return np.asarray(again)


def _with_future_odds(plan: SearchPlan, problem: SearchProblem) -> SearchPlan:
    """Return a plan with probabilities of cells for a target that moves.

    The order of a search follows one probability for each cell. Good ones are those at which the
    target is when robots get there. Compared are those at some times after the start, and mixtures
    of the best with what the looks of its own plan find.
    """
    n, ground = len(plan.tour), plan.ground
    assert isinstance(ground, MovingGround)

    def evaluate(
        odds: NDArray[np.float64], thorough: bool
    ) -> tuple[float, SearchPlan, Looks | None]:
        layout = replace(plan, tour_cost=replace(plan.tour_cost, odds=odds, thorough=thorough))
        ordered = _in_likely_order(layout, plan, problem)
        if ordered is None:
            return inf, layout, None
        looks = _looks_of(ordered)
        return _expected_time(ordered, problem, looks), layout, looks

    plans = [
        evaluate(ground.still(share * plan.planned_seconds).shares(n, _detection(problem)), False)
        for share in _LATER
    ]
    best = min(plans, key=lambda result: result[0])
    _, layout, looks = best
    for _ in range(_ROUNDS):
        if looks is None or layout.tour_cost.odds is None:
            break
        masses = ground.masses[looks.pieces] * looks.chances(problem.chosen_detection)
        mixed = (layout.tour_cost.odds + np.bincount(looks.cells, masses, minlength=n)) / 2
        plans.append(evaluate(mixed, False))
        _, layout, looks = plans[-1]
    best = min(plans, key=lambda result: result[0])
    assert plan.tour_cost.odds is not None
    assert best[1].tour_cost.odds is not None
    plans += [evaluate(plan.tour_cost.odds, True), evaluate(best[1].tour_cost.odds, True)]
    return min(plans, key=lambda result: result[0])[1]


def _looks_of(plan: SearchPlan) -> Looks:
    """Return the looks of a plan at the ground of its prior, with times in seconds."""
    assert plan.ground is not None
    stops = [plan.stops(robot) for robot in range(len(plan.places))]
    cells = [plan.visible_cells(robot, own) for robot, own in enumerate(stops)]
    times = [plan.times_by_cost(robot, own) for robot, own in enumerate(stops)]
    return looks_from(plan.ground, cells, times)


def _expected_time(plan: SearchPlan, problem: SearchProblem, looks: Looks | None = None) -> float:
    """Return the expected time until a plan finds the target of a prior, in seconds."""
    assert plan.ground is not None
    if isinstance(plan.ground, Ground):
        limit = plan.planned_seconds
    else:
        limit = problem.at_most * (plan.plain_seconds or 0.0)
    looks = _looks_of(plan) if looks is None else looks
    return plan.ground.expected_time(looks, problem.chosen_detection, limit)


def _reallocate(
    plan: SearchPlan,
    like: Allocation,
    problem: SearchProblem,
    arcs: Sequence[Sequence[Arc]] | None = None,
) -> SearchPlan:
    """Return a plan whose allocation follows its own tour cost, by the rule of another one. The
    argument ``arcs`` is that of `allocate`.
    """
    middles = plan.tour_cost.points[plan.starts]
    allocation = allocate(
        plan.tour_cost,
        plan.starts,
        allocator=like.allocator,
        rates=plan.rates,
        places=middles,
        widths=plan.widths,
        plain_arcs=arcs,
    )
    shared = _in_passes(
        plan.tour_cost, allocation, plan.starts, plan.rates, plan.widths, problem.multiplicity
    )
    return _with_delays(replace(plan, allocation=shared))


def with_work(plan: SearchPlan, name: str, work: Sequence[tuple[Arc, ...]]) -> SearchPlan:
    """Return a plan in which each robot searches given arcs of the tour, in their order."""
    middles = plan.tour_cost.points[plan.starts]
    times = [
        time_of(plan.tour_cost, arcs, place, int(start), int(width)) / rate
        for arcs, place, start, width, rate in zip(
            work, middles, plan.starts, plan.widths, plan.rates, strict=True
        )
    ]
    allocation = Allocation(name, tuple(work), np.array(times), tuple(work))
    return _with_delays(replace(plan, allocation=allocation, compared=()))


def attempts(problem: SearchProblem, margin: float) -> list[tuple[bool, float]]:
    """Return what the planner tries in turn until all vehicles have room: pairs of whether the rows
    have other angles than the best one, and of the margin in metres.

    A margin below the error of positions is the last resort, because with it vehicles may leave the
    region or enter no-go zones. Margins and angles that the problem gives do not change. Other
    angles are tried with the narrowest margins alone, because each of them takes as long as the best
    one. In large problems, where comparisons do not fly either, the rows keep the best angle.
    """
    least = problem.least_margin
    margins = [margin]
    if problem.margin is None and margin:
        margins += sorted({_NARROWER * margin, least, 0.0}, reverse=True)
        margins = [
            width
            for number, width in enumerate(margins)
            if not number or (width < margin and (width >= least or not width))
        ]
    side = float(np.min(check_footprints(problem.chosen_footprint, problem.robots)))
    flown = problem.place.area_m2 * problem.robots <= _FLOWN * side**2
    turns = problem.chosen_angle is None and problem.along is None and flown
    tried: list[tuple[bool, float]] = []
    for safe in (True, False):
        widths = [width for width in margins if (width >= least) == safe]
        tried += [(False, width) for width in widths]
        tried += [(True, width) for width in widths[-1:] if turns]
    return tried


def narrower_margin_text(margin: float, default: float) -> str:
    """Return the notice about a margin that is narrower than the default because of a vehicle
    without room.
    """
    return (
        f"margin: {margin:.3g} m in place of {default:.3g} m, because with the wider margin a"
        " vehicle has no room for its turns or its path; --margin sets another one"
    )


def tell_if_straight_rows_are_faster(plan: SearchPlan, problem: SearchProblem, seed: int) -> None:
    """Tell if a plan along a line takes much longer than one with straight rows along the region's
    longest side.

    The other plan compares nothing, so the one without a line may be still faster.
    """
    if not listeners or problem.along is None or plan.refusal is not None:
        return
    along = plan.plain or plan  # nothing that is about a prior differs between them
    seconds = without_delays(along)
    if seconds <= _MUCH_SLOWER * plan.least_seconds:
        return
    choices = {"tour": plan.tour.name, "allocation": plan.allocation.allocator}
    straight = problem.replaced(along=None, angle=longest_angle(problem.place.area), **choices)
    try:
        other = _plain_plan(straight.at_place(problem.place), seed)
    except InvalidInputError:
        return
    if other.refusal is None and seconds > _MUCH_SLOWER * without_delays(other):
        tell_once(
            f"along: robots need {seconds:.0f} s and turn {turns_by_robot(along).sum()} times along"
            f" the line, and {without_delays(other):.0f} s and {turns_by_robot(other).sum()} times"
            f" in straight rows at {round(other.row_angle, 1) % 180:g} degrees: --along is for long"
            " regions that are a few footprints wide"
        )


def _tell_if_a_row_is_for_little(plan: SearchPlan, problem: SearchProblem) -> None:
    """Tell if rows of a slightly larger footprint would be one less.

    Sides of whole footprints are longer than that by the rounding of their corners in files.
    """
    grid = layers_of(plan.grid)[0]
    if not listeners or isinstance(grid.lattice, LineLattice):
        return
    # the rows of cells run along the x axis of the lattice, and those of a tour perhaps across
    across = 1 if abs((plan.row_angle - grid.angle + 90) % 180 - 90) < 45 else 0
    extent = float(np.ptp(shapely.get_coordinates(grid.area)[:, across]))
    rows, excess = divmod(extent, grid.size)
    if rows and _ROUNDED < excess / grid.size < _LITTLE:
        footprint = float(np.min(check_footprints(problem.chosen_footprint, problem.robots)))
        larger = footprint * (extent / (extent - excess) + 1e-6)
        tell_once(
            f"footprint: the region is {1000 * excess:.3g} mm wider than {rows:.0f} rows of"
            f" {grid.size:g} m, so it needs one more; with {np.ceil(1e4 * larger) / 1e4:.7g} m it"
            " does not"
        )


def _report_refusal(plan: SearchPlan) -> SearchPlan:
    """Return a plan, with a notice if a vehicle cannot fly its path."""
    if plan.refusal is not None:
        tell_once(
            "plan: its times are estimates without the paths of vehicles, because a vehicle cannot"
            f" fly its path: {plan.refusal}"
        )
    return plan


def plan_at_margin(problem: SearchProblem, seed: int, *, rotated_rows: bool = False) -> SearchPlan:
    """Return the plan of a search with the margin of the problem's region.

    If a camera, which turns with its vehicle, misses some of the region, the cells become narrower.
    With ``rotated_rows``, the plan is the fastest of those that vehicles can fly with the rows at
    one of the `other_angles`.
    """
    plain = _rotated_plan(problem, seed) if rotated_rows else _plain_plan(problem, seed)
    if not problem.prior:
        return plain
    # Missions learn their start times from the order, so the order does not depend on these.
    return _add_delays(_with_prior(_add_delays(plain, -plain.delays), problem), plain.delays)


def in_order(plan: SearchPlan, problem: SearchProblem) -> SearchPlan:
    """Return a plan with a prior in another `SearchProblem.order`, that of ``problem``."""
    assert plan.plain is not None
    return _add_delays(_with_prior(plan.plain, problem), plan.delays)


def _add_delays(plan: SearchPlan, seconds: NDArray[np.float64]) -> SearchPlan:
    """Return a plan whose robots depart so many seconds later."""
    times = plan.allocation.times + seconds / plan.cell_seconds
    return replace(
        plan,
        delays=plan.delays + seconds,
        allocation=replace(plan.allocation, times=times),
        flown={},
    )


def _plain_plan(problem: SearchProblem, seed: int) -> SearchPlan:
    """Return the plan of a search without its prior, with narrower cells where a camera misses
    some of the region.
    """
    seed = check_integer(seed, what="seed", least=0)
    problem.check_at_place()
    image = problem.image
    narrowest = 1.0 if image is None else min(1.0, min(image.across, image.along) / 2**0.5)
    for scale in np.linspace(1.0, narrowest, _NARROWED if narrowest < 1.0 else 1).tolist():
        plan = _best_plan(problem, seed, scale)
        if (
            scale == narrowest
            or not isinstance(plan.grid, CellGrid)
            or plan.grid.n_cells > _LOOKED
            or _is_seen(plan, plan.grid)
        ):
            break
    return plan


def _rotated_plan(problem: SearchProblem, seed: int) -> SearchPlan:
    """Return the fastest plan with its rows at one of the `other_angles`, if possible one that
    vehicles can fly.
    """
    speeds = np.ones(problem.robots) if problem.rates is None else np.array(problem.rates)
    size = cell_side(check_footprints(problem.chosen_footprint, problem.robots), speeds)
    price = problem.turn_price(turn_cells(problem.chosen_vehicle, size))
    angles = other_angles(problem.place, size, price)
    plans, refusal = [], None
    for angle in angles:
        try:
            plans.append(_plain_plan(problem.replaced(angle=angle).at_place(problem.place), seed))
        except InvalidInputError as error:
            refusal = error
    if not plans and refusal is not None:
        raise refusal
    flyable = [plan for plan in plans if plan.refusal is None]
    return min(flyable or plans, key=lambda plan: plan.planned_seconds)


def _is_seen(plan: SearchPlan, grid: CellGrid) -> bool:
    """Return whether the camera, which turns with the vehicle, sees the whole region along the
    paths of a plan.
    """
    routes = [
        plan.route(robot, stops)
        for robot in range(len(plan.places))
        if len(stops := plan.stops(robot))
    ]
    searched = [route.points[route.stops[1] :] for route in routes]
    sides = [
        float(plan.footprints[robot]) for robot in range(len(plan.places)) if len(plan.stops(robot))
    ]
    return (
        coverage_check(
            grid.region, searched, sides, angle=grid.angle, image=plan.image
        ).covered_fraction
        >= 1 - UNSEEN
    )


def _best_plan(problem: SearchProblem, seed: int, scale: float) -> SearchPlan:
    """Return the fastest of the compared plans, with footprints ``scale`` times as wide as those of
    the problem.

    Cells are squares along the rows, but an image turns with its vehicle. On slanted legs, images
    cover squares only if the squares are narrower. Squares of 1 / sqrt(2) of an image lie in the
    image whatever its heading.
    """
    all_plans = plans_along(problem, seed, scale=scale)
    if not _are_compared(problem, layers_of(all_plans[0].grid)[0].n_cells):
        return all_plans[0]
    # Of vehicles, what counts is when the last one is back: its way out and home, curves, climbs and
    # charges belong to that. Plans whose routes alone take too long need not be flown to know it.
    bounds = [least_price(plan, problem) for plan in all_plans]
    likeliest = [all_plans[k] for k in np.argsort(bounds, kind="stable").tolist()]
    flown: list[tuple[float, SearchPlan]] = []
    with one_by_one(likeliest, "plans") as each:
        for plan, bound in zip(each, sorted(bounds), strict=False):
            if plan.flies and len(flown) > ALTERNATIVES and bound > flown[ALTERNATIVES][0]:
                break
            if plan.refusal is None:
                insort(flown, (price_of_turns(plan, problem), plan), key=itemgetter(0))
    if not flown:  # no plan can be flown: to fly the other robots of each would tell nothing
        return min(all_plans, key=lambda plan: plan.seconds(plan.allocation.makespan))
    plans = [plan for _, plan in flown]
    tours_compared = _compared_tours(plans)
    best, *alternatives = (
        replace(plan, compared=(*tours_compared, *_compared_allocations(plans, plan)))
        for plan in plans[: 1 + ALTERNATIVES]
    )
    return replace(best, alternatives=tuple(alternatives))


def plans_along(
    problem: SearchProblem, seed: int, *, scale: float = 1.0, names: Sequence[str] = ()
) -> list[SearchPlan]:
    """Return the plans of all allocations that the problem compares, along the best tours. The best
    tour comes first, that at the price of ``prefer="time"`` where tours are ranked at both prices.
    All robots start at the same places in all plans.

    With the ways of robots out and home, a plan may turn out otherwise than its tour: for each price
    of a turn, up to `_PLANNED` tours are planned, and the best one of each name, unless cells times
    robots are more than `_FLOWN`. With ``names``, the best tours of these names
    are planned, too, also where two are equal.
    """
    speeds = np.ones(problem.robots) if problem.rates is None else np.array(problem.rates)
    options: dict[str, Any] = {"scale": scale, "cache": {}}
    chosen = _ranked_tours(problem, speeds, **options)
    size = chosen[0].grid.size
    own = turn_cells(problem.chosen_vehicle, size)
    # Both prices rank all tours, in the same order whatever is preferred: the best plan at one price
    # may be made of a tour that is best at the other, and robots start at the same places.
    prices = dict.fromkeys(max(own, least) for least in TURN_PRICES.values())
    if _are_compared(problem, chosen[0].grid.n_cells):
        rankings = [_ranked_tours(problem, speeds, price=price, **options) for price in prices]
        found = [grid_tour for ranking in rankings for grid_tour in ranking]
        chosen = []
        for least in TURN_PRICES.values():
            price = _price_of_all(least, own, flies=problem.vehicle is not None)
            costs = [one.once_round(price, own * size) for one in found]
            ranked = [found[k] for k in np.argsort(costs, kind="stable").tolist()]
            chosen += _different(ranked)[:_PLANNED]
        for ranking in rankings:
            chosen += {one.tour.name: one for one in reversed(ranking)}.values()
        chosen = _different(chosen)
    else:
        del chosen[1:]
    for name in names:
        best = [
            _ranked_tours(problem, speeds, price=price, names=(name,), **options)[0]
            for price in prices
        ]
        alike = [grid_tour for grid_tour in chosen if grid_tour.tour.name == name]
        chosen += _different([*alike, *best])[len(alike) :]
    tours = [_in_layers(problem, grid_tour, speeds, scale) for grid_tour in chosen]
    ground = layers_of(tours[0].grid)[0]
    places = start_points(problem, ground, np.random.default_rng(seed))
    landing = (
        None
        if problem.land is None
        else places_of(problem.land, ground.region, problem.robots, what="land")
    )
    plans = [
        plan
        for grid_tour in tours
        for plan in _team_plans(problem, grid_tour, speeds, places, landing, scale)
    ]
    return [replace(plan, airspace=plans[0].airspace) for plan in plans]


def _different(tours: Sequence[GridTour]) -> list[GridTour]:
    """Return the tours that lead through other cells, or through them in another order, than all
    before.
    """
    found: list[GridTour] = []
    for grid_tour in tours:
        if not any(_is_same(grid_tour, other) for other in found):
            found.append(grid_tour)
    return found


def _is_same(first: GridTour, second: GridTour) -> bool:
    """Return whether two tours lead through the same cells in the same order."""
    return np.array_equal(first.tour.cells, second.tour.cells) and np.array_equal(
        first.grid.viewpoints, second.grid.viewpoints
    )


def _are_compared(problem: SearchProblem, cells: int) -> bool:
    """Return whether plans of a region of so many cells are compared, not only their tours."""
    looks = problem.passes * len(problem.altitudes)
    return cells * looks * problem.robots <= _FLOWN


def _price_of_all(least: float, own: float, *, flies: bool) -> float:
    """Return what a robot's turn costs in `price_of_turns`, in cells, if all robots turn as often, a
    turn takes the time for ``own`` cells, and it costs at least ``least``.
    """
    return max(own, least) + _TEAM * least * flies


def price_of_turns(plan: SearchPlan, problem: SearchProblem) -> float:
    """Return the time that decides between plans, in seconds: the longest time between the
    departure of a vehicle and its return, where each of its turns takes at least the time that turns
    cost with ``prefer="time"``, and what a robot's turns on average cost beyond that. Without a
    vehicle, robots do not return, and their turns take no time.
    """
    return _price(plan, problem, _working_times(plan), turns_by_robot(plan))


def least_price(plan: SearchPlan, problem: SearchProblem) -> float:
    """Return a lower bound on the `price_of_turns` of a plan: what it would be if each vehicle needed
    no more than its route takes, in one sortie and, of a fixed wing, with its shortest curves from
    row to row. Without a vehicle, it is the price itself.
    """
    if not plan.flies:
        return price_of_turns(plan, problem)
    vehicle, times = plan.vehicle, np.zeros(len(plan.places))
    counts = np.zeros(len(plan.places), np.int64)
    try:
        routes = whole_routes(plan)
    except InvalidInputError:  # no way: its flight tells why
        return 0.0
    for robot, route in routes:
        counts[robot] = turns_of(route).sum()
        merged = merge_straight_legs(route, MERGED)  # gentle bends between long legs take less time
        path = np.full((len(merged), 3), vehicle.height)
        path[:, : route.shape[1]] = merged
        if not vehicle.radius:  # fixed wings may climb on their way
            ends = path[[0, -1]] * (1.0, 1.0, 0.0)
            path = np.vstack([ends[:1], path, ends[1:]])
        rate = float(plan.rates[robot])
        times[robot] = trajectory(path, vehicle, rate=rate).duration
        if vehicle.radius:
            link = LINK * float(plan.footprints[robot])
            length = least_length(merged[:, :2], vehicle.radius, link=link)
            fastest = rate * vehicle.cruise + vehicle.wind
            times[robot] = max(times[robot], length / fastest)
    return _price(plan, problem, ((1 - _LOOSE) * times).tolist(), counts)


def _price(
    plan: SearchPlan, problem: SearchProblem, times: Sequence[float], counts: NDArray[np.int64]
) -> float:
    """Return the `price_of_turns` of a plan whose robots take given times in seconds, with given
    numbers of turns.
    """
    own = turn_cells(plan.vehicle, plan.grid.size)
    least = max(own, TURN_PRICES["time"]) if plan.flies else own
    price = _price_of_all(problem.turn_price(0.0), own, flies=plan.flies)
    latest = (np.array(times) + (least - own) * plan.cell_seconds * counts).max()
    return float(latest + (price - least) * plan.cell_seconds * counts.mean())


def turns_by_robot(plan: SearchPlan) -> NDArray[np.int64]:
    """Return the number of turns on the route of each robot."""
    counts = np.zeros(len(plan.places), np.int64)
    for robot, route in whole_routes(plan):
        counts[robot] = turns_of(route).sum()
    return counts


def whole_routes(plan: SearchPlan) -> list[tuple[int, Points]]:
    """Return the number of each robot that has work, counted from 0, and its route: from its start
    along its stops and, of a vehicle, to where it lands; float64, each of shape (k, 2) or (k, 3).
    """
    routes = []
    for robot in range(len(plan.places)):
        stops = plan.stops(robot)
        if not len(stops):
            continue
        route = plan.route(robot, stops).points
        if plan.flies:
            home = (plan.places if plan.landing is None else plan.landing)[robot]
            back = plan.leg(home, route[-1, :2])[::-1]
            level = np.full((len(back), route.shape[1] - 2), route[-1, 2:])
            route = np.vstack([route, np.hstack([back, level])[1:]])
        routes.append((robot, route))
    return routes


def without_delays(plan: SearchPlan) -> float:
    """Return the longest time of a robot at work, in seconds."""
    return max(_working_times(plan), default=0.0)


def _working_times(plan: SearchPlan) -> list[float]:
    """Return the time of each robot in seconds: between its departure and its return or, without a
    vehicle, until it has searched its part.
    """
    if not plan.flies:
        return [plan.seconds(float(cells)) for cells in plan.allocation.times]
    return [
        end_of(sorties) - float(delay)
        for sorties, delay in zip(plan.sorties, plan.delays, strict=True)
    ]


def _compared_tours(plans: Sequence[SearchPlan]) -> list[Candidate]:
    """Return the compared tours with the time of the best plan along each, the fastest first. A
    single tour gives no candidates.
    """
    fastest: dict[str, Candidate] = {}
    for plan in sorted(plans, key=without_delays):
        name, cells = plan.tour.name, plan.cells(plan.planned_seconds)
        fastest.setdefault(
            name, Candidate(plan.row_angle, name, cells, seconds=plan.planned_seconds)
        )
    return list(fastest.values()) if len(fastest) > 1 else []


def _compared_allocations(plans: Sequence[SearchPlan], best: SearchPlan) -> list[Candidate]:
    """Return the compared allocations of the best plan's tour, the fastest first. A single
    allocation gives no candidates.
    """
    same_tour = sorted((plan for plan in plans if plan.tour is best.tour), key=without_delays)
    candidates = [
        Candidate(
            plan.row_angle,
            plan.tour.name,
            plan.cells(plan.planned_seconds),
            plan.allocation.allocator,
            seconds=plan.planned_seconds,
        )
        for plan in same_tour
    ]
    return candidates if len(candidates) > 1 else []


def _team_plans(
    problem: SearchProblem,
    grid_tour: GridTour,
    speeds: NDArray[np.float64],
    places: Points,
    landing: Points | None,
    scale: float,
) -> list[SearchPlan]:
    """Return a plan for each compared allocation of a tour, the best by its cost in cells first."""
    robots, grid, tour, vehicle = (
        problem.robots,
        grid_tour.grid,
        grid_tour.tour,
        problem.chosen_vehicle,
    )
    footprints = scale * check_footprints(problem.chosen_footprint, robots)
    own = turn_cells(vehicle, grid.size)
    tour_cost = _tour_cost(grid_tour, own, stepwise=problem.stepwise)
    if problem.vehicle is not None:
        # also where rows are preferred: robots are back together only if turns count as they take
        tour_cost = replace(tour_cost, turn_price=max(TURN_PRICES["time"] - own, 0.0))
    ground = layers_of(grid)[0]
    numbers = tour.position[tuple(grid.cell_of(places).T)]
    widths = widths_of(footprints, ground.size)
    # Messages contain cells, not positions. Therefore robots can agree only on parts that they
    # compute from cells.
    angle = tour.row_angle(grid.angle, 0)
    middles, cell = tour_cost.points[numbers], grid.size / vehicle.mean_speed(angle)
    compared = compared_allocations(
        tour_cost,
        numbers,
        problem.allocations_to_compare,
        rates=speeds,
        places=middles,
        widths=widths,
        energy=working_seconds(vehicle) * float(speeds.min()) / cell,
        recharge=vehicle.recharge_seconds / cell,
    )
    candidates = [
        Candidate(angle, tour.name, time, allocation.allocator) for allocation, time in compared
    ]
    delays = np.zeros(robots) if problem.delays is None else np.array(problem.delays)
    plans = []
    flown: dict[Any, Durations] = {}
    for allocation, _ in compared:
        shared = _in_passes(tour_cost, allocation, numbers, speeds, widths, problem.multiplicity)
        plan = SearchPlan(
            grid,
            tour_cost,
            places,
            numbers,
            speeds,
            shared,
            footprints,
            problem.transit,
            landing,
            vehicle,
            delays=delays,
            compared=grid_tour.compared + tuple(candidates if len(candidates) > 1 else ()),
            flies=problem.vehicle is not None,
            stay_inside=problem.stay_inside,
            image=None if problem.image is None else problem.image.scaled(1 / scale),
            reach=_reach(problem, grid.size),
            flown=flown,
        )
        plans.append(_with_delays(plan))
    return plans


def _reach(problem: SearchProblem, side: float) -> float:
    """Return by how many metres images that are hardly longer than a cell see less beyond the ends
    of paths than the reserve of rows.
    """
    vehicle = problem.chosen_vehicle
    if vehicle.image_size is None or problem.footprint is not None:
        return 0.0
    return max((problem.cross_track or 0.0) - (vehicle.image_size[1] - side) / 2, 0.0)


def _in_passes(
    tour_cost: TourCost,
    allocation: Allocation,
    starts: NDArray[np.int64],
    rates: NDArray[np.float64],
    widths: NDArray[np.int64],
    multiplicity: int,
) -> Allocation:
    """Return an allocation in which so many different robots search each cell."""
    if multiplicity == 1:
        return allocation
    numbers = range(1, len(starts) + 1)
    team = zip(numbers, starts.tolist(), rates.tolist(), widths.tolist(), strict=True)
    return in_passes(tour_cost, allocation, tuple(team), tour_cost.points[starts], multiplicity)


def _with_delays(plan: SearchPlan) -> SearchPlan:
    """Return a plan whose completion times contain what robots need before they begin."""
    late = []
    for robot in range(len(plan.places)):
        first = None
        if plan.launch_distances is not None and len(stops := plan.stops(robot)):
            first = int(stops[0])
        late.append(_lateness(plan, robot, first))
    times = plan.allocation.times + np.array(late)
    return replace(plan, allocation=replace(plan.allocation, times=times))


def _lateness(plan: SearchPlan, robot: int, first: int | None) -> float:
    """Return the time, in cells, that a robot's delay and its path from a launch point outside the
    region to its first cell add to its times.
    """
    late = float(plan.delays[robot]) / plan.cell_seconds
    if (
        first is not None
        and plan.launch_distances is not None
        and robot + 1 in plan.launch_distances
    ):
        length = plan.launch_distances.length(robot + 1, first)
        late += (length - plan.tour_cost.length(int(plan.starts[robot]), first)) / plan.rates[robot]
    return late


def _sizes_of_cells(
    problem: SearchProblem, speeds: NDArray[np.float64], scale: float
) -> list[float]:
    """Return the side of the cells at each altitude, in metres."""
    return [
        cell_side(scale * check_footprints(problem.footprint_at(up), problem.robots), speeds)
        for up in problem.altitudes
    ]


def _ranked_tours(
    problem: SearchProblem,
    speeds: NDArray[np.float64],
    *,
    scale: float,
    cache: dict[Any, Any],
    price: float | None = None,
    names: Sequence[str] | None = None,
) -> list[GridTour]:
    """Divide the region into cells at the given angle or at the likeliest angles, and return the
    tours through them, as `ranked_grid_tours` does.

    The argument ``price`` is that of a turn in cells, in place of the problem's, and ``names`` those
    of the tours.
    """
    size = _sizes_of_cells(problem, speeds, scale)[0]
    own = turn_cells(problem.chosen_vehicle, size)
    return ranked_grid_tours(
        problem.place,
        size,
        problem.tours_to_compare(own) if names is None else names,
        turn_cost=problem.turn_price(own) if price is None else price,
        reach=own * size,
        angle=problem.chosen_angle,
        line=problem.line,
        cache=cache,
        transit=problem.transit,
        stepwise=problem.stepwise,
        along_rows=isinstance(problem.angle, float) or None,
    )


def _in_layers(
    problem: SearchProblem, first: GridTour, speeds: NDArray[np.float64], scale: float
) -> GridTour:
    """Return a tour through all layers that begins with a tour of the lowest one."""
    vehicle, sizes = problem.chosen_vehicle, _sizes_of_cells(problem, speeds, scale)
    climb = float(vehicle.vertical_seconds([1.0, -1.0]).mean()) * vehicle.mean_speed(
        first.tour.row_angle(first.grid.angle)
    )
    return in_layers(
        first,
        problem.altitudes,
        problem.passes,
        sizes,
        first.tour.name,
        climb=climb,
        turn_cost=problem.turn_price(turn_cells(vehicle, sizes[0])),
        transit=problem.transit,
        stepwise=problem.stepwise,
        along_rows=isinstance(problem.angle, float) or None,
    )


def _tour_cost(grid_tour: GridTour, turn_cost: float, *, stepwise: bool = False) -> TourCost:
    """Return a tour with its costs, computed from the lengths of paths that stay inside
    the region.
    """
    grid, tour, paths, round_trip = grid_tour.grid, grid_tour.tour, grid_tour.paths, grid_tour.route
    index = grid.ordinals(tour.cells)
    firsts = grid.viewpoints[grid.viewpoint_starts[index]]
    distances = partial_sums(leg_lengths(with_climb_cost(grid, round_trip.points)))[
        round_trip.stops
    ]
    begins = partial_sums(np.diff(grid.viewpoint_starts)[index])
    steps = np.diff(distances[begins]) / grid.size
    # the last entry of the turns belongs to the first point
    closed_path = np.concatenate([round_trip.points, round_trip.points[1:2]])
    shares = turn_shares(closed_path, reach=turn_cost * grid.size)
    turns = np.diff(np.cumsum(np.concatenate([[0], shares[-1:], shares]))[round_trip.stops[begins]])
    free = grid.region.free
    straight = not stepwise and bool(free.convex_hull.area - free.area <= _HOLLOW * free.area)
    options: dict[str, Any] = {"distances": None}
    if isinstance(paths, LayeredPaths):
        options |= _layer_options(grid_tour, paths, straight=straight or stepwise)
        if stepwise:
            options["distances"] = cells_of_layers(paths.grid, tour, steps)
    else:
        options["footprint"] = RegionFootprint(paths.grid, tour)
        if not straight:
            cellwise = CellDistances(
                tour, planes=[plane_of(paths.grid, tour.position)], steps=steps
            )
            options["distances"] = cellwise if stepwise else RegionDistances(paths, tour, cellwise)
    options |= {"turn_cost": turn_cost, "steps": steps, "turns": turns, "reckoned": True}
    return TourCost(tour, with_climb_cost(grid, firsts) / grid.size, **options)


def _layer_options(grid_tour: GridTour, paths: LayeredPaths, *, straight: bool) -> dict[str, Any]:
    """Return the arguments of `TourCost` for a tour through several layers."""
    numbers = LayerNumbers(grid_tour.tour, tuple(layer.tour for layer in grid_tour.layers))
    grids = layers_of(grid_tour.grid)
    # a layer with some cells of another has its distances
    bases = [grid_tour.layers[grids.index(grid.whole or grid)] for grid in grids]
    own = {
        layer: {} if straight else vars(_tour_cost(layer, 0.0)) for layer in dict.fromkeys(bases)
    }
    footprint_of = {
        layer: RegionFootprint(grid, layer.tour)
        for layer, grid in zip(grid_tour.layers, grids, strict=True)
    }
    return {
        "footprint": LayeredFootprint(numbers, [footprint_of[layer] for layer in grid_tour.layers]),
        "least": (
            sum(layer.grid.n_cells * layer.grid.size for layer in grid_tour.layers)
            / grid_tour.grid.size
        ),
        "distances": LayeredDistances(
            paths,
            numbers,
            [own[layer]["distances"] for layer in bases] if not straight else (),
        ),
    }
