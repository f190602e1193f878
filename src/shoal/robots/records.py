"""What the records of a flown or rehearsed search say: what was searched, and whether the promises
were kept that no two robots are in one cell, that vehicles keep apart, that nobody leaves the
region, and that nobody is left in the air.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from itertools import combinations, pairwise, product
from typing import Any, NamedTuple

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
_COLLISION = 2.0  # metres that vehicles keep in an emergency, across or in height
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
    emergency : mapping or None
        The nearest approach of two vehicles of which one climbs or descends after something went
        wrong: it then passes the heights of others. Such vehicles must keep 2 m.
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
    emergency: Mapping[str, Any] | None
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
            f"robots {robot} and {other} were both in cell {cell} after {time:.0f} s"
            for cell, robot, other, time in self.shared
        ]
        near = self.approach
        if near is not None and near["horizontal_m"] < horizontal:
            robot, other = near["robots"]
            faults.append(
                f"robots {robot} and {other} came as near as {near['horizontal_m']:.1f} m, and"
                f" {near['vertical_m']:.1f} m in height, after {near['time_s']:.0f} s; expected"
                f" {horizontal:g} m, or {vertical:g} m in height"
            )
        near = self.emergency
        if near is not None and near["horizontal_m"] < _COLLISION:
            robot, other = near["robots"]
            faults.append(
                f"robots {robot} and {other} came as near as {near['horizontal_m']:.1f} m, and"
                f" {near['vertical_m']:.1f} m in height, in an emergency after"
                f" {near['time_s']:.0f} s"
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
        horizontal, vertical = self.required_m
        return dict(vars(self)) | {
            "required_m": [horizontal, None if math.isinf(vertical) else vertical],
            "covered_fraction": self.covered_fraction,
            "faults": self.faults,
            "shared": [list(meeting) for meeting in self.shared],
            "doubtful": [list(pair) for pair in self.doubtful],
        }


def search_record(task: RobotTask, robots: Sequence[RobotRecord]) -> SearchRecord:
    """Return what the records of all robots of a search say."""
    searched, doubtful, cells_found = set[int](), [], set[int]()
    for record in robots:
        for report in record.reports:
            if report["kind"] != "searched":
                continue
            cell = int(report["cell"])
            if not _was_at_cell(task, record, cell, report["time"]):
                doubtful.append((record.robot, cell))
                continue
            searched |= {cell, *report.get("around", ())}
            if report.get("found"):
                cells_found.add(cell)
            cells_found |= {*report.get("beside", ())}
    flights = {record.robot: _flights(task, record) for record in robots}
    flown = [flight for parts in flights.values() for flight in parts]
    begin = min((flight.begin for flight in flown), default=0.0)
    end = max((flight.begin + flight.trajectory.duration for flight in flown), default=0.0)
    vertical = math.inf if task.kind == "rover" else task.limits.vertical_m - 2 * _TOLERANCE
    close = math.inf if task.kind == "rover" else _COLLISION
    return SearchRecord(
        cells=len(task.cells),
        searched=len(searched),
        doubtful=tuple(doubtful),
        seconds=round(end - begin, 2),
        approach=_nearest_approach(flights, vertical, begin, calm=True),
        required_m=(task.limits.horizontal_m, vertical),
        emergency=_nearest_approach(flights, close, begin, calm=False),
        shared=tuple(_shared_cells(robots)),
        outside_m={record.robot: _distance_outside(task, record) for record in robots},
        breaches={record.robot: record.breaches for record in robots},
        hovering=tuple(
            record.robot for record in robots if record.armed or _is_airborne(task, record)
        ),
        battery={record.robot: round(record.battery, 3) for record in robots},
        found=tuple(sorted(cells_found)),
    )


def _was_at_cell(task: RobotTask, record: RobotRecord, cell: int, time: float) -> bool:
    """Return whether a vehicle was at the viewpoint of a cell when it reported the cell."""
    near = np.abs(record.times - time) <= _SECONDS
    if not near.any():
        return False
    distances = np.linalg.norm(record.places[near, :2] - task.cells[cell, :2], axis=1)
    return bool(distances.min() <= task.arrival_m + _TOLERANCE)


def _is_airborne(task: RobotTask, record: RobotRecord) -> bool:
    return task.kind != "rover" and len(record.places) > 0 and bool(record.places[-1, 2] > _ALOFT)


class _Flight(NamedTuple):
    """A part of a flight: when it began, its trajectory, and whether all was well."""

    begin: float
    trajectory: Trajectory
    calm: bool


def _flights(task: RobotTask, record: RobotRecord) -> list[_Flight]:
    """Return the parts of a vehicle's flight. After its robot has given up or died for the first
    time, all is well only as long as the vehicle flies at its own height.
    """
    if len(record.times) < 2:
        return []
    times = np.arange(record.times[0], record.times[-1], _EVERY)
    at = [np.interp(times, record.times, record.places[:, axis]) for axis in range(3)]
    points = np.stack(at, axis=1)
    if task.kind == "rover":
        up = np.linalg.norm(points[:, :2] - points[0, :2], axis=1) > _LEFT
    else:
        up = points[:, 2] > _ALOFT
    wrong = [report["time"] for report in record.reports if report["kind"] in ("fault", "ended")]
    level = np.abs(points[:, 2] - task.height(record.robot)) <= _TOLERANCE + _ALOFT / 2
    calm = (times < min(wrong, default=math.inf)) | level
    state = np.where(up, 1 + calm, 0)
    edges = [0, *(np.flatnonzero(np.diff(state)) + 1).tolist(), len(state)]
    parts = []
    for first, last in pairwise(edges):
        if state[first] and last - first > 1:
            trajectory = Trajectory(times[first:last] - times[first], points[first:last])
            parts.append(_Flight(float(times[first]), trajectory, bool(state[first] == 2)))
    return parts


def _nearest_approach(
    flights: Mapping[int, Sequence[_Flight]], vertical: float, begin: float, *, calm: bool
) -> dict[str, Any] | None:
    """Return the nearest approach of two vehicles that are both in flight: while all is well with
    both, or while it is not.
    """
    best: dict[str, Any] | None = None
    for robot, other in combinations(sorted(flights), 2):
        for part, other_part in product(flights[robot], flights[other]):
            later = other_part.begin - part.begin
            together = -other_part.trajectory.duration <= later <= part.trajectory.duration
            if (part.calm and other_part.calm) != calm or not together:
                continue
            approach = nearest_approach(
                part.trajectory, other_part.trajectory, vertical=vertical, later=later
            )
            if approach is not None and (
                best is None or approach.horizontal < best["horizontal_m"]
            ):
                best = {
                    "robots": [robot, other],
                    "horizontal_m": round(approach.horizontal, 2),
                    "vertical_m": round(approach.vertical, 2),
                    "time_s": round(part.begin - begin + approach.times[0], 1),
                }
    return best


def _shared_cells(robots: Sequence[RobotRecord]) -> list[tuple[int, int, int, float]]:
    """Return the cells in which two robots were at the same time, by what they have logged."""
    stays: dict[int, list[tuple[float, float, int]]] = {}
    for record in robots:
        inside: tuple[int, float] | None = None
        for report in [*record.reports, {"kind": "ended", "time": math.inf}]:
            if inside is not None and (report["kind"] in ("enters", *_LEAVES)):
                stays.setdefault(inside[0], []).append((inside[1], report["time"], record.robot))
                inside = None
            if report["kind"] == "enters":
                inside = int(report["cell"]), report["time"]
    shared = []
    for cell, stays_in_cell in sorted(stays.items()):
        for (begin, end, first), (start, stop, other) in combinations(sorted(stays_in_cell), 2):
            if first != other and start < end and begin < stop:
                shared.append((cell, first, other, round(start, 1)))
    return shared


def _distance_outside(task: RobotTask, record: RobotRecord) -> float:
    """Return the largest distance of a vehicle in flight from where it may be: in the region and on
    its ways to and from its launch point; on a return of its autopilot, between all these.
    """
    import shapely

    up = (
        record.places[:, 2] > _ALOFT
        if task.kind != "rover"
        else np.ones(len(record.places), np.bool_)
    )
    if not up.any():
        return 0.0
    outline, ways = task.plan.grid.region.outline, _corridors(task, record.robot)
    led = shapely.union_all([outline, *ways])
    home = shapely.Point(task.plan.places[record.robot - 1])
    returns = shapely.convex_hull(shapely.union_all([outline, home, *ways]))
    distance = 0.0
    for allowed, moments in ((led, up & record.led), (returns, up & ~record.led)):
        if moments.any():
            points = shapely.points(record.places[moments, :2])
            distance = max(distance, float(shapely.distance(allowed, points).max()))
    return round(distance, 2)


def _corridors(task: RobotTask, robot: int) -> list[Any]:
    """Return corridors between the region and a launch point outside of it."""
    import shapely

    plan, place = task.plan, task.plan.places[robot - 1]
    if plan.grid.region.contains(place[None])[0]:
        return []
    cells = task.cells[:: max(1, len(task.cells) // _WAYS), :2]
    return [
        shapely.LineString(plan.leg(place, cell)).buffer(task.limits.horizontal_m) for cell in cells
    ]
