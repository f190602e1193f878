"""Ways between homes and routes: launch points, rally points and returns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.geometry import partial_sums, step_lengths
from shoal.missions.mission import Mission
from shoal.missions.rules import ROUNDING, inside_of, search_slice
from shoal.search.flight.legs import complete_path
from shoal.search.flight.separation import Approach, Separation, nearest_approach
from shoal.search.flight.terrain import Terrain, ground_profile
from shoal.search.flight.timing import Floats, Trajectory, trajectory
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
    horizontal, vertical : float
        Horizontal and vertical distance of the two vehicles at the nearest approach, in metres.
    time : float
        Time of the nearest approach in seconds after the start of the first missions, if the first
        vehicle has no unplanned delay.
    place : ndarray of float64, shape (3,)
        Position of the first vehicle at the nearest approach: metres east, north and up.
    """

    robots: tuple[int, int]
    sorties: tuple[int, int]
    horizontal: float
    vertical: float
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
        count as an approach.
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
    flights = _Flights(
        {(mission.robot, mission.sortie): mission for mission in missions},
        separation,
        frame,
        vehicle,
    )
    best: MissionApproach | None = None
    for first, second in combinations(sorted(flights.missions), 2):
        approach = None if first[0] == second[0] else flights.approach(first, second)
        if approach is not None and (best is None or approach.horizontal < best.horizontal):
            time = flights.starts[first] + approach.times[0]
            best = MissionApproach(
                (first[0], second[0]),
                (first[1], second[1]),
                approach.horizontal,
                approach.vertical,
                time,
                approach.places[0],
            )
    return best


class _Flights:
    """The missions of all robots, with start times on one common clock."""

    def __init__(
        self,
        missions: dict[tuple[int, int], Mission],
        separation: Separation,
        frame: LocalFrame | None,
        vehicle: Vehicle | None,
    ) -> None:
        self.missions, self.separation = missions, separation
        self.vehicles = {
            key: constant_speed(mission) if vehicle is None else vehicle
            for key, mission in missions.items()
        }
        self.paths = {key: common_path(mission, frame) for key, mission in missions.items()}
        self.trajectories = {key: self._trajectory(key, 0.0) for key in missions}
        self.starts: dict[tuple[int, int], float] = {}
        for key in sorted(missions, key=lambda key: key[::-1]):
            before = [
                start + self.trajectories[earlier].duration
                for earlier, start in self.starts.items()
                if earlier[1] < key[1]
            ]
            earliest = max(before) + separation.delay if before else 0.0
            planned = missions[key].start
            self.starts[key] = earliest if planned is None else planned
        last = (
            max(
                (start + self.trajectories[key].duration for key, start in self.starts.items()),
                default=0.0,
            )
            + separation.delay
        )
        for key, mission in missions.items():
            if mission.loiter is not None and (key[0], key[1] + 1) not in missions:
                self.trajectories[key] = self._trajectory(
                    key, last - self.starts[key] - self.trajectories[key].duration
                )

    def _trajectory(self, key: tuple[int, int], stay: float) -> Trajectory:
        mission, vehicle = self.missions[key], self.vehicles[key]
        return mission_trajectory(mission, self.paths[key], vehicle, mission.rates(vehicle), stay)

    def approach(self, first: tuple[int, int], second: tuple[int, int]) -> Approach | None:
        """Return the nearest approach on two missions, or None if the vehicles always keep the
        vertical separation.
        """
        first_flight, second_flight = self.trajectories[first], self.trajectories[second]
        apart = self.separation
        later = self.starts[second] - self.starts[first]
        earliest, latest = (
            -second_flight.duration - apart.delay,
            first_flight.duration + apart.delay,
        )
        if not earliest <= later <= latest:
            return None
        return nearest_approach(
            first_flight, second_flight, vertical=apart.vertical, later=later, tolerance=apart.delay
        )


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
