"""A route in pieces that a vehicle's memory and battery hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from shoal.errors import InvalidInputError
from shoal.search.regions.outline_checks import Points, check_plane_points, text_of

Ways = Callable[[Points, Points], ArrayLike]

_FINE = 0.01  # metres: how near to the battery's limit a leg is cut
_SHORTEST = 0.1  # metres: where the battery brings the robot on by less, it brings it nowhere


def sorties(way: Points, home: Points, *, room: int, limit: float, ways: Ways | None = None, robot: int = 1) -> list[Points]:
    """Return the waypoints of each sortie along a way.

    Parameters
    ----------
    way : ndarray of float64, shape (k, 2), k >= 1
        Metres.
    home : ndarray of float64, shape (2,)
    room : int
        Most waypoints of a sortie.
    limit : float
        Most metres of a sortie, from home and back included.
    ways : callable, optional
        Ways between home and points; straight if not given.
    robot : int
        For messages.

    Raises
    ------
    InvalidInputError
        If the battery or the room does not bring the robot on.
    """
    return _Splitter(way, home, room, limit, ways, robot).parts()


class _Splitter:
    """Cuts at a distance along the way: as late as the battery, then as the room allows."""

    def __init__(self, way: Points, home: Points, room: int, limit: float, ways: Ways | None, robot: int) -> None:
        self.way, self.home, self.room, self.limit, self.ways, self.robot = way, home, room, limit, ways, robot
        self.at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])

    def parts(self) -> list[Points]:
        begin, end = 0.0, float(self.at[-1])
        found: list[Points] = []
        while True:
            out = self._way_home(begin)[::-1]
            late = self._within_battery(begin, out)
            until = self._within_room(begin, late, len(out) - 2)
            if until < end and (until <= begin or (until == late and late - begin < _SHORTEST)):
                self._refuse(begin, out, full=until < late)
            found.append(np.vstack([out[1:-1], self._between(begin, until), self._way_home(until)[1:-1]]))
            if until >= end:
                return found
            begin = until

    def _point(self, at: float) -> Points:
        """Return the point of the way at a distance along it."""
        leg = int(np.clip(np.searchsorted(self.at, at, side="right") - 1, 0, max(0, len(self.way) - 2)))
        if len(self.way) == 1 or at == self.at[leg]:
            return np.asarray(self.way[leg])
        if at == self.at[leg + 1]:
            return np.asarray(self.way[leg + 1])
        share = (at - self.at[leg]) / (self.at[leg + 1] - self.at[leg])
        return np.asarray(self.way[leg] + share * (self.way[leg + 1] - self.way[leg]))

    def _way_home(self, at: float) -> Points:
        """Return the way from a point of the route to home, both included."""
        point = self._point(at)
        if self.ways is None or np.array_equal(point, self.home):
            return np.array([point, self.home])
        way = check_plane_points(self.ways(point, self.home), what="way home")
        return way if len(way) >= 2 else np.array([point, self.home])

    def _between(self, begin: float, until: float) -> Points:
        """Return the waypoints from one distance along the way to another."""
        inner = self.way[(self.at > begin) & (self.at < until)]
        ends = [self._point(begin)] if until == begin else [self._point(begin), self._point(until)]
        return np.vstack([ends[:1], inner, ends[1:]]) if len(ends) == 2 else np.array(ends)

    def _within_battery(self, begin: float, out: Points) -> float:
        """Return how far the battery reaches: the farther along, the longer the sortie, for no way home is a detour."""
        end = float(self.at[-1])
        used = _length(out)
        if not np.isfinite(self.limit):
            return end

        def reaches(at: float) -> bool:
            return used + at - begin + _length(self._way_home(at)) <= self.limit * (1 + 1e-12)

        if reaches(end):
            return end
        if not reaches(begin):
            self._refuse(begin, out, full=False)
        low, high = begin, min(end, begin + self.limit)
        while high - low > _FINE:
            middle = (low + high) / 2
            low, high = (middle, high) if reaches(middle) else (low, middle)
        return low

    def _within_room(self, begin: float, late: float, bends_out: int) -> float:
        """Return where a sortie ends so that it has room for its waypoints, not later than ``late``."""
        until = late
        while True:
            inner = np.flatnonzero((self.at > begin) & (self.at < until))
            count = bends_out + len(inner) + (2 if until > begin else 1) + len(self._way_home(until)) - 2
            if count <= self.room:
                return until
            excess = count - self.room
            if excess > len(inner):
                return begin
            until = float(self.at[inner[-excess]])

    def _refuse(self, begin: float, out: Points, *, full: bool) -> None:
        place = text_of(self._point(begin))
        if full:
            raise InvalidInputError(
                f"cap: expected room for more waypoints of robot {self.robot}, got {self.room}: "
                f"the ways from home to {place} and back have {2 * (len(out) - 2)} bends"
            )
        away, straight = _length(out), np.hypot(*(self.way - self.home).T)
        if straight.max() > away:  # what will be the trouble next
            away, place = float(straight.max()), text_of(self.way[int(np.argmax(straight))])
        raise InvalidInputError(
            f"battery: expected sorties of more than {2 * away:.6g} m for robot {self.robot}, "
            f"for {place} is {away:.6g} m from home, got {self.limit:.6g} m"
        )


def _length(way: Points) -> float:
    return float(np.hypot(*np.diff(way, axis=0).T).sum())
