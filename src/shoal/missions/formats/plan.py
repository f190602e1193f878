"""Missions as `.plan` files of QGroundControl: JSON with latitude before longitude."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from shoal.core.checks import shortened
from shoal.missions.diagnostics import Sheet
from shoal.missions.fence import circle_ring
from shoal.missions.formats.fences import (
    fence_from,
    fence_items,
    plan_fence,
    plan_rally,
    rally_items,
)
from shoal.missions.formats.items import (
    Item,
    Number,
    check_take_off,
    degrees,
    dump_json,
    items_of,
    load_json,
    raw,
    read_items,
)
from shoal.missions.mission import Mission

_FIRMWARE = {"px4": 12, "ardupilot": 3}  # MAV_AUTOPILOT
_VEHICLES = {"multirotor": 2, "fixed-wing": 1, "rover": 10}  # MAV_TYPE
_MULTIROTORS = dict.fromkeys((2, 13, 14, 15), "multirotor")  # with 4, 6, 8 and 3 rotors
_KINDS = {number: kind for kind, number in _VEHICLES.items()} | _MULTIROTORS
# terrain-following missions are written with heights above home
_ALTITUDE_MODES = {"home": 1, "ground": 1, "sea": 2}


def write(mission: Mission) -> str:
    """Return a mission as the text of a `.plan` file."""
    longitude, latitude = mission.home
    items = [_item(item, number) for number, item in enumerate(items_of(mission), start=1)]
    return (
        dump_json(
            {
                "fileType": "Plan",
                "version": 1,
                "groundStation": "QGroundControl",
                "mission": {
                    "version": 2,
                    "firmwareType": _FIRMWARE[mission.autopilot],
                    "vehicleType": _VEHICLES[mission.kind],
                    "cruiseSpeed": mission.speed,
                    "hoverSpeed": mission.speed,
                    "globalPlanAltitudeMode": _ALTITUDE_MODES[mission.altitude_frame],
                    "plannedHomePosition": [
                        raw(degrees(latitude)),
                        raw(degrees(longitude)),
                        mission.elevation or 0,
                    ],
                    "items": items,
                },
                "geoFence": plan_fence(mission.fence),
                "rallyPoints": plan_rally(mission.rally),
            }
        )
        + "\n"
    )


def _item(item: Item, number: int) -> dict[str, Any]:
    params: list[Any] = list(item.params)
    if params[4] or params[5]:
        params[4:6] = [raw(degrees(value)) for value in params[4:6]]
    return {
        "type": "SimpleItem",
        "command": item.command,
        "frame": item.frame,
        "params": params,
        "autoContinue": True,
        "doJumpId": number,
    }


def scan(text: str, sheet: Sheet) -> None:
    """Read the content of a `.plan` file into a mission sheet."""
    from pydantic import ValidationError  # slow to import, and only files that are read need it

    from shoal.missions.formats.plan_form import PlanForm

    data = load_json(text, sheet)
    if sheet.readable and not isinstance(data, dict):
        sheet.add("unreadable", "", f"expected a JSON object, got {shortened(data)}")
    if not sheet.readable:
        return
    places = _expand_surveys(data)
    try:
        form = PlanForm.model_validate(data)
    except ValidationError as error:
        faults = error.errors()
        of_type = {fault["loc"][:-1] for fault in faults if fault["loc"][-1] == "type"}
        for fault in faults:
            if fault["loc"][-1] == "type" or not of_type & {
                fault["loc"][: k + 1] for k in range(len(fault["loc"]))
            }:
                _note(sheet, fault, places)  # of an item of another type, only its type is wrong
        return
    mission = form.mission
    sheet.autopilot = {number: name for name, number in _FIRMWARE.items()}.get(
        mission.firmware_type
    )
    sheet.kind = _KINDS.get(mission.vehicle_type)
    if sheet.autopilot is None:
        sheet.add(
            "firmware",
            "mission",
            f"expected firmwareType 12 (PX4) or 3 (ArduPilot), got {mission.firmware_type}",
        )
    if sheet.kind is None:
        kinds = "1 (fixed-wing), 2 (multirotor) or 10 (rover)"
        sheet.add(
            "wrong-value", "mission", f"expected vehicleType {kinds}, got {mission.vehicle_type}"
        )
    sheet.speed = mission.hover_speed if sheet.kind == "multirotor" else mission.cruise_speed
    latitude, longitude = (float("nan") if value is None else value for value in mission.home[:2])
    sheet.home = (longitude, latitude)
    sheet.elevation = mission.home[2] or None  # 0 means unknown
    sheet.decimals = _decimals(data)
    rings = [(np.array(entry.polygon)[:, ::-1], entry.inclusion) for entry in form.fence.polygons]
    for entry in form.fence.circles:
        center = (entry.circle.center[1], entry.circle.center[0])
        rings.append(
            (circle_ring(center, entry.circle.radius, inclusion=entry.inclusion), entry.inclusion)
        )
    if rings:
        sheet.fence = fence_from(
            [ring for ring, inclusion in rings if inclusion],
            [ring for ring, inclusion in rings if not inclusion],
        )
    sheet.rally = tuple((longitude, latitude, up) for latitude, longitude, up in form.rally.points)
    items = [
        Item(item.command, item.frame, tuple(item.params), place)
        for place, item in zip(places, mission.items, strict=True)
    ]
    read_items(sheet, items)
    check_take_off(sheet, items)
    for number, item in enumerate(mission.items, start=1):
        if item.do_jump_id != number:
            sheet.add(
                "do-jump-id",
                places[number - 1],
                f"expected doJumpId {number}, got {item.do_jump_id}",
            )
        if not item.auto_continue:
            sheet.add(
                "autocontinue",
                places[number - 1],
                "expected autoContinue true, got false: the vehicle stops here",
            )


def items_on_board(text: str) -> tuple[list[Item], list[Item], list[Item]]:
    """Return the items of the mission, the fence and the rally points of a `.plan` file that `scan`
    has read without fatal diagnostics.
    """
    from shoal.missions.formats.plan_form import PlanForm

    data = json.loads(text)
    _expand_surveys(data)
    form = PlanForm.model_validate(data)
    mission = [Item(item.command, item.frame, tuple(item.params)) for item in form.mission.items]
    rings = [(entry.polygon, entry.inclusion) for entry in form.fence.polygons]
    circles = [(entry.circle, entry.inclusion) for entry in form.fence.circles]
    rally = [(place[:2], place[2]) for place in form.rally.points]
    return mission, fence_items(rings, circles), rally_items(rally)


def _expand_surveys(data: Any) -> list[str]:
    """Replace the survey items of QGroundControl by the simple items that they contain, and return
    the place of each item.
    """
    mission = data.get("mission") if isinstance(data, dict) else None
    items = mission.get("items") if isinstance(mission, dict) else None
    if not isinstance(mission, dict) or not isinstance(items, list):
        return []
    expanded: list[tuple[str, Any]] = []
    for number, item in enumerate(items, start=1):
        survey = (
            item.get("TransectStyleComplexItem")
            if isinstance(item, dict) and item.get("type") == "ComplexItem"
            else None
        )
        parts = survey.get("Items") if isinstance(survey, dict) else None
        if isinstance(parts, list) and parts:
            expanded += [
                (f"item {number}, part {part}", child) for part, child in enumerate(parts, start=1)
            ]
        else:
            expanded.append((f"item {number}", item))
    mission["items"] = [item for _, item in expanded]
    return [place for place, _ in expanded]


def _note(sheet: Sheet, fault: Any, places: list[str]) -> None:
    """Convert an error of the library Pydantic to a diagnostic, and add it to a sheet."""
    place = ", ".join(
        places[int(part)] if before == "items" else str(part)
        for before, part in _path(fault["loc"])
    )
    kind, got = fault["type"], repr(fault["input"])[:60]
    if kind == "missing":
        where, _, key = place.rpartition(", ")
        sheet.add("missing-key", where, f"expected the key {key!r}, got none")
    elif kind in ("too_short", "too_long") and fault["loc"][-1] == "params":
        sheet.add("params-count", place, f"expected 7 params, got {len(fault['input'])}")
    else:
        expected = fault["msg"].removeprefix("Input should be ")
        expected = expected[:1].lower() + expected[1:]
        sheet.add("wrong-value", place, f"expected {expected}, got {got}")


def _path(location: tuple[int | str, ...]) -> list[tuple[int | str, Any]]:
    """Return the keys and indices that lead to a place in a JSON file, as pairs (previous key,
    key).

    The result leaves out the list name "items" and the type name "float".
    """
    steps = [(location[k - 1] if k else "", part) for k, part in enumerate(location)]
    return [(before, part) for before, part in steps if part not in ("items", "float")]


def _decimals(data: dict[str, Any]) -> int:
    values = [value for item in data["mission"]["items"] for value in item["params"][4:6]] + data[
        "mission"
    ]["plannedHomePosition"][:2]
    return max((value.decimals for value in values if isinstance(value, Number)), default=0)
