"""Shortest ways around the corners of a region."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.regions.outline_checks import Points
from shoal.search.regions.region import SearchRegion

_STRAIGHT = 1e-12  # sine of a turn that is none
_ALONG = 1e-9  # sine of the angle between lines that are one
_AT_ONCE = 100_000  # segments tested in one call
_LOOK_AHEAD = 64


def inside(region: SearchRegion, starts: Points, ends: Points) -> NDArray[np.bool_]:
    """Tell which straight segments stay in the region, within `TOUCH`; bool, shape (n,)."""
    import shapely

    found = np.empty(len(starts), dtype=np.bool_)
    for low in range(0, len(starts), _AT_ONCE):
        part = slice(low, low + _AT_ONCE)
        lines = shapely.linestrings(np.stack([starts[part], ends[part]], axis=1))
        found[part] = shapely.covers(region.reach, lines)
    return found


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners at which the inside of a region has more than 180 degrees: where shortest ways bend.

    Parameters
    ----------
    points, before, after : ndarray of float64, shape (n, 2)
        The corners, and their neighbours on the border.
    """

    points: Points
    before: Points
    after: Points

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, chosen: NDArray[Any]) -> Corners:
        return Corners(self.points[chosen], self.before[chosen], self.after[chosen])

    def touched(self, directions: Points) -> NDArray[np.bool_]:
        """Tell whether a line through each corner leaves both of its sides on one hand: other lines are in no shortest way."""
        sines = []
        for neighbours in (self.before, self.after):
            side = neighbours - self.points
            cross = directions[:, 0] * side[:, 1] - directions[:, 1] * side[:, 0]
            sines.append(cross / np.maximum(np.hypot(*directions.T) * np.hypot(*side.T), np.finfo(float).tiny))
        return np.asarray((np.minimum(*sines) >= -_ALONG) | (np.maximum(*sines) <= _ALONG))


def inward_corners(area: Any) -> Corners:
    """Return the corners of a polygon where shortest ways bend."""
    import shapely

    found = []
    for polygon in shapely.get_parts(area):
        turned = shapely.orient_polygons(polygon)
        for ring in (turned.exterior, *turned.interiors):
            corners = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
            come, go = corners - before, after - corners
            inward = come[:, 0] * go[:, 1] - come[:, 1] * go[:, 0] < -_STRAIGHT * np.hypot(*come.T) * np.hypot(*go.T)
            found.append(np.stack([corners[inward], before[inward], after[inward]]))
    return Corners(*np.concatenate(found, axis=1))


def around(region: SearchRegion, start: Points, end: Points, corners: Corners) -> Points | None:
    """Return the shortest way that bends at the given corners only (A*), or None; float64, shape (k, 2).

    What a corner sees is looked up when the search comes to it.
    """
    nodes = np.vstack([corners.points, start, end])
    first, last = len(nodes) - 2, len(nodes) - 1
    to_end = np.hypot(*(nodes - end).T)
    length = np.full(len(nodes), np.inf)
    length[first] = 0.0
    came = np.full(len(nodes), -1)
    done = np.zeros(len(nodes), dtype=np.bool_)
    queue = [(float(to_end[first]), first)]
    while queue:
        _, node = heapq.heappop(queue)
        if done[node]:
            continue
        if node == last:
            return nodes[_chain(came, last)]
        done[node] = True
        steps = nodes - nodes[node]
        reached = length[node] + np.hypot(*steps.T)
        better = ~done & (reached < length)
        better[:first] &= corners.touched(steps[:first])
        if node < first:
            better &= corners[np.full(len(nodes), node)].touched(steps)
        asked = np.flatnonzero(better)
        seen = asked[inside(region, np.broadcast_to(nodes[node], (len(asked), 2)), nodes[asked])]
        length[seen], came[seen] = reached[seen], node
        for other in seen.tolist():
            heapq.heappush(queue, (float(reached[other] + to_end[other]), other))
    return None


def _chain(came: NDArray[np.int64], last: int) -> list[int]:
    way = [last]
    while came[way[-1]] >= 0:
        way.append(int(came[way[-1]]))
    return way[::-1]


def pulled(region: SearchRegion, way: Points) -> Points:
    """Return a way without the bends that it does not need, each leg as far along it as can be seen."""
    kept = [0]
    while kept[-1] < len(way) - 1:
        here = kept[-1]
        ahead = np.arange(here + 1, min(here + 1 + _LOOK_AHEAD, len(way)))
        seen = inside(region, np.broadcast_to(way[here], (len(ahead), 2)), way[ahead])
        seen[0] = True  # this leg is there already
        kept.append(int(ahead[np.flatnonzero(seen)[-1]]))
    return np.asarray(way[kept])


def merge_collinear(points: Points) -> Points:
    """Return a way without repeated points and without those on a straight leg; turns back are kept.

    Examples
    --------
    >>> merge_collinear(np.array([(0, 0), (1, 0), (1, 0), (2, 0), (1, 0), (1, 1.0)])).tolist()
    [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    way = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    if len(way) < 2:
        return way
    way = way[np.concatenate([[True], np.any(np.diff(way, axis=0) != 0, axis=1)])]
    steps = np.diff(way, axis=0)
    before, after = steps[:-1], steps[1:]
    scale = np.hypot(*before.T) * np.hypot(*after.T)
    turn = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    straight = (turn <= 1e-9 * scale) & (np.sum(before * after, axis=1) > 0)
    return np.asarray(way[np.concatenate([[True], ~straight, np.ones(min(1, len(steps)), dtype=np.bool_)])])
