"""Flight of a vehicle from home along a path and back, with turns and terrain following."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from shoal.core.checks import check_choice, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.flight.terrain import Floats, Profile, Terrain, followed, profile_of
from shoal.search.flight.timing import Trajectory, trajectory
from shoal.search.flight.turning import NEAR, KnownCurves, turned_way
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.outline_checks import Points, text_of
from shoal.search.regions.projection import LocalFrame

FRAMES = ("home", "sea", "ground")
"""Reference surfaces of altitudes."""

TERRAIN_ERROR = 2.0  # metres
_WIDER = 1.01  # factor for wider turns than necessary, because coordinates in files are rounded


@dataclass(frozen=True, eq=False)
class Flight:
    """The motion of a vehicle from home along a path and home again.

    Parameters
    ----------
    vehicle : Vehicle
    home : ndarray of float64, shape (2,)
        Metres.
    frame : LocalFrame or None
        Position of the local frame on Earth.
    altitude_frame : "home", "sea" or "ground"
        Reference of the vehicle's altitude.
    terrain : Terrain or None
        Terrain heights, required for altitudes above the ground.
    terrain_error : float
        Maximum deviation of the height above ground from the altitude, in metres.
    rate : float
        Speed of this robot relative to the vehicle's speed.
    link : float
        Length in metres up to which a fixed wing may leave a straight leg.
    blocked : Shapely geometry, optional
        Areas that no turn may cross.
    landing : ndarray of float64, shape (2,), optional
        Landing point in metres. The default is home.

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

    def __post_init__(self) -> None:
        check_choice(self.altitude_frame, what="altitude_frame", choices=FRAMES)
        check_number(self.terrain_error, what="terrain_error", least=0.01)
        if check_number(self.rate, what="rate", above=0) != 1.0:
            self.vehicle.replaced(cruise_speed=self.vehicle.cruise * self.rate)  # refuses a wind that is too strong for the vehicle
        if self.altitude_frame == "ground" and self.flies and self.terrain is None:
            raise InvalidInputError("altitude_frame: expected home or sea without a terrain, which has the heights of the ground")

    @cached_property
    def _known(self) -> KnownCurves:
        return KnownCurves()

    @property
    def end(self) -> Points:
        """Landing point in metres."""
        return self.home if self.landing is None else self.landing

    @property
    def flies(self) -> bool:
        """Whether the vehicle leaves the ground."""
        return self.vehicle.kind != "rover"

    @cached_property
    def elevation(self) -> float | None:
        """Height of home above sea level in metres, or None if unknown."""
        return None if self.terrain is None else float(self.terrain.at(self.home[None], self.frame)[0])

    def waypoints(self, way: Points) -> Floats:
        """Return the waypoints of a path; float64, shape (m, 3): metres east, north, and above home.

        Home itself is not a waypoint. Over terrain, the point above home is the first and the last waypoint.

        Parameters
        ----------
        way : ndarray of float64, shape (k, 2) or (k, 3)
            Path in metres, without home. The third column holds altitudes; the default is the vehicle's altitude.

        Raises
        ------
        InvalidInputError
            If the path has several altitudes and the vehicle cannot climb vertically, or if the path meets the ground.
        """
        inner = way[:, 2] if way.shape[1] == 3 else np.full(len(way), self.vehicle.height)
        whole, ups = np.vstack([self.home, way[:, :2], self.end]), np.full(2, self.vehicle.height)
        ups = np.pad(inner, 1, mode="edge") if len(inner) else ups
        if self.vehicle.radius:
            if np.ptp(ups):
                raise InvalidInputError("vehicle: expected one that climbs where it stands for several altitudes, got a fixed wing")
            turned = turned_way(whole, _WIDER * self.vehicle.ground_radius, link=self.link, blocked=self.blocked, known=self._known)
            first, last = (np.hypot(*(way[[0, -1], :2] - self.home).T) <= NEAR).astype(int).tolist()  # home is then also a waypoint
            whole = np.vstack([turned[:first], turned, turned[len(turned) - last :]])
            ups = np.full(len(whole), ups[0])
        if not self.flies or self.terrain is None:
            return self._level(whole[1:-1], ups[1:-1])
        whole, ups = climbs_apart(whole, ups)
        borders = [0, *(np.flatnonzero(np.diff(ups)) + 1).tolist(), len(ups)]
        over = [self._over(self.terrain, whole[begin:end], float(ups[begin])) for begin, end in pairwise(borders)]
        return np.concatenate(over) if self.altitude_frame == "ground" else np.concatenate(over)[1:-1]

    def _over(self, terrain: Terrain, way: Points, up: float) -> Floats:
        """Return the waypoints of a path at constant height above terrain."""
        profile = profile_of(terrain, way, self.frame, error=self.terrain_error)
        base = float(self.elevation or 0.0)
        if self.altitude_frame == "ground":
            over = followed(profile, up, self.terrain_error) - (0.0, 0.0, base)
            return np.asarray(over[np.concatenate([[True], np.diff(over[:, :2], axis=0).any(axis=1)])])
        self._check_clear(profile, up, base if self.altitude_frame == "home" else 0.0)
        return self._level(way, np.full(len(way), up))

    def _level(self, way: Points, ups: Floats) -> Floats:
        """Return waypoints at altitudes that do not follow the ground."""
        base = float(self.elevation or 0.0) if self.altitude_frame == "sea" and self.flies else 0.0
        return np.column_stack([way, ups - base])

    def _check_clear(self, profile: Profile, up: float, base: float) -> None:
        """Refuse a level path that meets the ground."""
        highest = int(np.argmax(profile.heights))
        if profile.heights[highest] + profile.rough >= up + base:
            place = text_of(profile.points[highest])
            raise InvalidInputError(
                f"altitude: expected more than {profile.heights[highest] - base:.4g} m above {self.altitude_frame}, the height of "
                f"the ground at {place}, got {up:g}"
            )

    def flown(self, waypoints: Floats) -> Trajectory:
        """Return the vehicle's trajectory from the ground at home along waypoints to the ground at its landing point."""
        return trajectory(whole_way(self.home, waypoints, self.landing), self.vehicle, rate=self.rate)


def climbs_apart(way: Points, ups: Floats) -> tuple[Points, Floats]:
    """Return a path and its altitudes, with climbs moved before each leg and descents after it, so that both are vertical.

    Examples
    --------
    >>> way, ups = climbs_apart(np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0)]), np.array([30.0, 50.0, 30.0]))
    >>> np.column_stack([way, ups]).tolist()
    [[0.0, 0.0, 30.0], [0.0, 0.0, 50.0], [9.0, 0.0, 50.0], [9.0, 9.0, 50.0], [9.0, 9.0, 30.0]]
    """
    change, moves = np.diff(ups), np.diff(way, axis=0).any(axis=1)
    rises, sinks = np.flatnonzero((change > 0) & moves), np.flatnonzero((change < 0) & moves) + 1
    at = np.concatenate([rises + 1, sinks])
    kept = np.insert(way, at, np.concatenate([way[rises], way[sinks]]), axis=0)
    return kept, np.insert(ups, at, np.concatenate([ups[rises + 1], ups[sinks - 1]]))


def whole_way(home: Points, waypoints: Floats, landing: Points | None = None) -> Floats:
    """Return the complete path: from the ground at home, along the waypoints, and to the ground at home or the landing point.

    The vehicle climbs above home to the height of the first waypoint. It descends from the height of the last waypoint. Heights are
    above home.

    Examples
    --------
    >>> whole_way(np.zeros(2), np.array([(40.0, 0.0, 30.0)])).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 30.0], [40.0, 0.0, 30.0], [0.0, 0.0, 30.0], [0.0, 0.0, 0.0]]
    """
    end = home if landing is None else landing
    return np.vstack([[*home, 0.0], [*home, waypoints[0, 2]], waypoints, [*end, waypoints[-1, 2]], [*end, 0.0]])
