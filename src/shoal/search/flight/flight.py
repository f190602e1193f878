"""The flight of a vehicle from its home along a path and back home, with turns and terrain
following.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise
from math import atan2, ceil, cos, inf, pi, sin

import numpy as np

from shoal.core.checks import check_choice, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums, step_lengths, unit_vectors
from shoal.search.flight.dubins import NEAR, Airspace, NoRoomError, circles, plan_dubins_path
from shoal.search.flight.legs import complete_path, lengthen_short_legs, separate_climbs
from shoal.search.flight.terrain import (
    Floats,
    Profile,
    Terrain,
    follow_terrain,
    ground_profile,
    limit_climbs,
)
from shoal.search.flight.timing import Trajectory, leg_seconds, trajectory
from shoal.search.flight.vehicle import Vehicle, vehicle_of
from shoal.search.regions.outline import Points, check_plane_points, text_of
from shoal.search.regions.projection import LocalFrame

FRAMES = ("home", "sea", "ground")
"""Reference surfaces of altitudes."""

ENDINGS = ("return", "land", "loiter")
"""Endings of a flight: a return by the autopilot, a landing, or a stay in the air, in which a fixed
wing flies circles.
"""

TERRAIN_ERROR = 2.0  # metres
_WIDER = 1.01  # factor for wider turns than necessary, because coordinates in files are rounded
_DIRECTIONS = 12  # number of directions among which those of a take-off and a landing are chosen
_TOUCHING = 0.9  # upper part of a climb or an approach; the rest may be near the ground
_SAFE = 40.0  # metres: height at which a fixed wing may turn after take-off
_HAIR = 0.01  # metres


@dataclass(frozen=True, eq=False)
class Altitudes:
    """What the altitudes of a flight mean.

    Parameters
    ----------
    frame : "home", "sea" or "ground"
        Reference surface of the vehicle's altitude.
    terrain : Terrain or None
        Terrain heights. The frame "ground" requires terrain heights; with another frame, a path
        that meets the ground is refused.
    error : float
        Maximum deviation of the height above ground from the altitude, in metres, in the frame
        "ground". Additional waypoints keep the deviation below it.
    """

    frame: str = "home"
    terrain: Terrain | None = None
    error: float = TERRAIN_ERROR

    def __post_init__(self) -> None:
        check_choice(self.frame, what="altitude_frame", choices=FRAMES)
        check_number(self.error, what="terrain_error", least=0.01)


@dataclass(frozen=True, eq=False)
class Flight:
    """The motion of a vehicle from its home along a path and back to its home.

    Parameters
    ----------
    vehicle : Vehicle or str
        A vehicle, or a text that `vehicle_of` understands.
    home : array_like of float, shape (2,), optional
        Start point of the vehicle in metres. By default, the first point of the path that
        `split_missions` divides.
    frame : LocalFrame or None
        Local frame of coordinates in metres, or None if the coordinates have no position on Earth.
    landing : array_like of float, shape (2,), optional
        Landing point in metres. By default, the vehicle lands at its home.
    ending : "return", "land" or "loiter", optional
        Ending of the flight. By default, a landing at the landing point, or a return without one.
        With "land", a fixed wing descends steadily on a straight approach. Instead of landing, a
        rover stops and holds.
    altitudes : Altitudes
    airspace : Airspace
        Where the vehicle may fly.
    rate : float
        Speed of the robot divided by the vehicle's cruise speed.
    link : float
        Maximum length in metres of a straight leg that a fixed wing may replace by a curve.
    """

    vehicle: Vehicle = "multirotor"  # type: ignore[assignment]  # settled below
    home: Points = None  # type: ignore[assignment]  # settled by `split_missions`
    frame: LocalFrame | None = None
    landing: Points | None = None
    ending: str = None  # type: ignore[assignment]  # settled below
    altitudes: Altitudes = Altitudes()
    airspace: Airspace = field(default_factory=Airspace)
    rate: float = 1.0
    link: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "vehicle", vehicle_of(self.vehicle))
        for name in ("home", "landing"):
            if getattr(self, name) is not None:
                point = check_plane_points([getattr(self, name)], what=name)[0]
                object.__setattr__(self, name, point)
        if self.ending is None:
            object.__setattr__(self, "ending", "return" if self.landing is None else "land")
        check_choice(self.ending, what="ending", choices=ENDINGS)
        if self.ending == "return" and self.landing is not None:
            raise InvalidInputError(
                "ending: expected land or loiter with a landing point, because a return leads home,"
                " got return"
            )
        if check_number(self.rate, what="rate", above=0) != 1.0:
            # refuses a wind that is too strong for the vehicle
            self.vehicle.replaced(cruise_speed=self.vehicle.cruise * self.rate)
        if self._follows and self.altitudes.terrain is None:
            raise InvalidInputError(
                "altitude_frame: expected home or sea without a terrain file, got ground"
            )

    @cached_property
    def _loose(self) -> set[bytes]:
        """Vertices at which straight legs had to be shortened; see `plan_dubins_path`."""
        return set()

    @property
    def end(self) -> Points:
        """Landing point in metres."""
        return self.home if self.landing is None else self.landing

    @property
    def flies(self) -> bool:
        """Whether the vehicle leaves the ground."""
        return self.vehicle.kind != "rover"

    @property
    def radius(self) -> float:
        """Radius of flown turns in metres, or 0 for a vehicle that turns on the spot."""
        return _WIDER * self.vehicle.ground_radius

    @property
    def glides(self) -> bool:
        """Whether the vehicle is a fixed wing that descends to its landing point along the last
        leg.
        """
        return bool(self.vehicle.radius) and self.ending == "land"

    @cached_property
    def elevation(self) -> float | None:
        """Height of the vehicle's home above sea level in metres, or None without
        terrain heights.
        """
        return (
            None
            if self.altitudes.terrain is None
            else float(self.altitudes.terrain.at(self.home[None], self.frame)[0])
        )

    def waypoints(self, path: Points) -> Floats:
        """Return the waypoints of a path as metres east, north, and above home; float64, shape (m,
        3).

        The coordinates are rounded as in mission files. The home is not a waypoint. If waypoints
        follow the terrain, the points above home and landing point are waypoints. A fixed wing's
        first waypoint is the end of its straight climb after take-off.

        Parameters
        ----------
        path : ndarray of float64, shape (k, 2) or (k, 3)
            Points of the path in metres, without home. The third column holds altitudes. A path
            without a third column has the vehicle's altitude.

        Raises
        ------
        InvalidInputError
            If the path meets the ground, or if the vehicle has no space for a turn, a circle or its
            approach.
        """
        waypoints = self._exact_waypoints(path)
        return np.column_stack([self._rounded(waypoints[:, :2]), waypoints[:, 2]])

    def height_at(self, point: Points) -> float:
        """Return the planned height above home at a point of a path, in metres, without what other
        points demand. The point has the coordinates of `waypoints`.
        """
        up = float(point[2]) if len(point) > 2 else float(self.vehicle.height)
        there = np.tile(point[:2], (2, 1))
        there[1, 0] += NEAR
        return float(self._waypoints_at(there, up)[0, 2])

    def _rounded(self, points: Points) -> Points:
        """Return points rounded as in a mission file. Rounding changes directions of short legs,
        and can add or remove turns.
        """
        return points if self.frame is None else self.frame.written(points)

    def _exact_waypoints(self, path: Points) -> Floats:
        """Return the waypoints of a path before their coordinates are rounded."""
        inner = path[:, 2] if path.shape[1] == 3 else np.full(len(path), self.vehicle.height)
        whole, ups = np.vstack([self.home, path[:, :2], self.end]), np.full(2, self.vehicle.height)
        whole, ups = separate_climbs(whole, np.pad(inner, 1, mode="edge") if len(inner) else ups)
        if self.vehicle.radius:
            return self._curved_waypoints(whole, ups, path)
        if self.altitudes.terrain is None:
            return self._level_waypoints(whole[1:-1], ups[1:-1])
        borders = [0, *(np.flatnonzero(np.diff(ups)) + 1).tolist(), len(ups)]
        over = np.concatenate(
            [
                self._waypoints_at(whole[begin:end], float(ups[begin]))
                for begin, end in pairwise(borders)
            ]
        )
        return over if self._follows else over[1:-1]

    def lengthen_short_legs(self, path: Points) -> Points:
        """Return a path without legs that are shorter than the acceptance radius of the vehicle,
        where this is possible.

        Both ends of the path stay. Fixed wings fly curves instead, and a path of narrow rows (see
        ``link``) keeps its rows.
        """
        least = min(_WIDER * (self.vehicle.acceptance_radius or 0.0) + _HAIR, self.link / 4)
        legs = step_lengths(path[:, :2])
        if self.vehicle.radius or not ((legs > 0) & (legs < least)).any():
            return path
        return lengthen_short_legs(path, least, self.airspace.allows)

    @property
    def _follows(self) -> bool:
        """Whether the waypoints follow the terrain."""
        return self.flies and self.altitudes.frame == "ground"

    def _curved_waypoints(self, whole: Points, ups: Floats, path: Points) -> Floats:
        """Return the waypoints of a fixed wing's path, with turns, and with circles for changes of
        altitude.
        """
        base = float(self.elevation or 0.0) if self.altitudes.frame == "sea" else 0.0
        if self.glides:
            descent = self._plan_approach(whole[-2], ups[-1] - base)
            # or over the landing point: the path there is free
            before = whole[:-1] if self._passes(whole[-2], descent) else whole
            whole = np.vstack([before, descent, whole[[-1, -1]]])  # its last leg is flown straight
            ups = np.append(ups, np.full(len(whole) - len(ups), ups[-1]))
        away = [np.hypot(*(whole - whole[end]).T) > NEAR for end in (0, -1)]
        begin, end = (
            int(np.argmax(far)) if far.any() else len(far) for far in (away[0], away[1][::-1])
        )
        ups = np.concatenate(
            [np.full(begin, ups[begin - 1]), ups[begin : len(ups) - end], np.full(end, ups[-end])]
        )[: len(ups)]
        then = whole[min(begin, len(whole) - 1)]
        climb = self._plan_departure(then, ups[0] - base)
        # its first leg is flown straight; or back over home: the path from there is free
        over_home = begin > 1 or not self._passes(climb, then)
        whole = np.vstack([whole[[0, 0]], climb, whole[begin - over_home :]])
        ups = np.append(np.full(len(whole) - len(ups) + begin, ups[0]), ups[begin:])
        changes = np.flatnonzero(np.diff(ups)) + 1
        changes = changes[
            np.insert(np.diff(whole[changes], axis=0).any(axis=1), 0, np.ones(min(len(changes), 1)))
        ]
        stretches = plan_dubins_path(
            whole,
            self.radius,
            link=self.link,
            airspace=self.airspace,
            loose=self._loose,
            cuts=changes.tolist(),
        )
        last = stretches[-1][-2:]
        if self.glides:
            stretches[-1] = stretches[-1][:-1]
        levels = [*ups[changes - 1].tolist(), float(ups[-1])]
        flown = [
            self._waypoints_at(stretch, up) for stretch, up in zip(stretches, levels, strict=True)
        ]
        circles = [
            self._circle_climb(before_climb[-2:, :2], before_climb[-1], after_climb[0, 2])[1:-1]
            for before_climb, after_climb in pairwise(flown)
        ]
        waypoints = np.vstack(
            [flown[0], *(piece for pair in zip(circles, flown[1:], strict=True) for piece in pair)]
        )
        first, waypoints = waypoints[:2, :2], waypoints[1:]
        if waypoints[0, 2] > (most := self._climb_limits(first)[0][0]) + _HAIR:
            waypoints = np.vstack(
                [
                    self._circle_climb(first, np.append(first[1], most), waypoints[0, 2])[:-1],
                    waypoints,
                ]
            )
        if not self.glides:
            # the end is also a waypoint
            ends_at_waypoint = self._follows or np.hypot(*(path[-1, :2] - self.end)) <= NEAR
            return waypoints if ends_at_waypoint else waypoints[:-1]
        if waypoints[-1, 2] > (most := self._climb_limits(last)[1][0]) + _HAIR:
            waypoints = np.vstack([waypoints, self._circle_climb(last, waypoints[-1], most)[1:]])
        return waypoints

    def _climb_limits(self, path: Points) -> tuple[Floats, Floats]:
        """Return, for each leg of a level path, the largest possible climb and the largest possible
        descent in metres.
        """
        lasting = leg_seconds(
            np.column_stack([path, np.zeros(len(path))]), self.vehicle, rate=self.rate
        )
        return lasting * (self.vehicle.climb_speed or inf), lasting * (
            self.vehicle.sink_speed or inf
        )

    def _circle_climb(self, leg: Points, place: Floats, top: float) -> Floats:
        """Return a path in circles from the point ``place`` to the height ``top``, beginning in the
        direction of ``leg``.
        """
        toward = leg[1] - leg[0]
        start = np.append(place[:2], np.arctan2(toward[1], toward[0]))
        side = self.airspace.circle_side(start, self.radius)
        if not side:
            raise NoRoomError(
                f"turn_radius: expected room to climb in a circle of {self.radius:.4g} m, got none"
                f" at {text_of(place[:2])}"
            )
        lasting = float(self.vehicle.vertical_seconds(top - place[2]))
        length = lasting * (self.vehicle.cruise * self.rate + self.vehicle.wind)
        count = max(1, ceil(length / (2 * pi * self.radius)))
        path = circles(start, side, count, self.radius)
        far = partial_sums(step_lengths(path))
        return np.column_stack([path, place[2] + (top - place[2]) * far / far[-1]])

    @cached_property
    def _around(self) -> Points:
        """Offsets in metres from a point, in all directions, to the farthest points of a turn that
        begins at this point.
        """
        angles = np.linspace(0.0, 2 * pi, _DIRECTIONS, endpoint=False)
        return 2 * self.radius * unit_vectors(angles)

    def _directions(self, toward: Points) -> Iterator[tuple[Points, float]]:
        """Yield unit vectors of possible courses, and the ground speed in m/s on each course.

        The first course leads against the wind or, without wind, in the direction ``toward``.
        """
        ahead = -self.vehicle.wind_vector if self.vehicle.wind else toward
        for number in range(_DIRECTIONS):
            heading = (
                atan2(ahead[1], ahead[0])
                + (-1) ** number * ((number + 1) // 2) * 2 * pi / _DIRECTIONS
            )
            course = np.array([cos(heading), sin(heading)])
            yield course, float(self.vehicle.ground_speed([course])[0]) * self.rate

    def _plan_departure(self, then: Points, up: float) -> Points:
        """Return the end of the straight climb after take-off. After the climb, the path continues
        to the point ``then``.

        If circles make the path shorter, or if a straight climb has no room, the vehicle climbs the
        rest of the height in circles.
        """
        import shapely

        around = 2 * pi * self.radius
        safe, least = (
            float(self.vehicle.vertical_seconds(height)) for height in (min(_SAFE, up), 0.0)
        )
        whole = float(self.vehicle.vertical_seconds(up))
        bounded = self.airspace.area is not None and shapely.intersects_xy(
            self.airspace.area, *self.home
        )
        for lengths, inside in (
            ((whole, safe), bounded),
            ((least,), bounded),
            ((whole, safe, least), False),
        ):
            for course, speed in self._directions(then - self.home):
                courses = []
                for lasting in lengths:
                    far = max(lasting * speed, 2 * self.radius)
                    end, height = (
                        self.home + course * far,
                        min(up, far / speed * float(self.vehicle.climb_speed or inf)),
                    )
                    leaves = inside and not shapely.covers(
                        self.airspace.area, shapely.linestrings([self.home, end])
                    )
                    if (
                        not leaves
                        and self._has_room(self.home, end, course)
                        and self._clears_terrain(self.home, end, height)
                    ):
                        over = [end, then] if self._passes(end, then) else [end, self.home, then]
                        length = float(np.hypot(*np.diff(over, axis=0).T).sum())
                        courses.append((length + around * (lasting < whole), end))
                if courses:
                    return min(courses, key=lambda course: course[0])[1]
        raise NoRoomError(
            "launch: expected a path without no-go zones and higher ground, on which the vehicle"
            f" climbs by {up:g} m from {text_of(self.home)}, got none in any direction"
        )

    def _plan_approach(self, last: Points, up: float) -> Points:
        """Return the start of a landing approach. The approach leads as directly against the wind
        as space allows.
        """
        lasting = float(self.vehicle.vertical_seconds(-up))
        for course, speed in self._directions(self.end - last):
            best = self.end - course * max(lasting * speed, 2 * self.radius)
            if self._has_room(self.end, best, course) and self._clears_terrain(self.end, best, up):
                return np.asarray(best)
        raise NoRoomError(
            "landing: expected a path without no-go zones and higher ground, on which the vehicle"
            f" sinks by {up:g} m to {text_of(self.end)}, got none from any direction"
        )

    def _has_room(self, low: Points, high: Points, course: Points) -> bool:
        """Return whether a leg avoids blocked areas and also leaves the vehicle room to turn at the
        upper end of the leg.
        """
        return self._passes(low, high) and bool(
            self.airspace.circle_side(np.append(high, atan2(course[1], course[0])), self.radius)
        )

    def _passes(self, start: Points, end: Points) -> bool:
        """Return whether a straight leg avoids blocked areas."""
        import shapely

        return self.airspace.blocked is None or not shapely.intersects(
            self.airspace.blocked, shapely.linestrings([start, end])
        )

    def _clears_terrain(self, low: Points, high: Points, up: float) -> bool:
        """Return whether a climb from the ground, or a descent to the ground, stays above the
        terrain.

        A turn at the upper end must stay above the terrain too. The result is False where the
        height of the ground is unknown.
        """
        if self.altitudes.terrain is None:
            return True
        shares = np.linspace(0.0, _TOUCHING, 64)[:, None]
        try:
            around = self.altitudes.terrain.at(high + self._around, self.frame)
            ground = self.altitudes.terrain.at((1 - shares) * high + shares * low, self.frame)
            base = float(self.altitudes.terrain.at(low[None], self.frame)[0])
        except InvalidInputError:
            return False  # where the height of the ground is unknown
        return bool(
            (base + (1 - shares[:, 0]) * up > ground).all() and (base + up / 2 >= around).all()
        )

    def _waypoints_at(self, path: Points, up: float) -> Floats:
        """Return the waypoints of a path with one altitude. With the altitude frame "ground", the
        waypoints follow the terrain.
        """
        terrain = self.altitudes.terrain
        if terrain is None or not self.flies:
            return self._level_waypoints(path, np.full(len(path), up))
        profile = ground_profile(terrain, path, self.frame, error=self.altitudes.error)
        base = float(self.elevation or 0.0)
        if self.altitudes.frame == "ground":
            if self.vehicle.radius:  # others may climb where they stand
                profile = replace(
                    profile,
                    heights=limit_climbs(profile.heights, *self._climb_limits(profile.points)),
                )
            over = self._follow(profile, up) - (0.0, 0.0, base)
            over = over[np.concatenate([[True], np.diff(over[:, :2], axis=0).any(axis=1)])]
            if self.vehicle.radius:
                over[:, 2] = limit_climbs(over[:, 2], *self._climb_limits(over[:, :2]))
            return np.asarray(over)
        self._check_clears_terrain(profile, up, base if self.altitudes.frame == "home" else 0.0)
        return self._level_waypoints(path, np.full(len(path), up))

    def _follow(self, profile: Profile, up: float) -> Floats:
        """Return a path with a nearly constant height above the ground, and with a camera nowhere
        below this height: it would see less than planned.
        """
        error = self.altitudes.error
        if self.vehicle.image_size is None:
            return follow_terrain(profile, up, error)
        over = follow_terrain(profile, up + error / 2, error / 2)
        far, own = (partial_sums(step_lengths(points[:, :2])) for points in (profile.points, over))
        flown = np.interp(far, own, over[:, 2])
        spare = float((flown - profile.heights).min()) - profile.rough - up
        return over - (0.0, 0.0, max(spare, 0.0))

    def _level_waypoints(self, path: Points, ups: Floats) -> Floats:
        """Return the waypoints of a path with given altitudes, which do not follow the terrain."""
        base = float(self.elevation or 0.0) if self.altitudes.frame == "sea" and self.flies else 0.0
        return np.column_stack([path, ups - base])

    def _check_clears_terrain(self, profile: Profile, up: float, base: float) -> None:
        """Refuse a level path that meets the ground."""
        highest = int(np.argmax(profile.heights))
        if profile.heights[highest] + profile.rough >= up + base:
            place = text_of(profile.points[highest])
            raise InvalidInputError(
                f"altitude: expected more than {profile.heights[highest] - base:.4g} m above"
                f" {self.altitudes.frame}, the height of the ground at {place}, got {up:g}"
            )

    def trajectory(self, waypoints: Floats) -> Trajectory:
        """Return the vehicle's trajectory from the ground at its home, along waypoints, to the
        ground at its landing point.
        """
        climb = 0.0 if self.vehicle.radius else None
        home, end = self._rounded(np.vstack([self.home, self.end]))
        return trajectory(
            complete_path(home, waypoints, end, climb=climb, glides=self.glides),
            self.vehicle,
            rate=self.rate,
        )
