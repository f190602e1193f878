"""When robots look: the times at which they are at their stops, and at which they first see each
cell, by the flights of their vehicles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import partial_sums, step_lengths, unit_vectors
from shoal.search.flight.timing import Trajectory
from shoal.search.planning.plan import SearchPlan
from shoal.search.problem import SearchProblem
from shoal.search.problem.target import Ground, looks_from

Floats = NDArray[np.float64]

_NEAR = 0.75  # cells from a stop, within which a vehicle that comes nearer passes it
_FINE = 0.125  # cells between two samples of a flight
_SLACK = 20.0  # cells, beside three times the way, within which a stop follows the one before
_PLACES = 4  # along the side of a cell, which vehicles first see on their flights
_AT_ONCE = 128  # samples that are looked at first
_TOGETHER = 10_000_000  # samples times stops, up to which all are matched together


@dataclass(frozen=True, eq=False)
class Sightings:
    """When a robot looks.

    Parameters
    ----------
    times : ndarray of float64, shape (k,)
        When it is at each of its stops, in seconds since the start of the search.
    track : ndarray of float64, shape (n, 2)
        Its positions while it searches, in metres; none without a vehicle.
    moments : ndarray of float64, shape (n,)
        When it is there, in seconds.
    """

    times: Floats
    track: Floats
    moments: Floats


def sightings_of(plan: SearchPlan, robot: int, stops: ArrayLike) -> Sightings:
    """Return when a robot looks from each of its stops.

    A vehicle looks when it passes the stop on its flights, with its turns, climbs and charges. If
    missions shift or lengthen its sorties, their times shift with them. Without a vehicle, or if it
    cannot fly its path, the time follows from the costs of the cells.

    Parameters
    ----------
    plan : SearchPlan
    robot : int
        Number of the robot, counted from 0.
    stops : array_like of int, shape (k,)
        Tour indices in the order of the search.
    """
    cells = np.asarray(stops, dtype=np.int64)
    none = np.zeros((0, 2)), np.zeros(0)
    if not len(cells):
        return Sightings(np.zeros(0), *none)
    if plan.flies and plan.refusal is None:
        flights = plan.flown_sorties(robot, cells).searching()
        sorties = plan.sorties[robot]
        if len(flights) == len(sorties):
            begins = [
                start + (lasting - flight.duration) / 2
                for (flight, *_), (start, lasting) in zip(flights, sorties, strict=True)
            ]
            return _passed(flights, begins, plan.positions(cells)[:, :2], plan.grid.size)
    return Sightings(plan.times_by_cost(robot, cells), *none)


def first_seen(
    plan: SearchPlan, sightings: Sequence[Sightings], view: ArrayLike, *, fine: int = 1
) -> tuple[NDArray[np.int64], Floats]:
    """Return which robot (counted from 0, or -1) first sees places in each cell on its flights, and
    when, in seconds (or infinity); int64 and float64, shape (N, fine**2).

    A vehicle sees the square of side ``view``, in metres, while it searches, also between its
    stops, and not on its ways out and home. Looks at the same ground from one altitude, as of several
    passes and of second looks, are all seen. Searches at several altitudes and robots without a
    vehicle have no such track.

    Parameters
    ----------
    plan : SearchPlan
    sightings : sequence of Sightings
        Those of each robot.
    view : float, or array_like of float, shape (m,)
        Side of what each robot sees, in metres.
    fine : int
        Number of places along the side of a cell; with 1, its viewpoint.
    """
    from scipy.spatial import KDTree

    n, facing = len(plan.tour_cost), plan.facing
    robots, times = np.full(n * fine**2, -1, dtype=np.int64), np.full(n * fine**2, inf)
    if len(set(plan.altitudes)) == 1 and any(len(own.track) for own in sightings):
        # along a line, footprints turn
        angle, norm = (facing, inf) if isinstance(facing, float) else (0.0, 2.0)
        axes = unit_vectors(np.radians(np.array([angle, angle + 90.0]))).T
        steps = ((np.arange(fine) + 0.5) / fine - 0.5) * plan.grid.size
        within = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        places = (plan.positions(np.arange(n))[:, :2] @ axes)[:, None] + within
        tree = KDTree(places.reshape(-1, 2))
        for robot, (own, side) in enumerate(
            zip(sightings, np.broadcast_to(view, len(sightings)), strict=True)
        ):
            if len(own.track):
                seen = tree.query_ball_point(own.track @ axes, side / 2, p=norm)
                first = np.full(len(times), inf)
                for moment, found in zip(own.moments[::-1].tolist(), seen[::-1], strict=True):
                    first[found] = moment
                earlier = first < times
                robots[earlier], times[earlier] = robot, first[earlier]
    return robots.reshape(n, -1), times.reshape(n, -1)


@dataclass(frozen=True, eq=False)
class Success:
    """The probability that a target is found, over time, by the prior of a plan.

    Parameters
    ----------
    times : ndarray of float64, shape (k,)
        Increasing times of searches, in seconds.
    probabilities : ndarray of float64, shape (k,)
        Probability that the target is found until each time.
    mean : float or None
        Expected time in seconds (`shoal.search.problem.target`), or None if nothing can be found.
    """

    times: Floats
    probabilities: Floats
    mean: float | None

    @property
    def probability(self) -> float:
        """Probability that the whole search finds the target."""
        return float(self.probabilities[-1]) if len(self.probabilities) else 0.0


def success_of(
    plan: SearchPlan,
    sightings: Sequence[Sightings],
    seen: Sequence[Sequence[NDArray[np.int64]]],
    *,
    view: ArrayLike,
    detection: float,
    limit: float,
) -> Success:
    """Return the probability that robots find the target of a prior, over time.

    Each search of a place finds a target in it with the probability ``detection``, if no search
    before did. A vehicle's first search of a target that stands still counts from when its
    footprint, which moves along its flight, reaches each of 4 x 4 places in the cell.

    Parameters
    ----------
    plan : SearchPlan
        A plan that knows where the target may be.
    sightings : sequence of Sightings
        Those of each robot.
    seen : sequence of sequence of ndarray of int64
        For each stop of each robot, the cells that it searches, as tour indices.
    view : float, or array_like of float, shape (m,)
        Side of what each robot sees, in metres.
    detection : float
    limit : float
        Time in seconds after which a search in vain is repeated, or for a target that moves, the
        time that counts if it is not found.
    """
    ground = plan.ground
    assert ground is not None
    looks = looks_from(ground, seen, [own.times for own in sightings])
    moments = looks.times[:, None]
    if isinstance(ground, Ground) and any(len(own.track) for own in sightings):
        # vehicles first see parts of a cell on their way, before they are at a stop
        first = first_seen(plan, sightings, view, fine=_PLACES)[1][looks.cells]
        moments = np.where((looks.earlier == 0)[:, None], np.minimum(first, moments), moments)
    found = ground.masses[looks.pieces] * looks.chances(detection)
    parts = np.repeat(found / moments.shape[1], moments.shape[1])
    order = np.argsort(moments, axis=None, kind="stable")
    # the mean is linear in the times
    mean = ground.expected_time(replace(looks, times=moments.mean(axis=1)), detection, limit)
    return Success(
        moments.ravel()[order],
        np.minimum(np.cumsum(parts[order]), 1.0),  # rounded sums exceed 1
        mean if len(found) and mean < inf else None,
    )


def planned_success(
    plan: SearchPlan, problem: SearchProblem, limit: float | None = None
) -> Success:
    """Return the probability that robots find the target of a prior over time, if all goes as in a
    plan that knows where it may be. By default, the ``limit`` of `success_of` is the plan's time.
    """
    robots = range(len(plan.places))
    stops = [plan.stops(robot) for robot in robots]
    return success_of(
        plan,
        [sightings_of(plan, robot, stops[robot]) for robot in robots],
        [plan.visible_cells(robot, stops[robot]) for robot in robots],
        view=problem.view,
        detection=problem.chosen_detection,
        limit=plan.planned_seconds if limit is None else limit,
    )


def _passed(
    flights: list[tuple[Trajectory, float, float]], begins: list[float], stops: Floats, size: float
) -> Sightings:
    """Return when flights pass stops, one after the other."""
    points, times, borders = [], [], [0]
    for (flight, first, last), begin in zip(flights, begins, strict=True):
        legs = step_lengths(flight.points[:, :2])
        counts = np.maximum(1, np.ceil(legs / (_FINE * size))).astype(np.int64)
        shares = np.arange(counts.sum()) - np.repeat(partial_sums(counts)[:-1], counts)
        leg = np.repeat(np.arange(len(legs)), counts)
        moments = flight.times[leg] + shares / counts[leg] * np.diff(flight.times)[leg]
        moments = np.append(moments, flight.times[-1])
        moments = moments[(moments >= first) & (moments <= last)]
        points.append(flight.at(moments)[:, :2])
        times.append(begin + moments)
        borders.append(borders[-1] + len(moments))
    track, clock = np.concatenate(points), np.concatenate(times)
    found = (
        _followed(track, stops)
        if len(track) * len(stops) <= _TOGETHER
        else _one_by_one(track, borders, stops, size)
    )
    return Sightings(clock[found], track, clock)


def _followed(track: Floats, stops: Floats) -> NDArray[np.int64]:
    """Return the samples of a track that pass stops one after the other with the least sum of
    squared distances; int64, shape (k,).
    """
    befores = np.zeros((len(stops), len(track)), dtype=np.int32)
    least, numbers = np.zeros(len(track)), np.arange(len(track), dtype=np.int32)
    for k, stop in enumerate(stops):
        # the best sample for the stop before, up to each sample
        lowest = np.minimum.accumulate(least)
        befores[k] = np.maximum.accumulate(np.where(least == lowest, numbers, 0))
        least = lowest + ((track - stop) ** 2).sum(axis=1)
    found, at = np.zeros(len(stops), dtype=np.int64), int(np.argmin(least))
    for k in range(len(stops) - 1, -1, -1):
        found[k] = at
        at = int(befores[k, at])
    return found


def _one_by_one(track: Floats, borders: list[int], stops: Floats, size: float) -> NDArray[np.int64]:
    """Return the samples of a track that pass stops one after the other, each soon after the one
    before; int64, shape (k,).
    """
    far = partial_sums(step_lengths(track))
    ways = partial_sums(step_lengths(stops))
    found = np.full(len(stops), -1, dtype=np.int64)
    at, before = 0, 0.0  # the last stop that was passed, and the way there from stop to stop
    for number, (stop, way) in enumerate(zip(stops, ways.tolist(), strict=True)):
        # in this sortie soon, or else anywhere in the next one
        here = int(np.searchsorted(borders, at, side="right"))
        soon = min(
            int(np.searchsorted(far, far[at] + 3 * (way - before) + _SLACK * size)), borders[here]
        )
        passed = _nearest(track, stop, at, max(soon, at + 1), _NEAR * size)
        if passed < 0 and here < len(borders) - 1:
            passed = _nearest(track, stop, borders[here], borders[here + 1], _NEAR * size)
        if passed >= 0:
            found[number] = at = passed
            before = way
    known = np.flatnonzero(found >= 0)
    if not len(known):
        return np.linspace(0, len(track) - 1, len(stops)).astype(np.int64)
    between = np.interp(np.arange(len(stops)), known, found[known])
    return np.asarray(between, dtype=np.int64)


def _nearest(track: Floats, stop: Floats, begin: int, end: int, reach: float) -> int:
    """Return the sample at which a track first passes a stop within ``reach``, or -1."""
    many = _AT_ONCE
    while begin < end:
        away = np.hypot(*(track[begin : min(begin + many, end)] - stop).T)
        near = np.flatnonzero(away <= reach)
        if len(near):
            first = begin + int(near[0])
            away = np.hypot(*(track[first : min(first + _AT_ONCE, end)] - stop).T)
            leaving = np.flatnonzero(np.diff(away) > 0)
            return first + (int(leaving[0]) if len(leaving) else len(away) - 1)
        begin, many = begin + many, 2 * many
    return -1
