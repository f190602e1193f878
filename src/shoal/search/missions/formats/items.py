"""MAVLink mission items: what `.plan` and WPL files consist of."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from shoal.dataclass import dataclass
from shoal.search.missions.diagnostics import Sheet
from shoal.search.missions.mission import Mission

WAYPOINT, RETURN, LAND, TAKE_OFF, SPEED = 16, 20, 21, 22, 178  # MAV_CMD
RELATIVE, WITHOUT_PLACE = 3, 2  # MAV_FRAME: GLOBAL_RELATIVE_ALT and MISSION
_PLACED = {WAYPOINT, LAND, TAKE_OFF}
_RELATIVE_FRAMES = {3, 6}  # 6 is 3 with integers on the wire

Params = tuple[float | None, ...]


@dataclass(frozen=True)
class Item:
    """One mission item; latitude, longitude and altitude are the last three of its seven parameters; None is unset."""

    command: int
    frame: int
    params: Params
    place: str = ""


def items_of(mission: Mission) -> list[Item]:
    """Return the items of a mission, without home.

    Take-off comes first, for autopilots begin with it; the speed then holds until the end.
    """
    longitude, latitude = mission.home
    height = mission.altitude
    take_off = Item(TAKE_OFF, RELATIVE, (0.0, 0.0, 0.0, None, latitude, longitude, height))
    speed = Item(SPEED, WITHOUT_PLACE, (1.0, mission.speed, -1.0, 0.0, 0.0, 0.0, 0.0))  # over ground; throttle unchanged
    points = [Item(WAYPOINT, RELATIVE, (0.0, 0.0, 0.0, None, y, x, height)) for x, y in mission.waypoints.tolist()]
    home = Item(RETURN, WITHOUT_PLACE, (0.0,) * 7)
    return [*([take_off] if mission.kind == "multirotor" else []), speed, *points, home]


def read_items(sheet: Sheet, items: Sequence[Item]) -> None:
    """Fill a sheet with what items say, and note what is wrong with them."""
    waypoints = [item for item in items if item.command == WAYPOINT]
    sheet.n_items = len(items) + 1
    sheet.points = np.array([_number(item.params[5], item.params[4]) for item in waypoints], dtype=np.float64).reshape(-1, 2)
    sheet.altitudes = [_number(item.params[6])[0] for item in waypoints]
    sheet.places = [item.place for item in waypoints]
    speeds = [item for item in items if item.command == SPEED]
    if speeds:
        sheet.speed = _number(speeds[0].params[1])[0]
    for item in items:
        if item.command in _PLACED and item.frame not in _RELATIVE_FRAMES:
            sheet.add("frame", item.place, f"expected frame {RELATIVE} (altitude above home) for a position, got {item.frame}")
        elif item.command in (RETURN, SPEED) and item.frame != WITHOUT_PLACE:
            sheet.add("frame", item.place, f"expected frame {WITHOUT_PLACE} for command {item.command}, got {item.frame}")
        if item.command not in {*_PLACED, RETURN, SPEED}:
            sheet.add("unknown-command", item.place, f"expected the commands 16, 20, 21, 22 and 178, got {item.command}")
    if items and items[-1].command not in (RETURN, LAND):
        last = items[-1]
        sheet.add("no-return", last.place, f"expected a return (20) or a landing (21) at the end, got command {last.command}")


def check_take_off(sheet: Sheet, items: Sequence[Item]) -> None:
    """Note a take-off that is missing before the first waypoint, or that a rover has."""
    commands = [item.command for item in items if item.command in (TAKE_OFF, WAYPOINT)]
    if sheet.kind == "rover":
        if TAKE_OFF in commands:
            place = next(item.place for item in items if item.command == TAKE_OFF)
            sheet.add("take-off", place, "expected no take-off in a rover's mission, got command 22")
    elif WAYPOINT in commands and commands[0] != TAKE_OFF:
        place = next(item.place for item in items if item.command == WAYPOINT)
        sheet.add("take-off", place, "expected a take-off (22) before the first waypoint of a multirotor, got none")


def _number(*values: float | None) -> tuple[float, ...]:
    return tuple(math.nan if value is None else float(value) for value in values)
