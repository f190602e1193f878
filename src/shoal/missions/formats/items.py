"""Mission items (MAVLink commands) and their numbers, as all formats share them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from shoal.core.checks import check_json_memory
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.missions.diagnostics import Sheet, decimals_of
from shoal.missions.mission import CAPS, FASTEST, KINDS, SAME_LEVEL, Mission
from shoal.search.flight.flight import FRAMES
from shoal.search.flight.imaging import CameraItem
from shoal.search.regions.projection import DECIMALS

WAYPOINT, HOLD, RETURN, LAND, TAKE_OFF, SPLINE, DELAY, SPEED, GIMBAL, TRIGGER = (
    16,
    17,
    20,
    21,
    22,
    82,
    93,
    178,
    205,
    206,
)  # MAV_CMD
_WAITS = {
    DELAY: "a wait",
    HOLD: "an endless loiter",
    18: "loiter turns",
    19: "a loiter for a time",
    112: "a delay",
}  # MAV_CMD
WITHOUT_PLACE = 2  # MAV_FRAME: MISSION
_PASSED = (WAYPOINT, SPLINE)
_PLACED = {*_PASSED, HOLD, LAND, TAKE_OFF}
_KNOWN = {*_PLACED, RETURN, SPEED, GIMBAL, TRIGGER}
# relays and servos, marks for landings and jumps, settings of cameras, single images, videos,
# grippers: the vehicle goes on along its path, and its camera looks where it looked
_HARMLESS = {181, 182, 183, 184, 189, 200, 202, 203, 211, 530, 532, 600, 2000, 2001, 2500, 2501}
_WRITTEN = {"home": 3, "ground": 3, "sea": 0}  # MAV_FRAME: GLOBAL_RELATIVE_ALT and GLOBAL
# frames 6 and 5 equal 3 and 0 with integer coordinates
_READ = {3: "home", 6: "home", 0: "sea", 5: "sea"}
# MAV_FRAME: GLOBAL_TERRAIN_ALT, which ArduPilot reads and PX4 does not
_TERRAIN = {10: "ground", 11: "ground"}
_AIMING = {
    195: "a region of interest",
    196: "a region of interest",
    197: "the end of a region of interest",
    201: "a region of interest",
    531: "a zoom",
    534: "another camera",
    1000: "another pitch of the gimbal",
    2003: "a control of the trigger",
}  # MAV_CMD: after these, the check does not know whether a camera sees the ground

_BY_ANGLES = 2.0  # MAV_MOUNT_MODE_MAVLINK_TARGETING
_AIR, _GROUND = 0.0, 1.0  # SPEED_TYPE
_UNCHANGED, _USUAL = -1.0, -2.0  # values of a speed that are none
_STEEP = 15.0  # degrees: pitch of fixed wings during take-off
# of the first waypoint's height: there the take-off of a fixed wing ends, so that it goes on
# straight to the waypoint
_CLIMBED = 0.8
_SAME_PLACE = 1e-5  # degrees: about a metre

Params = tuple[float | None, ...]


@dataclass(frozen=True)
class Item:
    """A mission item with seven parameters. The last three parameters are latitude, longitude and
    altitude.

    A parameter that is None is unset.
    """

    command: int
    frame: int
    params: Params
    place: str = ""


def items_of(mission: Mission) -> list[Item]:
    """Return the mission items of a mission, without its home.

    The first item is the take-off, and no wait precedes it: PX4 (COM_DISARM_PRFLT) and ArduPilot
    (DISARM_DELAY) disarm a vehicle that stays on the ground for some seconds after arming. The item
    after the take-off sets the speed for the whole mission. The camera takes images from the first
    to the last waypoint of the search, also at all bends, and none on the ways out and home. The
    take-off of a fixed wing has the position of the first waypoint, because the vehicle climbs
    toward this waypoint.
    """
    frame, wing = _WRITTEN[mission.altitude_frame], mission.kind == "fixed-wing"
    above = mission.elevation or 0.0 if frame == 0 else 0.0  # altitude of home in this frame
    heights = mission.heights_above_home + above
    places = [
        (y, x, z) for (x, y), z in zip(mission.waypoints.tolist(), heights.tolist(), strict=True)
    ]
    rise = float(heights[0]) if mission.vertical_climb is None else mission.vertical_climb + above
    start = (0.0, 0.0, 0.0, mission.yaw, mission.home[1], mission.home[0], rise)
    if wing:
        start = (
            _STEEP,
            0.0,
            0.0,
            mission.yaw,
            *places[0][:2],
            above + round(_CLIMBED * (float(heights[0]) - above), 2),
        )
    reach = mission.acceptance_radius or 0.0
    points = [Item(WAYPOINT, frame, (0.0, reach, 0.0, mission.yaw, *place)) for place in places]

    def speed(value: float) -> Item:
        # the throttle stays unchanged
        return _placeless(SPEED, _AIR if wing else _GROUND, float(value), -1.0)

    items = [speed(mission.speed)]
    if mission.gimbal_pitch is not None:
        items.append(_placeless(GIMBAL, mission.gimbal_pitch, 0.0, 0.0, 0.0, 0.0, 0.0, _BY_ANGLES))
    # also images at once: the last image on a leg may be a whole distance before the leg's end
    for image in reversed(mission.camera_items):
        points.insert(image.after, _placeless(TRIGGER, image.value, 0.0, float(image.at_once)))
    take_off = [Item(TAKE_OFF, frame, start)] if mission.kind != "rover" else []
    if mission.speeds is not None:
        items[0], points = (
            speed(mission.speeds[0]),
            _with_speeds(points, [speed(value) for value in mission.speeds.tolist()]),
        )
    end = _placeless(RETURN)
    if mission.landing is not None:
        stays = mission.loiter is not None
        height = float(heights[-1]) if stays else above
        command = HOLD if stays or mission.kind == "rover" else LAND
        end = Item(
            command,
            frame,
            (0.0, 0.0, mission.loiter or 0.0, mission.yaw, *mission.landing[::-1], height),
        )
    return [*take_off, *items, *points, end]


def _with_speeds(points: Sequence[Item], speeds: Sequence[Item]) -> list[Item]:
    """Return items with the item of a new speed before each waypoint whose leg has another speed
    than the leg before.
    """
    items: list[Item] = []
    reached = 0
    for item in points:
        if item.command == WAYPOINT:
            items += [speeds[reached]] if reached and speeds[reached] != speeds[reached - 1] else []
            reached += 1
        items.append(item)
    return items + ([speeds[-1]] if speeds[-1] != speeds[-2] else [])


def _placeless(command: int, *params: float) -> Item:
    return Item(command, WITHOUT_PLACE, (*params, *(0.0,) * (7 - len(params))))


def read_items(sheet: Sheet, items: Sequence[Item]) -> None:
    """Read the content of mission items into a mission sheet, and add diagnostics."""
    sheet.n_items = len(items) + 1
    items = _with_take_off_place(sheet, items)
    waypoints = [item for item in items if item.command in _PASSED]
    sheet.points = np.array(
        [_number(item.params[5], item.params[4]) for item in waypoints], dtype=np.float64
    ).reshape(-1, 2)
    sheet.altitudes = [_number(item.params[6])[0] for item in waypoints]
    sheet.places = [item.place for item in waypoints]
    if waypoints:
        first = waypoints[0]
        sheet.altitude_frame = _frames(sheet).get(first.frame)
        if first.command == WAYPOINT:
            sheet.acceptance_radius = first.params[1] or None
        sheet.acceptance_radii = [_number(item.params[1])[0] for item in waypoints]
        sheet.headings = [
            None if item.params[3] is None or not math.isfinite(item.params[3]) else item.params[3]
            for item in waypoints
        ]
        sheet.yaw = sheet.headings[0] if first.command == WAYPOINT else None
        if sheet.altitude_frame == "ground":
            message = (
                "expected altitudes above home or sea level, got altitudes above the terrain"
                f" (frame {first.frame})"
            )
            sheet.add(
                "terrain-frame",
                first.place,
                f"{message}: the check compares no heights of this mission with other vehicles",
            )
        ups = [_number(item.params[6])[0] for item in items if item.command == TAKE_OFF]
        if ups and ups[0] > 0 and abs(ups[0] - sheet.altitudes[0]) > SAME_LEVEL:
            sheet.take_off = ups[0]
    if waypoints and items[-1].command in (HOLD, LAND):
        _read_end(sheet, items[-1], waypoints[-1])
    _read_speeds(sheet, items)
    for command, name, parameter in (
        (GIMBAL, "gimbal_pitch", 0),
        (TRIGGER, "trigger_distance", 0),
    ):
        value = next(
            (_number(item.params[parameter])[0] for item in items if item.command == command), None
        )
        if value is not None:
            setattr(sheet, name, value)
    numbers = np.cumsum([item.command in _PASSED for item in items])
    images = [
        (int(number), _number(item.params[0])[0] > 0)
        for item, number in zip(items, numbers, strict=True)
        if item.command == TRIGGER
    ]
    # an end before a beginning at the same waypoint only begins to measure the distance anew
    images = [
        one
        for number, one in enumerate(images)
        if one[1] or images[number + 1 : number + 2] != [(one[0], True)]
    ]
    begun = [begins for _, begins in images]
    if begun == [True] * (len(begun) - 1) + [False] and len(begun) > 1 and images[0][0] > 0:
        sheet.waypoints_out, sheet.waypoints_home = images[0][0] - 1, len(waypoints) - images[-1][0]
    sheet.camera_items = [
        CameraItem(
            int(number),
            item.command,
            _number(item.params[0])[0],
            at_once=_number(item.params[2])[0] > 0,
            place=item.place,
        )
        for item, number in zip(items, numbers, strict=True)
        if item.command in (GIMBAL, TRIGGER, *_AIMING)
    ]
    aloft = next(
        (k for k, item in enumerate(items) if item.command in (TAKE_OFF, *_PASSED)), len(items)
    )
    for number, item in enumerate(items):
        _check_frame(sheet, item)
        if item.command in _PASSED and item.params[0]:
            sheet.add("stay", item.place, f"expected no stay on the way, got {_stay(item)}")
        if item.command in _WAITS and number < aloft < len(items):
            sheet.add(
                "armed-wait",
                item.place,
                f"expected no wait before the take-off, but a start at its time, got {_stay(item)}",
            )
        elif item.command == SPLINE:
            sheet.add(
                "spline",
                item.place,
                "expected a waypoint (16), got a spline waypoint (82): the check uses straight"
                " legs",
            )
        elif item.command in _WAITS and item is not items[-1]:
            sheet.add("stay", item.place, f"expected no stay on the way, got {_stay(item)}")
        elif item.command not in _KNOWN | _WAITS.keys():
            commands = ", ".join(map(str, sorted(_KNOWN - {SPLINE})))
            about = f" ({_AIMING[item.command]})" if item.command in _AIMING else ""
            sheet.add(
                "unknown-command" if item.command in _HARMLESS else "unchecked-command",
                item.place,
                f"expected one of the commands {commands}, got {item.command}{about}",
            )
    _check_order(sheet, items)
    _check_camera(sheet, items)
    if items and items[-1].command not in (RETURN, LAND, HOLD):
        last = items[-1]
        sheet.add(
            "no-return",
            last.place,
            f"expected a return (20) or a landing (21) at the end, got command {last.command}",
        )


def _read_end(sheet: Sheet, end: Item, last: Item) -> None:
    """Read the landing or the hold at the end of a mission, after its last waypoint."""
    # without a place, the vehicle lands or stays where it is; PX4 takes zeros for a place
    zeros = end.params[4:6] == (0.0, 0.0)
    here = any(map(math.isnan, _number(*end.params[4:6]))) or (zeros and sheet.autopilot != "px4")
    latitude, longitude, height = _number(*(last if here else end).params[4:6], end.params[6])
    sheet.landing = (longitude, latitude)
    if end.command != HOLD or not any(altitude > 0 for altitude in sheet.altitudes):
        return
    sheet.loiter = abs(_number(end.params[2])[0])
    if not here and not abs(height - sheet.altitudes[-1]) <= SAME_LEVEL:
        sheet.add(
            "altitude",
            end.place,
            f"expected a hold at {sheet.altitudes[-1]:g} m, the height of the last waypoint, got"
            f" one at {height:g} m",
        )


def _with_take_off_place(sheet: Sheet, items: Sequence[Item]) -> Sequence[Item]:
    """Return items with a waypoint at the place of the first take-off, if the vehicle flies there on
    its way to its first waypoint.

    PX4 flies to the place of a take-off. ArduPilot takes off where the vehicle stands.
    """
    number = next((k for k, item in enumerate(items) if item.command in (TAKE_OFF, *_PASSED)), None)
    if sheet.autopilot == "ardupilot" or number is None or items[number].command != TAKE_OFF:
        return items
    take_off, after = items[number], [item for item in items[number:] if item.command in _PASSED]
    latitude, longitude = _number(*take_off.params[4:6])
    if not after or not math.isfinite(latitude + longitude) or not (latitude or longitude):
        return items
    following = after[0]
    for y, x in (_number(*following.params[4:6]), (sheet.home or (math.nan, math.nan))[::-1]):
        if abs(latitude - y) < _SAME_PLACE and abs(longitude - x) < _SAME_PLACE:
            return items
    frames = _frames(sheet)
    (height,) = _number(take_off.params[6])
    if frames.get(take_off.frame) != frames.get(following.frame) or not height > 0:
        height = _number(following.params[6])[0]
    params = (0.0, following.params[1], 0.0, following.params[3], latitude, longitude, height)
    place = Item(WAYPOINT, following.frame, params, take_off.place)
    return [*items[: number + 1], place, *items[number + 1 :]]


def _check_order(sheet: Sheet, items: Sequence[Item]) -> None:
    """Add diagnostics for a mission that ends before its last waypoint, or takes off again."""
    passed = [number for number, item in enumerate(items) if item.command in _PASSED]
    if not passed:
        return
    for item in items[: passed[-1]]:
        if item.command in (RETURN, LAND):
            what = "return" if item.command == RETURN else "landing"
            sheet.add(
                "ends-early",
                item.place,
                f"expected a {what} ({item.command}) only after the last waypoint, got one before",
            )
    for item in items[passed[0] :]:
        if item.command == TAKE_OFF:
            sheet.add(
                "take-off",
                item.place,
                "expected a take-off (22) only before the first waypoint, got one after it",
            )


def _stay(item: Item) -> str:
    """Return a text about an item at which a vehicle stays."""
    (lasting,) = _number(item.params[0])
    text = f"{_WAITS.get(item.command, 'a holding time')} ({item.command})"
    return text + (f" of {lasting:g} s" if item.command not in (HOLD, 18) else "")


def _read_speeds(sheet: Sheet, items: Sequence[Item]) -> None:
    """Read the speed on each leg into a mission sheet, and add diagnostics for impossible speeds
    after the first one.
    """
    usual = now = sheet.speed
    speeds: list[float | None] = []
    first: float | None = None
    for item in items:
        if item.command in _PASSED:
            speeds.append(now)
        if item.command != SPEED or item.params[0] not in (_AIR, _GROUND, None):
            continue  # the others are speeds of climbs and descents
        (value,) = _number(item.params[1])
        if value in (_UNCHANGED, _USUAL) and (now is not None or usual is not None):
            now = usual if value == _USUAL else now
        elif first is None:
            first = now = value
        elif not math.isfinite(value):
            sheet.add("not-a-number", item.place, f"expected a finite speed, got {value}")
        elif not 0 < value <= FASTEST:
            sheet.add(
                "speed",
                item.place,
                f"expected a speed above 0 and at most {FASTEST:g} m/s, got {value:g}",
            )
        else:
            now = value
    speeds.append(now)
    if first is not None:
        sheet.speed = first
    leg_speeds = [sheet.speed if speed is None else speed for speed in speeds]
    stated_speeds = [speed for speed in leg_speeds if speed is not None]
    sheet.speeds = (
        stated_speeds
        if len(stated_speeds) == len(speeds)
        and len({*stated_speeds}) > 1
        and min(stated_speeds) > 0
        else None
    )


def _check_frame(sheet: Sheet, item: Item) -> None:
    """Add a diagnostic if a position has the wrong altitude reference, or if an item without a
    position has a positional frame.
    """
    if item.command in _PLACED:
        reference = sheet.altitude_frame or "home"
        if (reference, item.command) == ("ground", TAKE_OFF) and item.frame in _READ:
            return  # the climb begins at home, whose height above the terrain is 0
        if _frames(sheet).get(item.frame) != reference:
            of_home, of_sea = "3 (altitude above home)", "0 (above sea level)"
            of_ground = "10 (above the terrain)"
            either = f"{of_home} or {of_sea}"
            expected = {"sea": of_sea, "ground": of_ground}.get(
                reference, of_home if sheet.altitude_frame else either
            )
            sheet.add(
                "frame", item.place, f"expected frame {expected} for a position, got {item.frame}"
            )
    elif item.command in _KNOWN and item.frame != WITHOUT_PLACE:
        sheet.add(
            "frame",
            item.place,
            f"expected frame {WITHOUT_PLACE} for command {item.command}, got {item.frame}",
        )


def _frames(sheet: Sheet) -> dict[int, str]:
    """Return the altitude references by frame number that the autopilot of a mission reads. Without
    an autopilot, all count.
    """
    return _READ if sheet.autopilot == "px4" else _READ | _TERRAIN


def _check_camera(sheet: Sheet, items: Sequence[Item]) -> None:
    """Add a diagnostic for an invalid pitch of the gimbal, or for a camera that never stops taking
    images.
    """
    for item in items:
        pitch, mode = _number(item.params[0], item.params[6])
        if item.command == GIMBAL and not (abs(pitch) <= 90 and mode == _BY_ANGLES):
            sheet.add(
                "gimbal",
                item.place,
                f"expected a pitch within ±90 and mode 2 (by angles), got {pitch:g} and {mode:g}",
            )
    triggers = [item for item in items if item.command == TRIGGER]
    begun = False
    for item in triggers:
        (distance,) = _number(item.params[0])
        if not (distance > 0 or begun):
            sheet.add(
                "camera",
                item.place,
                f"expected a distance between images above 0, got {distance:g}",
            )
        begun = distance > 0
    if begun:
        sheet.add(
            "camera",
            triggers[-1].place,
            "expected the end of images, a distance of 0, after it, got none",
        )


def kind_of(sheet: Sheet, items: Sequence[Item]) -> str:
    """Return the kind of vehicle that mission items imply, for a file that does not state the kind
    of vehicle.
    """
    if not any(altitude > 0 for altitude in sheet.altitudes) and not any(
        item.command == TAKE_OFF for item in items
    ):
        return "rover"
    through_air = any(item.command == SPEED and item.params[0] == _AIR for item in items)
    return "fixed-wing" if through_air else "multirotor"


def check_take_off(sheet: Sheet, items: Sequence[Item]) -> None:
    """Add a diagnostic if a flight has no take-off before the first waypoint, or if a rover has a
    take-off or a landing.
    """
    commands = [
        WAYPOINT if item.command in _PASSED else TAKE_OFF
        for item in items
        if item.command in (TAKE_OFF, *_PASSED)
    ]
    if sheet.kind == "rover":
        if TAKE_OFF in commands:
            place = next(item.place for item in items if item.command == TAKE_OFF)
            sheet.add(
                "take-off", place, "expected no take-off in a rover's mission, got command 22"
            )
        for item in items:
            if item.command == LAND:  # ArduPilot's rovers do not drive there
                sheet.add(
                    "unchecked-command",
                    item.place,
                    "expected a hold (17) or a return (20) at the end of a rover's mission, got a"
                    " landing (21)",
                )
        return
    first = next((item for item in items if item.command == TAKE_OFF), None)
    if first is not None and sheet.altitudes:
        base = sheet.elevation or 0.0 if _frames(sheet).get(first.frame) == "sea" else 0.0
        above = sheet.altitudes[0] - (
            sheet.elevation or 0.0 if sheet.altitude_frame == "sea" else 0.0
        )
        (up,) = _number(first.params[6])
        if not math.isfinite(up):
            sheet.add(
                "not-a-number", first.place, f"expected a take-off to a finite altitude, got {up}"
            )
        elif up <= base < base + above:
            message = (
                f"expected a take-off to a height above 0, got {up - base:g} m above home before a"
                f" waypoint at {above:g} m"
            )
            sheet.add("take-off", first.place, message)
    if WAYPOINT in commands and commands[0] != TAKE_OFF:
        place = next(item.place for item in items if item.command in _PASSED)
        message = (
            f"expected a take-off (22) before the first waypoint of a {sheet.kind or 'multirotor'},"
            " got none"
        )
        sheet.add("take-off", place, message)


def _number(*values: float | None) -> tuple[float, ...]:
    return tuple(math.nan if value is None else float(value) for value in values)


_MOST_VALUES = 2_000_000


def degrees(value: float) -> str:
    """Return a coordinate in degrees as text.

    Examples
    --------
    >>> degrees(8.5), degrees(-0.000000001)
    ('8.50000000', '0.00000000')
    """
    text = f"{value:.{DECIMALS}f}"
    return text.lstrip("-") if float(text) == 0 else text


def plain(value: float) -> str:
    """Return a number as a short, exact text without an exponent.

    Examples
    --------
    >>> plain(30.0), plain(2.5), plain(1e-7)
    ('30', '2.5', '0.0000001')
    """
    if value == int(value) and abs(value) < 1e15:
        return str(int(value))
    return np.format_float_positional(value, trim="-")


class Number(float):
    """A number from a JSON file, with the number of decimals that it had in the file."""

    decimals = 0

    def __new__(cls, text: str) -> Number:
        """Return the number that a text represents."""
        number = super().__new__(cls, text)
        number.decimals = decimals_of(text)
        return number


def load_json(text: str, sheet: Sheet) -> Any:
    """Parse the JSON text of a mission file. Numbers with decimals become `Number`. An invalid text
    makes the sheet unreadable.
    """

    def constant(name: str) -> float:  # Python reads NaN and infinities, which JSON does not have
        sheet.not_json.append(name)
        return float(name)

    if (values := text.count(",")) > _MOST_VALUES:  # each `Number` needs about 150 bytes
        sheet.add("unreadable", "", f"expected at most {_MOST_VALUES} values, got {values}")
        return None
    try:
        check_json_memory(text, where="")
        return json.loads(text, parse_float=Number, parse_constant=constant)
    except InvalidInputError as error:
        sheet.add("unreadable", "", str(error).removeprefix(": "))
    except json.JSONDecodeError as error:
        sheet.add(
            "unreadable",
            f"line {error.lineno}",
            f"expected JSON, got something else: {error.msg.lower()}",
        )
    except (RecursionError, ValueError):
        sheet.add(
            "unreadable",
            "",
            "expected JSON, got values nested too deeply or a number of too many digits",
        )
    return None


def dump_json(value: Any) -> str:
    """Return a JSON text, in which the strings from the function `raw` appear as numbers.

    Examples
    --------
    >>> dump_json([raw("8.50000000"), 1.5])
    '[8.50000000, 1.5]'
    """
    text = json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False)
    text = re.sub(r'"\\u001f([-\d.]+)"', r"\1", text)
    return re.sub(
        r"\[\s+([^\[\]{}]*?)\s+\]", lambda match: "[" + re.sub(r",\s+", ", ", match[1]) + "]", text
    )


def raw(number: str) -> str:
    """Mark the text of a number, so that `dump_json` writes this text unchanged as a number."""
    return f"\x1f{number}"


NAMES = ("robot", "sortie", "autopilot", "kind", "altitude_m", "altitude_frame", "speed_m_s")

MORE = (
    "start_s",
    "landing_x",
    "landing_y",
    "loiter_m",
    "takeover_m",
    "waypoints_out",
    "waypoints_home",
)
"""Names of the optional attributes of a mission, such as its start time and its landing point."""

ALTITUDES = "altitudes_m"
"""Name of the attribute for the altitudes of all waypoints, if they differ, as numbers separated by
spaces.
"""


def attributes_of(mission: Mission) -> dict[str, str | int | float]:
    """Return the attributes of a mission by name: all in `NAMES`, and those in `MORE` and
    `ALTITUDES` that the mission has.

    Raises
    ------
    InvalidInputError
        If the mission has several speeds, which only mission items can express.
    """
    if mission.speeds is not None:
        raise InvalidInputError(
            f"{mission.name}: expected one speed in the formats geojson, kml, gpx and csv, got"
            f" {len({*mission.speeds.tolist()})} speeds; the formats plan and wpl have them"
        )
    named = {name: getattr(mission, name.removesuffix("_m_s").removesuffix("_m")) for name in NAMES}
    more: list[float | None] = [
        mission.start,
        *(mission.landing or (None, None)),
        mission.loiter,
        mission.takeover,
        mission.waypoints_out,
        mission.waypoints_home,
    ]
    named |= {name: value for name, value in zip(MORE, more, strict=True) if value is not None}
    levels = mission.levels
    return named | (
        {ALTITUDES: " ".join(f"{level:.10g}" for level in levels.tolist())}
        if np.ptp(levels) > SAME_LEVEL
        else {}
    )


def attributes_as_text(mission: Mission) -> dict[str, str]:
    """Return the attributes of a mission as texts, for file formats without numbers."""
    return {
        name: value if isinstance(value, str) else plain(value)
        for name, value in attributes_of(mission).items()
    }


def take_attributes(sheet: Sheet, place: str, attributes: Mapping[str, Any]) -> None:
    """Store the attributes of a mission file in its sheet, and add diagnostics for invalid
    attributes.
    """
    missing = [name for name in NAMES if name not in attributes]
    for name in missing:
        sheet.add("missing-key", place, f"expected {name!r}, got none")
    if missing:
        return
    for name, least in (("robot", 1), ("sortie", 1), ("waypoints_out", 0), ("waypoints_home", 0)):
        if name not in attributes:
            continue
        number = _whole(attributes[name])
        if number is None or number < least:
            sheet.add(
                "wrong-value",
                place,
                f"expected a whole number of {least} or more as {name!r}, got"
                f" {_short(attributes[name])}",
            )
        else:
            setattr(sheet, name, number)
    for name, choices in (("autopilot", CAPS), ("kind", KINDS), ("altitude_frame", FRAMES)):
        if isinstance(attributes[name], str) and attributes[name] in choices:
            setattr(sheet, name, attributes[name])
        else:
            sheet.add(
                "wrong-value",
                place,
                f"expected {' or '.join(map(repr, choices))} as {name!r}, got"
                f" {_short(attributes[name])}",
            )
    more = {name: attributes[name] for name in MORE if name in attributes}
    if "landing_x" in more and "landing_y" in more:
        sheet.landing = (
            number_in(sheet, place, "landing_x", more),
            number_in(sheet, place, "landing_y", more),
        )
    for name in ("loiter_m", "start_s", "takeover_m"):
        if name in more:
            setattr(sheet, name.rpartition("_")[0], number_in(sheet, place, name, more))
    words = str(attributes.get(ALTITUDES, "")).split()
    sheet.altitudes = [number_in(sheet, place, ALTITUDES, {ALTITUDES: word}) for word in words] or [
        number_in(sheet, place, "altitude_m", attributes)
    ]
    sheet.speed = number_in(sheet, place, "speed_m_s", attributes)


def position_in(
    sheet: Sheet, place: str, names: Sequence[str], attributes: Mapping[str, str]
) -> tuple[float, float]:
    """Return the two coordinates ``names`` as numbers, and note their decimals. If one is missing or
    invalid, return NaN for both and add a diagnostic.
    """
    point = []
    for name in names:
        if name not in attributes:
            sheet.add("missing-key", place, f"expected the attribute {name!r}, got none")
            return math.nan, math.nan
        try:
            point.append(float(attributes[name]))
        except ValueError:
            sheet.add(
                "wrong-value",
                place,
                f"expected a number as {name!r}, got {attributes[name][:40]!r}",
            )
            return math.nan, math.nan
        sheet.decimals = max(sheet.decimals or 0, decimals_of(attributes[name]))
    return point[0], point[1]


def spread_altitudes(sheet: Sheet, place: str) -> None:
    """Give each waypoint of a sheet an altitude: its own altitude, or the common altitude of the
    mission.
    """
    count = len(sheet.points)
    if len(sheet.altitudes) > 1 and len(sheet.altitudes) != count:
        sheet.add(
            "wrong-value",
            place,
            f"expected {count} numbers as {ALTITUDES!r}, one per waypoint, got"
            f" {len(sheet.altitudes)}",
        )
        sheet.altitudes = sheet.altitudes[:1]
    if len(sheet.altitudes) == 1:
        sheet.altitudes *= count


def _whole(value: Any) -> int | None:
    if isinstance(value, bool):
        return None
    try:
        return int(str(value))
    except ValueError:
        return None


def number_in(sheet: Sheet, place: str, name: str, attributes: Mapping[str, Any]) -> float:
    """Return the attribute ``name`` as a number. If the attribute is invalid, return NaN and add a
    diagnostic.
    """
    value = attributes[name]
    if not isinstance(value, bool):
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            pass
        else:
            if name in MORE and not math.isfinite(number):
                sheet.add(
                    "not-a-number", place, f"expected a finite number as {name!r}, got {number}"
                )
                return math.nan
            return number
    sheet.add("wrong-value", place, f"expected a number as {name!r}, got {_short(value)}")
    return math.nan


def _short(value: Any) -> str:
    return repr(value)[:60]
