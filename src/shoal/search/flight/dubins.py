"""Dubins paths: flights with a smallest turning radius."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from itertools import pairwise
from math import ceil, cos, pi, sin, tan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline import text_of

Floats = NDArray[np.float64]

WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
"""The six types of shortest paths with a minimum turning radius, spelled with L (left), S
(straight) and R (right).
"""

SHARPEST = pi / 6  # largest bend of an approximated path at a vertex
_ROUND = 2 * pi
_CLOSE = 1e-9
_SLIGHT = 0.01  # metres: half of an arc that needs no vertex
_SENSE = {"L": 1.0, "R": -1.0, "S": 0.0}
_SENSES = np.array([[_SENSE[letter] for letter in word] for word in WORDS])


def dubins_parts(starts: ArrayLike, ends: ArrayLike, radius: float) -> Floats:
    """Return, for each pair of a start pose and an end pose, the lengths of the arcs and segments
    of all six Dubins curves.

    Parameters
    ----------
    starts, ends : array_like of float, shape (..., 3)
        Poses (x, y, heading), with x and y in metres and the heading in radians counter-clockwise
        from east. NumPy broadcasts the two arrays to pairs of poses.
    radius : float
        Minimum turning radius in metres.

    Returns
    -------
    ndarray of float64, shape (..., 6, 3)
        For each curve type in `WORDS`, the lengths of the curve's three parts divided by the
        radius. If a curve does not exist, its lengths are infinite.

    Notes
    -----
    The source is Dubins, "On curves of minimal length with a constraint on average curvature",
    1957. The formulas are those of Shkel and Lumelsky, "Classification of the Dubins set", 2001.

    Examples
    --------
    >>> parts = dubins_parts((0, 0, 0), (0, 200, pi), 50.0)
    >>> print(parts.sum(axis=-1).min().round(3) * 50)  # half a circle, 100 m across, half a circle
    257.1
    """
    one, other = np.broadcast_arrays(
        np.asarray(starts, dtype=np.float64), np.asarray(ends, dtype=np.float64)
    )
    across = (other[..., :2] - one[..., :2]) / radius
    d, toward = np.hypot(across[..., 0], across[..., 1]), np.arctan2(across[..., 1], across[..., 0])
    a, b = one[..., 2] - toward, other[..., 2] - toward
    sa, sb, ca, cb, both = np.sin(a), np.sin(b), np.cos(a), np.cos(b), np.cos(a - b)
    found = []
    with np.errstate(invalid="ignore"):  # nonexistent curves are NaN until the end
        turn = np.arctan2(cb - ca, d + sa - sb)
        found.append(
            (turn - a, np.sqrt(np.maximum(2 + d * d - 2 * both + 2 * d * (sa - sb), 0.0)), b - turn)
        )
        turn = np.arctan2(ca - cb, d - sa + sb)
        found.append(
            (a - turn, np.sqrt(np.maximum(2 + d * d - 2 * both + 2 * d * (sb - sa), 0.0)), turn - b)
        )
        p = np.sqrt(d * d - 2 + 2 * both + 2 * d * (sa + sb))
        turn = np.arctan2(-ca - cb, d + sa + sb) - np.arctan2(-2.0, p)
        found.append((turn - a, p, turn - b))
        p = np.sqrt(d * d - 2 + 2 * both - 2 * d * (sa + sb))
        turn = np.arctan2(ca + cb, d - sa - sb) - np.arctan2(2.0, p)
        found.append((a - turn, p, b - turn))
        p = _ROUND - np.arccos((6 - d * d + 2 * both + 2 * d * (sa - sb)) / 8)
        t = a - np.arctan2(ca - cb, d - sa + sb) + p / 2
        found.append((t, p, a - b - t + p))
        p = _ROUND - np.arccos((6 - d * d + 2 * both + 2 * d * (sb - sa)) / 8)
        t = -a - np.arctan2(ca - cb, d + sa - sb) + p / 2
        found.append((t, p, b - a - t + p))
    parts = np.stack([np.stack(three, axis=-1) for three in found], axis=-2)
    parts[..., [0, 2]] %= _ROUND
    parts[..., [0, 2]] = np.where(parts[..., [0, 2]] > _ROUND - _CLOSE, 0.0, parts[..., [0, 2]])
    return np.where(np.isfinite(parts).all(axis=-1, keepdims=True), parts, np.inf)


def dubins_way(start: ArrayLike, word: str, parts: ArrayLike, radius: float) -> Floats:
    """Return a path of straight legs that approximates a Dubins curve, in metres; float64, shape
    (k, 2).

    The argument ``word`` is a curve type of `WORDS`, and ``parts`` holds the three lengths that
    `dubins_parts` returns for this type. The legs of the path are tangents of the curve's arcs.
    Therefore a vehicle that rounds off each bend with the turning radius ``radius`` flies exactly
    along the curve. From leg to leg, the direction changes by at most `SHARPEST`. The first leg has
    the heading of the curve's start, and the last leg has the heading of the curve's end.
    """
    x, y, heading = (float(value) for value in np.asarray(start, dtype=np.float64))
    found = [(x, y)]
    for letter, length in zip(word, np.asarray(parts, dtype=np.float64).tolist(), strict=True):
        sense = _SENSE[letter]
        if not sense:
            x, y = x + radius * length * cos(heading), y + radius * length * sin(heading)
            continue
        count = max(1, ceil(length / SHARPEST - _CLOSE))
        bend = length / count
        reach = radius * tan(bend / 2)
        for _ in range(count):
            x, y = x + reach * cos(heading), y + reach * sin(heading)
            if reach > _SLIGHT:  # otherwise the path bends slightly where the arc begins
                found.append((x, y))
            heading += sense * bend
            x, y = x + reach * cos(heading), y + reach * sin(heading)
    found.append((x, y))
    return np.array(found)


def dubins_ways(
    starts: Floats, words: NDArray[np.int64], parts: Floats, radius: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the paths of many Dubins curves at once, equal to those of `dubins_way` except for
    rounding errors.

    Parameters
    ----------
    starts : ndarray of float64, shape (n, 3)
        Start pose of each curve, in metres and radians.
    words : ndarray of int64, shape (n,)
        Type of each curve as an index in `WORDS`.
    parts : ndarray of float64, shape (n, 3)
        Lengths of the parts of each curve, divided by the radius.
    radius : float
        Turning radius in metres.

    Returns
    -------
    points : ndarray of float64, shape (k, 2)
        The points of all paths in metres, path after path.
    numbers : ndarray of int64, shape (k,)
        Index of the curve to which each point belongs.
    """
    place, heading = starts[:, :2], starts[:, 2]
    columns, present = [place[:, None, :]], [np.ones((len(starts), 1), dtype=np.bool_)]
    for part in range(3):
        sense, length = _SENSES[words, part], parts[:, part]
        counts = np.maximum(np.ceil(length / SHARPEST - _CLOSE), 1.0)
        bend = length / counts
        number = np.arange(int(counts[sense != 0].max(initial=0.0)))
        # The tangents of an arc meet at the angle in the middle between two points of the arc, R /
        # cos(bend / 2) from its centre.
        angles = heading[:, None] + (sense * bend)[:, None] * (number + 0.5)
        centre = place + (sense * radius)[:, None] * np.column_stack(
            [-np.sin(heading), np.cos(heading)]
        )
        away = sense * radius / np.cos(bend / 2)
        columns.append(
            centre[:, None, :]
            + away[:, None, None] * np.stack([np.sin(angles), -np.cos(angles)], axis=-1)
        )
        bent = (sense != 0) & (radius * np.tan(bend / 2) > _SLIGHT)
        present.append(bent[:, None] & (number < counts[:, None]))
        ahead = np.where(sense == 0, radius * length, 0.0)[:, None] * np.column_stack(
            [np.cos(heading), np.sin(heading)]
        )
        heading = heading + sense * length
        ended = centre + (sense * radius)[:, None] * np.column_stack(
            [np.sin(heading), -np.cos(heading)]
        )
        place = np.where((sense == 0)[:, None], place + ahead, ended)
    columns.append(place[:, None, :])
    present.append(np.ones((len(starts), 1), dtype=np.bool_))
    kept = np.concatenate(present, axis=1)
    return np.concatenate(columns, axis=1)[kept], np.nonzero(kept)[0]


def shortest_length(start: ArrayLike, end: ArrayLike, radius: float) -> float:
    """Return the length in metres of the shortest Dubins curve between two poses."""
    return float(dubins_parts(start, end, radius).sum(axis=-1).min() * radius)


NEAR = 0.05
"""Distance in metres below which two points count as one."""

# at a point that may be passed in any direction: those of `_FREE` from the leg after it, and along
# the leg before
HEADINGS = 17
LINK = (
    1.001  # footprints: both ends of a shorter leg see all of it, so it need not be flown straight
)
_FREE = np.radians([*range(0, 360, 30), *range(45, 360, 90)])  # corners are passed across
_KEPT, _CUT = 1, 2  # marks of vertices
_AT_ONCE = 1000  # number of links whose curves are computed at once
_TOUCH = 0.005  # metres by which a curve may enter a blocked area because of rounding
_SAME = 1e-6  # metres, and radians
_AHEAD = np.array(
    [0.0, 1.0, 2.0, 4.0]
)  # lengths of straight ends of a detour, divided by the radius
_RETRIED = 4  # number of links before an unreachable point that may become detours


@dataclass
class _Poses:
    """The points of a path, the possible headings at each point, and whether the leg to the next
    point is straight.

    The array ``headings`` has shape (n, `HEADINGS`), with NaN for unused entries. The list
    ``vertices`` holds the index of the vertex at each point. A vertex between two straight legs
    gives two points, with different headings.
    """

    points: Floats
    headings: Floats
    straight: list[bool]
    vertices: list[int]


@dataclass
class _Room:
    """The allowed area and the blocked areas for curves. A curve must not cross a blocked area.

    A curve may leave the allowed area only if the straight line between the ends of the curve also
    leaves the allowed area.
    """

    blocked: Any
    area: Any

    @classmethod
    def of(cls, blocked: Any, area: Any) -> _Room:
        """Return the allowed area and the blocked areas, each with a small tolerance for rounding
        errors.
        """
        import shapely

        closed = None if blocked is None or blocked.is_empty else blocked.buffer(-_TOUCH)
        room = cls(closed, None if area is None else area.buffer(_TOUCH, join_style="mitre"))
        shapely.prepare([shape for shape in (room.blocked, room.area) if shape is not None])
        return room

    def crossing(self, curves: list[Floats]) -> list[int]:
        """Return the indices of the curves that cross a blocked area or leave the allowed area."""
        if not curves:
            return []
        numbers = np.repeat(np.arange(len(curves)), [len(curve) for curve in curves])
        return [
            int(number) for number in np.flatnonzero(self.crossed(np.concatenate(curves), numbers))
        ]

    def crossed(self, points: Floats, numbers: Any) -> Any:
        """Return whether each of n curves crosses a blocked area or leaves the allowed area; bool,
        shape (n,).

        The array ``points`` holds the points of all curves, and ``numbers`` the index of the curve
        of each point, ascending from 0.
        """
        count = int(numbers[-1]) + 1 if len(numbers) else 0
        if not count or (self.blocked is None and self.area is None):
            return np.zeros(count, dtype=np.bool_)
        import shapely

        begins = np.searchsorted(numbers, np.arange(count))
        single = begins[np.diff(np.append(begins, len(numbers))) == 1]
        if len(single):  # a line needs two points
            points, numbers = (
                np.insert(points, single, points[single], axis=0),
                np.insert(numbers, single, numbers[single]),
            )
            begins = np.searchsorted(numbers, np.arange(count))
        lines = shapely.linestrings(points, indices=numbers)
        wrong = (
            np.zeros(count, dtype=np.bool_)
            if self.blocked is None
            else shapely.intersects(self.blocked, lines)
        )
        if self.area is not None:
            ends = np.append(begins[1:], len(numbers)) - 1
            chords = shapely.linestrings(np.stack([points[begins], points[ends]], axis=1))
            wrong |= ~shapely.covers(self.area, lines) & shapely.covers(self.area, chords)
        return wrong


Costs = dict[bytes, tuple[Floats, Any]]
"""Costs of links, as `KnownCurves` holds them."""


@dataclass
class KnownCurves:
    """A cache of curves, which all candidate sorties along one route share.

    Several routes may share the costs, but not the vertices: the result for a route must not depend
    on the routes before it.

    Parameters
    ----------
    costs : dict
        For each link (two points that a curve must connect), the lengths of the shortest unblocked
        curves, and the types of these curves as indices in `WORDS`. The key of a link consists of
        its two end points and their possible headings.
    loose : set
        Vertices at which straight legs had to be shortened, because all curves at the vertex were
        blocked.
    """

    costs: Costs = field(default_factory=dict)
    loose: set[bytes] = field(default_factory=set)


def turned_way(
    way: Floats,
    radius: float,
    *,
    link: float = 0.0,
    blocked: Any = None,
    area: Any = None,
    known: KnownCurves | None = None,
    cuts: Sequence[int] = (),
) -> list[Floats]:
    """Return a path that follows the legs of a given path, and turns outside these legs with at
    least a minimum radius.

    The path passes all vertices of the given path. The path follows legs longer than ``link``
    straight from end to end, and may replace any shorter leg by a curve. If the first or the last
    point is given twice, the path follows the leg at this point straight. The function chooses the
    curves, and the headings at the vertices, so that the total length is smallest. At a vertex
    without a straight leg, the function compares `HEADINGS` headings.

    If all curves at an end of a straight leg are blocked, the path near this end passes a series of
    points on the leg, each in any direction. The distance between neighbouring points is at most
    max(``link`` / `LINK`, ``radius`` / 8). If this does not suffice, the path makes detours: it
    leaves a point straight on, out of a gap between blocked areas, before it turns.

    Parameters
    ----------
    way : ndarray of float64, shape (k, 2)
        Given path in metres. The vehicle may leave the first point, and reach the last point, in
        any direction.
    radius : float
        Minimum turning radius in metres.
    link : float
        Maximum length in metres of a straight leg that a curve may replace, usually `LINK` times
        the side of the footprint.
    blocked : Shapely geometry, optional
        Areas that no curve may cross.
    area : Shapely geometry, optional
        Area that a curve must not leave if the straight line between the ends of the curve lies
        inside the area.
    known : KnownCurves, optional
        Cache of curves for paths with equal ``radius``, ``link``, ``blocked`` and ``area``. New
        curves are added to the cache.
    cuts : sequence of int
        Indices of inner vertices at which the path is cut. A piece begins in the direction in which
        the previous piece ends.

    Returns
    -------
    list of ndarray of float64, each of shape (m, 2)
        The pieces of the path between cuts, in metres. A path without cuts is a single piece.

    Raises
    ------
    InvalidInputError
        If the vehicle has no room for a turn.

    Examples
    --------
    >>> rows = np.array([(0.0, 0.0), (400.0, 0.0), (400.0, 20.0), (0.0, 20.0), (-50.0, 0.0)])
    >>> (flown,) = turned_way(rows, 50.0, link=30.0)
    >>> bool((flown[:, 0].max() > 450.0) & (len(flown) > 12))
    True
    """
    moves = np.hypot(*np.diff(way, axis=0).T) > NEAR
    points = np.asarray(way[np.concatenate([[True], moves])])
    points[-1] = way[-1]  # a last leg shorter than NEAR is not flown, but the path ends at its end
    if len(points) < 3:
        return [points]
    marks = np.zeros(len(points), dtype=np.int8)
    marks[[1, -2, -1]] = _KEPT
    marks[np.cumsum(moves)[np.asarray(cuts, dtype=np.int64) - 1]] = _CUT
    straight = np.hypot(*np.diff(points, axis=0).T) > max(link, _SAME)
    straight[[0, -1]] = ~moves[[0, -1]]  # where the first or last point is given twice
    room = _Room.of(blocked, area)
    memory = KnownCurves() if known is None else known
    loosen = [vertex for vertex, point in enumerate(points) if point.tobytes() in memory.loose]
    detours = False
    while True:
        for vertex in reversed(loosen):
            points, straight, marks = _loosened(
                points, straight, marks, vertex, 3 * radius, max(link / LINK, radius / 8)
            )
        found = _along(_poses(points, straight), radius, room, memory, detours=detours)
        if not isinstance(found, list):
            return _joined(*found, marks)
        *stuck, lost = found
        exhausted = not any(straight[max(vertex - 1, 0) : vertex + 1].any() for vertex in stuck)
        if exhausted and not detours:
            detours, loosen = True, []
            continue
        if exhausted:
            allowed = (
                "outside the no-go zones" if area is None else "in the airspace around the region"
            )
            raise InvalidInputError(
                f"turn_radius: expected room for turns of {radius:.4g} m {allowed}, got none at"
                f" {text_of(points[lost])}"
            )
        memory.loose.update(points[vertex].tobytes() for vertex in stuck)
        loosen = stuck


def _loosened(
    points: Floats, straight: Any, marks: Any, vertex: int, reach: float, step: float
) -> tuple[Floats, Any, Any]:
    """Return the points, the straight legs and the marks of a path, with shorter straight legs at a
    vertex.

    The vehicle passes the removed section of each leg point by point.
    """
    for leg in (vertex, vertex - 1):  # the later leg first, because indices change after it
        if not (0 <= leg < len(straight)) or not straight[leg]:
            continue
        along = points[leg + 1] - points[leg]
        length = float(np.hypot(*along))
        whole = (
            length <= reach + step
        )  # then the whole leg is passed point by point, otherwise only the part within reach
        count = ceil(length / step - _SAME) if whole else int(reach / step)
        far = np.arange(1, count + (not whole)) * (1 / count if whole else step / length)
        shares = far if leg == vertex else 1.0 - far[::-1]
        left = np.zeros(len(shares) + 1, dtype=np.bool_)
        left[-1 if leg == vertex else 0] = not whole
        points = np.insert(points, leg + 1, points[leg] + shares[:, None] * along, axis=0)
        marks = np.insert(marks, leg + 1, np.zeros(len(shares), dtype=np.int8))
        straight = np.concatenate([straight[:leg], left, straight[leg + 1 :]])
    return points, straight, marks


def _along(
    poses: _Poses, radius: float, room: _Room, known: KnownCurves, *, detours: bool
) -> tuple[_Poses, Any, list[Floats]] | list[int]:
    """Return the shortest path through all points.

    With ``detours``, the links before a point that is otherwise unreachable may make detours. If no
    path exists, return the vertices at which straight legs must be shortened, followed by the first
    unreachable vertex.
    """
    links = np.flatnonzero(~np.array(poses.straight))
    lengths, words = _costs(poses, links, radius)
    looked: set[int] = set()
    extended: set[int] = set()
    known_curves: dict[tuple[int, int, int], Floats] = {}
    while True:
        chosen = _cheapest(poses, links, lengths)
        if isinstance(chosen, int):
            before = (
                range(*np.searchsorted(links, (chosen - _RETRIED, chosen)).tolist())
                if detours
                else ()
            )
            retried = [number for number in before if number not in extended]
            if retried:
                for number in retried:
                    looked.add(number)
                    extended.add(number)
                    lengths[number], words[number] = _detour_costs(
                        poses, int(links[number]), radius, room, known
                    )
                known_curves = {
                    key: curve for key, curve in known_curves.items() if key[0] not in extended
                }
                continue
            stuck = [
                number for number in looked if not np.isfinite(lengths[number]).any()
            ] or looked
            ends = (poses.vertices[links[number] + end] for number in stuck for end in (0, 1))
            return [*sorted({int(vertex) for vertex in ends}), poses.vertices[chosen]]
        keys = [
            (number, chosen[link], chosen[link + 1]) for number, link in enumerate(links.tolist())
        ]
        fresh = [key for key in keys if key not in known_curves]
        curves = _curves(poses, links, words, fresh, radius)
        known_curves.update(zip(fresh, curves, strict=True))
        untested = [k for k, key in enumerate(fresh) if key[0] not in looked]
        crossing = [fresh[untested[k]][0] for k in room.crossing([curves[k] for k in untested])]
        if not crossing:
            return poses, links, [known_curves[key] for key in keys]
        for number in crossing:  # all curves of these links are tested once
            looked.add(number)
            lengths[number], words[number] = _free_costs(
                poses, int(links[number]), radius, room, known
            )
        known_curves = {key: curve for key, curve in known_curves.items() if key[0] not in crossing}


def _poses(points: Floats, far: Any) -> _Poses:
    """Return the points of a path with their possible headings. Both ends of a straight leg have
    the heading of this leg.
    """
    legs = np.diff(points, axis=0)
    courses = np.arctan2(legs[:, 1], legs[:, 0])
    vertices: list[int] = []
    headings: list[Floats] = []
    straight: list[bool] = []
    for index in range(len(points)):
        before, after = index > 0 and far[index - 1], index < len(legs) and far[index]
        directions = [legs[leg] for leg, there in ((index - 1, before), (index, after)) if there]
        for number, direction in enumerate(directions or [None]):
            allowed = np.full(HEADINGS, np.nan)
            if direction is None:
                allowed[:-1], allowed[-1] = (
                    _FREE + courses[min(index, len(legs) - 1)],
                    courses[max(index - 1, 0)],
                )
            else:
                allowed[0] = np.arctan2(direction[1], direction[0])
            vertices.append(index)
            headings.append(allowed)
            straight.append(bool(after) and number == len(directions) - 1)
    return _Poses(points[vertices], np.array(headings), straight[:-1], vertices)


def _costs(poses: _Poses, links: Any, radius: float) -> tuple[Floats, Any]:
    """Return the length and the type of the shortest Dubins curve for each link and each pair of
    headings at its two ends.
    """
    lengths, words = (
        np.full((len(links), HEADINGS, HEADINGS), np.inf),
        np.zeros((len(links), HEADINGS, HEADINGS), dtype=np.int8),
    )
    only = np.isnan(poses.headings[:, 1])
    fixed = only[links] & only[links + 1]
    for some, count in ((np.flatnonzero(fixed), 1), (np.flatnonzero(~fixed), HEADINGS)):
        for begin in range(0, len(some), _AT_ONCE):
            chunk = some[begin : begin + _AT_ONCE]
            every = _parts(poses, links[chunk], radius, count).sum(axis=-1)
            lengths[chunk, :count, :count], words[chunk, :count, :count] = (
                every.min(axis=-1),
                every.argmin(axis=-1),
            )
    return lengths, words


def _parts(poses: _Poses, links: Any, radius: float, count: int = HEADINGS) -> Floats:
    """Return the lengths of the parts of each link's Dubins curves, infinite for unused headings;
    shape (n, count, count, 6, 3).
    """
    ends = []
    for some in (links, links + 1):
        place = np.broadcast_to(poses.points[some][:, None, :], (len(some), count, 2))
        ends.append(np.concatenate([place, poses.headings[some][:, :count, None]], axis=-1))
    return dubins_parts(ends[0][:, :, None, :], ends[1][:, None, :, :], radius)


def _free_costs(
    poses: _Poses, link: int, radius: float, room: _Room, known: KnownCurves
) -> tuple[Floats, Any]:
    """Return the lengths and types of the shortest unblocked Dubins curves of one link, for each
    pair of headings.
    """
    key = poses.points[link : link + 2].tobytes() + poses.headings[link : link + 2].tobytes()
    if key in known.costs:
        return known.costs[key]
    parts = _parts(poses, np.array([link]), radius)[0]
    lengths = parts.sum(axis=-1)
    ranks = np.argsort(lengths, axis=-1, kind="stable")
    best, words = np.full(lengths.shape[:2], np.inf), np.zeros(lengths.shape[:2], dtype=np.int8)
    ones, others = np.nonzero(np.isfinite(lengths).any(axis=-1))
    for rank in range(
        len(WORDS)
    ):  # the shortest curve of each pair of headings first; a longer one only if it is blocked
        word = ranks[ones, others, rank]
        there = np.isfinite(lengths[ones, others, word])
        ones, others, word = ones[there], others[there], word[there]
        if not len(ones):
            break
        starts = np.column_stack(
            [np.tile(poses.points[link], (len(ones), 1)), poses.headings[link, ones]]
        )
        blocked = room.crossed(*dubins_ways(starts, word, parts[ones, others, word], radius))
        free = ones[~blocked], others[~blocked]
        words[free] = word[~blocked]
        best[free] = lengths[(*free, word[~blocked])]
        ones, others = ones[blocked], others[blocked]
    known.costs[key] = best, words
    return known.costs[key]


def _detour_costs(
    poses: _Poses, link: int, radius: float, room: _Room, known: KnownCurves
) -> tuple[Floats, Any]:
    """Return the lengths and types of the shortest unblocked curves of one link, with detours where
    all Dubins curves are blocked.

    A detour is a Dubins curve with a straight leg before it, a straight leg after it, or both. The
    type is the index of the curve type in `WORDS` plus 6 times the index of the pair of straight
    legs.
    """
    key = (
        poses.points[link : link + 2].tobytes()
        + poses.headings[link : link + 2].tobytes()
        + b"detours"
    )
    if key in known.costs:
        return known.costs[key]
    best, types = (array.copy() for array in _free_costs(poses, link, radius, room, known))
    there = ~np.isnan(poses.headings[link])[:, None] & ~np.isnan(poses.headings[link + 1])
    ones, others = np.nonzero(there & ~np.isfinite(best))
    poses_at = [
        np.column_stack(
            [np.tile(poses.points[link + end], (len(k), 1)), poses.headings[link + end, k]]
        )
        for end, k in ((0, ones), (1, others))
    ]
    count = len(_AHEAD)
    before, after = np.repeat(_AHEAD, count), np.tile(_AHEAD, count)
    starts = _moved(
        poses_at[0][:, None], radius * before
    )  # shape (pairs, combinations of straight legs, 3)
    ends = _moved(poses_at[1][:, None], -radius * after)
    parts = dubins_parts(starts, ends, radius)
    lengths = (parts.sum(axis=-1) + (before + after)[:, None]).reshape(
        len(ones), len(before) * len(WORDS)
    )
    lengths[:, : len(WORDS)] = np.inf  # without straight legs: already blocked
    ranks = np.argsort(lengths, axis=-1, kind="stable")
    left = np.arange(len(ones))
    for rank in range(lengths.shape[1] - len(WORDS)):
        kind = ranks[left, rank]
        possible = np.isfinite(lengths[left, kind])
        left, kind = left[possible], kind[possible]
        if not len(left):
            break
        legs, word = kind // len(WORDS), kind % len(WORDS)
        points, numbers = dubins_ways(starts[left, legs], word, parts[left, legs, word], radius)
        points = np.concatenate([poses_at[0][left, :2], points, poses_at[1][left, :2]])
        numbers = np.concatenate([np.arange(len(left)), numbers, np.arange(len(left))])
        order = np.argsort(numbers, kind="stable")
        free = ~room.crossed(points[order], numbers[order])
        best[ones[left[free]], others[left[free]]] = lengths[left[free], kind[free]]
        types[ones[left[free]], others[left[free]]] = kind[free]
        left = left[~free]
    known.costs[key] = best, types
    return known.costs[key]


def _moved(poses: Floats, lengths: Floats) -> Floats:
    """Return poses moved straight ahead by given lengths in metres."""
    x, y, heading = np.moveaxis(poses, -1, 0)
    return np.stack(
        [
            *np.broadcast_arrays(
                x + lengths * np.cos(heading), y + lengths * np.sin(heading), heading
            )
        ],
        axis=-1,
    )


def _cheapest(poses: _Poses, links: Any, lengths: Floats) -> list[int] | int:
    """Return the heading of each point on the shortest path, as a column index of ``headings``.

    If no path exists, return the first unreachable point.
    """
    number = dict(zip(links.tolist(), range(len(links)), strict=True))
    costs = [np.where(np.isnan(poses.headings[0]), np.inf, 0.0)]
    came: list[Any] = []
    for place in range(len(poses.points) - 1):
        if place in number:
            every = costs[-1][:, None] + lengths[number[place]]
        else:  # a straight leg: its only heading is kept
            every = np.full((HEADINGS, HEADINGS), np.inf)
            every[0, 0] = costs[-1][0]
        came.append(every.argmin(axis=0))
        costs.append(every.min(axis=0))
        if not np.isfinite(costs[-1]).any():
            return place + 1
    chosen = [int(costs[-1].argmin())]
    for before in reversed(came):
        chosen.append(int(before[chosen[-1]]))
    return chosen[::-1]


def _curves(
    poses: _Poses, links: Any, words: Any, chosen: list[tuple[int, int, int]], radius: float
) -> list[Floats]:
    """Return the curve of each chosen link. A chosen link is its number, and the numbers of the
    headings at its two ends.
    """
    if not chosen:
        return []
    numbers, ones, others = np.array(chosen).T
    begins = links[numbers]
    starts = np.column_stack([poses.points[begins], poses.headings[begins, ones]])
    ends = np.column_stack([poses.points[begins + 1], poses.headings[begins + 1, others]])
    legs, types = np.divmod(words[numbers, ones, others].astype(np.int64), len(WORDS))
    before, after = (radius * _AHEAD[index] for index in np.divmod(legs, len(_AHEAD)))
    starts, ends = _moved(starts, before), _moved(ends, -after)
    parts = dubins_parts(starts, ends, radius)[np.arange(len(types)), types]
    found = []
    for start, end, word, lengths, straight in zip(
        starts, ends, types.tolist(), parts, np.stack([before, after], axis=1), strict=True
    ):
        way = dubins_way(start, WORDS[word], lengths, radius)
        way[-1] = end[:2]  # the heading exists except for rounding errors
        if straight.any():
            first, last = (
                _moved(start[None], -straight[:1])[0, :2],
                _moved(end[None], straight[1:])[0, :2],
            )
            way = np.vstack([first, way, last])
        found.append(way)
    return found


def _joined(poses: _Poses, links: Any, curves: list[Floats], marks: Any) -> list[Floats]:
    """Return the pieces of the path that consists of all legs and curves, without unmarked points
    on straight lines.

    The second point and the last but one point are always marked, because the vehicle searches the
    region between these two points.
    """
    number = dict(zip(links.tolist(), curves, strict=True))
    pieces, told = [poses.points[:1]], [_KEPT]
    for place in range(len(poses.straight)):
        piece = number[place][1:] if place in number else poses.points[place + 1 : place + 2]
        pieces.append(piece)
        again = (
            poses.vertices[place + 1] == poses.vertices[place]
        )  # where a place is passed twice it is cut the first time
        here = int(marks[poses.vertices[place + 1]])
        told += [*[0] * (len(piece) - 1), min(here, _KEPT) if again else here]
    way, mark = np.vstack(pieces), np.array(told)
    apart = np.concatenate([[True], np.hypot(*np.diff(way, axis=0).T) > _SAME])
    mark[:-1] = np.maximum(
        mark[:-1], np.where(apart[1:], 0, mark[1:])
    )  # of two at one place the first one stays
    way, mark = way[apart], mark[apart]
    legs = np.diff(way, axis=0)
    legs /= np.hypot(*legs.T)[:, None]
    mark[1:-1] = np.maximum(mark[1:-1], np.hypot(*np.diff(legs, axis=0).T) > _SAME)
    way, mark = way[mark > 0], mark[mark > 0]
    borders = [0, *np.flatnonzero(mark == _CUT).tolist(), len(way) - 1]
    return [np.asarray(way[begin : end + 1]) for begin, end in pairwise(borders)]


def room_beside(start: Floats, radius: float, *, blocked: Any, area: Any) -> str:
    """Return the side on which a vehicle at a given pose has room for a circle: "L", "R", or an
    empty text for neither side.
    """
    room = _Room.of(blocked, area)
    return "".join(
        sense for sense in "LR" if not room.crossing([dubins_way(start, sense, [2 * pi], radius)])
    )[:1]
