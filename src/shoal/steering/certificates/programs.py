"""What the convex programs of all certificates share: their variables, and the solver's settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Expression = NDArray[np.float64]
"""Rows of coefficients, one column for each variable; the last column is the constant."""


class Variables:
    """The variables of a convex program, added one after the other.

    Parameters
    ----------
    most : int
        Largest number of variables; expressions have so many columns until `columns` selects those
        in use.
    dimensions : int
        Number of coordinates of a vector.

    Attributes
    ----------
    count : int
        Number of variables so far.
    low, high, costs : ndarray of float64, shape (most,)
        Bounds of the variables, and their part of the objective.
    boxed : ndarray of bool, shape (most,)
        Whether the bounds of a variable do not follow from the rest of the program.
    """

    def __init__(self, most: int, dimensions: int) -> None:
        self.count = 0
        self.low, self.high, self.costs = np.zeros(most), np.zeros(most), np.zeros(most)
        self.boxed = np.zeros(most, np.bool_)
        self._shape = dimensions, most + 1

    @property
    def columns(self) -> list[int]:
        """Columns of the variables in use, and of the constant."""
        return [*range(self.count), len(self.low)]

    def vector(self, low: ArrayLike, high: ArrayLike, *, boxed: bool = False) -> Expression:
        """Add a vector between two bounds."""
        added = self._add(self._shape[0], low, high, boxed=boxed)
        vector = np.zeros(self._shape)
        vector[range(self._shape[0]), range(added.start, added.stop)] = 1
        return vector

    def point(self, origin: ArrayLike, axes: NDArray[np.float64]) -> Expression:
        """Add a point ``origin + fractions @ axes`` with fractions between 0 and 1."""
        point = self.constant(origin)
        point[:, self._add(len(axes), 0, 1, boxed=True)] = axes.T
        return point

    def length(self, most: float) -> Expression:
        """Add a length from 0 to ``most`` that is part of the objective; shape (1, columns)."""
        added = self._add(1, 0, most, boxed=False)
        self.costs[added] = 1
        length = np.zeros((1, self._shape[1]))
        length[0, added] = 1
        return length

    def constant(self, value: ArrayLike) -> Expression:
        """Return a constant vector as an expression."""
        constant = np.zeros(self._shape)
        constant[:, -1] = value
        return constant

    def _add(self, number: int, low: ArrayLike, high: ArrayLike, *, boxed: bool) -> slice:
        added = slice(self.count, self.count + number)
        self.low[added], self.high[added], self.boxed[added] = low, high, boxed
        self.count += number
        return added


def equality(left: Sequence[Expression], right: Sequence[Expression]) -> list[Expression]:
    """Return rows, each at least 0, that make points equal to others."""
    return [row for a, b in zip(left, right, strict=True) for row in (a - b, b - a)]


def solver_settings(clarabel: Any) -> Any:
    """Return the settings of Clarabel: silent, on one thread, and for the program as it is stated."""
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.presolve_enable = False, False
    settings.chordal_decomposition_enable, settings.max_threads = False, 1
    return settings
