"""Upload a mission, its fence and its rally points to an autopilot.

Run: python examples/upload_mission.py udpin:0.0.0.0:14550 FILE.plan The script needs pymavlink
(`pip install pymavlink`), but no part of Shoal. A mission for ArduPilot has home as item 0, and a
mission for PX4 has no home item.
"""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path
from typing import Any

os.environ["MAVLINK20"] = "1"  # fences and rally points need MAVLink 2

WAYPOINT, INSIDE, OUTSIDE, RALLY = 16, 5001, 5002, 5100
GLOBAL, ABOVE_HOME = 0, 3
MISSION_KINDS = {"mission": 0, "fence": 1, "rally": 2}
ARDUPILOT = 3

Item = tuple[int, int, list[float]]
"""A frame, a command, and seven parameters; the last three are latitude, longitude and altitude."""


def items_of(plan: dict[str, Any], *, with_home: bool) -> dict[str, list[Item]]:
    """Return the items of the mission, of the fence and of the rally points of a plan."""
    mission = [
        (
            item["frame"],
            item["command"],
            [math.nan if value is None else float(value) for value in item["params"]],
        )
        for item in plan["mission"]["items"]
    ]
    if with_home:
        mission.insert(
            0, (GLOBAL, WAYPOINT, [0.0, 0.0, 0.0, 0.0, *plan["mission"]["plannedHomePosition"]])
        )
    fence = [
        (
            GLOBAL,
            INSIDE if polygon["inclusion"] else OUTSIDE,
            [float(len(polygon["polygon"])), 0.0, 0.0, 0.0, *corner, 0.0],
        )
        for polygon in plan["geoFence"]["polygons"]
        for corner in polygon["polygon"]
    ]
    rally = [
        (ABOVE_HOME, RALLY, [0.0, 0.0, 0.0, 0.0, *point]) for point in plan["rallyPoints"]["points"]
    ]
    return {"mission": mission, "fence": fence, "rally": rally}


def upload(link: Any, items: list[Item], kind: int) -> None:
    """Send the items that the autopilot requests."""
    system, component = link.target_system, link.target_component
    link.mav.mission_count_send(system, component, len(items), kind)
    while True:
        asked = link.recv_match(
            type=["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"],
            blocking=True,
            timeout=10,
        )
        if asked is None:
            raise SystemExit("the autopilot does not answer")
        if asked.mission_type != kind:
            continue
        if asked.get_type() == "MISSION_ACK":
            if asked.type != 0:
                raise SystemExit(
                    f"the autopilot refused the items: MAV_MISSION_RESULT {asked.type}"
                )
            return
        frame, command, (*first, latitude, longitude, altitude) = items[asked.seq]
        place = (0, 0) if math.isnan(latitude) else (round(latitude * 1e7), round(longitude * 1e7))
        current = int(asked.seq == 0 and kind == 0)
        link.mav.mission_item_int_send(
            system, component, asked.seq, frame, command, current, 1, *first, *place, altitude, kind
        )


def main() -> None:
    """Connect to the autopilot, wait for it, and upload a file."""
    from pymavlink import mavutil

    address, file = sys.argv[1:]
    plan = json.loads(Path(file).read_text(encoding="utf-8"))
    link = mavutil.mavlink_connection(address)
    heartbeat = link.wait_heartbeat(timeout=30)
    if heartbeat is None:
        raise SystemExit(f"no autopilot at {address}")
    for name, items in items_of(plan, with_home=heartbeat.autopilot == ARDUPILOT).items():
        upload(link, items, MISSION_KINDS[name])
        print(f"{name}: {len(items)} items")


if __name__ == "__main__":
    main()
