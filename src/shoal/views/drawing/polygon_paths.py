"""Functions that convert polygons to closed lines (rings) for drawing."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Ring = NDArray[np.float64]


def rings_of(area: Any) -> list[list[Ring]]:
    """Return the closed border lines (rings) of each part of an area, the outer ring first; each float64, shape (n, 2)."""
    return [
        [np.asarray(ring.coords)[:, :2] for ring in (part.exterior, *part.interiors)]
        for part in getattr(area, "geoms", [area])
        if part.geom_type == "Polygon" and not part.is_empty
    ]


def path_of_rings(rings: Iterable[Ring]) -> Any:
    """Return several closed lines (rings) as one matplotlib path."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(np.vstack([ring, ring[:1]]), closed=True) for ring in rings))


def hole_in(frame: Ring, ring: Ring) -> Ring:
    """Return the closed line ``ring`` with the orientation opposite to ``frame``. In drawings, this line is a hole in ``frame``."""
    areas = [float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) for x, y in (ring.T, frame.T)]
    return ring if areas[0] * areas[1] < 0 else ring[::-1]
