"""Turns of fixed wings: a way of straight legs becomes one that they can follow."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from shoal.dataclass import dataclass
from shoal.errors import InvalidInputError
from shoal.search.flight.dubins import WORDS, Floats, dubins_parts, dubins_way
from shoal.search.regions.outline_checks import text_of

HEADINGS = 12  # at a point that may be passed in any direction
_AT_ONCE = 1000  # links whose curves are reckoned at once
_NEAR = 0.05  # metres: points that are no nearer to each other are passed one by one
_SAME = 1e-6  # metres, and radians


@dataclass
class _Poses:
    """Places in order, the headings in which each may be passed, and whether the way to the next is a straight leg.

    ``headings`` has shape (n, `HEADINGS`) with not-a-number for those that there are not.
    """

    points: Floats
    headings: Floats
    straight: list[bool]


def turned_way(way: Floats, radius: float, *, link: float = 0.0, blocked: Any = None) -> Floats:
    """Return a way along the legs of another one whose turns are as wide as a radius, outside of the legs.

    All vertices are passed. Legs longer than ``link``, but for the first and the last, are flown straight from end to end; all
    others may be left for a curve between their ends. Of all headings, `HEADINGS` where one is free, and all curves, those are
    taken that are shortest together.

    Parameters
    ----------
    way : ndarray of float64, shape (k, 2)
        Metres. First and last point may be left and reached in any direction.
    radius : float
        Metres.
    link : float
        Metres.
    blocked : Shapely geometry, optional
        What no curve crosses.

    Raises
    ------
    InvalidInputError
        If there is no curve that crosses nothing.

    Examples
    --------
    >>> rows = np.array([(0.0, 0.0), (400.0, 0.0), (400.0, 20.0), (0.0, 20.0), (-50.0, 0.0)])
    >>> flown = turned_way(rows, 50.0, link=30.0)
    >>> bool((flown[:, 0].max() > 450.0) & (len(flown) > 12))
    True
    """
    kept = np.concatenate([[True], np.hypot(*np.diff(way, axis=0).T) > _NEAR])
    points = way[kept]
    if len(points) < 3:
        return np.asarray(points)
    poses = _poses(points, link)
    links = np.flatnonzero(~np.array(poses.straight))
    lengths, words = _costs(poses, links, radius)
    open_links: set[int] = set()
    while True:
        chosen = _cheapest(poses, links, lengths)
        if chosen is None:
            at = text_of(poses.points[links[min(open_links)]])
            raise InvalidInputError(
                f"turn_radius: expected room for turns of {radius:.4g} m outside the no-go zones, got none from {at} on"
            )
        curves = _curves(poses, links, words, chosen, radius)
        closed = [number for number in _crossing(curves, blocked) if number not in open_links]
        if not closed:
            return _joined(poses, links, curves)
        for number in closed:  # all curves of these are looked at, once
            open_links.add(number)
            lengths[number], words[number] = _free_costs(poses, int(links[number]), radius, blocked)


def _poses(points: Floats, link: float) -> _Poses:
    """Return the places to pass: both ends of each straight leg with its heading, else a place with free headings."""
    legs = np.diff(points, axis=0)
    far = np.hypot(*legs.T) > max(link, _SAME)
    far[[0, -1]] = False
    free = np.arange(HEADINGS) * (2 * pi / HEADINGS)
    places: list[Floats] = []
    headings: list[Floats] = []
    straight: list[bool] = []
    for index, point in enumerate(points):
        before, after = index > 0 and far[index - 1], index < len(legs) and far[index]
        directions = [legs[leg] for leg, there in ((index - 1, before), (index, after)) if there]
        for number, direction in enumerate(directions or [None]):
            allowed = np.full(HEADINGS, np.nan)
            if direction is None:
                allowed[:] = free + _course(points, index)
            else:
                allowed[0] = np.arctan2(direction[1], direction[0])
            places.append(point)
            headings.append(allowed)
            straight.append(bool(after) and number == len(directions) - 1)
    return _Poses(np.array(places), np.array(headings), straight[:-1])


def _course(points: Floats, index: int) -> float:
    """Return the direction from the point before to the one after."""
    east, north = points[min(index + 1, len(points) - 1)] - points[max(index - 1, 0)]
    return float(np.arctan2(north, east))


def _costs(poses: _Poses, links: Any, radius: float) -> tuple[Floats, Any]:
    """Return for each link and pair of headings the length of the shortest curve, and its word."""
    lengths, words = np.full((len(links), HEADINGS, HEADINGS), np.inf), np.zeros((len(links), HEADINGS, HEADINGS), dtype=np.int8)
    for begin in range(0, len(links), _AT_ONCE):
        some = slice(begin, begin + _AT_ONCE)
        every = _parts(poses, links[some], radius).sum(axis=-1)
        lengths[some], words[some] = every.min(axis=-1), every.argmin(axis=-1)
    return lengths, words


def _parts(poses: _Poses, links: Any, radius: float) -> Floats:
    """Return the parts of all curves of links, shape (n, HEADINGS, HEADINGS, 6, 3); infinite for headings that there are not."""
    ends = []
    for some in (links, links + 1):
        place = np.broadcast_to(poses.points[some][:, None, :], (len(some), HEADINGS, 2))
        ends.append(np.concatenate([place, poses.headings[some][:, :, None]], axis=-1))
    return dubins_parts(ends[0][:, :, None, :], ends[1][:, None, :, :], radius)


def _free_costs(poses: _Poses, link: int, radius: float, blocked: Any) -> tuple[Floats, Any]:
    """Return the lengths of the shortest curves of one link that cross nothing, and their words."""
    parts = _parts(poses, np.array([link]), radius)[0]
    lengths = parts.sum(axis=-1)
    there = np.argwhere(np.isfinite(lengths))
    ways = [
        dubins_way((*poses.points[link], poses.headings[link, one]), WORDS[word], parts[one, other, word], radius)
        for one, other, word in there.tolist()
    ]
    for number in _crossing(ways, blocked):
        lengths[tuple(there[number])] = np.inf
    return lengths.min(axis=-1), lengths.argmin(axis=-1)


def _cheapest(poses: _Poses, links: Any, lengths: Floats) -> list[int] | None:
    """Return the heading of each place, as a column of ``headings``, of the shortest way; None if there is none."""
    number = dict(zip(links.tolist(), range(len(links)), strict=True))
    costs = [np.where(np.isnan(poses.headings[0]), np.inf, 0.0)]
    came: list[Any] = []
    for place in range(len(poses.points) - 1):
        if place in number:
            every = costs[-1][:, None] + lengths[number[place]]
        else:  # a straight leg: the only heading stays
            every = np.full((HEADINGS, HEADINGS), np.inf)
            every[0, 0] = costs[-1][0]
        came.append(every.argmin(axis=0))
        costs.append(every.min(axis=0))
    if not np.isfinite(costs[-1]).any():
        return None
    chosen = [int(costs[-1].argmin())]
    for before in reversed(came):
        chosen.append(int(before[chosen[-1]]))
    return chosen[::-1]


def _curves(poses: _Poses, links: Any, words: Any, chosen: list[int], radius: float) -> list[Floats]:
    found = []
    for number, link in enumerate(links.tolist()):
        one, other = chosen[link], chosen[link + 1]
        start = np.append(poses.points[link], poses.headings[link, one])
        end = np.append(poses.points[link + 1], poses.headings[link + 1, other])
        word = int(words[number, one, other])
        way = dubins_way(start, WORDS[word], dubins_parts(start, end, radius)[word], radius)
        way[-1] = poses.points[link + 1]  # but for rounding it is there
        found.append(way)
    return found


def _crossing(curves: list[Floats], blocked: Any) -> list[int]:
    """Return the numbers of curves that cross what is blocked."""
    if blocked is None or blocked.is_empty or not curves:
        return []
    import shapely

    shapely.prepare(blocked)
    lines = [shapely.linestrings(curve if len(curve) > 1 else np.repeat(curve, 2, axis=0)) for curve in curves]
    return [int(number) for number in np.flatnonzero(shapely.intersects(blocked, np.array(lines)))]


def _joined(poses: _Poses, links: Any, curves: list[Floats]) -> Floats:
    """Return the whole way, without points on straight stretches: ends of rows lie on the first legs of curves."""
    pieces = [poses.points[:1]]
    number = dict(zip(links.tolist(), curves, strict=True))
    pieces += [
        number[place][1:] if place in number else poses.points[place + 1 : place + 2] for place in range(len(poses.straight))
    ]
    way = np.vstack(pieces)
    way = way[np.concatenate([[True], np.hypot(*np.diff(way, axis=0).T) > _SAME])]
    legs = np.diff(way, axis=0)
    legs /= np.hypot(*legs.T)[:, None]
    bends = np.hypot(*np.diff(legs, axis=0).T) > _SAME
    return np.asarray(way[np.concatenate([[True], bends, [True]])])
