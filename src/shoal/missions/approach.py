"""Ways between homes and routes: launch points, rally points and returns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.geometry import partial_sums, step_lengths
from shoal.missions.mission import Mission
from shoal.missions.rules import ROUNDING, inside_of, search_slice
from shoal.search.flight.legs import complete_path
from shoal.search.flight.separation import Approach, Separation, nearest_approach
from shoal.search.flight.terrain import Terrain, ground_profile
from shoal.search.flight.timing import RETURN_HEIGHT, Floats, Trajectory, trajectory
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion

# metres: an eighth of this is the deviation of the ground from a straight line between two heights
_FINE = 0.1


def mission_trajectory(
    mission: Mission, path: Floats, vehicle: Vehicle, rate: float | Floats, stay: float
) -> Trajectory:
    """Return the trajectory of a vehicle that follows its mission.

    If the mission ends with loitering, the vehicle circles for ``stay`` seconds at the end of the
    trajectory.
    """
    if mission.loiter is None:
        return trajectory(path, vehicle, rate=rate)
    before = trajectory(path[:-1], vehicle, rate=rate if isinstance(rate, float) else rate[:-1])
    times = np.append(before.times, before.times[-1] + stay)
    return Trajectory(times, np.vstack([before.points, before.points[-1:]]), mission.loiter)


def common_path(mission: Mission, frame: LocalFrame | None) -> Floats:
    """Return the path of a mission with heights above sea level, or above home if home's height
    above sea level is unknown.
    """
    path = mission.path_in(frame)
    path[:, 2] += mission.elevation or 0.0
    return path


def constant_speed(mission: Mission) -> Vehicle:
    """Return a vehicle that always moves at the mission's speed, even in climbs, and needs no time
    for turns.
    """
    return Vehicle(
        preset="ideal",
        cruise_speed=mission.speed,
        climb_speed=min(mission.speed, 50),
        sink_speed=min(mission.speed, 50),
    )


def airspace_of(missions: Sequence[Mission], region: SearchRegion) -> float:
    """Return the largest distance in metres by which vehicles leave a region during its search, on
    turns or elsewhere.
    """
    import shapely

    shapely.prepare(region.outline)
    most = 0.0
    for mission in missions:
        path = mission.path_in(region.frame)[1:-1, :2]
        inside = inside_of(region, path)
        outside = path[1:-1][search_slice(inside, mission.kind)]
        most = max(
            most, float(shapely.distance(region.outline, shapely.points(outside)).max(initial=0.0))
        )
    return most


@dataclass(frozen=True, eq=False)
class MissionApproach:
    """The nearest approach of any two vehicles that follow missions.

    Parameters
    ----------
    robots : tuple of int
        Numbers of the two robots.
    sorties : tuple of int
        Number of the sortie that each of the two robots flies at the nearest approach.
    horizontal : float
        Horizontal distance of the two vehicles at the nearest approach, in metres.
    vertical : float or None
        Vertical distance of the two vehicles at the nearest approach, in metres, or None if one of
        their heights is unknown: on the way home of a return, or above the terrain.
    time : float
        Time of the nearest approach in seconds after the start of the first missions, if the first
        vehicle has no unplanned delay.
    place : ndarray of float64, shape (3,)
        Position of the first vehicle at the nearest approach: metres east, north and up.
    """

    robots: tuple[int, int]
    sorties: tuple[int, int]
    horizontal: float
    vertical: float | None
    time: float
    place: Floats

    def report(self, frame: LocalFrame | None = None) -> dict[str, Any]:
        """Return the approach as a mapping for JSON. With a frame, the mapping has the position in
        metres and in degrees.
        """
        summary = {
            "robots": list(self.robots),
            "sorties": list(self.sorties),
            "horizontal_m": self.horizontal,
            "vertical_m": self.vertical,
            "time_s": self.time,
            "x": float(self.place[0]),
            "y": float(self.place[1]),
            "up_m": float(self.place[2]),
        }
        if frame is None:
            return summary
        return summary | dict(
            zip(
                ("longitude", "latitude"),
                frame.to_degrees(self.place[None, :2])[0].tolist(),
                strict=True,
            )
        )


def missions_approach(
    missions: Sequence[Mission],
    separation: Separation,
    frame: LocalFrame | None,
    *,
    vehicle: Vehicle | None = None,
) -> MissionApproach | None:
    """Return the nearest approach over all pairs of vehicles that follow missions.

    Each vehicle may be late by up to ``separation.delay`` seconds.

    Parameters
    ----------
    missions : sequence of Mission
        The missions. Each sortie begins at its ``start``. By default, a first sortie has the start
        0, and the start of any other sortie is ``separation.delay`` seconds after the end of all
        sorties with smaller numbers.
    separation : Separation
        The required separation. Moments at which two vehicles keep the vertical separation do not
        count as an approach. Where a height is unknown, it counts as any height: on the way home
        of a return, and above the terrain. Two missions of one robot and one sortie count as those
        of two vehicles.
    frame : LocalFrame or None
        Local frame in which distances are measured, or None for missions in metres.
    vehicle : Vehicle, optional
        Vehicle that gives the speeds of climb and descent, and the duration of turns. By default,
        vehicles fly and climb at the speed in the mission, and turn in no time.

    Returns
    -------
    MissionApproach or None
        The nearest approach, or None if all vehicles always keep the vertical separation.
    """
    flights = _Flights(missions, separation, frame, vehicle)
    best: MissionApproach | None = None
    for first, second in combinations(range(len(flights.missions)), 2):
        one, other = flights.missions[first], flights.missions[second]
        if one.robot == other.robot and one.sortie != other.sortie:
            continue
        near = flights.approach(first, second)
        if near is not None and (best is None or near[0].horizontal < best.horizontal):
            approach, begin, known = near
            best = MissionApproach(
                (one.robot, other.robot),
                (one.sortie, other.sortie),
                approach.horizontal,
                approach.vertical if known else None,
                begin + approach.times[0],
                approach.places[0],
            )
    return best


class _Stretch(NamedTuple):
    """A part of a flight: when it begins after the start of the flight, how much later than planned
    it may begin besides unplanned delays, and whether its heights are known.
    """

    flown: Trajectory
    begin: float = 0.0
    late: float = 0.0
    heights_known: bool = True


class _Flights:
    """The missions of all robots, with start times on one common clock."""

    def __init__(
        self,
        missions: Sequence[Mission],
        separation: Separation,
        frame: LocalFrame | None,
        vehicle: Vehicle | None,
    ) -> None:
        # two missions of one robot and one sortie stay two flights: another vehicle may fly each
        self.missions = sorted(missions, key=lambda one: (one.robot, one.sortie))
        self.separation = separation
        self.vehicles = [
            constant_speed(mission) if vehicle is None else vehicle for mission in self.missions
        ]
        self.paths = [mission.path_in(frame) for mission in self.missions]
        numbers = range(len(self.missions))
        self.trajectories = [self._trajectory(number, 0.0) for number in numbers]
        self.starts = [0.0 for _ in numbers]
        ends: dict[int, float] = {}  # by sortie
        for number in sorted(numbers, key=lambda number: self.missions[number].sortie):
            mission = self.missions[number]
            before = [end for sortie, end in ends.items() if sortie < mission.sortie]
            earliest = max(before) + separation.delay if before else 0.0
            start = earliest if mission.start is None else mission.start
            self.starts[number] = start
            end = start + self.trajectories[number].duration
            ends[mission.sortie] = max(ends.get(mission.sortie, 0.0), end)
        last = max(ends.values(), default=0.0) + separation.delay
        flown = {(mission.robot, mission.sortie) for mission in self.missions}
        for number, mission in enumerate(self.missions):
            if mission.loiter is not None and (mission.robot, mission.sortie + 1) not in flown:
                self.trajectories[number] = self._trajectory(
                    number, last - self.starts[number] - self.trajectories[number].duration
                )
        self.stretches = [self._stretches(number) for number in numbers]

    def _trajectory(self, number: int, stay: float) -> Trajectory:
        mission, vehicle = self.missions[number], self.vehicles[number]
        return mission_trajectory(
            mission, self.paths[number], vehicle, mission.rates(vehicle), stay
        )

    def _stretches(self, number: int) -> list[_Stretch]:
        """Return the flight of a mission, with its return as a stretch of its own.

        A return begins with a climb to a height that only the autopilot's settings tell.
        """
        mission, flown = self.missions[number], self.trajectories[number]
        if mission.landing is not None or mission.kind == "rover":
            return [_Stretch(flown)]
        vehicle, last = self.vehicles[number], self.paths[number][-3]
        there = np.isclose(flown.points, last, rtol=0.0, atol=1e-6).all(axis=1)
        turn = int(np.flatnonzero(there)[-1])
        while turn and there[turn - 1]:
            turn -= 1
        before = Trajectory(flown.times[: turn + 1], flown.points[: turn + 1])
        begin, climb = float(flown.times[turn]), max(RETURN_HEIGHT - float(last[2]), 0.0)
        up, down = vehicle.vertical_seconds((climb, -climb)).tolist()
        times = np.append(flown.times[turn:] - begin, flown.duration - begin)
        times[-1] += down
        home = Trajectory(times, np.vstack([flown.points[turn:], flown.points[-1:]]))
        return [_Stretch(before), _Stretch(home, begin, up, False)]

    def approach(self, first: int, second: int) -> tuple[Approach, float, bool] | None:
        """Return the nearest approach on two missions, the time at which the stretch of the first
        vehicle begins, and whether the heights of both are known; or None if the vehicles always
        keep the vertical separation.
        """
        missions, delay = (self.missions[first], self.missions[second]), self.separation.delay
        levels = common_levels(*missions)
        # a vehicle that returns or follows the ground stays above those that drive
        drives = any(mission.kind == "rover" for mission in missions)
        best: tuple[Approach, float, bool] | None = None
        for mine, theirs in product(self.stretches[first], self.stretches[second]):
            known = drives or (levels is not None and mine.heights_known and theirs.heights_known)
            begin = self.starts[first] + mine.begin
            later = self.starts[second] + theirs.begin - begin + (theirs.late - mine.late) / 2
            tolerance = delay + (mine.late + theirs.late) / 2
            earliest = -theirs.flown.duration - tolerance
            if not earliest <= later <= mine.flown.duration + tolerance:
                continue
            near = nearest_approach(
                raised(mine.flown, 0.0 if levels is None else levels[0]),
                raised(theirs.flown, 0.0 if levels is None else levels[1]),
                vertical=self.separation.vertical if known else np.inf,
                later=later,
                tolerance=tolerance,
            )
            if near is not None and (best is None or near.horizontal < best[0].horizontal):
                best = near, begin, known
        return best


def raised(flown: Trajectory, height: float) -> Trajectory:
    """Return a trajectory ``height`` metres higher."""
    if not height:
        return flown
    return Trajectory(flown.times, flown.points + np.array([0.0, 0.0, height]), flown.circle)


def common_levels(first: Mission, second: Mission) -> tuple[float, float] | None:
    """Return the heights of the homes of two missions above one level, or None if the heights of the
    two cannot be compared.

    The level is the sea if both say how high they are above it. Otherwise both homes count as
    equally high: an unknown height is no height of 0 m.
    """
    seas = [_levels_of(mission) for mission in (first, second)]
    for one, other in zip(*seas, strict=True):
        if one is not None and other is not None:
            return one, other
    return None


def _levels_of(mission: Mission) -> tuple[float | None, float | None]:
    """Return what the heights of a mission's path count from, in metres above the sea and above
    home; None if unknown.
    """
    if mission.altitude_frame == "ground" and mission.heights is None:
        return None, None
    if mission.elevation is not None:
        return mission.elevation, 0.0
    return (0.0, None) if mission.altitude_frame == "sea" else (None, 0.0)


@dataclass(frozen=True, eq=False)
class Clearance:
    """The smallest and the largest height above ground of vehicles that follow missions.

    A `Clearance` ignores rovers, landings, and climbs after take-off.

    Parameters
    ----------
    lowest, highest : float
        The smallest and the largest height above ground in metres.
    missions : tuple of str
        Names of the missions with the smallest and with the largest height above ground.
    places : ndarray of float64, shape (2, 2)
        Positions of the smallest and of the largest height above ground, in metres.
    error : float
        Largest deviation of a height above ground from the altitude of the mission, in metres. If
        no mission has altitudes above ground, the deviation is 0.
    """

    lowest: float
    highest: float
    missions: tuple[str, str]
    places: Floats
    error: float

    def report(self, frame: LocalFrame | None = None) -> dict[str, Any]:
        """Return the clearance as a mapping that can be written as JSON. If a frame is given,
        positions are in degrees.
        """
        placed = self.places if frame is None else frame.to_degrees(self.places)
        low, high = (
            {"height_m": height, "mission": name, "place": place}
            for height, name, place in zip(
                (self.lowest, self.highest), self.missions, placed.tolist(), strict=True
            )
        )
        return {"lowest": low, "highest": high, "error_m": self.error}


def clearance_of(
    missions: Sequence[Mission], terrain: Terrain, frame: LocalFrame | None
) -> Clearance | None:
    """Return the smallest and largest height above ground of vehicles that follow missions, or None
    if no vehicle flies.

    The function evaluates the height of the ground at every waypoint, wherever a path crosses a
    grid line of the terrain, and at points in between.

    Parameters
    ----------
    missions : sequence of Mission
    terrain : Terrain
    frame : LocalFrame or None
        Local frame in which distances are measured, or None for missions in metres.

    Raises
    ------
    InvalidInputError
        If the terrain has no height at a point of a mission.
    """
    extremes = []
    for mission in missions:
        if mission.kind == "rover":
            continue
        places, heights = _heights_of(mission, terrain, frame)
        follows_ground = mission.altitude_frame == "ground" and mission.altitudes is None
        error = float(np.abs(heights - mission.altitude).max()) if follows_ground else 0.0
        extremes += [
            (float(heights[k]), mission.name, places[k], error)
            for k in (heights.argmin(), heights.argmax())
        ]
    if not extremes:
        return None
    low, high = (
        min(extremes, key=lambda extreme: extreme[0]),
        max(extremes, key=lambda extreme: extreme[0]),
    )
    return Clearance(
        low[0],
        high[0],
        (low[1], high[1]),
        np.array([low[2], high[2]]),
        max(extreme[3] for extreme in extremes),
    )


def _heights_of(
    mission: Mission, terrain: Terrain, frame: LocalFrame | None
) -> tuple[Floats, Floats]:
    """Return positions along the path of a mission, shape (n, 2), and the height above ground at
    each position.

    A position may occur several times.
    """
    points = np.vstack([mission.home, mission.waypoints, mission.end])
    points = points if frame is None else frame.to_metres(points)
    ground = terrain.at(points, frame)
    height_known = mission.heights is not None or mission.altitude_frame != "ground"
    # without the height of home, heights above the sea are taken for heights above home
    above_sea = mission.altitude_frame == "sea" and mission.elevation is None
    base = 0.0 if above_sea else ground[0]
    ups = mission.heights_above_home + base if height_known else mission.levels + ground[1:-1]
    climb = None if mission.vertical_climb is None else mission.vertical_climb + base
    path = complete_path(
        points[0],
        np.column_stack([points[1:-1], ups]),
        points[-1],
        climb=climb,
        glides=mission.glides,
    )
    path = path[1 + (mission.kind == "fixed-wing") : -1]
    profile = ground_profile(terrain, path[:, :2], frame, error=_FINE)
    distances = partial_sums(step_lengths(profile.points))
    flown = np.interp(distances, distances[profile.vertices], path[:, 2])
    places = np.vstack([profile.points, path[:, :2]])
    return places, np.concatenate(
        [flown - profile.heights, path[:, 2] - profile.heights[profile.vertices]]
    )


def heights_along(
    path: Floats, terrain: Terrain, frame: LocalFrame | None
) -> tuple[Floats, Floats]:
    """Return a path with the points at which it crosses grid lines of a terrain, and points in
    between, shape (m, 3), and the least height above ground between neighbouring points, shape
    (m - 1,).

    Parameters
    ----------
    path : ndarray of float64, shape (k, 3)
        Points of the path as metres east, metres north, and metres above sea level.
    terrain : Terrain
    frame : LocalFrame or None
    """
    profile = ground_profile(terrain, path[:, :2], frame, error=_FINE)
    far = partial_sums(step_lengths(profile.points))
    ups = np.interp(far, far[profile.vertices], path[:, 2])
    above = ups - profile.heights - profile.rough
    return np.column_stack([profile.points, ups]), np.minimum(above[:-1], above[1:])


Place = tuple[float, float]


@dataclass(frozen=True)
class NearHomes:
    """Two different vehicles whose homes or landing points are nearest to each other.

    Parameters
    ----------
    robots : tuple of int
        Numbers of the two robots.
    distance : float
        Smallest distance in metres between a home or landing point of one robot and a home or
        landing point of the other robot.
    pairs : int
        Number of pairs of robots whose homes or landing points are nearer to each other than
        ``required``.
    required : float
        Horizontal separation of vehicles in flight, in metres.
    """

    robots: tuple[int, int]
    distance: float
    pairs: int
    required: float

    def report(self) -> dict[str, Any]:
        """Return the nearest homes as a mapping that can be written as JSON."""
        return {
            "robots": list(self.robots),
            "distance_m": self.distance,
            "pairs": self.pairs,
            "warning": str(self),
        }

    def __str__(self) -> str:
        first, second = self.robots
        more = (
            f" and {self.pairs - 1} more pair{'s' * (self.pairs > 2)} as near"
            if self.pairs > 1
            else ""
        )
        return (
            f"expected homes and landing points of different vehicles at least {self.required:g} m"
            f" apart, got {self.distance:.3g} m between robots {first} and {second}{more}; give each"
            " vehicle its own point, or clear the point before the next vehicle uses it"
        )


def near_homes(
    places: Iterable[tuple[int, Place]], required: float, frame: LocalFrame | None
) -> NearHomes | None:
    """Return the nearest homes or landing points of different robots, or None if all are at least
    ``required`` metres apart.

    Parameters
    ----------
    places : iterable of (int, (float, float))
        Pairs of a robot's number and the position of a home or landing point of this robot.
        Positions are in degrees if a frame is given, and otherwise in metres.
    required : float
        Smallest allowed distance in metres.
    frame : LocalFrame or None
        Local frame in which distances are measured.

    Raises
    ------
    InvalidInputError
        If a position is too far away for the frame.
    """
    import shapely

    homes = sorted({*places})
    if not homes:
        return None
    robots = np.array([robot for robot, _ in homes])
    points = np.array([place for _, place in homes])
    points = points if frame is None else frame.to_metres(points)
    shapes = shapely.points(points)
    first, second = shapely.STRtree(shapes).query(
        shapes, predicate="dwithin", distance=max(required - ROUNDING, 0.0)
    )
    first, second = np.stack([first, second])[:, robots[first] < robots[second]]
    if not len(first):
        return None
    distances = np.hypot(*(points[first] - points[second]).T)
    nearest = int(np.argmin(distances))
    pairs = len({*zip(robots[first].tolist(), robots[second].tolist(), strict=True)})
    return NearHomes(
        (int(robots[first[nearest]]), int(robots[second[nearest]])),
        float(distances[nearest]),
        pairs,
        required,
    )


def homes_of(missions: Iterable[Mission]) -> list[tuple[int, Place]]:
    """Return the homes and landing points of missions, as pairs of a robot's number and a position.

    A point at which a vehicle loiters is no landing point.
    """
    homes = [(mission.robot, mission.home) for mission in missions]
    return homes + [(mission.robot, mission.end) for mission in missions if mission.loiter is None]
