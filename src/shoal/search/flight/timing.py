"""Times of flights: speeds, accelerations, turns and wind."""

from __future__ import annotations

from math import pi, radians, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.dataclass import dataclass
from shoal.core.geometry import partial_sums, step_lengths
from shoal.search.flight.dubins import shortest_length
from shoal.search.flight.vehicle import Vehicle

Floats = NDArray[np.float64]
# distance between unit vectors whose directions differ by one degree
STRAIGHT = 2.0 * sin(radians(0.5))
# The same for 45 degrees: at a sharper bend, a vehicle stops. Between squares in rows, bends of just
# 45 degrees are common: whether a vehicle stops there must not depend on the rounding in files.
CORNER = 2.0 * sin(radians(22.55))
_SLOWEST = 1e-9  # of the square of a speed: rounding errors must not stop a vehicle in a curve
STILL = 0.005  # metres: a shorter leg is due to the rounding of coordinates, and no motion
RETURN_HEIGHT = 60.0
"""Metres above home to which a return may climb first: RTL_RETURN_ALT of PX4, unless it is set."""
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
    turns : tuple of float
        Least and largest factor of the times for which the vehicle may stand at its turns: one
        unknown factor for all turns.
    """

    times: Floats
    points: Floats
    circle: float = 0.0
    turns: tuple[float, float] = (1.0, 1.0)

    @property
    def duration(self) -> float:
        """Duration of the whole trajectory in seconds."""
        return float(self.times[-1])

    def at(self, times: ArrayLike) -> Floats:
        """Return the vehicle's positions in metres at given times in seconds; float64, shape (...,
        3).

        Before the first time and after the last time of the trajectory, the vehicle stands still.
        """
        moments = np.asarray(times, dtype=np.float64)
        return np.stack(
            [np.interp(moments, self.times, self.points[:, axis]) for axis in range(3)], axis=-1
        )


def trajectory(path: ArrayLike, vehicle: Vehicle, *, rate: float | Floats = 1.0) -> Trajectory:
    """Return the trajectory of a vehicle that follows a path.

    The duration of a leg is max(l / v, t), where l is the horizontal length of the leg, v is the
    ground speed in the wind, and t is the time of the climb or descent. Each horizontal change of
    direction by more than 45 degrees, and each change between vertical and horizontal motion, adds
    the duration of a turn. A gentler bend adds a part of it; see `turn_shares`. The start and the
    stop at the ends of the path each add half the duration of a turn. For fixed wings, the path
    itself must contain the turns as short legs.

    Parameters
    ----------
    path : array_like of float, shape (k, 3), k >= 1
        Points of the path as metres east, metres north and metres up.
    vehicle : Vehicle
    rate : float, or ndarray of float64 of shape (k - 1,)
        Airspeed of the vehicle, divided by its cruise speed: one number, or one for each leg.

    Examples
    --------
    >>> vehicle = Vehicle(cruise_speed=10.0, climb_speed=2.0, sink_speed=1.0, acceleration=5.0)
    >>> flown = trajectory([(0, 0, 0), (0, 0, 30), (100, 0, 30), (100, 0, 0)], vehicle)
    >>> flown.times.tolist()
    [0.0, 1.0, 16.0, 18.0, 28.0, 30.0, 60.0, 61.0]
    """
    points = check_points(path, what="path", dimensions=3)
    turning, legs = vehicle.turn_seconds, leg_seconds(points, vehicle, rate=rate)
    pauses = np.full(len(points), 0.0)
    if turning:
        pauses[1:-1] = turning * turn_shares(
            points,
            reach=vehicle.cruise * turning,
            cut=vehicle.acceptance_radius or CUT,
            still=STILL,
        )
    # also without motion, so that the rounding of coordinates in files makes no difference
    pauses[[0, -1]] = turning / 2
    stands = pauses > 0
    arrivals = partial_sums(legs) + partial_sums(pauses[:-1])
    times = np.stack([arrivals, arrivals + pauses], axis=1)
    present = np.stack([np.ones(len(points), dtype=np.bool_), stands], axis=1).ravel()
    return Trajectory(times.ravel()[present], np.repeat(points, 2, axis=0)[present])


def leg_seconds(points: Floats, vehicle: Vehicle, *, rate: float | Floats = 1.0) -> Floats:
    """Return the duration of each leg of a path in seconds, without the time for turns; float64,
    shape (k - 1,).
    """
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    moving = lengths > 0
    along = np.zeros(len(legs))
    rates = np.broadcast_to(rate, lengths.shape)
    for value in np.unique(rates[moving]).tolist():
        faster = vehicle if value == 1.0 else vehicle.replaced(cruise_speed=vehicle.cruise * value)
        alike = moving & (rates == value)
        along[alike] = lengths[alike] / faster.ground_speed(legs[alike, :2])
    return np.maximum(along, vehicle.vertical_seconds(legs[:, 2]))


def turns_of(points: Floats, still: float = STILL) -> NDArray[np.bool_]:
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
    moving = np.flatnonzero(np.abs(legs).max(axis=1) > still)
    sharp = np.zeros(len(points) - 2, dtype=np.bool_)
    apart = step_lengths(headings[moving]) > STRAIGHT
    sharp[moving[1:][apart] - 1] = True
    return sharp


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
    moving = np.flatnonzero(np.abs(legs).max(axis=1) > still)
    lengths = np.hypot(legs[moving, 0], legs[moving, 1])
    headings = legs[moving, :2] / np.where(lengths > 0, lengths, 1.0)[:, None]
    apart = step_lengths(headings)
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
        shares[moving[1:][gentle] - 1] = 0.0
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
    entry_speed, exit_speed = ends[:-1], ends[1:]
    top = np.sqrt(np.minimum((entry_speed**2 + exit_speed**2) / 2 + free / reach, 1.0))
    slower = np.maximum(
        2 * top - entry_speed - exit_speed - (2 * top**2 - entry_speed**2 - exit_speed**2) / 2, 0.0
    )
    lost += (slower[:-1] + slower[1:]) / 2
    lost[0], lost[-1] = lost[0] + slower[0] / 2, lost[-1] + slower[-1] / 2
    shares[moving[1:] - 1] = stops + np.maximum(lost, 0.0)  # rounding can make it negative
    return shares


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


def return_seconds(vehicle: Vehicle, height: float) -> float:
    """Return the time in seconds by which the autopilot's return is longer than a way home at the
    height above home where it begins: the climb to the height of the return, the descent from
    there, and the stops before and after the climb.

    Examples
    --------
    >>> vehicle = Vehicle(cruise_speed=10.0, climb_speed=2.0, sink_speed=1.0, acceleration=5.0)
    >>> return_seconds(vehicle, 30.0), return_seconds(vehicle, 80.0)
    (49.0, 0.0)
    """
    climb = RETURN_HEIGHT - height
    if vehicle.kind == "rover" or climb <= 0:
        return 0.0
    return float(vehicle.vertical_seconds([climb, -climb]).sum()) + 2 * vehicle.turn_seconds
