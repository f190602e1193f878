"""Timing: when a vehicle that follows a way is where."""

from __future__ import annotations

from math import radians, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.dataclass import dataclass
from shoal.search.flight.vehicle import Vehicle

Floats = NDArray[np.float64]
STRAIGHT = 2.0 * sin(radians(0.5))  # how far apart unit vectors are whose directions differ by a degree


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where a vehicle is at which time: straight and at constant speed between vertices.

    Parameters
    ----------
    times : ndarray of float64, shape (n,)
        Seconds, not falling. A vehicle that turns stands for that time: its place is there twice.
    points : ndarray of float64, shape (n, 3)
        Metres east, north and up.
    """

    times: Floats
    points: Floats

    @property
    def duration(self) -> float:
        """How long it takes, seconds."""
        return float(self.times[-1])

    def at(self, times: ArrayLike) -> Floats:
        """Return where the vehicle is at some times; before its first and after its last it stands. Shape (..., 3)."""
        asked = np.asarray(times, dtype=np.float64)
        return np.stack([np.interp(asked, self.times, self.points[:, axis]) for axis in range(3)], axis=-1)


def trajectory(way: ArrayLike, vehicle: Vehicle, *, rate: float = 1.0) -> Trajectory:
    """Return when a vehicle that follows a way is where.

    A leg takes as long as its ground part at the speed that the wind leaves, or its climb if that is longer. A change of direction
    of more than a degree adds the time of a turn, seen from above; so does one from up or down to along. Starting and stopping at
    the ends of the way add half of it each. Turns of fixed wings are ways: what is given must have them as short legs.

    Parameters
    ----------
    way : array_like of float, shape (k, 3), k >= 1
        Metres east, north and up.
    vehicle : Vehicle
    rate : float
        Its speed through the air as a multiple of its cruise speed.

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
    pauses[1:-1] = turning * turns_of(points)
    pauses[[0, -1]] = turning / 2 if legs.any() else 0.0
    stands = pauses > 0
    arrivals = np.concatenate([[0.0], np.cumsum(legs)]) + np.concatenate([[0.0], np.cumsum(pauses[:-1])])
    times = np.stack([arrivals, arrivals + pauses], axis=1)
    kept = np.stack([np.ones(len(points), dtype=np.bool_), stands], axis=1).ravel()
    return Trajectory(times.ravel()[kept], np.repeat(points, 2, axis=0)[kept])


def leg_seconds(points: Floats, vehicle: Vehicle, *, rate: float = 1.0) -> Floats:
    """Return how long each leg of a way takes without turns; float64, shape (k - 1,)."""
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    moving = lengths > 0
    along = np.zeros(len(legs))
    faster = vehicle if rate == 1.0 else vehicle.replaced(cruise_speed=vehicle.cruise * rate)
    along[moving] = lengths[moving] / faster.ground_speed(legs[moving, :2])
    return np.maximum(along, vehicle.vertical_seconds(legs[:, 2]))


def turns_of(points: Floats) -> NDArray[np.bool_]:
    """Tell at which inner points of a way its direction changes by more than a degree, seen from above; shape (k - 2,)."""
    if len(points) < 3:
        return np.zeros(max(len(points) - 2, 0), dtype=np.bool_)
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    headings = legs[:, :2] / np.where(lengths > 0, lengths, 1.0)[:, None]
    here = np.flatnonzero(np.abs(legs).max(axis=1) > 0)  # a leg of no length has no direction
    found = np.zeros(len(points) - 2, dtype=np.bool_)
    apart = np.hypot(*np.diff(headings[here], axis=0).T) > STRAIGHT
    found[here[1:][apart] - 1] = True
    return found
