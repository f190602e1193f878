"""Deviation: the path that a vehicle flies in place of its planned path, because it cuts corners and
is wrong about its position.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.geometry import partial_sums, step_lengths
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.outline import Points

_DRIFT = 30.0  # seconds in which the error of a position becomes another one


def cut_corners(path: Points, radius: float) -> Points:
    """Return a path that leaves each leg ``radius`` metres before its end, and joins the next leg as
    far behind its beginning; float64, shape (k, 2).

    At legs shorter than twice the radius, it cuts half of the leg.

    Examples
    --------
    >>> cut_corners(np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)]), 1.0).tolist()
    [[0.0, 0.0], [9.0, 0.0], [10.0, 1.0], [10.0, 10.0]]
    """
    lengths = step_lengths(path)
    path = np.concatenate([path[:1], path[1:][lengths > 0]])
    lengths = lengths[lengths > 0]
    if len(path) < 3:
        return path
    ahead = np.diff(path, axis=0) / lengths[:, None]
    cut = np.minimum(radius, lengths / 2)[:, None]
    before, behind = path[1:-1] - cut[:-1] * ahead[:-1], path[1:-1] + cut[1:] * ahead[1:]
    corners = np.stack([before, behind], axis=1).reshape(-1, 2)
    return np.concatenate([path[:1], corners, path[-1:]])


def with_position_errors(path: Points, error: float, drift: float, rng: Generator) -> Points:
    """Return a path that is beside another one by up to ``error`` metres; float64, shape (k, 2).

    Every ``drift`` metres, the difference is another random vector, uniform in a disk of radius
    ``error``, and in between it changes evenly.
    """
    far = partial_sums(step_lengths(path))
    knots = np.arange(0.0, far[-1] + drift, drift)
    turn, size = rng.uniform(0, 2 * np.pi, len(knots)), error * np.sqrt(rng.random(len(knots)))
    # a path is straight between two corners, and so is the one beside it between two knots
    places = np.union1d(far, knots[knots < far[-1]])
    return np.stack(
        [
            np.interp(places, far, path[:, axis]) + np.interp(places, knots, size * wave(turn))
            for axis, wave in enumerate((np.cos, np.sin))
        ],
        axis=1,
    )


def deviate(path: NDArray[np.float64], vehicle: Vehicle, rng: Generator) -> Points:
    """Return the path that a vehicle flies if it cuts the corners of a path at its acceptance radius
    and is wrong about its position by up to its position error; float64, shape (k, 2).

    Parameters
    ----------
    path : ndarray of float64, shape (n, 2)
        The planned path in metres.
    vehicle : Vehicle
    rng : Generator
    """
    if len(path) < 2:
        return path
    flown = cut_corners(path, float(vehicle.acceptance_radius or 0.0))
    error = float(vehicle.position_error or 0.0)
    return with_position_errors(flown, error, _DRIFT * vehicle.cruise, rng) if error else flown
