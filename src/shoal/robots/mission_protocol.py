"""The mission protocol of MAVLink: upload, download and clear the mission, the fence or the rally
points of a vehicle over a link that loses, delays and doubles messages.

The vehicle asks for each item of an upload, and we ask for each item of a download; whoever asks
repeats. Nothing here judges whether an upload has worked by its acknowledgement, which may be
late, lost, or that of an earlier upload: `compare_items` judges what a download returns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.missions.formats.items import (
    GIMBAL,
    HOLD,
    LAND,
    RETURN,
    SPEED,
    TAKE_OFF,
    TRIGGER,
    WAYPOINT,
    Item,
)
from shoal.robots.mavlink import ARDUPILOT, HeardVehicle, LinkError, Station

MISSION, FENCE, RALLY = "mission", "fence", "rally"
MISSION_TYPES = {MISSION: 0, FENCE: 1, RALLY: 2}
"""MAV_MISSION_TYPE of what a vehicle stores."""

FENCE_CORNERS, FENCE_CIRCLES, RALLY_POINT = (5001, 5002), (5003, 5004), 5100  # MAV_CMD
_GLOBAL_FRAMES = (0, 3, 5, 6, 10, 11)  # MAV_FRAME with latitude and longitude
_ALIKE = {5: 0, 6: 3, 11: 10}  # MAV_FRAME: the same frames with integer coordinates
UNSET = 2**31 - 1  # of a coordinate without a value

RESULTS = {
    1: "an error",
    2: "unsupported frame",
    3: "unsupported",
    4: "no space",
    5: "invalid",
    **{6 + number: f"invalid parameter {number + 1}" for number in range(7)},
    13: "invalid sequence",
    14: "denied",
    15: "cancelled",
}
"""MAV_MISSION_RESULT."""
_ACCEPTED, _UNSUPPORTED, _OUT_OF_ORDER, _CANCELLED = 0, 3, 13, 15
_PASSING = {1, 13, 14, 15}  # refusals of a vehicle that is busy with an earlier transfer
_RESTARTED = 6  # repeats without an answer after which an upload begins anew
_PLAIN_AFTER = 4  # repeats of the first item after which a vehicle may know float items only
_SHORTEST, _LONGEST = 0.1, 1.5  # seconds between two repeats
_MOST = 65535  # items that a count can say


class MissionItem(NamedTuple):
    """An item as it is on the air: latitude and longitude in 1e-7 degrees.

    ``exact`` is false if a vehicle told it in a message with coordinates as float32.
    """

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1
    exact: bool = True


class RefusedError(LinkError):
    """Raised if a vehicle refuses items.

    Attributes
    ----------
    unsupported : bool
        Whether the vehicle says that it has no such items at all.
    """

    def __init__(self, text: str, *, unsupported: bool = False) -> None:
        super().__init__(text)
        self.unsupported = unsupported


class UnansweredError(LinkError):
    """Raised if a vehicle does not answer.

    Attributes
    ----------
    silent : bool
        Whether nothing at all is heard of the vehicle.
    """

    def __init__(self, text: str, *, silent: bool) -> None:
        super().__init__(text)
        self.silent = silent


def item_on_air(item: Item) -> MissionItem:
    """Return a mission item as it is sent. An unset parameter is NaN, an unset position `UNSET`."""
    first = tuple(math.nan if value is None else float(value) for value in item.params[:4])
    places = [math.nan if value is None else float(value) for value in item.params[4:6]]
    scale = 1e7 if item.frame in _GLOBAL_FRAMES else 1.0
    x, y = (UNSET if math.isnan(value) else round(value * scale) for value in places)
    z = math.nan if item.params[6] is None else float(item.params[6])
    return MissionItem(item.frame, item.command, first, x, y, z)  # type: ignore[arg-type]


class _Repeats:
    """When a request to a vehicle is repeated, and when the vehicle counts as lost."""

    def __init__(
        self, station: Station, vehicle: HeardVehicle, purpose: str, most: int | None
    ) -> None:
        self.station, self.vehicle, self.what = station, vehicle, purpose
        self.limits = station.limits
        self.most = self.limits.unanswered if most is None else most
        self.quick = False  # items come quickly, and what begins a transfer may take its time
        self.note_answer()

    def note_answer(self) -> None:
        """Note that the vehicle has answered."""
        self.count = 0
        self.sent_at: float | None = None
        self.heard, self.since = self.vehicle.heard, self.station.now()

    def send(self, *messages: Any) -> None:
        """Send messages, and set the time of their repeat."""
        for message in messages:
            self.station.send(self.vehicle, message)
        delay = self.vehicle.delay if self.quick else None
        pause = self.limits.repeat_after if delay is None else max(_SHORTEST, 4 * delay)
        self.sent_at = self.station.now()
        self.due = self.sent_at + min(pause * 1.3**self.count, max(_LONGEST, pause))

    def measure(self) -> None:
        """Measure the delay of the link by an answer to a request that was not repeated."""
        if self.sent_at is not None and self.count == 0:
            taken = self.station.now() - self.sent_at
            delay = self.vehicle.delay
            self.vehicle.delay = taken if delay is None else 0.8 * delay + 0.2 * taken

    def count_repeat(self) -> None:
        """Count a repeat; raise `UnansweredError` if there were too many.

        A silent vehicle may only be out of reach for a while. One that is heard, and answers
        nothing, will not answer later.
        """
        self.count += 1
        waited = self.station.now() - self.since
        silent = self.station.now() - self.vehicle.heard_at
        if waited > self.limits.end_after and silent > self.limits.end_after:
            raise UnansweredError(
                f"the vehicle was not heard for {silent:.0f} s {self.what}", silent=True
            )
        if self.count > self.most and self.vehicle.heard - self.heard >= 3:
            raise UnansweredError(
                f"the vehicle, which is heard, gave no answer to {self.count} requests"
                f" in {waited:.0f} s {self.what}",
                silent=False,
            )


def _refusal(kind: str, result: int, doing: str) -> RefusedError:
    return RefusedError(
        f"the vehicle refused {doing} {_of(kind)}: {RESULTS.get(result, 'unknown reason')}"
        f" (MAV_MISSION_RESULT {result})",
        unsupported=result == _UNSUPPORTED,
    )


def _of(kind: str) -> str:
    return {MISSION: "the mission", FENCE: "the fence", RALLY: "the rally points"}[kind]


def _is_about(message: Any, kind: str) -> bool:
    """Return whether a message is about items of a kind. A vehicle that knows of missions alone says
    that something is unsupported as if it were the mission.
    """
    number = getattr(message, "mission_type", None)
    return number == MISSION_TYPES[kind] or (
        message.get_type() == "MISSION_ACK" and message.type == _UNSUPPORTED and number == 0
    )


def upload_items(
    station: Station,
    vehicle: HeardVehicle,
    kind: str,
    items: Sequence[MissionItem],
    *,
    unanswered: int | None = None,
) -> None:
    """Send items, which replace what the vehicle has of this kind. Without items, clear it.

    The end of an upload is the vehicle's acknowledgement, or silence after the last item, because
    the acknowledgement may be lost.

    Parameters
    ----------
    unanswered : int, optional
        Number of repeats of one request after which a vehicle that is heard counts as not
        answering; by default that of the station's limits.

    Raises
    ------
    RefusedError
        If the vehicle refuses the items.
    UnansweredError
        If the vehicle does not answer.
    """
    if not items:
        clear_items(station, vehicle, kind, unanswered=unanswered)
        return
    if len(items) > _MOST:
        raise RefusedError(f"{_of(kind)}: expected at most {_MOST} items, got {len(items)}")
    number, make = MISSION_TYPES[kind], station.dialect
    address = vehicle.system, vehicle.component
    count = [make.MAVLink_mission_count_message(*address, len(items), number)]
    repeats = _Repeats(station, vehicle, f"during the upload of {_of(kind)}", unanswered)
    requested_items: set[int] = set()
    requests: Counter[int] = Counter()
    refusals = out_of_order = 0
    pending, plain = count, False
    repeats.send(*pending)
    try:
        while True:
            message = station.receive(vehicle, repeats.due)
            if message is None:
                repeats.count_repeat()
                if len(requested_items) == len(items) and repeats.count > _RESTARTED:
                    return  # the acknowledgement is lost, or the vehicle sends none
                if repeats.count % _RESTARTED == 0:
                    pending = count  # the vehicle may have given up
                repeats.send(*pending)
                continue
            name = message.get_type()
            if not _is_about(message, kind):
                continue
            if name in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                if message.seq >= len(items):
                    continue
                requests[message.seq] += 1
                # a vehicle that asks for the first item alone, again and again, knows no integers
                plain = plain or (
                    name == "MISSION_REQUEST"
                    and len(requested_items) <= 1
                    and requests[message.seq] > _PLAIN_AFTER
                )
                if message.seq not in requested_items:
                    repeats.measure()
                repeats.note_answer()
                repeats.quick = True
                requested_items.add(message.seq)
                pending = _item_messages(
                    make, address, message.seq, items[message.seq], number, plain=plain
                )
                repeats.send(*pending)
            elif name == "MISSION_ACK":
                if message.type == _ACCEPTED:
                    if len(requested_items) == len(items):
                        return
                    continue  # of an earlier upload
                if (
                    message.type == _OUT_OF_ORDER
                    and requested_items
                    and out_of_order < 4 * len(items)
                ):
                    out_of_order += 1  # to an item that came twice
                    continue
                refusals += 1
                if message.type not in _PASSING or refusals > station.limits.refusals:
                    raise _refusal(kind, message.type, "to store")
                pending = count
    except UnansweredError:
        station.send(vehicle, make.MAVLink_mission_ack_message(*address, _CANCELLED, number))
        raise


def _item_messages(
    make: Any, address: tuple[int, int], seq: int, item: MissionItem, number: int, *, plain: bool
) -> list[Any]:
    """Return the message of an item and, for vehicles that know float items only, that one too."""
    current = int(seq == 0 and number == 0)
    header = *address, seq, item.frame, item.command, current, item.autocontinue, *item.params
    messages = [make.MAVLink_mission_item_int_message(*header, item.x, item.y, item.z, number)]
    if plain:
        scale = 1e7 if item.frame in _GLOBAL_FRAMES else 1.0
        place = (math.nan if value == UNSET else value / scale for value in (item.x, item.y))
        messages.append(make.MAVLink_mission_item_message(*header, *place, item.z, number))
    return messages


def clear_items(
    station: Station, vehicle: HeardVehicle, kind: str, *, unanswered: int | None = None
) -> None:
    """Remove all items of a kind from a vehicle.

    Raises
    ------
    RefusedError, UnansweredError
    """
    number, make = MISSION_TYPES[kind], station.dialect
    request = make.MAVLink_mission_clear_all_message(vehicle.system, vehicle.component, number)
    repeats = _Repeats(station, vehicle, f"while {_of(kind)} should be cleared", unanswered)
    refusals = 0
    repeats.send(request)
    while True:
        message = station.receive(vehicle, repeats.due)
        if message is None:
            repeats.count_repeat()
            repeats.send(request)
        elif message.get_type() == "MISSION_ACK" and _is_about(message, kind):
            if message.type == _ACCEPTED:
                return
            refusals += 1
            if message.type not in _PASSING or refusals > station.limits.refusals:
                raise _refusal(kind, message.type, "to clear")


def download_items(
    station: Station, vehicle: HeardVehicle, kind: str, *, unanswered: int | None = None
) -> list[MissionItem]:
    """Return all items of a kind that a vehicle stores.

    Parameters
    ----------
    unanswered : int, optional
        Number of repeats of the first request after which a vehicle that is heard counts as not
        answering; by default that of the station's limits.

    Raises
    ------
    RefusedError, UnansweredError
    """
    number, make = MISSION_TYPES[kind], station.dialect
    address = vehicle.system, vehicle.component
    purpose = f"while {_of(kind)} should be read"
    request = make.MAVLink_mission_request_list_message(*address, number)
    size = _ask(
        station,
        vehicle,
        kind,
        _Repeats(station, vehicle, purpose, unanswered),
        lambda _count: [request],
        lambda message: message.count if message.get_type() == "MISSION_COUNT" else None,
    )
    items: dict[int, MissionItem] = {}
    for seq in range(size):
        whole = make.MAVLink_mission_request_int_message(*address, seq, number)
        plain = make.MAVLink_mission_request_message(*address, seq, number)
        knows_integers = None if seq == 0 else items[seq - 1].exact

        def ask(
            count: int, whole: Any = whole, plain: Any = plain, exact: bool | None = knows_integers
        ) -> list[Any]:
            if exact is not None:
                return [whole if exact else plain]
            return [whole, plain] if count >= _PLAIN_AFTER else [whole]

        def take(message: Any, seq: int = seq) -> int | None:
            exact = message.get_type() == "MISSION_ITEM_INT"
            if (exact or message.get_type() == "MISSION_ITEM") and message.seq < size:
                if exact or message.seq not in items:
                    items[message.seq] = _item_of(message)
                return 1 if message.seq == seq else None
            return None

        if seq not in items:
            repeats = _Repeats(station, vehicle, purpose, None)
            repeats.quick = True
            _ask(station, vehicle, kind, repeats, ask, take)
    station.send(vehicle, make.MAVLink_mission_ack_message(*address, _ACCEPTED, number))
    return [items[seq] for seq in range(size)]


def _ask(
    station: Station,
    vehicle: HeardVehicle,
    kind: str,
    repeats: _Repeats,
    ask: Callable[[int], list[Any]],
    take: Callable[[Any], int | None],
) -> int:
    """Repeat a request until a message answers it, and return what ``take`` returns for it."""
    refusals = 0
    repeats.send(*ask(0))
    while True:
        message = station.receive(vehicle, repeats.due)
        if message is None:
            repeats.count_repeat()
            repeats.send(*ask(repeats.count))
        elif _is_about(message, kind):
            answer = take(message)
            if answer is not None:
                repeats.measure()
                return answer
            if message.get_type() == "MISSION_ACK" and message.type != _ACCEPTED:
                refusals += 1
                if message.type not in _PASSING or refusals > station.limits.refusals:
                    raise _refusal(kind, message.type, "to read out")


def _item_of(message: Any) -> MissionItem:
    exact = message.get_type() == "MISSION_ITEM_INT"
    scale = 1e7 if not exact and message.frame in _GLOBAL_FRAMES else 1.0
    x, y = (
        UNSET if not math.isfinite(value) else round(value * scale)
        for value in (message.x, message.y)
    )
    params = message.param1, message.param2, message.param3, message.param4
    return MissionItem(
        message.frame, message.command, params, x, y, message.z, message.autocontinue, exact
    )


PLACE_STEPS = 1
"""Tolerance of a coordinate in 1e-7 degrees, about 1 cm: conversions may round or cut."""
HEIGHT = 0.01
"""Tolerance of an altitude in metres: ArduPilot stores centimetres."""
RALLY_HEIGHT = 1.0
"""Tolerance of a rally point's altitude in metres: ArduPilot stores whole metres."""
PARAMETER = 0.01
"""Tolerance of a parameter in its unit: float32, and degrees that were radians."""
RADIUS = 0.5
"""Tolerance of the radius of a loiter in metres: ArduPilot stores whole metres."""

_NAMES = ("parameter 1", "parameter 2", "parameter 3", "parameter 4")
_ITEM_NAMES = {
    (WAYPOINT, 0): "hold time",
    (WAYPOINT, 1): "acceptance radius",
    (WAYPOINT, 2): "pass radius",
    (TAKE_OFF, 0): "pitch",
    (SPEED, 0): "kind of speed",
    (SPEED, 1): "speed",
    (SPEED, 2): "throttle",
    (TRIGGER, 0): "distance between images",
    (TRIGGER, 1): "shutter time",
    (TRIGGER, 2): "first image at once",
    (GIMBAL, 0): "pitch",
    (HOLD, 2): "radius",
    **{(command, 3): "heading" for command in (WAYPOINT, TAKE_OFF, LAND, HOLD)},
}
_DROPPED = {
    WAYPOINT: (1, 2, 3),
    TAKE_OFF: (0, 1, 2, 3),
    LAND: (0, 1, 2, 3),
    HOLD: (0, 1, 3),
    RETURN: (0, 1, 2, 3),
    SPEED: (2, 3),
    TRIGGER: (1, 2, 3),
    GIMBAL: (3,),
    RALLY_POINT: (0, 1, 2, 3),
    **dict.fromkeys(FENCE_CORNERS, (1, 2, 3)),
    **dict.fromkeys(FENCE_CIRCLES, (1, 2, 3)),
}
"""Parameters that an autopilot may drop: it reads them back as 0, -1 or unset. The path, the
altitudes, the speeds and the distances between images are not among them.
"""


class ItemComparison(NamedTuple):
    """What differs between items that were sent and items that were read back.

    ``different`` counts the items that differ, with a sentence for each of the first ones in
    ``sentences``. ``dropped`` counts the fields that the autopilot dropped as it may, by name.
    ``rounded`` tells whether positions were told as float32.
    """

    different: int
    sentences: tuple[str, ...]
    dropped: Counter[str]
    rounded: bool


_SHOWN = 3  # sentences


def compare_items(
    kind: str, sent: Sequence[MissionItem], onboard: Sequence[MissionItem], *, autopilot: int
) -> ItemComparison:
    """Compare items field by field with the tolerances of this module.

    Item 0 of ArduPilot's mission is its home, which it sets itself: it is left out.
    """
    skipped = int(kind == MISSION and autopilot == ARDUPILOT)
    sentences: list[str] = []
    dropped: Counter[str] = Counter()
    different = abs(len(sent) - len(onboard))
    # without a mission, ArduPilot may store nothing, or home alone
    if len(sent) <= skipped and len(onboard) <= skipped:
        return ItemComparison(0, (), dropped, rounded=False)
    if len(sent) != len(onboard):
        sentences.append(
            f"{kind}: expected {len(sent) - skipped} items on board, got {len(onboard) - skipped}"
        )
    for number, (ours, theirs) in enumerate(zip(sent, onboard, strict=False)):
        if number < skipped:
            continue
        faults = _item_faults(ours, theirs, dropped)
        if faults:
            different += 1
            sentences.append(f"{kind} item {number}: {', '.join(faults)}")
    shown = tuple(sentences[:_SHOWN])
    if len(sentences) > _SHOWN:
        shown += (f"{kind}: {len(sentences) - _SHOWN} more like it",)
    return ItemComparison(
        different, shown, dropped, rounded=any(not item.exact for item in onboard)
    )


def _item_faults(sent: MissionItem, onboard: MissionItem, dropped: Counter[str]) -> list[str]:
    """Return the fields in which two items differ. Count fields that the autopilot dropped."""
    if sent.command != onboard.command:
        return [f"expected command {sent.command}, got {onboard.command}"]
    faults = []
    placed = sent.frame in _GLOBAL_FRAMES
    border = sent.command in (*FENCE_CORNERS, *FENCE_CIRCLES)
    frames = [_ALIKE.get(item.frame, item.frame) for item in (sent, onboard)]
    # autopilots store no frame of an item without a place, nor of a fence, which has no altitude
    if placed and not border and frames[0] != frames[1]:
        faults.append(f"expected frame {frames[0]}, got {frames[1]}")
    for number, (ours, theirs) in enumerate(zip(sent.params, onboard.params, strict=True)):
        if _same_parameter(sent.command, number, ours, theirs):
            continue
        name = _ITEM_NAMES.get((sent.command, number), _NAMES[number])
        if number in _DROPPED.get(sent.command, ()) and (math.isnan(theirs) or theirs in (0, -1)):
            dropped[name] += 1
        else:
            faults.append(f"expected {name} {ours:g}, got {theirs:g}")
    for name, ours, theirs in (("latitude", sent.x, onboard.x), ("longitude", sent.y, onboard.y)):
        if placed and abs(ours - theirs) > (PLACE_STEPS if onboard.exact else _float_steps(ours)):
            faults.append(f"expected {name} {ours / 1e7:.7f}, got {theirs / 1e7:.7f}")
        elif not placed and ours != theirs and theirs not in (0, UNSET):
            faults.append(f"expected {name[0]} parameter {ours}, got {theirs}")
    if placed and not border:
        most = RALLY_HEIGHT if sent.command == RALLY_POINT else HEIGHT
        if not (
            abs(sent.z - onboard.z) <= most + 1e-6 * abs(sent.z) or _both_nan(sent.z, onboard.z)
        ):
            faults.append(f"expected altitude {sent.z:g}, got {onboard.z:g}")
    elif not placed and not _nearly_equal(sent.z, onboard.z, PARAMETER) and onboard.z != 0:
        faults.append(f"expected parameter 7 {sent.z:g}, got {onboard.z:g}")
    flown = not border and sent.command != RALLY_POINT  # nothing continues after a corner
    if flown and sent.autocontinue and not onboard.autocontinue:
        faults.append("expected it to continue, got a stop")
    return faults


def _float_steps(value: int) -> int:
    """Return half the distance of neighbouring float32 numbers at a coordinate, in 1e-7 degrees."""
    return PLACE_STEPS + math.ceil(float(np.spacing(np.float32(abs(value) / 1e7))) * 1e7 / 2)


def _same_parameter(command: int, number: int, ours: float, theirs: float) -> bool:
    if (
        number == 3
        and (command, 3) in _ITEM_NAMES
        and math.isfinite(ours)
        and math.isfinite(theirs)
    ):
        return abs((ours - theirs + 180) % 360 - 180) <= PARAMETER
    return _nearly_equal(ours, theirs, RADIUS if (command, number) == (HOLD, 2) else PARAMETER)


def _nearly_equal(ours: float, theirs: float, most: float) -> bool:
    return _both_nan(ours, theirs) or abs(ours - theirs) <= most + 1e-6 * abs(ours)


def _both_nan(ours: float, theirs: float) -> bool:
    return math.isnan(ours) and math.isnan(theirs)


def fence_areas(
    items: Sequence[MissionItem],
    to_metres: Callable[[float, float], NDArray[np.float64]],
    *,
    all_inside: bool,
) -> list[tuple[Any, bool]]:
    """Return the areas of a fence in metres, and whether a vehicle must be inside of each.

    The first area is what several polygons and circles allow together that a vehicle must not
    leave.

    Parameters
    ----------
    items : sequence of MissionItem
    to_metres : callable
        Function that returns the place of a longitude and latitude in degrees.
    all_inside : bool
        Whether a vehicle must be inside all of these, as for ArduPilot, or inside any, as for PX4.
    """
    import shapely

    inside: list[Any] = []
    outside: list[Any] = []
    corners: list[MissionItem] = []
    for item in items:
        if item.command in FENCE_CIRCLES:
            middle = shapely.Point(to_metres(item.y / 1e7, item.x / 1e7))
            circle = middle.buffer(item.params[0])
            (inside if item.command == FENCE_CIRCLES[0] else outside).append(circle)
            continue
        corners.append(item)
        if len(corners) == item.params[0]:
            ring = [to_metres(corner.y / 1e7, corner.x / 1e7) for corner in corners]
            polygon = shapely.make_valid(shapely.Polygon(ring if len(ring) > 2 else ()))
            (inside if item.command == FENCE_CORNERS[0] else outside).append(polygon)
            corners = []
    common = shapely.intersection_all(inside) if all_inside else shapely.union_all(inside)
    return [(common, True)] * bool(inside) + [(area, False) for area in outside]
