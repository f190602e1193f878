"""Dubins paths: flights with a smallest turning radius."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from functools import cached_property
from itertools import pairwise
from math import ceil, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import angles_of, step_lengths
from shoal.search.regions.outline import text_of

Floats = NDArray[np.float64]
Costs = tuple[Floats, Any]  # of a link, for each pair of headings: length and type of its curve


class NoRoomError(InvalidInputError):
    """Raised if a vehicle has no room for its turns, its climb or its landing."""


WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
"""The six types of shortest paths with a minimum turning radius, spelled with L (left), S
(straight) and R (right).
"""

SHARPEST = pi / 6  # largest bend of an approximated path at a vertex
_ROUND = 2 * pi
_SLIGHT = 0.01  # metres: half of an arc that needs no vertex
_SENSES = np.array([["RSL".index(letter) - 1 for letter in word] for word in WORDS])


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
    from shoal.search.kernels.dubins import curves_between

    begin, end = np.broadcast_arrays(
        np.asarray(starts, dtype=np.float64), np.asarray(ends, dtype=np.float64)
    )
    parts = np.empty((begin[..., 0].size, len(WORDS), 3))
    rows = (np.array(poses.reshape(-1, 3), order="C") for poses in (begin, end))
    curves_between(*rows, float(radius), parts)
    return parts.reshape(*begin.shape[:-1], len(WORDS), 3)


def least_length(path: Floats, radius: float, *, link: float) -> float:
    """Return a lower bound on the length in metres of what `plan_dubins_path` makes of a path: its
    straight legs, and the shortest curves from each of them to the next one. The first and the last
    leg need not be straight.

    Examples
    --------
    >>> out, back = [(-9.0, 0.0), (0.0, 0.0), (400.0, 0.0)], [(400.0, 20.0), (0.0, 20.0), (-9.0, 20.0)]
    >>> rows = np.array(out + back)
    >>> least = least_length(rows, 50.0, link=30.0)
    >>> (flown,) = plan_dubins_path(rows, 50.0, link=30.0)
    >>> round(least), round(step_lengths(flown).sum())
    (1161, 1168)
    """
    points = path[np.concatenate([[True], step_lengths(path) > NEAR])]
    legs = step_lengths(points)
    far = 1 + np.flatnonzero(legs[1:-1] > link)
    if not len(far):
        return float(legs.sum())
    courses = angles_of(np.diff(points, axis=0))[far, None]
    ends = np.hstack([points[far + 1], courses])[:-1], np.hstack([points[far], courses])[1:]
    curves = radius * dubins_parts(*ends, radius).sum(axis=-1).min(axis=-1)
    beside = step_lengths(points[[0, far[0]]]), step_lengths(points[[far[-1] + 1, -1]])
    return float(legs[far].sum() + curves.sum() + np.sum(beside))


def dubins_paths(
    starts: Floats, words: NDArray[np.int64], parts: Floats, radius: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return paths of straight legs that approximate Dubins curves.

    The legs of a path are tangents of its curve's arcs. Therefore a vehicle that rounds off each
    bend with the turning radius ``radius`` flies exactly along the curve. From leg to leg, the
    direction changes by at most `SHARPEST`. The first leg has the heading of the curve's start, and
    the last leg has the heading of the curve's end.

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
    from shoal.search.kernels.dubins import bent_paths

    senses = _SENSES[words]
    corners = np.where(senses != 0, parts, 0.0) / SHARPEST + 1.0
    assert ((parts >= 0.0) & np.isfinite(parts)).all()
    points = np.empty((int(corners.sum()) + 2 * len(starts), 2))
    ends = np.empty(len(starts), dtype=np.int64)
    bent_paths(
        np.ascontiguousarray(starts),
        senses,
        np.ascontiguousarray(parts),
        radius,
        SHARPEST,
        _SLIGHT,
        points,
        ends,
    )
    numbers = np.repeat(np.arange(len(starts)), np.diff(ends, prepend=0))
    return points[: len(numbers)], numbers


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
_TOUCH = 0.004  # metres by which a path may enter a blocked area; below the rounding in files
_SAME = 1e-6  # metres, and radians
# lengths of straight ends of a detour, divided by the radius
_AHEAD = np.array([0.0, 1.0, 2.0, 4.0])
# numbers of points before an unreachable point that are tested alone, the fewest first
_SECTIONS = 3, 6, 10
_RETRIED = 4  # number of links before an unreachable point that may become detours


@dataclass
class _Poses:
    """The points of a path, the possible headings at each point, and whether the leg to the next
    point is straight.

    The array ``headings`` has shape (n, `HEADINGS`), with NaN for unused entries. The array
    ``vertices`` holds the index of the vertex at each point. A vertex between two straight legs
    gives two points, with different headings.
    """

    points: Floats
    headings: Floats
    straight: NDArray[np.bool_]
    vertices: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Airspace:
    """Where vehicles may fly: geometries in metres, each of which may be missing.

    Parameters
    ----------
    blocked : Shapely geometry, optional
        Areas that no turn may cross.
    area : Shapely geometry, optional
        Area that a turn must not leave, if the straight line between the ends of the turn lies
        inside the area.
    free : Shapely geometry, optional
        Area that a path must not leave where legs are merged, unless the original path leaves it.
    curves : dict
        For each turning radius, the costs of links (two points that a curve must connect): the
        lengths of the shortest unblocked curves, and their types. The key of a link consists of its
        two end points, their possible headings, and whether curves may make detours. All flights in
        one airspace share these costs.
    shortest : dict
        For each turning radius, the same of curves that may be blocked.
    dead_ends : dict
        For each turning radius and link length, sections of paths through which no vehicle with
        this radius can fly: each an array of consecutive points, by the bytes of its first point.
        A path that contains such a section is refused at once.
    """

    blocked: Any = None
    area: Any = None
    free: Any = None
    curves: dict[float, dict[tuple[bytes, bool], Costs]] = field(default_factory=dict, repr=False)
    shortest: dict[float, dict[bytes, Costs]] = field(default_factory=dict, repr=False)
    dead_ends: dict[tuple[float, float], dict[bytes, Floats]] = field(
        default_factory=dict, repr=False
    )

    @cached_property
    def _bounds(self) -> tuple[Any, Any, Any]:
        """The three geometries, with a small tolerance for rounding errors, prepared."""
        import shapely

        blocked = (
            None if self.blocked is None or self.blocked.is_empty else self.blocked.buffer(-_TOUCH)
        )
        area = None if self.area is None else self.area.buffer(_TOUCH, join_style="mitre")
        free = None if self.free is None else self.free.buffer(_TOUCH)
        shapely.prepare([shape for shape in (blocked, area, free) if shape is not None])
        return blocked, area, free

    @cached_property
    def _allowed(self) -> dict[bytes, bool]:
        """Paths of which `allows` has told whether they are allowed. Sorties that are tried have
        most of their short legs in common.
        """
        return {}

    def allows(self, path: Floats) -> bool:
        """Return whether a path avoids the blocked areas and stays in the free area."""
        key = path.tobytes()
        if key not in self._allowed:
            self._allowed[key] = self._allows(path)
        return self._allowed[key]

    def _allows(self, path: Floats) -> bool:
        import shapely

        blocked, _, free = self._bounds
        line = shapely.linestrings(path)
        if blocked is not None and shapely.intersects(blocked, line):
            return False
        return free is None or bool(shapely.covers(free, line))

    def blocks(self, points: Floats, numbers: Any) -> Any:
        """Return whether each of n curves crosses a blocked area or leaves the area for turns;
        bool, shape (n,).

        The array ``points`` holds the points of all curves, and ``numbers`` the index of the curve
        of each point, ascending from 0.
        """
        blocked, area, _ = self._bounds
        count = int(numbers[-1]) + 1 if len(numbers) else 0
        if not count or (blocked is None and area is None):
            return np.zeros(count, dtype=np.bool_)
        import shapely

        begins = np.searchsorted(numbers, np.arange(count))
        single = begins[np.diff(np.append(begins, len(numbers))) == 1]
        if len(single):  # a line needs two points
            points = np.insert(points, single, points[single], axis=0)
            numbers = np.insert(numbers, single, numbers[single])
            begins = np.searchsorted(numbers, np.arange(count))
        lines = shapely.linestrings(points, indices=numbers)
        wrong = np.zeros(count, dtype=np.bool_)
        if blocked is not None:
            wrong |= shapely.intersects(blocked, lines)
        if area is not None:
            ends = np.append(begins[1:], len(numbers)) - 1
            chords = shapely.linestrings(np.stack([points[begins], points[ends]], axis=1))
            wrong |= ~shapely.covers(area, lines) & shapely.covers(area, chords)
        return wrong

    def blocks_legs(self, starts: Floats, stops: Floats) -> Any:
        """Return whether straight legs cross a blocked area; bool, shape (n,)."""
        import shapely

        blocked = self._bounds[0]
        if blocked is None:
            return np.zeros(len(starts), dtype=np.bool_)
        return shapely.intersects(
            blocked, shapely.linestrings(np.stack([starts[:, :2], stops[:, :2]], axis=1))
        )

    def circle_side(self, start: Floats, radius: float) -> str:
        """Return the side on which a vehicle at a given pose has room for a circle: "L", "R", or an
        empty text for neither side.
        """
        for side in "LR":
            circle = circles(start, side, 1, radius)
            if not self.blocks(circle, np.zeros(len(circle), dtype=np.int64))[0]:
                return side
        return ""


def circles(start: Floats, side: str, count: int, radius: float) -> Floats:
    """Return a path of ``count`` circles to the left ("L") or right ("R") of a pose, back to it;
    float64, shape (k, 2).
    """
    word = np.array([WORDS.index(f"{side}S{side}")])
    return dubins_paths(start[None], word, np.array([(count * _ROUND, 0.0, 0.0)]), radius)[0]


def plan_dubins_path(
    path: Floats,
    radius: float,
    *,
    link: float = 0.0,
    airspace: Airspace | None = None,
    loose: set[bytes] | None = None,
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
    path : ndarray of float64, shape (k, 2)
        Given path in metres. The vehicle may leave the first point, and reach the last point, in
        any direction.
    radius : float
        Minimum turning radius in metres.
    link : float
        Maximum length in metres of a straight leg that a curve may replace, usually `LINK` times
        the side of the footprint.
    airspace : Airspace, optional
        Where curves may lead.
    loose : set of bytes, optional
        Vertices at which straight legs had to be shortened, because all curves at the vertex were
        blocked. All candidate sorties along one route share them; those of other routes must not
        come in, because the result for a route must not depend on the routes before it.
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
    >>> (flown,) = plan_dubins_path(rows, 50.0, link=30.0)
    >>> bool((flown[:, 0].max() > 450.0) & (len(flown) > 12))
    True
    """
    moves = step_lengths(path) > NEAR
    points = np.asarray(path[np.concatenate([[True], moves])])
    points[-1] = path[-1]  # a last leg shorter than NEAR is not flown, but the path ends at its end
    if len(points) < 3:
        return [points]
    marks = np.zeros(len(points), dtype=np.int8)
    marks[[1, -2, -1]] = _KEPT
    marks[np.cumsum(moves)[np.asarray(cuts, dtype=np.int64) - 1]] = _CUT
    straight = step_lengths(points) > max(link, _SAME)
    straight[[0, -1]] = ~moves[[0, -1]]  # where the first or last point is given twice
    airspace = Airspace() if airspace is None else airspace
    dead_ends = airspace.dead_ends.setdefault((radius, link), {})
    _refuse_dead_ends(points, dead_ends, radius, airspace)
    original = points
    loose = set() if loose is None else loose
    loosen = [vertex for vertex, point in enumerate(points) if point.tobytes() in loose]
    detours = False
    while True:
        for vertex in reversed(loosen):
            points, straight, marks = _shorten_straight_legs(
                points, straight, marks, vertex, 3 * radius, max(link / LINK, radius / 8)
            )
        outcome = _shortest_path(
            _possible_poses(points, straight), radius, airspace, detours=detours
        )
        if not isinstance(outcome, list):
            return _join_pieces(*outcome, marks)
        *stuck, lost = outcome
        exhausted = not any(straight[max(vertex - 1, 0) : vertex + 1].any() for vertex in stuck)
        if exhausted and not detours:
            detours, loosen = True, []
            continue
        if exhausted:
            for count in _SECTIONS:
                section = _section_before(original, points[: lost + 1], count)
                if len(section) and not _is_passable(section, radius, link, airspace):
                    dead_ends[section[0].tobytes()] = section
                    break
            raise _no_room(points[lost], radius, airspace)
        loose.update(points[vertex].tobytes() for vertex in stuck)
        loosen = stuck


def _no_room(point: Floats, radius: float, airspace: Airspace) -> NoRoomError:
    allowed = (
        "outside the no-go zones" if airspace.area is None else "in the airspace around the region"
    )
    return NoRoomError(
        f"turn_radius: expected room for turns of {radius:.4g} m {allowed}, got none at"
        f" {text_of(point)}"
    )


def _refuse_dead_ends(
    points: Floats, dead_ends: dict[bytes, Floats], radius: float, airspace: Airspace
) -> None:
    """Refuse a path that contains a section through which no vehicle can fly.

    The ends of a path are passed in other directions than its inner points, so a section counts
    only inside the path.
    """
    if not dead_ends:
        return
    for first in range(1, len(points) - 1):
        section = dead_ends.get(points[first].tobytes())
        if section is None or first + len(section) >= len(points):
            continue
        if np.array_equal(points[first : first + len(section)], section):
            raise _no_room(section[-2], radius, airspace)


def _section_before(original: Floats, passed: Floats, count: int) -> Floats:
    """Return the last ``count`` points of a given path up to an unreachable one, and the next point,
    without the ends of the path; no points if too few are left.

    The array ``passed`` holds the points up to the unreachable one: given points, and points
    between them.
    """
    last = 0
    for point in passed:
        last += last < len(original) and np.array_equal(point, original[last])
    first = max(last - count, 1)
    return (
        original[first : last + 1]
        if last - first > 1 and last + 1 < len(original)
        else original[:0]
    )


def _is_passable(section: Floats, radius: float, link: float, airspace: Airspace) -> bool:
    """Return whether a vehicle can fly along a section of a path, from and to any direction."""
    try:
        plan_dubins_path(section, radius, link=link, airspace=airspace)
    except NoRoomError:
        return False
    return True


def _shorten_straight_legs(
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
        # then the whole leg is passed point by point, otherwise only the part within reach
        whole = length <= reach + step
        count = ceil(length / step - _SAME) if whole else int(reach / step)
        far = np.arange(1, count + (not whole)) * (1 / count if whole else step / length)
        shares = far if leg == vertex else 1.0 - far[::-1]
        still_straight = np.zeros(len(shares) + 1, dtype=np.bool_)
        still_straight[-1 if leg == vertex else 0] = not whole
        points = np.insert(points, leg + 1, points[leg] + shares[:, None] * along, axis=0)
        marks = np.insert(marks, leg + 1, np.zeros(len(shares), dtype=np.int8))
        straight = np.concatenate([straight[:leg], still_straight, straight[leg + 1 :]])
    return points, straight, marks


def _shortest_path(
    poses: _Poses, radius: float, airspace: Airspace, *, detours: bool
) -> tuple[_Poses, Any, list[Floats]] | list[int]:
    """Return the shortest path through all points.

    With ``detours``, the links before a point that is otherwise unreachable may make detours. If no
    path exists, return the vertices at which straight legs must be shortened, followed by the first
    unreachable vertex.
    """
    links = np.flatnonzero(~poses.straight)
    lengths, words = _link_costs(poses, links, radius, airspace.shortest.setdefault(radius, {}))
    looked: set[int] = set()
    extended: set[int] = set()
    curve_of: dict[tuple[int, int, int], Floats] = {}
    while True:
        chosen = _choose_headings(poses, links, lengths)
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
                    lengths[number], words[number] = _clear_costs(
                        poses, int(links[number]), radius, airspace, detours=True
                    )
                curve_of = {key: curve for key, curve in curve_of.items() if key[0] not in extended}
                continue
            stuck = [
                number for number in looked if not np.isfinite(lengths[number]).any()
            ] or looked
            ends = (poses.vertices[links[number] + end] for number in stuck for end in (0, 1))
            return [*sorted({int(vertex) for vertex in ends}), int(poses.vertices[chosen])]
        keys = [
            (number, chosen[link], chosen[link + 1]) for number, link in enumerate(links.tolist())
        ]
        fresh = [key for key in keys if key not in curve_of]
        curves = _chosen_curves(poses, links, words, fresh, radius)
        curve_of.update(zip(fresh, curves, strict=True))
        untested = [k for k, key in enumerate(fresh) if key[0] not in looked]
        numbers = np.repeat(np.arange(len(untested)), [len(curves[k]) for k in untested])
        tested = np.concatenate([np.zeros((0, 2)), *(curves[k] for k in untested)])
        blocked = np.flatnonzero(airspace.blocks(tested, numbers)).tolist()
        crossing = [fresh[untested[k]][0] for k in blocked]
        if not crossing:
            return poses, links, [curve_of[key] for key in keys]
        for number in crossing:  # all curves of these links are tested once
            looked.add(number)
            lengths[number], words[number] = _clear_costs(
                poses, int(links[number]), radius, airspace
            )
        curve_of = {key: curve for key, curve in curve_of.items() if key[0] not in crossing}


def _possible_poses(points: Floats, far: Any) -> _Poses:
    """Return the points of a path with their possible headings. Both ends of a straight leg have
    the heading of this leg.
    """
    courses = angles_of(np.diff(points, axis=0))
    before, after = np.concatenate([[False], far]), np.concatenate([far, [False]])
    vertices = np.repeat(np.arange(len(points)), np.maximum(before.astype(np.int64) + after, 1))
    last = np.concatenate([vertices[1:] != vertices[:-1], [True]])  # of those of one vertex
    free = ~(before | after)[vertices]
    headings = np.full((len(vertices), HEADINGS), np.nan)
    # the leg before a vertex, or the leg after it for the last one of two and where only this is
    # straight
    of_leg = vertices - (before[vertices] & ~(last & after[vertices]))
    headings[~free, 0] = courses[of_leg[~free]]
    leaving = np.minimum(vertices[free], len(courses) - 1)
    headings[free, :-1] = _FREE + courses[leaving][:, None]
    headings[free, -1] = courses[np.maximum(vertices[free] - 1, 0)]
    return _Poses(points[vertices], headings, (after[vertices] & last)[:-1], vertices)


def _link_costs(
    poses: _Poses, links: Any, radius: float, known: dict[bytes, Costs]
) -> tuple[Floats, Any]:
    """Return the length and the type of the shortest Dubins curve for each link and each pair of
    headings at its two ends. Costs between free headings are kept in ``known``.
    """
    from shoal.search.kernels.dubins import shortest_curves

    lengths, words = (
        np.full((len(links), HEADINGS, HEADINGS), np.inf),
        np.zeros((len(links), HEADINGS, HEADINGS), dtype=np.int8),
    )
    only = np.isnan(poses.headings[:, 1])
    fixed = only[links] & only[links + 1]
    keys = {
        number: poses.points[link : link + 2].tobytes() + poses.headings[link : link + 2].tobytes()
        for number, link in enumerate(links.tolist())
        if not fixed[number]
    }
    new = np.array([number for number, key in keys.items() if key not in known], dtype=np.int64)
    for some, count in ((np.flatnonzero(fixed), 1), (new, HEADINGS)):
        costs = np.empty((len(some), count, count)), np.empty((len(some), count, count), np.int8)
        begins, ends = links[some], links[some] + 1
        headings = poses.headings[:, :count]
        shortest_curves(
            poses.points[begins],
            poses.points[ends],
            headings[begins],
            headings[ends],
            radius,
            *costs,
        )
        lengths[some, :count, :count], words[some, :count, :count] = costs
    for number in new.tolist():
        known[keys[number]] = lengths[number].copy(), words[number].copy()
    for number, key in keys.items():
        lengths[number], words[number] = known[key]
    return lengths, words


def _clear_costs(
    poses: _Poses, link: int, radius: float, airspace: Airspace, *, detours: bool = False
) -> tuple[Floats, Any]:
    """Return the lengths and types of the shortest unblocked curves of one link, for each pair of
    headings.

    With ``detours``, a link whose Dubins curves are all blocked for a pair of headings makes a
    detour: a Dubins curve with a straight leg before it, a straight leg after it, or both. The type
    is the index of the curve type in `WORDS`, plus 6 times the index of the pair of straight legs.
    """
    cache = airspace.curves.setdefault(radius, {})
    ends = slice(link, link + 2)
    key = (poses.points[ends].tobytes() + poses.headings[ends].tobytes(), detours)
    if key in cache:
        return cache[key]
    ahead = _AHEAD if detours else _AHEAD[:1]
    best = np.full((HEADINGS, HEADINGS), np.inf)
    kinds = np.zeros((HEADINGS, HEADINGS), dtype=np.int8)
    if detours:
        direct, words = _clear_costs(poses, link, radius, airspace)
        best, kinds = direct.copy(), words.copy()
    possible_pairs = ~np.isnan(poses.headings[link])[:, None] & ~np.isnan(poses.headings[link + 1])
    start_headings, stop_headings = np.nonzero(possible_pairs & ~np.isfinite(best))
    first, last = (
        np.column_stack([np.tile(poses.points[point], (len(k), 1)), poses.headings[point, k]])
        for point, k in ((link, start_headings), (link + 1, stop_headings))
    )
    before, after = np.repeat(ahead, len(ahead)), np.tile(ahead, len(ahead))
    # shape (pairs, pairs of straight legs, 3)
    starts = _move_ahead(first[:, None], radius * before)
    stops = _move_ahead(last[:, None], -radius * after)
    parts = dubins_parts(starts, stops, radius)
    lengths = (parts.sum(axis=-1) + (before + after)[:, None]).reshape(
        len(start_headings), len(before) * len(WORDS)
    )
    if detours:
        lengths[:, : len(WORDS)] = np.inf  # without straight legs: already blocked
        for point, side, which in ((link, 1.0, before), (link + 1, -1.0, after)):
            index = start_headings if point == link else stop_headings
            blocked = _blocked_ends(poses, point, side * radius, airspace)
            wrong = blocked[index][:, np.searchsorted(_AHEAD, which)]
            lengths[np.repeat(wrong, len(WORDS), axis=1)] = np.inf
    # of curves as long as each other but for rounding, the first
    ranks = np.argsort(lengths.round(9), axis=-1, kind="stable")
    open_pairs = np.arange(len(start_headings))
    for rank in range(lengths.shape[1]):  # the shortest first; a longer one only if it is blocked
        kind = ranks[open_pairs, rank]
        possible = np.isfinite(lengths[open_pairs, kind])
        open_pairs, kind = open_pairs[possible], kind[possible]
        if not len(open_pairs):
            break
        legs, word = kind // len(WORDS), kind % len(WORDS)
        points, numbers = dubins_paths(
            starts[open_pairs, legs], word, parts[open_pairs, legs, word], radius
        )
        if detours:
            points = np.concatenate([first[open_pairs, :2], points, last[open_pairs, :2]])
            numbers = np.concatenate(
                [np.arange(len(open_pairs)), numbers, np.arange(len(open_pairs))]
            )
            order = np.argsort(numbers, kind="stable")
            points, numbers = points[order], numbers[order]
        clear = ~airspace.blocks(points, numbers)
        best[start_headings[open_pairs[clear]], stop_headings[open_pairs[clear]]] = lengths[
            open_pairs[clear], kind[clear]
        ]
        kinds[start_headings[open_pairs[clear]], stop_headings[open_pairs[clear]]] = kind[clear]
        open_pairs = open_pairs[~clear]
    cache[key] = best, kinds
    return cache[key]


def _blocked_ends(poses: _Poses, point: int, radius: float, airspace: Airspace) -> Any:
    """Return whether each straight end of a detour crosses a blocked area, for each heading at a
    point; bool, shape (`HEADINGS`, number of lengths). A negative radius is for ends before the
    point.
    """
    place = np.tile(poses.points[point], (HEADINGS, 1))
    poses_at = np.column_stack([place, np.nan_to_num(poses.headings[point])])
    ends = _move_ahead(poses_at[:, None], radius * _AHEAD[None])
    starts = np.repeat(poses_at, len(_AHEAD), axis=0)
    return airspace.blocks_legs(starts, ends.reshape(-1, 3)).reshape(HEADINGS, len(_AHEAD))


def _move_ahead(poses: Floats, lengths: Floats) -> Floats:
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


def _choose_headings(poses: _Poses, links: Any, lengths: Floats) -> list[int] | int:
    """Return the heading of each point on the shortest path, as a column index of ``headings``.

    If no path exists, return the first unreachable point.
    """
    from shoal.search.kernels.dubins import choose_headings

    link_of = np.full(len(poses.points) - 1, -1)
    link_of[links] = np.arange(len(links))
    chosen = np.zeros(len(poses.points), dtype=np.int64)
    lost = choose_headings(~np.isnan(poses.headings[0]), link_of, lengths, chosen)
    return lost or chosen.tolist()


def _chosen_curves(
    poses: _Poses, links: Any, words: Any, chosen: list[tuple[int, int, int]], radius: float
) -> list[Floats]:
    """Return the curve of each chosen link. A chosen link is its number, and the numbers of the
    headings at its two ends.
    """
    if not chosen:
        return []
    numbers, start_headings, stop_headings = np.array(chosen).T
    begins = links[numbers]
    starts = np.column_stack([poses.points[begins], poses.headings[begins, start_headings]])
    ends = np.column_stack([poses.points[begins + 1], poses.headings[begins + 1, stop_headings]])
    legs, types = np.divmod(
        words[numbers, start_headings, stop_headings].astype(np.int64), len(WORDS)
    )
    before, after = (radius * _AHEAD[index] for index in np.divmod(legs, len(_AHEAD)))
    starts, ends = _move_ahead(starts, before), _move_ahead(ends, -after)
    parts = dubins_parts(starts, ends, radius)[np.arange(len(types)), types]
    points, curves = dubins_paths(starts, types, parts, radius)
    borders = np.flatnonzero(np.diff(curves, prepend=-1, append=len(starts)))
    points[borders[1:] - 1] = ends[:, :2]  # the heading exists except for rounding errors
    curves_of = [points[begin:end] for begin, end in pairwise(borders.tolist())]
    for number in np.flatnonzero(before + after):
        first = _move_ahead(starts[number], -before[number])[:2]
        last = _move_ahead(ends[number], after[number])[:2]
        curves_of[number] = np.vstack([first, curves_of[number], last])
    return curves_of


def _join_pieces(poses: _Poses, links: Any, curves: list[Floats], marks: Any) -> list[Floats]:
    """Return the pieces of the path that consists of all legs and curves, without unmarked points
    on straight lines.

    The second point and the last but one point are always marked, because the vehicle searches the
    region between these two points.
    """
    pieces = list(poses.points[:, None])
    for link, curve in zip(links.tolist(), curves, strict=True):
        pieces[link + 1] = curve[1:]
    path, ends = np.concatenate(pieces), np.cumsum([len(piece) for piece in pieces]) - 1
    mark = np.zeros(len(path), dtype=marks.dtype)
    mark[ends] = marks[poses.vertices]
    # where a place is passed twice it is cut the first time
    again = ends[1:][poses.vertices[1:] == poses.vertices[:-1]]
    mark[again] = np.minimum(mark[again], _KEPT)
    mark[0] = _KEPT
    apart = np.concatenate([[True], step_lengths(path) > _SAME])
    # of two at one place the first one stays
    mark[:-1] = np.maximum(mark[:-1], np.where(apart[1:], 0, mark[1:]))
    path, mark = path[apart], mark[apart]
    legs = np.diff(path, axis=0)
    legs /= np.hypot(*legs.T)[:, None]
    mark[1:-1] = np.maximum(mark[1:-1], step_lengths(legs) > _SAME)
    path, mark = path[mark > 0], mark[mark > 0]
    borders = [0, *np.flatnonzero(mark == _CUT).tolist(), len(path) - 1]
    return [np.asarray(path[begin : end + 1]) for begin, end in pairwise(borders)]
