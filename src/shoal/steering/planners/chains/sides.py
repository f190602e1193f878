"""Chains in polygons with many corners: a search with a few sides, then a search with all sides near the found contacts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from shoal.steering.planners.chains.chain import REFINING, Chain, ChainQuery
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.normalized_walls import NormalizedWalls, with_few_sides

FEW = 9  # maximum number of sides for which all kinds of chains are tried
MANY = 12  # number of sides from which this reduction is used
_WORTH = 1e-4  # relative to the length: gain that justifies a change of sides
_END = 0.98  # relative to a side: a contact farther out may move to the next side


def between_few_sides(query: ChainQuery) -> ChainQuery:
    """Return a copy of the query in which the polygon has at most `FEW` of its sides.

    If the polygon has at most `MANY` sides, or if the chosen sides enclose no area, the function returns ``query`` unchanged.
    """
    found = with_few_sides(query.walls, FEW) if query.walls.sides > MANY else None
    return query if found is None else replace(query, walls=found)


def on_all_sides(query: ChainQuery, few: ChainQuery, chain: Chain) -> Chain:
    """Return a chain whose contacts have moved from the walls of the query ``few`` to the nearest walls of the whole polygon.

    The attribute ``length`` of the result is a copy of the length of ``chain``, not the exact length after the contacts have moved.
    """
    walls, d = query.walls, query.walls.dimensions
    sides, on = walls.sides, chain.walls.copy()
    unknowns = chain.unknowns.copy()
    for m, contact in enumerate(chain.contacts(few.walls)):
        if chain.walls[m] >= few.walls.sides:
            on[m] += sides - few.walls.sides
            continue
        outward = -(walls.normals[:sides, :2] @ contact[:2]) / -walls.offsets[:sides]
        on[m] = int(np.argmax(outward))
        unknowns[m * (d - 1)] = _along_side(walls, int(on[m]), contact)
    return replace(chain, walls=on, unknowns=unknowns)


def _along_side(walls: NormalizedWalls, side: int, point: Points) -> float:
    """Return the point of a side that is nearest to ``point``, as its signed distance from the midpoint of the side."""
    frame, end = walls.frames[side], np.linalg.norm(walls.frames[side, 0, :2] - walls.corners[side])
    return float(np.clip(frame[1] @ (point - frame[0]), -0.9 * end, 0.9 * end))


def _neighbours(query: ChainQuery, chain: Chain, step: int) -> Iterator[Chain]:
    """Yield copies of ``chain``, each with one contact on another side of the polygon.

    In ``chain``, the contact is at an end of its side. In the copy, the contact is on the ``step``-th side beyond this end.

    The attribute ``length`` of each yielded chain is still the length of ``chain``.
    """
    walls, d = query.walls, query.walls.dimensions
    contacts = chain.contacts(walls)
    for m, side in enumerate(chain.walls.tolist()):
        if side >= walls.sides:
            continue
        end = float(np.linalg.norm(walls.frames[side, 0, :2] - walls.corners[side]))
        along = float(chain.unknowns[m * (d - 1)])
        if abs(along) < _END * end:
            continue
        on, unknowns = chain.walls.copy(), chain.unknowns.copy()
        on[m] = (side + (step if along > 0 else -step)) % walls.sides
        unknowns[m * (d - 1)] = _along_side(walls, int(on[m]), contacts[m])
        yield replace(chain, walls=on, unknowns=unknowns)


def slid(query: ChainQuery, chain: Chain) -> Chain:
    """Return the chain that results if contacts move to neighbouring sides of the polygon as long as this shortens the chain."""
    step = query.walls.sides // FEW if query.walls.sides > MANY else 0
    while step > 0 and not query.late:
        shorter = None
        for other in _neighbours(query, chain, step):
            length = query.settle(other.unknowns, other.touchers, other.walls, rounds=REFINING[:3], bound=chain.length)
            if length < chain.length * (1 - _WORTH):
                shorter = replace(other, length=length)
                break
        chain, step = (chain, step // 2) if shorter is None else (shorter, step)
    return chain
