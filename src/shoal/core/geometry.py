"""Vectors and paths in the plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def unit_vectors(angles: ArrayLike) -> NDArray[np.float64]:
    """Return (cos a, sin a) for each angle a in radians; shape (..., 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def left_of(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (x, y) turned to the left by a right angle, (-y, x); shape (..., 2)."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def angles_of(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle of each vector from the x axis, in radians from -π to π; shape (...)."""
    return np.asarray(np.arctan2(vectors[..., 1], vectors[..., 0]))


def cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x y' - y x' of each pair of vectors (x, y) and (x', y'), which is above 0 if the other
    vector lies to the left; shape (...).
    """
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


def step_lengths(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance from each point of a path to the next; shape (n - 1,)."""
    return np.asarray(np.hypot(*np.diff(points, axis=0).T))


def segments_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the segments of a path of n points, by their ends; shape (n - 1, 2, dimensions)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def partial_sums(values: ArrayLike) -> NDArray[Any]:
    """Return 0 and the sum of the first k values for each k, such as the distances from the start
    of a path to its points; shape (n + 1,).
    """
    return np.concatenate([[0], np.cumsum(values)])
