"""SteeringWorkspace: what convex workspaces and regions with obstacles have in common."""

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
    """Base class of the workspaces.

    Attributes
    ----------
    kind : str
        Name of the kind of workspace for messages, such as "polygon".
    """

    kind: str

    @property
    @abstractmethod
    def dimensions(self) -> int:
        """2 or 3."""

    @property
    @abstractmethod
    def rings(self) -> tuple[Points, ...]:
        """Corners of the outline and of each obstacle, with free space on the left of each edge; each float64, shape (n, 2)."""

    @cached_property
    def size(self) -> float:
        """The largest extent of the workspace in the plane, to which relative tolerances refer."""
        return float(np.ptp(self.rings[0], axis=0).max())

    @property
    def bounds(self) -> tuple[Points, Points]:
        """The smallest and the largest x and y of the workspace, as two points; each float64, shape (2,)."""
        return self.rings[0].min(axis=0), self.rings[0].max(axis=0)

    @cached_property
    def edges(self) -> NDArray[np.float64]:
        """All edges as (x, y) of both ends, with free space on the left of each edge; float64, shape (edges, 4)."""
        return np.concatenate([np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in self.rings])

    @cached_property
    def shape(self) -> Any:
        """The area inside the outline and outside the obstacles, as a Shapely polygon."""
        from shapely import Polygon

        return Polygon(self.rings[0], self.rings[1:])

    @abstractmethod
    def depth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point to the nearest wall, negative for points outside; float64, shape (...)."""

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return for each point whether it lies inside or on a wall, with the tolerance `TOUCH`; bool, shape (...)."""
        return np.asarray(self.depth(points) >= -TOUCH * self.size)

    def check_inside(self, points: ArrayLike, *, what: str) -> Points:
        """Return points as a float64 array of shape (n, dimensions).

        Raises
        ------
        InvalidInputError
            If a point lies outside.
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
