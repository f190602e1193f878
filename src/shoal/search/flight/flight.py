"""The flight of a vehicle from its home along a path and back home, with turns and terrain
following.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from math import atan2, ceil, cos, inf, pi, sin
from typing import Any

import numpy as np

from shoal.core.checks import check_choice, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.flight.dubins import NEAR, Costs, KnownCurves, dubins_way, room_beside, turned_way
from shoal.search.flight.terrain import (
    Floats,
    Profile,
    Terrain,
    followed,
    limited_climbs,
    profile_of,
)
from shoal.search.flight.timing import (
    Trajectory,
    climbs_apart,
    leg_seconds,
    lengthened,
    trajectory,
    whole_way,
)
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.outline import Points, text_of
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
# metres by which a merged leg may enter a blocked area; below the rounding of coordinates in files
_TOUCH = 0.004


@dataclass(frozen=True, eq=False)
class Flight:
    """The motion of a vehicle from its home along a path and back to its home.

    Parameters
    ----------
    vehicle : Vehicle
    home : ndarray of float64, shape (2,)
        Start point of the vehicle in metres.
    frame : LocalFrame or None
        Local frame of coordinates in metres, or None if the coordinates have no position on Earth.
    altitude_frame : "home", "sea" or "ground"
        Reference surface of the vehicle's altitude.
    terrain : Terrain or None
        Terrain heights. The altitude frame "ground" requires terrain heights.
    terrain_error : float
        Maximum deviation of the height above ground from the altitude, in metres.
    rate : float
        Speed of the robot divided by the vehicle's cruise speed.
    link : float
        Maximum length in metres of a straight leg that a fixed wing may replace by a curve.
    blocked : Shapely geometry, optional
        Areas that no turn may cross.
    landing : ndarray of float64, shape (2,), optional
        Landing point in metres. By default, the vehicle lands at its home.
    area : Shapely geometry, optional
        Area that a turn between two points inside this area must not leave.
    ending : "return", "land" or "loiter"
        Ending of the flight. With "land", a fixed wing descends steadily on a straight approach.
    free : Shapely geometry, optional
        Area that a path must not leave where legs are merged, unless the original path leaves it.
    curves : dict, optional
        Curves of other flights, which this flight uses, and to which it adds its own.

    Raises
    ------
    InvalidInputError
    """

    vehicle: Vehicle
    home: Points
    frame: LocalFrame | None = None
    altitude_frame: str = "home"
    terrain: Terrain | None = None
    terrain_error: float = TERRAIN_ERROR
    rate: float = 1.0
    link: float = 0.0
    blocked: Any = None
    landing: Points | None = None
    area: Any = None
    ending: str = "return"
    free: Any = None
    curves: dict[Any, Costs] | None = None

    def __post_init__(self) -> None:
        check_choice(self.altitude_frame, what="altitude_frame", choices=FRAMES)
        check_choice(self.ending, what="ending", choices=ENDINGS)
        check_number(self.terrain_error, what="terrain_error", least=0.01)
        if check_number(self.rate, what="rate", above=0) != 1.0:
            self.vehicle.replaced(
                cruise_speed=self.vehicle.cruise * self.rate
            )  # refuses a wind that is too strong for the vehicle
        if self.altitude_frame == "ground" and self.flies and self.terrain is None:
            raise InvalidInputError(
                "altitude_frame: expected home or sea without a terrain file, got ground"
            )

    @cached_property
    def _known(self) -> KnownCurves:
        if self.curves is None:
            return KnownCurves()
        areas = (None if shape is None else shape.wkb for shape in (self.blocked, self.area))
        return KnownCurves(self.curves.setdefault((self.radius, *areas), {}))

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
            None if self.terrain is None else float(self.terrain.at(self.home[None], self.frame)[0])
        )

    def waypoints(self, way: Points) -> Floats:
        """Return the waypoints of a path as metres east, north, and above home; float64, shape (m,
        3).

        The coordinates are rounded as in mission files. The home is not a waypoint. If waypoints
        follow the terrain, the points above home and landing point are waypoints. A fixed wing's
        first waypoint is the end of its straight climb after take-off.

        Parameters
        ----------
        way : ndarray of float64, shape (k, 2) or (k, 3)
            Points of the path in metres, without home. The third column holds altitudes. A path
            without a third column has the vehicle's altitude.

        Raises
        ------
        InvalidInputError
            If the path meets the ground, or if the vehicle has no space for a turn, a circle or its
            approach.
        """
        found = self._exact_waypoints(way)
        return np.column_stack([self._written(found[:, :2]), found[:, 2]])

    def _written(self, points: Points) -> Points:
        """Return points rounded as in a mission file. Rounding changes directions of short legs,
        and can add or remove turns.
        """
        return points if self.frame is None else self.frame.written(points)

    def _exact_waypoints(self, way: Points) -> Floats:
        """Return the waypoints of a path before their coordinates are rounded."""
        inner = way[:, 2] if way.shape[1] == 3 else np.full(len(way), self.vehicle.height)
        whole, ups = np.vstack([self.home, way[:, :2], self.end]), np.full(2, self.vehicle.height)
        whole, ups = climbs_apart(whole, np.pad(inner, 1, mode="edge") if len(inner) else ups)
        if self.vehicle.radius:
            return self._curved(whole, ups, way)
        if self.terrain is None:
            return self._level(whole[1:-1], ups[1:-1])
        borders = [0, *(np.flatnonzero(np.diff(ups)) + 1).tolist(), len(ups)]
        over = np.concatenate(
            [self._at(whole[begin:end], float(ups[begin])) for begin, end in pairwise(borders)]
        )
        return over if self._follows else over[1:-1]

    def lengthened(self, way: Points) -> Points:
        """Return a path without legs that are shorter than the acceptance radius of the vehicle,
        where this is possible.

        Both ends of the path stay. Fixed wings fly curves instead, and a path of narrow rows (see
        ``link``) keeps its rows.
        """
        least = min(_WIDER * (self.vehicle.acceptance_radius or 0.0) + _HAIR, self.link / 4)
        legs = np.hypot(*np.diff(way[:, :2], axis=0).T)
        if self.vehicle.radius or not ((legs > 0) & (legs < least)).any():
            return way
        import shapely

        blocked, free = self._bounds

        def allowed(piece: Points) -> bool:
            line = shapely.linestrings(piece)
            if blocked is not None and shapely.intersects(blocked, line):
                return False
            return free is None or bool(shapely.covers(free, line))

        return lengthened(way, least, allowed)

    @cached_property
    def _bounds(self) -> tuple[Any, Any]:
        """The blocked areas and the free area, each with a small tolerance for rounding errors."""
        import shapely

        blocked = (
            None if self.blocked is None or self.blocked.is_empty else self.blocked.buffer(-_TOUCH)
        )
        free = None if self.free is None else self.free.buffer(_TOUCH)
        shapely.prepare([shape for shape in (blocked, free) if shape is not None])
        return blocked, free

    @property
    def _follows(self) -> bool:
        """Whether the waypoints follow the terrain."""
        return self.flies and self.terrain is not None and self.altitude_frame == "ground"

    def _curved(self, whole: Points, ups: Floats, way: Points) -> Floats:
        """Return the waypoints of a fixed wing's path, with turns, and with circles for changes of
        altitude.
        """
        base = float(self.elevation or 0.0) if self.altitude_frame == "sea" else 0.0
        if self.glides:
            descent = self._approach(whole[-2], ups[-1] - base)
            before = (
                whole[:-1] if self._passes(whole[-2], descent) else whole
            )  # or over the landing point: the way there is free
            whole = np.vstack([before, descent, whole[[-1, -1]]])  # its last leg is flown straight
            ups = np.append(ups, np.full(len(whole) - len(ups), ups[-1]))
        away = [np.hypot(*(whole - whole[end]).T) > NEAR for end in (0, -1)]
        begin, end = (
            int(np.argmax(far)) if far.any() else len(far) for far in (away[0], away[1][::-1])
        )
        ups = np.concatenate(
            [np.full(begin, ups[begin - 1]), ups[begin : len(ups) - end], np.full(end, ups[-end])]
        )[: len(ups)]
        climb = self._departure(whole[min(begin, len(whole) - 1)], ups[0] - base)
        whole = np.vstack(
            [whole[[0, 0]], climb, whole[begin - (begin > 1) :]]
        )  # its first leg is flown straight
        ups = np.append(np.full(len(whole) - len(ups) + begin, ups[0]), ups[begin:])
        changes = np.flatnonzero(np.diff(ups)) + 1
        changes = changes[
            np.insert(np.diff(whole[changes], axis=0).any(axis=1), 0, np.ones(min(len(changes), 1)))
        ]
        stretches = turned_way(
            whole,
            self.radius,
            link=self.link,
            blocked=self.blocked,
            area=self.area,
            known=self._known,
            cuts=changes.tolist(),
        )
        last = stretches[-1][-2:]
        if self.glides:
            stretches[-1] = stretches[-1][:-1]
        levels = [*ups[changes - 1].tolist(), float(ups[-1])]
        flown = [self._at(stretch, up) for stretch, up in zip(stretches, levels, strict=True)]
        circles = [
            self._circles(one[-2:, :2], one[-1], other[0, 2])[1:-1]
            for one, other in pairwise(flown)
        ]
        found = np.vstack(
            [flown[0], *(piece for pair in zip(circles, flown[1:], strict=True) for piece in pair)]
        )
        first, found = found[:2, :2], found[1:]
        if found[0, 2] > (most := self._rooms(first)[0][0]) + _HAIR:
            found = np.vstack(
                [self._circles(first, np.append(first[1], most), found[0, 2])[:-1], found]
            )
        if not self.glides:
            kept = (
                self._follows or np.hypot(*(way[-1, :2] - self.end)) <= NEAR
            )  # the end is also a waypoint
            return found if kept else found[:-1]
        if found[-1, 2] > (most := self._rooms(last)[1][0]) + _HAIR:
            found = np.vstack([found, self._circles(last, found[-1], most)[1:]])
        return found

    def _rooms(self, way: Points) -> tuple[Floats, Floats]:
        """Return, for each leg of a level path, the largest possible climb and the largest possible
        descent in metres.
        """
        lasting = leg_seconds(
            np.column_stack([way, np.zeros(len(way))]), self.vehicle, rate=self.rate
        )
        return lasting * (self.vehicle.climb_speed or inf), lasting * (
            self.vehicle.sink_speed or inf
        )

    def _circles(self, leg: Points, place: Floats, top: float) -> Floats:
        """Return a path in circles from the point ``place`` to the height ``top``, beginning in the
        direction of ``leg``.
        """
        toward = leg[1] - leg[0]
        start = np.append(place[:2], np.arctan2(toward[1], toward[0]))
        sense = self._sense(start)
        if not sense:
            raise InvalidInputError(
                f"turn_radius: expected room to climb in a circle of {self.radius:.4g} m, got none"
                f" at {text_of(place[:2])}"
            )
        lasting = float(self.vehicle.vertical_seconds(top - place[2]))
        length = lasting * (self.vehicle.cruise * self.rate + self.vehicle.wind)
        circles = max(1, ceil(length / (2 * pi * self.radius)))
        way = dubins_way(start, sense, [2 * pi * circles], self.radius)
        far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        return np.column_stack([way, place[2] + (top - place[2]) * far / far[-1]])

    @cached_property
    def _around(self) -> Points:
        """Offsets in metres from a point, in all directions, to the farthest points of a turn that
        begins at this point.
        """
        angles = np.linspace(0.0, 2 * pi, _DIRECTIONS, endpoint=False)
        return 2 * self.radius * np.column_stack([np.cos(angles), np.sin(angles)])

    def _sense(self, start: Floats) -> str:
        """Return the side on which a vehicle has room for a circle: "L", "R" or an empty text.

        The argument ``start`` holds the position in metres and the heading in radians.
        """
        return room_beside(start, self.radius, blocked=self.blocked, area=self.area)

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

    def _departure(self, then: Points, up: float) -> Points:
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
        bounded = self.area is not None and shapely.intersects_xy(self.area, *self.home)
        for lengths, inside in (
            ((whole, safe), bounded),
            ((least,), bounded),
            ((whole, safe, least), False),
        ):
            for course, speed in self._directions(then - self.home):
                found = []
                for lasting in lengths:
                    far = max(lasting * speed, 2 * self.radius)
                    end, height = (
                        self.home + course * far,
                        min(up, far / speed * float(self.vehicle.climb_speed or inf)),
                    )
                    leaves = inside and not shapely.covers(
                        self.area, shapely.linestrings([self.home, end])
                    )
                    if (
                        not leaves
                        and self._free(self.home, end, course)
                        and self._clear(self.home, end, height)
                    ):
                        found.append(
                            (float(np.hypot(*(then - end))) + around * (lasting < whole), end)
                        )
                if found:
                    return min(found, key=lambda one: one[0])[1]
        raise InvalidInputError(
            "launch: expected a path without no-go zones and higher ground, on which the vehicle"
            f" climbs by {up:g} m from {text_of(self.home)}, got none in any direction"
        )

    def _approach(self, last: Points, up: float) -> Points:
        """Return the start of a landing approach. The approach leads as directly against the wind
        as space allows.
        """
        lasting = float(self.vehicle.vertical_seconds(-up))
        for course, speed in self._directions(self.end - last):
            best = self.end - course * max(lasting * speed, 2 * self.radius)
            if self._free(self.end, best, course) and self._clear(self.end, best, up):
                return np.asarray(best)
        raise InvalidInputError(
            "landing: expected a path without no-go zones and higher ground, on which the vehicle"
            f" sinks by {up:g} m to {text_of(self.end)}, got none from any direction"
        )

    def _free(self, low: Points, high: Points, course: Points) -> bool:
        """Return whether a leg avoids blocked areas and also leaves the vehicle room to turn at the
        upper end of the leg.
        """
        return self._passes(low, high) and bool(
            self._sense(np.append(high, atan2(course[1], course[0])))
        )

    def _passes(self, one: Points, other: Points) -> bool:
        """Return whether a straight leg avoids blocked areas."""
        import shapely

        return self.blocked is None or not shapely.intersects(
            self.blocked, shapely.linestrings([one, other])
        )

    def _clear(self, low: Points, high: Points, up: float) -> bool:
        """Return whether a climb from the ground, or a descent to the ground, stays above the
        terrain.

        A turn at the upper end must stay above the terrain too. The result is False where the
        height of the ground is unknown.
        """
        if self.terrain is None:
            return True
        shares = np.linspace(0.0, _TOUCHING, 64)[:, None]
        try:
            around = self.terrain.at(high + self._around, self.frame)
            ground = self.terrain.at((1 - shares) * high + shares * low, self.frame)
            base = float(self.terrain.at(low[None], self.frame)[0])
        except InvalidInputError:
            return False  # where the height of the ground is unknown
        return bool(
            (base + (1 - shares[:, 0]) * up > ground).all() and (base + up / 2 >= around).all()
        )

    def _at(self, way: Points, up: float) -> Floats:
        """Return the waypoints of a path with one altitude. With the altitude frame "ground", the
        waypoints follow the terrain.
        """
        terrain = self.terrain
        if terrain is None or not self.flies:
            return self._level(way, np.full(len(way), up))
        profile = profile_of(terrain, way, self.frame, error=self.terrain_error)
        base = float(self.elevation or 0.0)
        if self.altitude_frame == "ground":
            if self.vehicle.radius:  # others may climb where they stand
                profile = replace(
                    profile, heights=limited_climbs(profile.heights, *self._rooms(profile.points))
                )
            over = followed(profile, up, self.terrain_error) - (0.0, 0.0, base)
            over = over[np.concatenate([[True], np.diff(over[:, :2], axis=0).any(axis=1)])]
            if self.vehicle.radius:
                over[:, 2] = limited_climbs(over[:, 2], *self._rooms(over[:, :2]))
            return np.asarray(over)
        self._check_clear(profile, up, base if self.altitude_frame == "home" else 0.0)
        return self._level(way, np.full(len(way), up))

    def _level(self, way: Points, ups: Floats) -> Floats:
        """Return the waypoints of a path with given altitudes, which do not follow the terrain."""
        base = float(self.elevation or 0.0) if self.altitude_frame == "sea" and self.flies else 0.0
        return np.column_stack([way, ups - base])

    def _check_clear(self, profile: Profile, up: float, base: float) -> None:
        """Refuse a level path that meets the ground."""
        highest = int(np.argmax(profile.heights))
        if profile.heights[highest] + profile.rough >= up + base:
            place = text_of(profile.points[highest])
            raise InvalidInputError(
                f"altitude: expected more than {profile.heights[highest] - base:.4g} m above"
                f" {self.altitude_frame}, the height of the ground at {place}, got {up:g}"
            )

    def flown(self, waypoints: Floats) -> Trajectory:
        """Return the vehicle's trajectory from the ground at its home, along waypoints, to the
        ground at its landing point.
        """
        climb = 0.0 if self.vehicle.radius else None
        home, end = self._written(np.vstack([self.home, self.end]))
        return trajectory(
            whole_way(home, waypoints, end, climb=climb, glides=self.glides),
            self.vehicle,
            rate=self.rate,
        )
