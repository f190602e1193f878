"""SteeringWorkspace: the attributes and methods that convex workspaces and regions with obstacles have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.errors import InvalidInputError
from shoal.steering.workspaces.convex_geometry import Points

TOUCH = 1e-9  # relative to the size: a particle closer to a wall than this is on it
EXACT_TOUCH = 1e-12  # relative to the size: contact tolerance in sensitive computations


class SteeringWorkspace(ABC):
    """Base class of the workspaces of steering: areas or volumes in which particles move.

    Attributes
    ----------
    kind : str
        Name of the kind of workspace in error messages, such as "polygon".
    """

    kind: str

    @property
    @abstractmethod
    def dimensions(self) -> int:
        """Number of dimensions of the workspace, 2 or 3."""

    @property
    @abstractmethod
    def rings(self) -> tuple[Points, ...]:
        """One array of corners for the outline, followed by one array for each obstacle; each float64, shape (n, 2).

        The free space lies on the left of each edge from one corner to the next.
        """

    @cached_property
    def size(self) -> float:
        """The larger of the workspace's extents along x and y. Relative tolerances are fractions of this size."""
        return float(np.ptp(self.rings[0], axis=0).max())

    @property
    def bounds(self) -> tuple[Points, Points]:
        """The points (smallest x, smallest y) and (largest x, largest y) of the workspace; each float64, shape (2,)."""
        return self.rings[0].min(axis=0), self.rings[0].max(axis=0)

    @cached_property
    def edges(self) -> NDArray[np.float64]:
        """One row (start x, start y, end x, end y) for each edge of the workspace; float64, shape (edges, 4).

        The free space lies on the left of each edge.
        """
        return np.concatenate([np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in self.rings])

    @cached_property
    def shape(self) -> Any:
        """The area inside the outline and outside the obstacles, as a Shapely polygon."""
        from shapely import Polygon

        return Polygon(self.rings[0], self.rings[1:])

    @abstractmethod
    def depth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point from the nearest wall, negative outside the workspace; float64, shape (...)."""

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point lies inside the workspace or on a wall, with the tolerance `TOUCH`; bool, shape (...)."""
        return np.asarray(self.depth(points) >= -TOUCH * self.size)

    def check_inside(self, points: ArrayLike, *, what: str) -> Points:
        """Check that points lie in the workspace, and return the points as a float64 array of shape (n, dimensions).

        Raises
        ------
        InvalidInputError
            If a point lies outside the workspace.
        """
        array = check_points(points, what=what, dimensions=self.dimensions)
        outside = ~self.contains(array)
        if outside.any():
            index = int(np.argmax(outside))
            raise InvalidInputError(
                f"{what}: expected points inside the {self.kind}, got {tuple(array[index].tolist())} at point {index + 1}, "
                f"{-float(self.depth(array[index])):.3g} outside"
            )
        return array
