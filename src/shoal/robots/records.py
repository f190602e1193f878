"""What the records of a flown or rehearsed search say: what was searched, and whether the promises
were kept that no two robots are in one cell, that vehicles keep apart, that nobody leaves the
region, and that nobody is left in the air.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.robots.tasks import RobotTask
from shoal.search.flight.separation import nearest_approach
from shoal.search.flight.timing import Trajectory

_ALOFT = 1.0  # metres above home, from which on a vehicle is in flight
_LEFT = 3.0  # metres from its first position, from which on a rover is on its way
_SECONDS = 1.5  # between a report and the position that belongs to it
_EVERY = 0.25  # seconds between two positions that are compared
_OUTSIDE = 1.0  # metres outside the region that count as rounding and wind
_WAYS = 100  # ways from a launch point that are looked at
_TOLERANCE = 1.0  # metres by which each of two heights may differ from what was told
_LEAVES = ("leaves", "fault", "ended")

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RobotRecord:
    """What one robot has logged, and where its vehicle was.

    Parameters
    ----------
    robot : int
    reports : sequence of mapping
        The reports of its program with their times in seconds. A report of the kind "ended" says
        when its program was killed.
    times : ndarray of float64, shape (n,)
        Times of the positions in seconds, on the same clock.
    places : ndarray of float64, shape (n, 3)
        Metres east and north in the region's frame, and above home.
    led : ndarray of bool, shape (n,)
        Whether the vehicle was in its guided mode, in which the robot's program leads it. Returns
        that an autopilot begins by itself are straight.
    armed : bool
        Whether the vehicle is armed at the end.
    battery : float
        Fraction that is left at the end.
    breaches : int
        Number of breaches of its fence.
    """

    robot: int
    reports: Sequence[Mapping[str, Any]]
    times: Floats
    places: Floats
    led: NDArray[np.bool_]
    armed: bool
    battery: float
    breaches: int


@dataclass(frozen=True)
class SearchRecord:
    """What the records of all robots say.

    Parameters
    ----------
    cells, searched : int
        Number of cells, and of cells that a robot has reported as searched while its vehicle was
        there.
    doubtful : tuple of (int, int)
        Robot and cell of reports for which the vehicle was elsewhere.
    seconds : float
        Time from the first moment in flight to the last.
    approach : mapping or None
        The nearest approach of two vehicles: "robots", "horizontal_m", "vertical_m" and "time_s".
    required_m : tuple of float
        Horizontal and vertical distance, of which two vehicles must keep one.
    shared : tuple of (int, int, int, float)
        Cell, two robots, and the time at which both were in it.
    outside_m : mapping of int to float
        Largest distance of each robot from the region in metres.
    breaches : mapping of int to int
        Breaches of the fence.
    hovering : tuple of int
        Robots whose vehicles are armed or in the air at the end.
    battery : mapping of int to float
        Fraction that is left.
    found : tuple of int
        Cells in which something was found.
    """

    cells: int
    searched: int
    doubtful: tuple[tuple[int, int], ...]
    seconds: float
    approach: Mapping[str, Any] | None
    required_m: tuple[float, float]
    shared: tuple[tuple[int, int, int, float], ...]
    outside_m: Mapping[int, float]
    breaches: Mapping[int, int]
    hovering: tuple[int, ...]
    battery: Mapping[int, float]
    found: tuple[int, ...] = field(default=())

    @property
    def covered_fraction(self) -> float:
        """Fraction of the cells that were searched."""
        return self.searched / self.cells

    @property
    def faults(self) -> list[str]:
        """What was not as promised, a sentence each."""
        horizontal, vertical = self.required_m
        faults = []
        if self.searched < self.cells:
            faults.append(f"{self.cells - self.searched} of {self.cells} cells were not searched")
        faults += [
            f"robot {robot} reported cell {cell} as searched while its vehicle was elsewhere"
            for robot, cell in self.doubtful
        ]
        faults += [
            f"robots {one} and {other} were both in cell {cell} after {time:.0f} s"
            for cell, one, other, time in self.shared
        ]
        near = self.approach
        if near is not None and near["horizontal_m"] < horizontal:
            one, other = near["robots"]
            faults.append(
                f"robots {one} and {other} came as near as {near['horizontal_m']:.1f} m, and"
                f" {near['vertical_m']:.1f} m in height, after {near['time_s']:.0f} s; expected"
                f" {horizontal:g} m, or {vertical:g} m in height"
            )
        faults += [
            f"robot {robot} was {metres:.1f} m outside the region"
            for robot, metres in self.outside_m.items()
            if metres > _OUTSIDE
        ]
        faults += [
            f"robot {robot} breached its fence {count} times"
            for robot, count in self.breaches.items()
            if count
        ]
        faults += [f"the vehicle of robot {robot} is still in the air" for robot in self.hovering]
        return faults

    def report(self) -> dict[str, Any]:
        """Return the record as a mapping for JSON."""
        return dict(vars(self)) | {
            "covered_fraction": self.covered_fraction,
            "faults": self.faults,
            "shared": [list(one) for one in self.shared],
            "doubtful": [list(one) for one in self.doubtful],
        }


def search_record(task: RobotTask, robots: Sequence[RobotRecord]) -> SearchRecord:
    """Return what the records of all robots of a search say."""
    searched, doubtful, found = set[int](), [], set[int]()
    for one in robots:
        for report in one.reports:
            if report["kind"] != "searched":
                continue
            cell = int(report["cell"])
            if not _was_there(task, one, cell, report["time"]):
                doubtful.append((one.robot, cell))
                continue
            searched |= {cell, *report.get("around", ())}
            if report.get("found"):
                found.add(cell)
            found |= {*report.get("beside", ())}
    flights = {one.robot: _flight(task, one) for one in robots}
    flown = [flight for flight in flights.values() if flight is not None]
    begin = min((flight[0] for flight in flown), default=0.0)
    end = max((flight[0] + flight[1].duration for flight in flown), default=0.0)
    rover = task.kind == "rover"
    vertical = math.inf if rover else task.limits.vertical_m - 2 * _TOLERANCE
    return SearchRecord(
        cells=len(task.cells),
        searched=len(searched),
        doubtful=tuple(doubtful),
        seconds=round(end - begin, 2),
        approach=_nearest(flights, vertical, begin),
        required_m=(task.limits.horizontal_m, vertical),
        shared=tuple(_shared_cells(robots)),
        outside_m={one.robot: _outside(task, one) for one in robots},
        breaches={one.robot: one.breaches for one in robots},
        hovering=tuple(one.robot for one in robots if one.armed or _is_up(task, one)),
        battery={one.robot: round(one.battery, 3) for one in robots},
        found=tuple(sorted(found)),
    )


def _was_there(task: RobotTask, one: RobotRecord, cell: int, time: float) -> bool:
    """Return whether a vehicle was at the viewpoint of a cell when it reported the cell."""
    near = np.abs(one.times - time) <= _SECONDS
    if not near.any():
        return False
    away = np.linalg.norm(one.places[near, :2] - task.cells[cell, :2], axis=1)
    return bool(away.min() <= task.arrival_m + _TOLERANCE)


def _is_up(task: RobotTask, one: RobotRecord) -> bool:
    return task.kind != "rover" and len(one.places) > 0 and bool(one.places[-1, 2] > _ALOFT)


def _flight(task: RobotTask, one: RobotRecord) -> tuple[float, Trajectory] | None:
    """Return when a vehicle was first in flight, and its way from then on to the last moment."""
    if not len(one.times):
        return None
    if task.kind == "rover":
        up = np.linalg.norm(one.places[:, :2] - one.places[0, :2], axis=1) > _LEFT
    else:
        up = one.places[:, 2] > _ALOFT
    if not up.any():
        return None
    first, last = np.flatnonzero(up)[[0, -1]].tolist()
    begin = float(one.times[first])
    times = np.arange(0.0, one.times[last] - begin + _EVERY, _EVERY)
    at = [np.interp(begin + times, one.times, one.places[:, axis]) for axis in range(3)]
    return begin, Trajectory(times, np.stack(at, axis=1))


def _nearest(
    flights: Mapping[int, tuple[float, Trajectory] | None], vertical: float, begin: float
) -> dict[str, Any] | None:
    """Return the nearest approach of two vehicles that are both in flight."""
    best: dict[str, Any] | None = None
    for one, other in combinations(sorted(flights), 2):
        mine, theirs = flights[one], flights[other]
        if mine is None or theirs is None:
            continue
        later = theirs[0] - mine[0]
        if not -theirs[1].duration <= later <= mine[1].duration:
            continue
        met = nearest_approach(mine[1], theirs[1], vertical=vertical, later=later)
        if met is not None and (best is None or met.horizontal < best["horizontal_m"]):
            best = {
                "robots": [one, other],
                "horizontal_m": round(met.horizontal, 2),
                "vertical_m": round(met.vertical, 2),
                "time_s": round(mine[0] - begin + met.times[0], 1),
            }
    return best


def _shared_cells(robots: Sequence[RobotRecord]) -> list[tuple[int, int, int, float]]:
    """Return the cells in which two robots were at the same time, by what they have logged."""
    stays: dict[int, list[tuple[float, float, int]]] = {}
    for one in robots:
        inside: tuple[int, float] | None = None
        for report in [*one.reports, {"kind": "ended", "time": math.inf}]:
            if inside is not None and (report["kind"] in ("enters", *_LEAVES)):
                stays.setdefault(inside[0], []).append((inside[1], report["time"], one.robot))
                inside = None
            if report["kind"] == "enters":
                inside = int(report["cell"]), report["time"]
    shared = []
    for cell, some in sorted(stays.items()):
        for (begin, end, one), (start, stop, other) in combinations(sorted(some), 2):
            if one != other and start < end and begin < stop:
                shared.append((cell, one, other, round(start, 1)))
    return shared


def _outside(task: RobotTask, one: RobotRecord) -> float:
    """Return the largest distance of a vehicle in flight from where it may be: in the region and on
    its ways to and from its launch point; on a return of its autopilot, between all these.
    """
    import shapely

    up = one.places[:, 2] > _ALOFT if task.kind != "rover" else np.ones(len(one.places), np.bool_)
    if not up.any():
        return 0.0
    outline, ways = task.plan.grid.region.outline, _ways_out(task, one.robot)
    led = shapely.union_all([outline, *ways])
    home = shapely.Point(task.plan.places[one.robot - 1])
    returns = shapely.convex_hull(shapely.union_all([outline, home, *ways]))
    away = 0.0
    for allowed, some in ((led, up & one.led), (returns, up & ~one.led)):
        if some.any():
            points = shapely.points(one.places[some, :2])
            away = max(away, float(shapely.distance(allowed, points).max()))
    return round(away, 2)


def _ways_out(task: RobotTask, robot: int) -> list[Any]:
    """Return corridors between the region and a launch point outside of it."""
    import shapely

    plan, place = task.plan, task.plan.places[robot - 1]
    if plan.grid.region.contains(place[None])[0]:
        return []
    some = task.cells[:: max(1, len(task.cells) // _WAYS), :2]
    return [
        shapely.LineString(plan.leg(place, cell)).buffer(task.limits.horizontal_m) for cell in some
    ]
