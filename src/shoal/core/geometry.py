"""Vectors in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def unit_vectors(angles: ArrayLike) -> NDArray[np.float64]:
    """Return (cos a, sin a) for each angle a in radians; shape (..., 2)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def left_of(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (x, y) turned to the left by a right angle, (-y, x); shape (..., 2)."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)
