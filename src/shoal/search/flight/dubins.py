"""Dubins curves: the shortest paths between two poses for vehicles with a minimum turning radius."""

from __future__ import annotations

from math import ceil, cos, pi, sin, tan

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
"""The six types of shortest paths with a minimum turning radius, spelled with L (left), S (straight) and R (right)."""

SHARPEST = pi / 6  # largest bend of an approximated path at a vertex
_ROUND = 2 * pi
_CLOSE = 1e-9
_SLIGHT = 0.01  # metres: half of an arc that needs no vertex
_SENSE = {"L": 1.0, "R": -1.0, "S": 0.0}
_SENSES = np.array([[_SENSE[letter] for letter in word] for word in WORDS])


def dubins_parts(starts: ArrayLike, ends: ArrayLike, radius: float) -> Floats:
    """Return, for each pair of a start pose and an end pose, the lengths of the arcs and segments of all six Dubins curves.

    Parameters
    ----------
    starts, ends : array_like of float, shape (..., 3)
        Poses (x, y, heading), with x and y in metres and the heading in radians counter-clockwise from east. NumPy broadcasts the
        two arrays to pairs of poses.
    radius : float
        Minimum turning radius in metres.

    Returns
    -------
    ndarray of float64, shape (..., 6, 3)
        For each curve type in `WORDS`, the lengths of the curve's three parts divided by the radius. If a curve does not exist, its
        lengths are infinite.

    Notes
    -----
    The source is Dubins, "On curves of minimal length with a constraint on average curvature", 1957. The formulas are those of
    Shkel and Lumelsky, "Classification of the Dubins set", 2001.

    Examples
    --------
    >>> parts = dubins_parts((0, 0, 0), (0, 200, pi), 50.0)
    >>> print(parts.sum(axis=-1).min().round(3) * 50)  # half a circle, 100 m across, half a circle
    257.1
    """
    one, other = np.broadcast_arrays(np.asarray(starts, dtype=np.float64), np.asarray(ends, dtype=np.float64))
    across = (other[..., :2] - one[..., :2]) / radius
    d, toward = np.hypot(across[..., 0], across[..., 1]), np.arctan2(across[..., 1], across[..., 0])
    a, b = one[..., 2] - toward, other[..., 2] - toward
    sa, sb, ca, cb, both = np.sin(a), np.sin(b), np.cos(a), np.cos(b), np.cos(a - b)
    found = []
    with np.errstate(invalid="ignore"):  # nonexistent curves are NaN until the end
        turn = np.arctan2(cb - ca, d + sa - sb)
        found.append((turn - a, np.sqrt(np.maximum(2 + d * d - 2 * both + 2 * d * (sa - sb), 0.0)), b - turn))
        turn = np.arctan2(ca - cb, d - sa + sb)
        found.append((a - turn, np.sqrt(np.maximum(2 + d * d - 2 * both + 2 * d * (sb - sa), 0.0)), turn - b))
        p = np.sqrt(d * d - 2 + 2 * both + 2 * d * (sa + sb))
        turn = np.arctan2(-ca - cb, d + sa + sb) - np.arctan2(-2.0, p)
        found.append((turn - a, p, turn - b))
        p = np.sqrt(d * d - 2 + 2 * both - 2 * d * (sa + sb))
        turn = np.arctan2(ca + cb, d - sa - sb) - np.arctan2(2.0, p)
        found.append((a - turn, p, b - turn))
        p = _ROUND - np.arccos((6 - d * d + 2 * both + 2 * d * (sa - sb)) / 8)
        t = a - np.arctan2(ca - cb, d - sa + sb) + p / 2
        found.append((t, p, a - b - t + p))
        p = _ROUND - np.arccos((6 - d * d + 2 * both + 2 * d * (sb - sa)) / 8)
        t = -a - np.arctan2(ca - cb, d + sa - sb) + p / 2
        found.append((t, p, b - a - t + p))
    parts = np.stack([np.stack(three, axis=-1) for three in found], axis=-2)
    parts[..., [0, 2]] %= _ROUND
    parts[..., [0, 2]] = np.where(parts[..., [0, 2]] > _ROUND - _CLOSE, 0.0, parts[..., [0, 2]])
    return np.where(np.isfinite(parts).all(axis=-1, keepdims=True), parts, np.inf)


def dubins_way(start: ArrayLike, word: str, parts: ArrayLike, radius: float) -> Floats:
    """Return a path of straight legs that approximates a Dubins curve, in metres; float64, shape (k, 2).

    The argument ``word`` is a curve type of `WORDS`, and ``parts`` holds the three lengths that `dubins_parts` returns for this
    type. The legs of the path are tangents of the curve's arcs. Therefore a vehicle that rounds off each bend with the turning
    radius ``radius`` flies exactly along the curve. From leg to leg, the direction changes by at most `SHARPEST`. The first leg has
    the heading of the curve's start, and the last leg has the heading of the curve's end.
    """
    x, y, heading = (float(value) for value in np.asarray(start, dtype=np.float64))
    found = [(x, y)]
    for letter, length in zip(word, np.asarray(parts, dtype=np.float64).tolist(), strict=True):
        sense = _SENSE[letter]
        if not sense:
            x, y = x + radius * length * cos(heading), y + radius * length * sin(heading)
            continue
        count = max(1, ceil(length / SHARPEST - _CLOSE))
        bend = length / count
        reach = radius * tan(bend / 2)
        for _ in range(count):
            x, y = x + reach * cos(heading), y + reach * sin(heading)
            if reach > _SLIGHT:  # otherwise the path bends slightly where the arc begins
                found.append((x, y))
            heading += sense * bend
            x, y = x + reach * cos(heading), y + reach * sin(heading)
    found.append((x, y))
    return np.array(found)


def dubins_ways(starts: Floats, words: NDArray[np.int64], parts: Floats, radius: float) -> tuple[Floats, NDArray[np.int64]]:
    """Return the paths of many Dubins curves at once, equal to those of `dubins_way` except for rounding errors.

    Parameters
    ----------
    starts : ndarray of float64, shape (n, 3)
        Start pose of each curve, in metres and radians.
    words : ndarray of int64, shape (n,)
        Type of each curve as an index in `WORDS`.
    parts : ndarray of float64, shape (n, 3)
        Lengths of the parts of each curve, divided by the radius.
    radius : float
        Turning radius in metres.

    Returns
    -------
    points : ndarray of float64, shape (k, 2)
        The points of all paths in metres, path after path.
    numbers : ndarray of int64, shape (k,)
        Index of the curve to which each point belongs.
    """
    place, heading = starts[:, :2], starts[:, 2]
    columns, present = [place[:, None, :]], [np.ones((len(starts), 1), dtype=np.bool_)]
    for part in range(3):
        sense, length = _SENSES[words, part], parts[:, part]
        counts = np.maximum(np.ceil(length / SHARPEST - _CLOSE), 1.0)
        bend = length / counts
        number = np.arange(int(counts[sense != 0].max(initial=0.0)))
        # The tangents of an arc meet at the angle in the middle between two points of the arc, R / cos(bend / 2) from its centre.
        angles = heading[:, None] + (sense * bend)[:, None] * (number + 0.5)
        centre = place + (sense * radius)[:, None] * np.column_stack([-np.sin(heading), np.cos(heading)])
        away = sense * radius / np.cos(bend / 2)
        columns.append(centre[:, None, :] + away[:, None, None] * np.stack([np.sin(angles), -np.cos(angles)], axis=-1))
        bent = (sense != 0) & (radius * np.tan(bend / 2) > _SLIGHT)
        present.append(bent[:, None] & (number < counts[:, None]))
        ahead = np.where(sense == 0, radius * length, 0.0)[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        heading = heading + sense * length
        ended = centre + (sense * radius)[:, None] * np.column_stack([np.sin(heading), -np.cos(heading)])
        place = np.where((sense == 0)[:, None], place + ahead, ended)
    columns.append(place[:, None, :])
    present.append(np.ones((len(starts), 1), dtype=np.bool_))
    kept = np.concatenate(present, axis=1)
    return np.concatenate(columns, axis=1)[kept], np.nonzero(kept)[0]


def shortest_length(start: ArrayLike, end: ArrayLike, radius: float) -> float:
    """Return the length in metres of the shortest Dubins curve between two poses."""
    return float(dubins_parts(start, end, radius).sum(axis=-1).min() * radius)
