"""Times of flights: speeds, accelerations, turns and wind."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from math import pi, radians, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.dataclass import dataclass
from shoal.search.flight.dubins import shortest_length
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.outline import Points

Floats = NDArray[np.float64]
STRAIGHT = 2.0 * sin(
    radians(0.5)
)  # distance between unit vectors whose directions differ by one degree
CORNER = 2.0 * sin(radians(22.5))  # the same for 45 degrees: at a sharper bend, a vehicle stops
_SLOWEST = 1e-9  # of the square of a speed: rounding errors must not stop a vehicle in a curve
STILL = 0.005  # metres: a shorter leg is due to the rounding of coordinates, and no motion
CUT = 1.0
"""Distance in metres from a waypoint within which a vehicle rounds off a bend, if the vehicle has
no acceptance radius.
"""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Position of a vehicle as a function of time, with constant velocity between the vertices of
    the trajectory.

    Parameters
    ----------
    times : ndarray of float64, shape (n,)
        Time at each vertex in seconds, in increasing order. If a vehicle turns on the spot, the
        position of the turn occurs twice.
    points : ndarray of float64, shape (n, 3)
        Position at each vertex as metres east, metres north and metres up.
    circle : float
        Radius in metres of the circles that the vehicle flies around one point during the last leg,
        or 0 without circles.
    """

    times: Floats
    points: Floats
    circle: float = 0.0

    @property
    def duration(self) -> float:
        """Duration of the whole trajectory in seconds."""
        return float(self.times[-1])

    def at(self, times: ArrayLike) -> Floats:
        """Return the vehicle's positions in metres at given times in seconds; float64, shape (...,
        3).

        Before the first time and after the last time of the trajectory, the vehicle stands still.
        """
        asked = np.asarray(times, dtype=np.float64)
        return np.stack(
            [np.interp(asked, self.times, self.points[:, axis]) for axis in range(3)], axis=-1
        )


def trajectory(way: ArrayLike, vehicle: Vehicle, *, rate: float | Floats = 1.0) -> Trajectory:
    """Return the trajectory of a vehicle that follows a path.

    The duration of a leg is max(l / v, t), where l is the horizontal length of the leg, v is the
    ground speed in the wind, and t is the time of the climb or descent. Each horizontal change of
    direction by more than 45 degrees, and each change between vertical and horizontal motion, adds
    the duration of a turn. A gentler bend adds a part of it; see `turn_shares`. The start and the
    stop at the ends of the path each add half the duration of a turn. For fixed wings, the path
    itself must contain the turns as short legs.

    Parameters
    ----------
    way : array_like of float, shape (k, 3), k >= 1
        Points of the path as metres east, metres north and metres up.
    vehicle : Vehicle
    rate : float, or ndarray of float64 of shape (k - 1,)
        Airspeed of the vehicle, divided by its cruise speed: one number, or one for each leg.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> vehicle = Vehicle(cruise_speed=10.0, climb_speed=2.0, sink_speed=1.0, acceleration=5.0)
    >>> flown = trajectory([(0, 0, 0), (0, 0, 30), (100, 0, 30), (100, 0, 0)], vehicle)
    >>> flown.times.tolist()
    [0.0, 1.0, 16.0, 18.0, 28.0, 30.0, 60.0, 61.0]
    """
    points = check_points(way, what="way", dimensions=3)
    turning, legs = vehicle.turn_seconds, leg_seconds(points, vehicle, rate=rate)
    pauses = np.full(len(points), 0.0)
    if turning:
        pauses[1:-1] = turning * turn_shares(
            points,
            reach=vehicle.cruise * turning,
            cut=vehicle.acceptance_radius or CUT,
            still=STILL,
        )
    pauses[[0, -1]] = (
        turning / 2
    )  # also without motion, so that the rounding of coordinates in files makes no difference
    stands = pauses > 0
    arrivals = np.concatenate([[0.0], np.cumsum(legs)]) + np.concatenate(
        [[0.0], np.cumsum(pauses[:-1])]
    )
    times = np.stack([arrivals, arrivals + pauses], axis=1)
    kept = np.stack([np.ones(len(points), dtype=np.bool_), stands], axis=1).ravel()
    return Trajectory(times.ravel()[kept], np.repeat(points, 2, axis=0)[kept])


def leg_seconds(points: Floats, vehicle: Vehicle, *, rate: float | Floats = 1.0) -> Floats:
    """Return the duration of each leg of a path in seconds, without the time for turns; float64,
    shape (k - 1,).
    """
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    moving = lengths > 0
    along = np.zeros(len(legs))
    rates = np.broadcast_to(rate, lengths.shape)
    for one in np.unique(rates[moving]).tolist():
        faster = vehicle if one == 1.0 else vehicle.replaced(cruise_speed=vehicle.cruise * one)
        alike = moving & (rates == one)
        along[alike] = lengths[alike] / faster.ground_speed(legs[alike, :2])
    return np.maximum(along, vehicle.vertical_seconds(legs[:, 2]))


def turns_of(points: Floats, still: float = 0.0) -> NDArray[np.bool_]:
    """Return, for each inner point of a path, whether a vehicle turns at this point; bool, shape (k
    - 2,).

    A turn is a horizontal change of direction by more than one degree, or a change between vertical
    and horizontal motion. A leg of at most ``still`` has no direction.
    """
    if len(points) < 3:
        return np.zeros(max(len(points) - 2, 0), dtype=np.bool_)
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    headings = legs[:, :2] / np.where(lengths > 0, lengths, 1.0)[:, None]
    here = np.flatnonzero(np.abs(legs).max(axis=1) > still)
    found = np.zeros(len(points) - 2, dtype=np.bool_)
    apart = np.hypot(*np.diff(headings[here], axis=0).T) > STRAIGHT
    found[here[1:][apart] - 1] = True
    return found


def turn_shares(points: Floats, *, reach: float, cut: float = CUT, still: float = 0.0) -> Floats:
    """Return, for each inner point of a path, the time that is lost there, divided by the duration
    of a turn; shape (k - 2,).

    At a bend of more than 45 degrees, and between vertical and horizontal motion, a vehicle stops
    and loses the whole duration of a turn, T = v / a, for the cruise speed v and the acceleration
    a. It passes a gentler bend on an arc of the radius R at the speed w = min(v, sqrt(a R)), so a
    smooth curve of many small bends costs what it costs to fly, and not a stop at every point.
    Beside the arcs, the vehicle accelerates to v and slows down again, as far as the legs allow.

    Parameters
    ----------
    points : ndarray of float64, shape (k, 2) or (k, 3)
    reach : float
        The distance v T = v**2 / a, in the unit of the points. An arc whose radius is at least
        ``reach`` costs no time.
    cut : float
        Distance from a bend within which the arc passes, in the unit of the points.
    still : float
        Length up to which a leg is no motion, in the unit of the points.

    Examples
    --------
    >>> turn_shares(np.array([(0.0, 0.0), (50.0, 0.0), (50.0, 50.0)]), reach=10.0)
    array([1.])
    >>> angles = np.radians(np.arange(-1.0, 92.0, 3.0))
    >>> around = 5.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    >>> print(turn_shares(around, reach=10.0).sum().round(2))  # a quarter of a circle of 5 m: less than one stop
    0.37
    """
    shares = turns_of(points, still).astype(np.float64)
    if reach <= 0 or not shares.any():
        return shares
    legs = np.diff(points, axis=0)
    here = np.flatnonzero(np.abs(legs).max(axis=1) > still)
    lengths = np.hypot(legs[here, 0], legs[here, 1])
    headings = legs[here, :2] / np.where(lengths > 0, lengths, 1.0)[:, None]
    apart = np.hypot(*np.diff(headings, axis=0).T)
    gentle = (apart > STRAIGHT) & (apart <= CORNER)
    if not gentle.any():
        return shares
    # Each arc touches both legs of its bend. It uses at most half of each leg, and passes the bend
    # within the distance ``cut``.
    half = np.arcsin(apart[gentle] / 2)
    touches = np.zeros(len(apart))
    touches[gentle] = np.minimum(
        np.minimum(lengths[:-1], lengths[1:])[gentle] / 2,
        cut * np.tan(half) / (1 / np.cos(half) - 1),
    )
    squares = np.ones(len(apart))  # of the speeds, divided by the cruise speed
    squares[gentle] = np.minimum(touches[gentle] / np.tan(half) / reach, 1.0)
    if (squares == 1.0).all():
        shares[here[1:][gentle] - 1] = 0.0
        return shares
    # Between two bends, the square of the speed changes by at most 2 a l. Nothing is carried across
    # a stop.
    stops = apart > CORNER
    at = 2 * np.cumsum(lengths)[:-1] / reach + 2.0 * (
        np.cumsum(stops) + np.cumsum(np.append(False, stops[:-1]))
    )
    squares = np.minimum.accumulate(squares - at) + at
    squares = (np.minimum.accumulate((squares + at)[::-1]))[::-1] - at
    speeds = np.sqrt(np.where(stops, 1.0, np.maximum(squares, _SLOWEST)))
    lost = np.where(gentle, 2 * touches / reach * (1 / speeds - 1), 0.0)
    ends = np.concatenate([[1.0], speeds, [1.0]])
    free = np.maximum(lengths - np.append(0.0, touches) - np.append(touches, 0.0), 0.0)
    one, other = ends[:-1], ends[1:]
    top = np.sqrt(np.minimum((one**2 + other**2) / 2 + free / reach, 1.0))
    slower = np.maximum(2 * top - one - other - (2 * top**2 - one**2 - other**2) / 2, 0.0)
    lost += (slower[:-1] + slower[1:]) / 2
    lost[0], lost[-1] = lost[0] + slower[0] / 2, lost[-1] + slower[-1] / 2
    shares[here[1:] - 1] = stops + np.maximum(lost, 0.0)  # rounding can make it negative
    return shares


def climbs_apart(way: Floats, ups: Floats) -> tuple[Floats, Floats]:
    """Return the points and altitudes of a path in which each leg is either horizontal or vertical.

    On each given leg, the vehicle first climbs, then flies horizontally, and then descends.

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


def whole_way(
    home: Floats,
    waypoints: Floats,
    landing: Floats | None = None,
    *,
    climb: float | None = None,
    glides: bool = False,
) -> Floats:
    """Return a complete path: up from the ground at home, along the waypoints, and down at home or
    at the landing point.

    The vehicle climbs vertically to the height ``climb``, and then flies straight to the first
    waypoint. By default, ``climb`` is the height of the first waypoint. If ``glides`` is true, the
    vehicle descends during the last leg. Otherwise, the vehicle descends vertically at the end of
    the path.

    Examples
    --------
    >>> whole_way(np.zeros(2), np.array([(40.0, 0.0, 30.0)])).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 30.0], [40.0, 0.0, 30.0], [0.0, 0.0, 30.0], [0.0, 0.0, 0.0]]
    """
    end = home if landing is None else landing
    over = np.zeros((0, 3)) if glides else np.array([[*end, waypoints[-1, 2]]])
    return np.vstack(
        [
            [*home, 0.0],
            [*home, waypoints[0, 2] if climb is None else climb],
            waypoints,
            over,
            [*end, 0.0],
        ]
    )


def turn_cells(vehicle: Vehicle, size: float) -> float:
    """Return the cost of a turn: the number of cells of side ``size`` that the vehicle would pass
    in the time of the turn.

    At the end of a row, a vehicle turns twice: towards the next row, and into the next row. For a
    fixed wing, the cost of a turn is (L - s) / (2 s), where L is the length of the curve from a row
    to the next row, and s is the distance between the rows.

    Examples
    --------
    >>> turn_cells(Vehicle(cruise_speed=5.0, turn_time=4.0), 10.0)
    2.0
    >>> round(turn_cells(Vehicle(preset="fixed-wing", turn_radius=40.0), 20.0), 2)
    6.22
    """
    if vehicle.radius:
        radius = vehicle.ground_radius
        return max(shortest_length((0.0, 0.0, 0.0), (0.0, size, pi), radius) - size, 0.0) / 2 / size
    return vehicle.turn_seconds * vehicle.cruise / size


def working_seconds(vehicle: Vehicle) -> float:
    """Return the usable endurance in seconds, minus the time for the climb to the search altitude
    and for the descent.
    """
    return vehicle.usable_seconds - climbing_seconds(vehicle)


def climbing_seconds(vehicle: Vehicle) -> float:
    """Return the total time in seconds that a vehicle needs to climb to the search altitude and to
    descend again.
    """
    return float(vehicle.vertical_seconds([vehicle.height, -vehicle.height]).sum())


def merged(points: Points, tolerance: float) -> Points:
    """Remove the points of a path that lie on straight legs between other points, in one pass over
    the points.

    At each kept point, the algorithm starts a cone of directions. A straight leg in a direction of
    the cone passes all points since the kept point within the tolerance. The leg may end at the
    next point if this point lies inside the cone, and is not nearer to the kept point than the
    points in between. Because of the second condition, the function keeps points at which the path
    turns back. The algorithm comes from Reumann and Witkam, 1974. The exact form of the cone comes
    from Williams, "An efficient algorithm for the piecewise linear approximation of planar curves",
    1978.

    Parameters
    ----------
    points : ndarray of float64, shape (k, 2) or (k, 3)
        Path in metres. The function keeps points at which the altitude changes.
    tolerance : float
        Maximum distance in metres between a removed point and the leg that replaces it.

    Returns
    -------
    ndarray of float64, shape (m, 2) or (m, 3)
        The kept points of the path, including both ends.

    Examples
    --------
    >>> merged(np.array([(0, 0), (1, 0.0005), (2, 0), (2, 0), (1, 0), (1, 1.0)]), 0.001).tolist()
    [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    if len(points) < 2:
        return points
    if points.shape[1] == 3 and np.ptp(points[:, 2]):
        borders = [0, *(np.flatnonzero(np.diff(points[:, 2])) + 1).tolist(), len(points)]
        return np.concatenate(
            [merged(points[begin:end], tolerance) for begin, end in pairwise(borders)]
        )
    way = points[np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])]
    kept = [0]
    cone = _Cone(way[0, :2], tolerance)
    for index, (x, y) in enumerate(way[1:, :2].tolist(), start=1):
        if not cone.takes(x, y):
            kept.append(index - 1)
            cone = _Cone(way[index - 1, :2], tolerance)
            cone.takes(x, y)
    if kept[-1] != len(way) - 1:
        kept.append(len(way) - 1)
    return np.asarray(way[kept])


def lengthened(points: Points, least: float, allowed: Callable[[Points], bool]) -> Points:
    """Return a path without legs shorter than an acceptance radius, as far as its surroundings
    allow.

    A vehicle counts a waypoint as reached at the acceptance radius, so it would skip the end of a
    shorter leg. On a curve, a short leg is replaced by the point where the legs before and after it
    meet, so the new path leads outside the curve, not across it. Elsewhere, the path omits one end
    of a short leg. Beside an end of the path, where the path around an obstacle has no room for
    this, the short leg becomes longer.

    Parameters
    ----------
    points : ndarray of float64, shape (k, 2) or (k, 3)
        Path in metres. Points at which the altitude changes, and both ends, stay.
    least : float
        Smallest length of a leg in metres.
    allowed : callable
        Function that tells whether a vehicle may follow a path, shape (m, 2).

    Examples
    --------
    >>> around = np.array([(0.0, 0.0), (9.5, 0.0), (10.0, 0.5), (10.0, 9.0)])
    >>> lengthened(around, 1.0, lambda way: True).tolist()
    [[0.0, 0.0], [10.0, 0.0], [10.0, 9.0]]
    """
    way = points[:, :2].tolist()
    ups = points[:, 2].tolist() if points.shape[1] == 3 else [0.0] * len(way)
    refused: set[tuple[float, ...]] = set()
    k = 0
    while k + 1 < len(way) > 2:  # the leg from k to k + 1
        here, then = way[k], way[k + 1]
        length = math.dist(here, then)
        key = (*here, *then)
        first, last = k == 0, k + 2 >= len(way)
        if not 0 < length < least or len({*ups[max(k - 1, 0) : k + 3]}) > 1 or key in refused:
            k += 1
            continue
        if first:
            options = [[here], [here, _beyond(here, then, least)]]
        elif last:
            options = [[then], [_beyond(then, here, least), then]]
        else:
            options = [[met] for met in _meeting(way[k - 1], here, then, way[k + 2], least)] + [
                [then],
                [here],
            ]
        for instead in options:
            if allowed(np.array([*way[max(k - 1, 0) : k], *instead, *way[k + 2 : k + 3]])):
                way[k : k + 2], ups[k : k + 2] = instead, [ups[k]] * len(instead)
                k = max(k - 1, 0)
                break
        else:
            refused.add(key)
    made = np.array(way)
    return np.column_stack([made, ups]) if points.shape[1] == 3 else made


def _beyond(here: list[float], then: list[float], least: float) -> list[float]:
    """Return the point just beyond the length ``least`` on the leg from ``here``
    through ``then``.
    """
    share = (1 + 1e-6) * least / math.dist(here, then)
    return [here[0] + share * (then[0] - here[0]), here[1] + share * (then[1] - here[1])]


def _meeting(
    before: list[float], here: list[float], then: list[float], after: list[float], least: float
) -> list[list[float]]:
    """Return the point where the leg to ``here`` and the leg from ``then`` meet if they are
    extended, if it is near to both.
    """
    ax, ay, bx, by = (
        here[0] - before[0],
        here[1] - before[1],
        after[0] - then[0],
        after[1] - then[1],
    )
    cross = ax * by - ay * bx
    if abs(cross) <= 1e-9 * math.hypot(ax, ay) * math.hypot(bx, by):
        return []
    far = ((then[0] - here[0]) * by - (then[1] - here[1]) * bx) / cross
    back = ((then[0] - here[0]) * ay - (then[1] - here[1]) * ax) / cross
    met = [here[0] + far * ax, here[1] + far * ay]
    return (
        [met]
        if far > 0 > back and math.dist(met, here) <= least and math.dist(met, then) <= least
        else []
    )


class _Cone:
    """The directions from an apex in which a straight leg passes all added points within the
    tolerance.
    """

    def __init__(self, apex: Points, tolerance: float) -> None:
        self.x, self.y = apex.tolist()
        self.tolerance = tolerance
        self.far = 0.0
        self.along: tuple[float, float] | None = None
        self.low, self.high = -math.pi, math.pi

    def takes(self, x: float, y: float) -> bool:
        """Return whether a leg from the apex may end at a point. If so, narrow the cone to
        directions that pass this point.
        """
        east, north = x - self.x, y - self.y
        distance = math.hypot(east, north)
        if distance < self.far:
            return False
        if self.along is None:
            self.along = (east, north)
        angle = math.atan2(
            self.along[0] * north - self.along[1] * east,
            self.along[0] * east + self.along[1] * north,
        )
        if not self.low <= angle <= self.high:
            return False
        self.far = distance
        width = math.asin(self.tolerance / distance) if distance > self.tolerance else math.pi
        self.low, self.high = max(self.low, angle - width), min(self.high, angle + width)
        return True
