"""Regions: workspaces of any shape, with obstacles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_list, check_points, fault_place
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.workspaces.convex import Points, SteeringWorkspace


@dataclass(frozen=True, eq=False)
class Region(SteeringWorkspace):
    """A workspace with obstacles: the points inside an outline and outside the obstacles.

    The function `region` creates a Region.

    Parameters
    ----------
    outline : ndarray of float64, shape (n, 2)
        Corners of the outline, counter-clockwise.
    obstacles : tuple of ndarray of float64, each of shape (n, 2)
        Corners of each obstacle, clockwise, so that the free space lies on the left of every edge.
    """

    outline: Points
    obstacles: tuple[Points, ...]

    kind = "region"
    dimensions = 2
    round = False
    height = 0.0

    @property
    def rings(self) -> tuple[Points, ...]:
        """Corners of the outline, followed by the corners of each obstacle; each float64, shape (n,
        2).
        """
        return self.outline, *self.obstacles

    def depth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point from the nearest edge, negative for points outside the
        region; float64, shape (...).
        """
        import shapely

        array = np.asarray(points, dtype=np.float64)
        spots = shapely.points(array)
        away = shapely.distance(self.shape.boundary, spots)
        return np.asarray(np.where(shapely.intersects(self.shape, spots), away, -away))

    def __repr__(self) -> str:
        return f"<Region, {len(self.outline)} corners, {len(self.obstacles)} obstacles>"


def region(outline: ArrayLike, obstacles: Sequence[ArrayLike] = ()) -> Region:
    """Return the workspace that lies inside ``outline`` and outside the obstacles.

    The obstacles must lie inside ``outline`` and must not touch each other.

    Examples
    --------
    >>> yard = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    >>> yard.contains([(0.5, 0.5), (1.5, 1.5)]).tolist()
    [True, False]
    """
    from shapely import Polygon
    from shapely.geometry.polygon import orient

    rings = [
        check_points(ring, what="outline" if k == 0 else f"obstacle {k}", dimensions=2)
        for k, ring in enumerate([outline, *check_list(obstacles, what="obstacles")])
    ]
    for k, ring in enumerate(rings):
        name = "outline" if k == 0 else f"obstacle {k}"
        if len(np.unique(ring, axis=0)) < 3:
            raise InvalidInputError(
                f"{name}: expected 3 different vertices or more, got {len(np.unique(ring, axis=0))}"
            )
        polygon = Polygon(ring)
        if not polygon.is_valid or polygon.area <= 1e-12 * float(np.ptp(ring, axis=0).max()) ** 2:
            why = "one without an area" if polygon.is_valid else "one that crosses itself"
            raise InvalidInputError(
                f"{name}: expected an outline that encloses an area and does not cross itself, got"
                f" {why}{fault_place(polygon)}"
            )
    area = Polygon(rings[0], rings[1:])
    if not area.is_valid:
        raise InvalidInputError(
            "region: expected obstacles inside the outline and apart from each other, got others"
            f"{fault_place(area)}"
        )
    oriented = orient(area)
    corners = [np.asarray(ring.coords)[:-1] for ring in (oriented.exterior, *oriented.interiors)]
    return Region(
        _without_repeats(corners[0]), tuple(_without_repeats(ring) for ring in corners[1:])
    )


def _without_repeats(ring: Points) -> Points:
    return np.asarray(ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)])
