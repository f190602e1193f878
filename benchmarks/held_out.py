"""Outlines of 36 further regions, for which only the price of a turn was chosen: county borders,
lakes, fields, islands.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from shapely.affinity import rotate, scale
from tests.reference.regions import county

PLACES = (
    ("WA", "Island"),
    ("WA", "Kitsap"),
    ("ME", "Knox"),
    ("ME", "Sagadahoc"),
    ("MD", "Talbot"),
    ("MD", "Calvert"),
    ("FL", "Pinellas"),
    ("MI", "Leelanau"),
    ("WI", "Door"),
    ("MA", "Nantucket"),
    ("MA", "Barnstable"),
    ("NY", "Suffolk"),
    ("RI", "Newport"),
    ("CA", "San Francisco"),
    ("CA", "Santa Cruz"),
    ("TX", "Galveston"),
    ("LA", "Orleans"),
    ("KS", "Ellis"),
    ("CO", "Boulder"),
    ("OR", "Hood River"),
    ("HI", "Kauai"),
)
# how rough the shore is, and length over width
LAKES = (0.15, 1.0), (0.3, 1.0), (0.25, 2.0), (0.2, 3.0), (0.4, 1.3)


def held_out_outlines() -> dict[str, Any]:
    """Return the outlines by name, of any size."""
    found = {f"{name}, {state}": county(state, name).parts[0] for state, name in PLACES}
    found |= {
        f"lake {k}": lake(*kind, np.random.default_rng(100 + k)) for k, kind in enumerate(LAKES)
    }
    for k in range(4):
        rng = np.random.default_rng(200 + k)
        corners = on_circle(np.sort(rng.uniform(0, 2 * np.pi, 5 + 2 * k)), 1.0)
        found[f"field {k}"] = rotate(
            scale(shapely.MultiPoint(corners).convex_hull, 1.6, 1), rng.uniform(0, 180)
        )
    for k in range(3):
        rng = np.random.default_rng(300 + k)
        way = np.sort(rng.uniform(0, 2 * np.pi, 11))
        found[f"ragged {k}"] = shapely.Polygon(on_circle(way, rng.uniform(0.5, 1, 11))).buffer(0)
    discs = [
        shapely.Point(0, 0).buffer(1),
        shapely.Point(1.7, 0.4).buffer(0.8),
        shapely.Point(2.9, -0.3).buffer(0.7),
    ]
    found["islands"] = shapely.union_all(discs).simplify(0.01)
    found["ring"] = (
        shapely.Point(0, 0)
        .buffer(1)
        .difference(shapely.Point(0.2, 0.1).buffer(0.45))
        .simplify(0.005)
    )
    found["T"] = rotate(
        shapely.union_all([shapely.box(0, 2, 4, 3), shapely.box(1.5, 0, 2.5, 2)]), 17
    )
    return found


def lake(rough: float, longer: float, rng: np.random.Generator) -> Any:
    """Return the outline of a lake with bays."""
    way = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    far = 1 + sum(rough / k * np.sin(k * way + rng.uniform(0, 6.28)) for k in (2, 3, 4, 5, 7, 9))
    shape = rotate(
        scale(shapely.Polygon(on_circle(way, far)).buffer(0), longer, 1), rng.uniform(0, 180)
    )
    return max(shapely.get_parts(shape), key=lambda part: part.area)


def on_circle(way: Any, far: Any) -> Any:
    """Return points at given angles and distances from the origin."""
    return np.stack([far * np.cos(way), far * np.sin(way)], axis=1)
