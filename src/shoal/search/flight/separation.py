"""Separation of flights in space and time, and staggered starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import left_of
from shoal.search.flight.timing import Floats, Trajectory

HORIZONTAL, VERTICAL, DELAY = 10.0, 5.0, 10.0
"""Defaults of the horizontal and vertical separation in metres, and of a vehicle's maximum
unplanned delay in seconds.
"""

LEVEL = 1e-3  # metres: tolerance of the vertical separation
_HAIR = 1e-9  # relative to a leg's duration
_HIGHEST = 1e6  # metres: a larger vertical separation counts as infinite
_FIRST = 64  # number of pairs of legs that are tested first
_TOGETHER = 16384  # number of pairs of legs that are gathered and tested at once, to save memory


@dataclass(frozen=True)
class Separation:
    """The required horizontal and vertical distance of vehicles in flight.

    Two vehicles must always keep the horizontal or the vertical distance.

    Parameters
    ----------
    horizontal, vertical : float
        Required horizontal and vertical distance in metres.
    delay : float
        Maximum unplanned delay of each vehicle in seconds. The unplanned delays of different
        vehicles are independent.
    """

    horizontal: float = HORIZONTAL
    vertical: float = VERTICAL
    delay: float = DELAY


@dataclass(frozen=True, eq=False)
class Approach:
    """The nearest approach of two vehicles.

    Parameters
    ----------
    horizontal : float
        Horizontal distance of the vehicles at the nearest approach, in metres. The nearest approach
        is the moment of the smallest horizontal distance among all moments at which the vertical
        distance is below the vertical separation.
    vertical : float
        Vertical distance of the vehicles at the nearest approach, in metres.
    times : tuple of float
        Time of the nearest approach, in seconds after the start of the first vehicle, and after the
        start of the second vehicle.
    places : ndarray of float64, shape (2, 3)
        Positions of both vehicles at the nearest approach, in metres.
    """

    horizontal: float
    vertical: float
    times: tuple[float, float]
    places: Floats


@dataclass(frozen=True, eq=False)
class _Legs:
    """The start time, the duration, the start point and the velocity of each leg of a trajectory,
    without legs that take no time.

    The attribute ``reach`` is the distance in metres by which a vehicle that flies circles may be
    away from the leg, and ``paused`` for how long the vehicle has stood before the leg, at turns.
    """

    begins: Floats
    lasts: Floats
    points: Floats
    velocities: Floats
    reach: Floats
    paused: Floats

    @classmethod
    def of(cls, flown: Trajectory, slower: float = 1.0) -> _Legs:
        lasts = np.diff(flown.times)
        moving = lasts > 0
        lasts = lasts[moving]
        velocities = np.diff(flown.points, axis=0)[moving] / lasts[:, None]
        reach = np.zeros(len(velocities))
        reach[-1:] = flown.circle
        pauses = np.where(velocities.any(axis=1), 0.0, lasts)
        paused = np.cumsum(pauses) - pauses
        lasts = np.where((pauses > 0) & (reach == 0), slower * lasts, lasts)
        begins, points = flown.times[:-1][moving], flown.points[:-1][moving]
        return cls(begins, lasts, points, velocities, reach, paused)

    @classmethod
    def together(cls, several: Sequence[_Legs]) -> _Legs:
        return cls(*map(np.concatenate, zip(*(legs.columns for legs in several), strict=True)))

    @property
    def columns(self) -> tuple[Floats, ...]:
        return self.begins, self.lasts, self.points, self.velocities, self.reach, self.paused

    def __getitem__(self, index: NDArray[np.int64]) -> _Legs:
        return _Legs(*(column[index] for column in self.columns))

    def bounds(self) -> tuple[Floats, Floats]:
        ends = self.points + self.velocities * self.lasts[:, None]
        around = self.reach[:, None] * (1.0, 1.0, 0.0)
        return np.minimum(self.points, ends) - around, np.maximum(self.points, ends) + around


def nearest_approach(
    first: Trajectory,
    second: Trajectory,
    *,
    vertical: float,
    later: float = 0.0,
    tolerance: float = 0.0,
) -> Approach | None:
    """Return the nearest approach of two vehicles in flight, or None if they always keep the
    vertical separation.

    A vehicle is in flight from the beginning to the end of its trajectory. The distance between two
    vehicles on straight legs is a convex function of time and delay. Therefore the minimum distance
    has a closed form.

    Parameters
    ----------
    first, second : Trajectory
    vertical : float
        Vertical separation in metres. Moments at which the vehicles keep the vertical separation do
        not count as an approach.
    later : float
        Time in seconds by which the second vehicle starts later than the first vehicle.
    tolerance : float
        Maximum additional delay of each vehicle in seconds. The additional delays of the two
        vehicles are independent.

    Examples
    --------
    >>> out = Trajectory(np.array([0.0, 10.0]), np.array([(0.0, 0.0, 30.0), (100.0, 0.0, 30.0)]))
    >>> back = Trajectory(np.array([0.0, 10.0]), np.array([(100.0, 8.0, 33.0), (0.0, 8.0, 33.0)]))
    >>> met = nearest_approach(out, back, vertical=5.0)
    >>> met.horizontal, met.times, nearest_approach(out, back, vertical=2.0)
    (8.0, (5.0, 5.0), None)
    """
    mine, theirs = _Legs.of(first), _Legs.of(second)
    index_of_first, index_of_second = _simultaneous_legs(mine, theirs, later, tolerance)
    level = min(vertical, _HIGHEST) - LEVEL
    gaps = _gaps(mine, theirs, index_of_first, index_of_second)
    near = np.flatnonzero(gaps[:, 2] <= level)
    if not len(near):
        return None
    apart = np.hypot(gaps[near, 0], gaps[near, 1])
    order = near[np.argsort(apart, kind="stable")]
    best: tuple[float, Any] = (np.inf, None)
    for some in (order[:_FIRST], order[_FIRST:]):
        part = some[np.hypot(gaps[some, 0], gaps[some, 1]) < best[0]]
        if len(part):
            best = min(
                best,
                _least_distance(
                    mine[index_of_first[part]],
                    theirs[index_of_second[part]],
                    level,
                    (later, tolerance),
                ),
                key=lambda encounter: encounter[0],
            )
    if best[1] is None:
        return None
    times, places = best[1]
    return Approach(best[0], float(abs(places[0, 2] - places[1, 2])), times, places)


def _simultaneous_legs(
    mine: _Legs, theirs: _Legs, later: float, tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of legs that two vehicles may fly at the same time, as an index array for
    each vehicle.
    """
    low = np.searchsorted(
        theirs.begins + theirs.lasts, mine.begins - later - tolerance, side="left"
    )
    high = np.searchsorted(
        theirs.begins, mine.begins + mine.lasts - later + tolerance, side="right"
    )
    counts = np.maximum(high - low, 0)
    first = np.repeat(np.arange(len(mine.begins)), counts)
    offsets = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    return first, np.repeat(low, counts) + offsets


def _gaps(
    mine: _Legs, theirs: _Legs, first: NDArray[np.int64], second: NDArray[np.int64]
) -> Floats:
    """Return, for pairs of legs, the gap between their bounding boxes along each axis, in metres;
    float64, shape (n, 3).
    """
    (low, high), (below, above) = mine.bounds(), theirs.bounds()
    return np.maximum(np.maximum(low[first] - above[second], below[second] - high[first]), 0.0)


def _planes(
    mine: _Legs, theirs: _Legs, level: float, shift: tuple[float, float] | None
) -> tuple[Floats, Floats]:
    """Return the normals and limits of linear constraints ``normals @ times <= limits``, with
    shapes (n, k, 2) and (n, k).

    For each of n pairs of legs, ``times`` holds one time for each vehicle, counted from the
    beginning of the vehicle's leg. The constraints demand that each time lies within the leg, and
    that the vehicles' heights differ by at most ``level`` metres. If ``shift`` is given as (later,
    tolerance), with the meanings in `nearest_approach`, additional constraints demand that the two
    times are the same moment, within the tolerance.
    """
    n, zero, ones = len(mine.begins), np.zeros(len(mine.begins)), np.ones(len(mine.begins))
    up, rise, fall = (
        mine.points[:, 2] - theirs.points[:, 2],
        mine.velocities[:, 2],
        theirs.velocities[:, 2],
    )
    rows = [
        (-ones, zero, zero),
        (ones, zero, mine.lasts),
        (zero, -ones, zero),
        (zero, ones, theirs.lasts),
        (rise, -fall, level - up),
        (-rise, fall, level + up),
    ]
    if shift is not None:
        ahead = mine.begins - theirs.begins
        rows += [
            (ones, -ones, shift[0] + shift[1] - ahead),
            (-ones, ones, shift[1] - shift[0] + ahead),
        ]
    table = np.array([[*row] for row in rows])
    assert table.shape[2] == n
    return np.moveaxis(table[:, :2], 2, 0), table[:, 2].T


def _edges(
    start: Floats, mine: _Legs, theirs: _Legs, normals: Floats, limits: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Return, for each of k constraints and n pairs of legs, the border line of the constraint, and
    the interval of this line that meets all constraints.

    The result contains a point of the line and its direction (of shape (k, n, 2)), the lower and
    the upper end of the interval (k, n), and along the line the horizontal offset of the two
    vehicles at the point and the change of this offset (k, n, 2).
    """
    normals, limits = np.moveaxis(normals, 1, 0), limits.T
    square = (normals**2).sum(axis=-1)
    nondegenerate = square > 0
    point = normals * (limits / np.where(nondegenerate, square, 1.0))[..., None]
    along = left_of(normals)
    low, high = np.full(nondegenerate.shape, -np.inf), np.full(nondegenerate.shape, np.inf)
    low[~nondegenerate] = np.inf
    for number, (normal, limit) in enumerate(zip(normals, limits, strict=True)):
        slope = (normal * along).sum(axis=-1)
        slack = limit - (normal * point).sum(axis=-1)
        flat = np.abs(slope) <= _HAIR * np.sqrt(square * square[number])
        reach = slack / np.where(flat, 1.0, slope)
        # a constraint does not bound its own border
        other = (np.arange(len(normals)) != number)[:, None]
        high = np.where(other & ~flat & (slope > 0), np.minimum(high, reach), high)
        low = np.where(other & ~flat & (slope < 0), np.maximum(low, reach), low)
        low = np.where(other & flat & (slack < -_HAIR * (1.0 + np.abs(limit))), np.inf, low)
    empty = np.isfinite(low) & np.isfinite(high) & (high < low)
    bottom = np.where(empty, low, 0.0)
    touching = empty & (bottom - np.where(empty, high, 0.0) <= _HAIR * (1.0 + np.abs(bottom)))
    base, change = (
        times[..., :1] * mine.velocities[:, :2] - times[..., 1:] * theirs.velocities[:, :2]
        for times in (point, along)
    )
    return point, along, low, np.where(touching, low, high), start + base, change


def _least_distance(
    mine: _Legs, theirs: _Legs, level: float, shift: tuple[float, float]
) -> tuple[float, Any]:
    """Return the smallest horizontal distance in metres on any pair of legs, and the times and
    positions at this distance.
    """
    normals, limits = _planes(mine, theirs, level, shift)
    start = mine.points[:, :2] - theirs.points[:, :2]
    crossing, met = _crossing(start, mine.velocities, theirs.velocities, normals, limits)
    point, along, low, high, base, change = _edges(start, mine, theirs, normals, limits)
    square = (change**2).sum(axis=-1)
    best = -(base * change).sum(axis=-1) / np.where(square > 0, square, 1.0)
    feasible = (low <= high) & np.isfinite(low) & np.isfinite(high)
    at = np.clip(best, np.where(feasible, low, 0.0), np.where(feasible, high, 0.0))[..., None]
    offsets = base + at * change
    distances = np.where(feasible, np.hypot(offsets[..., 0], offsets[..., 1]), np.inf)
    apart = np.maximum(np.vstack([crossing[None], distances]) - mine.reach - theirs.reach, 0.0)
    which, k = np.unravel_index(int(np.argmin(apart)), apart.shape)
    if not np.isfinite(apart[which, k]):
        return np.inf, None
    since = np.concatenate([met[None], point + at * along])[which, k]
    times = (float(mine.begins[k] + since[0]), float(theirs.begins[k] + since[1]))
    places = np.stack(
        [
            mine.points[k] + since[0] * mine.velocities[k],
            theirs.points[k] + since[1] * theirs.velocities[k],
        ]
    )
    return float(apart[which, k]), (times, places)


def _solve_crossing(
    start: Floats, mine: Floats, theirs: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return, for each pair of legs, when each vehicle is at the point where the legs cross on a
    map, and whether the legs cross.

    The function extends each leg to an endless straight line. Each time counts from the beginning
    of the vehicle's leg.
    """
    cross = mine[:, 0] * theirs[:, 1] - mine[:, 1] * theirs[:, 0]
    scale = np.hypot(*mine[:, :2].T) * np.hypot(*theirs[:, :2].T)
    crosses = np.abs(cross) > _HAIR * scale
    divisor = np.where(crosses, cross, 1.0)
    first = (theirs[:, 0] * start[:, 1] - theirs[:, 1] * start[:, 0]) / divisor
    second = (mine[:, 0] * start[:, 1] - mine[:, 1] * start[:, 0]) / divisor
    return np.stack([first, second], axis=1), crosses


def _crossing(
    start: Floats, mine: Floats, theirs: Floats, normals: Floats, limits: Floats
) -> tuple[Floats, Floats]:
    """Return, for each pair of legs, a distance, and the times at which the two vehicles are where
    the legs cross on a map.

    The distance is 0 if the legs cross within the constraints, and otherwise infinite.
    """
    times, crosses = _solve_crossing(start, mine, theirs)
    good = crosses & _within(times, normals, limits)
    return np.where(good, 0.0, np.inf), times


def _within(times: Floats, normals: Floats, limits: Floats) -> NDArray[np.bool_]:
    slack = limits - (normals * times[:, None]).sum(axis=2)
    return np.asarray((slack >= -_HAIR * (1.0 + np.abs(limits))).all(axis=1))


def conflicts(
    first: Trajectory,
    second: Trajectory,
    *,
    horizontal: float,
    vertical: float,
) -> Floats:
    """Return the intervals of start time differences for which two vehicles come too close, whatever
    their turns take between the factors `Trajectory.turns`, the same for both; float64, shape (k, 2).

    A start time difference is the second vehicle's start time minus the first vehicle's start time,
    in seconds. The intervals are in increasing order and do not overlap. For differences outside
    all intervals, the vehicles always keep the horizontal or the vertical separation.

    Parameters
    ----------
    first, second : Trajectory
    horizontal, vertical : float
        Required horizontal and vertical separation in metres.

    Examples
    --------
    >>> out = Trajectory(np.array([0.0, 10.0]), np.array([(0.0, 0.0, 30.0), (100.0, 0.0, 30.0)]))
    >>> across = Trajectory(np.array([0.0, 10.0]), np.array([(50.0, -50.0, 30.0), (50.0, 50.0, 30.0)]))
    >>> conflicts(out, across, horizontal=10.0, vertical=5.0).round(3).tolist()
    [[-1.414, 1.414]]
    """
    near = _near_legs(first, second, horizontal, vertical)
    return merge_intervals(_close_starts(*near, horizontal, vertical))


def _near_legs(
    first: Trajectory, second: Trajectory, horizontal: float, vertical: float
) -> tuple[_Legs, _Legs, Floats]:
    """Return the pairs of legs of two vehicles that come too close if they are flown at the right
    times, or nearly, and the least and the greatest factor of the time of turns; shape (n, 2).
    """
    import shapely

    turns = min(first.turns[0], second.turns[0]), max(first.turns[1], second.turns[1])
    mine, theirs = _Legs.of(first, turns[1]), _Legs.of(second, turns[1])
    (low, high), (below, above) = mine.bounds(), theirs.bounds()
    boxes = shapely.box(*(below[:, :2] - horizontal).T, *(above[:, :2] + horizontal).T)
    index_of_first, index_of_second = shapely.STRtree(boxes).query(
        shapely.box(*low[:, :2].T, *high[:, :2].T)
    )
    near = _gaps(mine, theirs, index_of_first, index_of_second)[:, 2] <= vertical - LEVEL
    pairs = index_of_first[near], index_of_second[near]
    return mine[pairs[0]], theirs[pairs[1]], np.tile(turns, (len(pairs[0]), 1))


def _close_starts(a: _Legs, b: _Legs, turns: Floats, horizontal: float, vertical: float) -> Floats:
    """Return, for pairs of legs, an interval of start time differences outside of which the two
    vehicles keep their separation on these legs, whatever their turns take; float64, shape (n, 2).
    """
    normals, limits = _planes(a, b, min(vertical, _HIGHEST) - LEVEL, None)
    start = a.points[:, :2] - b.points[:, :2]
    begins, near_by = a.begins - b.begins, horizontal + a.reach + b.reach
    tangents = _tangents(start, a.velocities, b.velocities, normals, limits, near_by)
    point, along, low, high, base, change = _edges(start, a, b, normals, limits)
    least, most = _close_interval(base, change, near_by, low, high)
    feasible = ((least <= most) & np.isfinite(least) & np.isfinite(most))[..., None]
    ends = np.where(feasible, np.stack([least, most], axis=-1), 0.0)
    shifts = (point[..., :1] - point[..., 1:]) + ends * (along[..., :1] - along[..., 1:])
    intervals = np.where(feasible, np.sort(shifts, axis=-1), [np.inf, -np.inf])
    every = np.concatenate([tangents[None], intervals])
    # other times of turns change when legs begin, and not how they are flown
    moved = (turns.T - 1.0) * (a.paused - b.paused)
    least, most = every[..., 0].min(axis=0) + begins, every[..., 1].max(axis=0) + begins
    return np.stack([least + moved.min(axis=0), most + moved.max(axis=0)], axis=1)


def _close_interval(
    base: Floats, change: Floats, horizontal: Floats, least: Floats, most: Floats
) -> tuple[Floats, Floats]:
    """Return both ends of the part of each interval in which two vehicles are closer than the
    horizontal separation.
    """
    square, half = (change**2).sum(axis=-1), (base * change).sum(axis=-1)
    excess = (base**2).sum(axis=-1) - horizontal**2
    still = square <= _HAIR**2
    root = half**2 - square * excess
    width = np.sqrt(np.maximum(root, 0.0)) / np.where(still, 1.0, square)
    middle = -half / np.where(still, 1.0, square)
    least = np.where(still, least, np.maximum(least, middle - width))
    most = np.where(still, np.where(excess <= 0, most, -np.inf), np.minimum(most, middle + width))
    return least, np.where(~still & (root < 0), -np.inf, most)


def _tangents(
    start: Floats, mine: Floats, theirs: Floats, normals: Floats, limits: Floats, horizontal: Floats
) -> Floats:
    """Return, for each pair of legs, the smallest and largest start time difference for which the
    vehicles come too close.

    If a difference would violate a constraint, the result is infinite instead.
    """
    middle, crosses = _solve_crossing(start, mine, theirs)
    # |M x| <= horizontal with M = [mine, -theirs]: the extremes of x0 - x1 lie in the direction
    # M^-T (1, -1).
    cross = np.where(crosses, mine[:, 0] * theirs[:, 1] - mine[:, 1] * theirs[:, 0], 1.0)
    # The inverse of M has the rows (theirs_y, -theirs_x) / cross and (mine_y, -mine_x) / cross.
    rows = (
        np.stack([theirs[:, [1, 0]] * [1, -1], mine[:, [1, 0]] * [1, -1]], axis=1)
        / cross[:, None, None]
    )
    direction = rows[:, 0] - rows[:, 1]
    direction /= np.maximum(np.hypot(*direction.T), np.finfo(float).tiny)[:, None]
    edges = np.full((2, len(start)), np.inf)
    for k, sign in enumerate((-1.0, 1.0)):
        times = middle + sign * horizontal[:, None] * (rows * direction[:, None]).sum(axis=2)
        good = crosses & _within(times, normals, limits)
        edges[k] = np.where(good, times[:, 0] - times[:, 1], -sign * np.inf)
    return np.stack([edges[0], edges[1]], axis=1)


def merge_intervals(intervals: Floats) -> Floats:
    """Return the unions of overlapping intervals in increasing order; float64, shape (k, 2).

    The function drops intervals that end before they begin.

    Examples
    --------
    >>> merge_intervals(np.array([(3.0, 4.0), (0.0, 2.0), (1.0, 2.5), (9.0, 8.0)])).tolist()
    [[0.0, 2.5], [3.0, 4.0]]
    """
    ordered = intervals[intervals[:, 0] <= intervals[:, 1]]
    ordered = ordered[np.argsort(ordered[:, 0], kind="stable")]
    if not len(ordered):
        return np.zeros((0, 2))
    ends = np.maximum.accumulate(ordered[:, 1])
    new = np.concatenate([[True], ordered[1:, 0] > ends[:-1]])
    return np.stack(
        [ordered[new, 0], ends[np.concatenate([np.flatnonzero(new)[1:] - 1, [len(ordered) - 1]])]],
        axis=1,
    )


_WORTH = 0.05  # relative to the longest flight: time that another layer must save
# seconds: distance of delays from a conflict, so that delays can be rounded to whole seconds
_AFTER = 1.0

Flights = Callable[[int], Sequence[Trajectory]]
Started = tuple[Sequence[Trajectory], float]


def stagger_starts(
    flights: Sequence[Flights],
    separation: Separation,
    layers: Sequence[int] | None = None,
    earliest: Floats | None = None,
    before: Sequence[Started] = (),
) -> tuple[NDArray[np.int64], Floats]:
    """Return an altitude layer and a start delay for each vehicle, with which all vehicles in
    flight keep the separation.

    The longest flight starts first, in the lowest layer. Each of the other flights uses the layer
    in which this flight can end earliest. A new layer must save at least a twentieth of the longest
    flight's duration, because a higher layer costs a longer climb.

    Parameters
    ----------
    flights : sequence of callable
        For each vehicle, a function that returns the vehicle's trajectories in a given layer. The
        lowest layer has the number 0. Several trajectories are alternative estimates of the
        vehicle's times. The separation holds between trajectories of different vehicles that have
        equal indices. A vehicle without trajectories stays on the ground.
    separation : Separation
    layers : sequence of int, optional
        Layer of each vehicle. With given layers, the function computes only the delays.
    earliest : ndarray of float64, shape (m,), optional
        Lower bound on the delay of each vehicle in seconds.
    before : sequence of (sequence of Trajectory, float)
        Trajectories and delays of vehicles whose delays are already fixed.

    Returns
    -------
    layers : ndarray of int64, shape (m,)
        Layer of each vehicle, counted from 0.
    delays : ndarray of float64, shape (m,)
        Delay of each vehicle in whole seconds.

    Examples
    --------
    >>> path = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 30.0), (100.0, 0.0, 30.0), (0.0, 0.0, 30.0), (0.0, 0.0, 0.0)])
    >>> flight = Trajectory(np.array([0.0, 10.0, 30.0, 50.0, 60.0]), path)
    >>> layers, delays = stagger_starts([lambda layer: [flight]] * 2, Separation())
    >>> layers.tolist(), delays.tolist()
    ([0, 0], [0.0, 71.0])
    """
    flown = [cache(flight) for flight in flights]
    lasting = np.array(
        [max((part.duration for part in flight(0)), default=0.0) for flight in flown]
    )
    chosen, delays = np.zeros(len(flights), dtype=np.int64), np.zeros(len(flights))
    least = np.zeros(len(flights)) if earliest is None else earliest
    settled: list[int] = []
    end, opened = float(lasting.max(initial=0.0)), 1
    for vehicle in np.argsort(-lasting, kind="stable").tolist():
        if not flown[vehicle](0):
            continue
        options = range(opened + 1) if layers is None else [layers[vehicle]]
        started = [
            *before,
            *(
                (flown[earlier](int(chosen[earlier])), float(delays[earlier]))
                for earlier in settled
            ),
        ]
        choices: list[tuple[float, int, float]] = []
        for layer in options:
            delay = _earliest_delay(
                flown[vehicle](layer), started, separation, float(least[vehicle])
            )
            dear = _WORTH * float(lasting.max()) if layer == opened and layers is None else 0.0
            choices.append((max(delay + lasting[vehicle], end) + dear, layer, delay))
            if choices[-1][0] <= end:
                break
        _, chosen[vehicle], delays[vehicle] = min(choices)
        end, opened = (
            max(end, float(delays[vehicle] + lasting[vehicle])),
            max(opened, int(chosen[vehicle]) + 1),
        )
        settled.append(vehicle)
    return chosen, delays


_Near = tuple[_Legs, _Legs, Floats, Floats]


def _barred_delays(near: Sequence[_Near], separation: Separation) -> list[Floats]:
    """Return the delays with which a vehicle comes too close to another one on some pairs of legs,
    given with the factors of the time of turns and the start of the other vehicle (n, 1): arrays of
    intervals, each of shape (k, 2).
    """
    if not near:
        return []
    own, other, turns, starts = zip(*near, strict=True)
    a, b = _Legs.together(own), _Legs.together(other)
    begun, factors = np.concatenate(starts), np.concatenate(turns)
    barred = []
    for first in range(0, len(begun), _TOGETHER):
        some = np.arange(first, min(first + _TOGETHER, len(begun)))
        apart = _close_starts(
            a[some], b[some], factors[some], separation.horizontal, separation.vertical
        )
        # With both uncertainties, the start differs by delay - begun, plus or minus the tolerance.
        within = begun[some] - apart[:, ::-1] + separation.delay * np.array([-1.0, 1.0])
        barred.append(merge_intervals(within))
    return barred


def _earliest_delay(
    mine: Sequence[Trajectory], others: Sequence[Started], separation: Separation, delay: float
) -> float:
    """Return the smallest delay, at least ``delay``, with which a vehicle keeps apart from vehicles
    with fixed delays.
    """
    barred, near, gathered = [np.zeros((0, 2))], list[_Near](), 0
    for theirs, started in others:
        latest = max(max(1.0, part.turns[1]) * part.duration for part in theirs)
        if started + latest + separation.delay < delay:
            continue  # it has landed, however late it is
        for own_flight, other_flight in zip(mine, theirs, strict=True):
            pairs = _near_legs(own_flight, other_flight, separation.horizontal, separation.vertical)
            near.append((*pairs, np.full((len(pairs[2]), 1), started)))
            gathered += len(pairs[2])
            if gathered > _TOGETHER:
                barred += _barred_delays(near, separation)
                near, gathered = [], 0
    barred += _barred_delays(near, separation)
    for low, high in merge_intervals(np.concatenate(barred)).tolist():
        if low - _AFTER < delay < high + _AFTER:
            delay = high + _AFTER
    return float(np.ceil(delay))
