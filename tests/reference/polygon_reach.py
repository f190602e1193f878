"""The sets of Δ that moves reach in a polygon, by intersecting polygons: what
`shoal.steering.polygon_reach` is compared with.

For each pair of a contact c (used) and a contact d (next), the points q of the polygon that are no
deeper below the wall at c than before, and from which d + (q - c) or d - (q - c) is in the polygon
as well, form a convex polygon. The greatest depth below the wall at d is at one of its corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPoint, Polygon, affinity, get_coordinates, union_all

from shoal.steering import PolygonReach

_SLACK = 1e-9  # two particles nearer to one line count as touching it at once


def deeper(reach: PolygonReach) -> NDArray[np.float64]:
    """Return the depths at the contacts of a set before two more moves; float64, shape (2,
    contacts).
    """
    space, contacts = reach.workspace, reach.contacts
    whole = Polygon(space.vertices).buffer(1e-12 * space.size)
    best = np.full_like(reach.depths, -1.0)
    for row, used, slab in _slabs(reach):
        for following, turn in ((row, 1.0), (1 - row, -1.0)):
            for d, (contact, wall) in enumerate(zip(contacts, reach.walls, strict=True)):
                # the points q for which the next particle is in the polygon
                allowed = affinity.translate(
                    affinity.scale(whole, turn, turn, origin=(0, 0)), *(used - turn * contact)
                )
                common = slab.intersection(allowed)
                if common.is_empty:
                    continue
                moved = turn * (get_coordinates(common) - used)
                best[following, d] = max(best[following, d], (moved @ space.normals[wall]).max())
    return np.where(best > _SLACK * space.size, best, -1.0)


def area(reach: PolygonReach) -> float:
    """Return the fraction of all position differences in the set."""
    pieces = []
    slabs = [*_slabs(reach)]
    for sign, row in ((1.0, 0), (-1.0, 1)):
        mine = [(used, slab) for which, used, slab in slabs if which == row]
        on = np.flatnonzero(reach.depths[row] >= 0)
        pieces += [sign * (get_coordinates(slab) - used) for used, slab in mine]
        for (k, one), (following, other) in zip(
            zip(on, mine, strict=True), zip(on[1:], mine[1:], strict=True), strict=False
        ):
            if following == k + 1 and reach.walls[k] == reach.walls[following]:
                lower = one if reach.depths[row, k] <= reach.depths[row, following] else other
                swept = [get_coordinates(lower[1]) - used for used in (one[0], other[0])]
                pieces.append(sign * np.vstack(swept))
    union = union_all(
        [MultiPoint(piece).convex_hull for piece in pieces], grid_size=1e-12 * reach.workspace.size
    )
    return float(union.area / reach.workspace.differences.shape.area)


def _slabs(reach: PolygonReach) -> Iterator[tuple[int, NDArray[np.float64], Any]]:
    """Yield the toucher, the contact, and the polygon of points that are no deeper than before."""
    space = reach.workspace
    for row in range(2):
        for k in np.flatnonzero(reach.depths[row] >= 0):
            normal, used = space.normals[reach.walls[k]], reach.contacts[k]
            along = np.array([normal[1], -normal[0]]) * 4 * space.size
            deep = (reach.depths[row, k] + 1e-12 * space.size) * normal
            behind = space.size * normal
            strip = Polygon(
                [
                    used - along - behind,
                    used + along - behind,
                    used + along + deep,
                    used - along + deep,
                ]
            )
            yield row, used, Polygon(space.vertices).intersection(strip)
