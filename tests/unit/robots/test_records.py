"""What the records of a flown search say: each broken promise is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pymavlink")

from shoal.robots.records import RobotRecord, search_record
from shoal.robots.tasks import RobotLimits, read_task, write_task
from shoal.search import SearchProblem
from shoal.search.run import run

SPEED = 5.0  # m/s


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    folder = tmp_path_factory.mktemp("task")
    problem = SearchProblem(
        region="rectangle:60x40", robots=2, footprint=20, vehicle="multirotor,altitude=30"
    )
    write_task(run(problem, seed=1), folder, RobotLimits())
    return read_task(folder)


def flown(task, robot, cells, begin=0.0):
    """Return the record of a robot that searches some cells and lands where it started."""
    home = task.cells[task.scenario.starts[robot - 1], :2]
    up = task.height(robot)
    stops = [(*home, 0.0), (*home, up)]
    stops += [(*task.cells[cell, :2], up) for cell in cells]
    stops += [(*home, up), (*home, 0.0)]
    points = np.array(stops)
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1) / SPEED)])
    at += begin
    times = np.arange(at[0], at[-1], 0.1)
    places = np.stack([np.interp(times, at, points[:, axis]) for axis in range(3)], axis=1)
    reports = [{"kind": "listening", "time": begin}]
    for cell, time in zip(cells, at[2:], strict=False):
        reports += [
            {"kind": "enters", "cell": cell, "time": time - 1.0},
            {"kind": "searched", "cell": cell, "time": time, "found": False},
        ]
    reports.append({"kind": "leaves", "time": at[-3] + 0.1})
    led = np.ones(len(times), dtype=np.bool_)
    return RobotRecord(robot, reports, times, places, led, False, 0.7, 0)


@pytest.fixture
def two(task):
    n = len(task.cells)
    return [flown(task, 1, range(n // 2)), flown(task, 2, range(n - 1, n // 2 - 1, -1))]


def test_a_search_as_promised_has_no_faults(task, two):
    record = search_record(task, two)
    assert record.faults == []
    assert record.covered_fraction == 1.0
    assert record.report()["battery"] == {1: 0.7, 2: 0.7}
    assert record.seconds > 25


def test_a_cell_counts_only_if_the_vehicle_was_there(task, two):
    *reports, last = two[0].reports
    lie = {**last, "kind": "searched", "cell": len(task.cells) - 1}
    record = search_record(task, [replace(two[0], reports=[*reports, lie])])
    assert record.doubtful == ((1, len(task.cells) - 1),)
    assert record.searched == len(task.cells) // 2
    assert record.faults[:2] == [
        "3 of 6 cells were not searched",
        "robot 1 reported cell 5 as searched while its vehicle was elsewhere",
    ]


def test_two_robots_in_one_cell_are_found(task, two):
    first = flown(task, 1, [0, 1, 2])
    second = flown(task, 2, [2], begin=[one["time"] for one in first.reports][-2] - 20)
    time = next(one["time"] for one in first.reports if one["kind"] == "enters")
    reports = [{"kind": "enters", "cell": 0, "time": time + 0.5}]
    shared = search_record(task, [first, replace(second, reports=reports)]).shared
    assert shared == ((0, 1, 2, round(time + 0.5, 1)),)
    # one after the other is as it should be, and so is one after the other was killed
    gone = next(one["time"] for one in first.reports if one.get("cell") == 1)
    reports = [{"kind": "enters", "cell": 0, "time": gone + 0.5}]
    assert not search_record(task, [first, replace(second, reports=reports)]).shared
    killed = [*first.reports[:2], {"kind": "ended", "time": time + 0.2}]
    reports = [{"kind": "enters", "cell": 0, "time": time + 0.5}]
    records = [replace(first, reports=killed), replace(second, reports=reports)]
    assert not search_record(task, records).shared


def test_vehicles_that_come_too_near_are_found(task, two):
    together = replace(two[0], robot=2, places=np.add(two[0].places, [4.0, 0.0, 0.0]))
    record = search_record(task, [two[0], together])
    assert record.approach["robots"] == [1, 2]
    assert record.approach["horizontal_m"] == 4.0
    (fault,) = [one for one in record.faults if "came as near as" in one]
    assert "4.0 m, and 0.0 m in height" in fault
    assert "expected 5 m, or 3 m in height" in fault
    above = replace(together, places=together.places + np.array([0.0, 0.0, task.limits.vertical_m]))
    assert search_record(task, [two[0], above]).approach is None


def test_who_leaves_the_region_or_stays_in_the_air_is_found(task, two):
    away = two[0].places.copy()
    away[len(away) // 2] += [500.0, 0.0, 0.0]
    record = search_record(task, [replace(two[0], places=away, breaches=1), two[1]])
    assert record.outside_m[1] > 100
    assert record.outside_m[2] == 0
    assert [one for one in record.faults if "robot 1" in one][-1] == (
        "robot 1 breached its fence 1 times"
    )
    some = {name: getattr(two[1], name)[:200] for name in ("times", "places", "led")}
    up = replace(two[1], **some, armed=True)
    assert search_record(task, [up]).hovering == (2,)
    assert search_record(task, [up]).faults[-1] == "the vehicle of robot 2 is still in the air"
