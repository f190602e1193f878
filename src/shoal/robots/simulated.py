"""A simulated vehicle that speaks MAVLink: a kinematic body with limited acceleration, and as much
of an autopilot as uploads, starts and rehearsals need, in the dialects of PX4 and ArduPilot.

`Quirks` are what real autopilots and radios do to the mission protocol. A `SimulatedVehicle` has no
clock and no socket: `SimulatedLink` connects vehicles to a station on simulated time, and
`run_vehicles` on real time and real sockets.
"""

from __future__ import annotations

import math
import struct
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_choice, check_integer, check_kind, check_points
from shoal.core.dataclass import dataclass
from shoal.missions.formats.items import HOLD, LAND, RETURN, SPEED, TAKE_OFF, WAYPOINT
from shoal.robots import modes
from shoal.robots.mavlink import (
    ARDUPILOT,
    ARMED,
    AUTOPILOT_COMPONENT,
    AUTOPILOTS,
    PX4,
    Address,
    VehicleLink,
)
from shoal.robots.mission_protocol import (
    FENCE,
    MISSION,
    MISSION_TYPES,
    RALLY,
    UNSET,
    MissionItem,
    fence_areas,
)
from shoal.search.regions.formats.flight_logs import dialect
from shoal.search.regions.projection import LocalFrame

TYPES = {"multirotor": 2, "fixed-wing": 1, "rover": 10}  # MAV_TYPE
_KINDS = {number: kind for kind, number in MISSION_TYPES.items()}
# MAV_CMD
_ARM, _SET_MODE, _START, _SET_CURRENT, _REPOSITION, _REQUEST_MESSAGE = 400, 176, 300, 224, 192, 512
# MAV_RESULT
_ACCEPTED, _REFUSED_NOW, _DENIED, _UNKNOWN, _FAILED = 0, 1, 2, 3, 4
# MAV_MISSION_RESULT
_ERROR, _UNSUPPORTED, _OUT_OF_ORDER = 1, 3, 13
_REPEAT, _GIVE_UP = 0.25, 5.0  # seconds of an upload
_STEP = 0.05  # seconds of a step of the motion
_BRAKE = 0.7  # share of the acceleration with which it brakes
_SETPOINT = 1.0  # seconds without set-points after which PX4 leaves the offboard mode
_TIMEOUT = 5.0  # seconds without heartbeats of its station after which ArduPilot acts
_BLIND = 10.0  # seconds without a position after which an autopilot lands
_HOVER = 30.0  # metres above home at which PX4 waits if it is not to land
_STATION = 255  # system id of ArduPilot's station by default
_REAL32, _INT32 = 9, 6  # MAV_PARAM_TYPE
_ON_GROUND, _IN_AIR = 1, 2  # MAV_LANDED_STATE
_PREARM = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK


@dataclass(frozen=True)
class Quirks:
    """What an autopilot or its radio does to the mission protocol, beside what it should.

    Parameters
    ----------
    asks_floats : bool
        It asks with MISSION_REQUEST, and takes integer and float items.
    knows_floats_only : bool
        It neither takes nor tells integer items.
    asks_backwards, asks_twice : bool
        It asks for the items from the last to the first, or for each of them twice.
    lost_acks : int
        Number of acknowledgements that are lost.
    doubled_acks : bool
        Each acknowledgement comes again later, when another transfer may run.
    late_acks : float
        Time in seconds by which acknowledgements are late.
    lacking : tuple of str
        What it does not have: "fence", "rally".
    says_lacking : "as asked", "as mission" or "never"
        How it says so: with the kind that was asked for, as if it were the mission, or not at all.
    refuses : mapping of str to int
        The MAV_MISSION_RESULT with which it refuses uploads of a kind.
    mixes : int
        Number of uploads that break half way and are acknowledged all the same: old items stay
        behind the new ones.
    spoils : tuple of (str, int, str, float)
        Kind, number and field of an item, and what is added to this field when it is stored.
    silent_after : int or None
        Number of received messages of the protocol after which it is silent, once.
    silent_for : float
        How long it is silent, in seconds.
    mute : bool
        It lets nothing be read.
    listens : bool
        It speaks to nobody of whom it has not heard a heartbeat.
    stores_nothing : bool
        It acknowledges uploads, and stores none.
    """

    asks_floats: bool = False
    knows_floats_only: bool = False
    asks_backwards: bool = False
    asks_twice: bool = False
    lost_acks: int = 0
    doubled_acks: bool = False
    late_acks: float = 0.0
    lacking: tuple[str, ...] = ()
    says_lacking: str = "as asked"
    refuses: Mapping[str, int] | None = None
    mixes: int = 0
    spoils: tuple[tuple[str, int, str, float], ...] = ()
    silent_after: int | None = None
    silent_for: float = 10.0
    mute: bool = False
    listens: bool = False
    stores_nothing: bool = False


class _Upload:
    """An upload to the vehicle that is under way."""

    def __init__(self, kind: str, count: int, partner: tuple[int, int], now: float) -> None:
        self.kind, self.count, self.partner = kind, count, partner
        self.items: dict[int, MissionItem] = {}
        self.asked_at, self.heard_at = -math.inf, now
        self.progressed = True


class SimulatedVehicle:
    """A vehicle that stores and flies missions.

    Parameters
    ----------
    system : int
        MAVLink system id.
    kind : "multirotor", "fixed-wing" or "rover"
    autopilot : "px4" or "ardupilot"
    home : tuple of float
        Longitude and latitude in degrees of the place where it stands.
    elevation : float
        Height of this place above sea level in metres.
    quirks : Quirks
    speed, acceleration : float
        Cruise speed in m/s until a mission sets another, and largest acceleration in m/s².
    battery : float
        Seconds in flight that a full battery lasts. Below ``low_battery`` of it, the vehicle returns.
    refuses_to_arm : str
        What keeps the vehicle from arming; nothing by default.
    station_timeout : float, optional
        Seconds without a heartbeat of a ground station after which it returns. By default, it
        flies on.
    parameters : mapping of str to float
        The autopilot's parameters, integers and floats apart. The vehicle does what they say of a
        lost station (FS_GCS_ENABLE, FS_GCS_TIMEOUT and SYSID_MYGCS; NAV_DLL_ACT and COM_DL_LOSS_T),
        of set-points that end (COM_OBL_RC_ACT, COM_OF_LOSS_T), of the fence (FENCE_ENABLE,
        FENCE_ACTION and FENCE_TYPE; GF_ACTION), and of the return (RTL_ALT and RTL_ALT_FINAL;
        RTL_RETURN_ALT and RTL_LAND_DELAY). Without parameters, it returns when it breaches a fence,
        and when PX4 gets no set-points.

    Attributes
    ----------
    stored : dict of str to list of MissionItem
        The items on board, without ArduPilot's home.
    position, velocity : ndarray of float64, shape (3,)
        In metres east, north and up of home, and m/s.
    armed : bool
    mode : str
    current : int
        Number of the item that it flies, as the autopilot counts.
    breaches : int
        Number of breaches of the fence.
    silent, lost_position : bool
        Whether the vehicle says nothing any more, or has no position any more. Without a position,
        it refuses all modes but landing, and lands by itself after a while.
    charge_unknown : bool
        Whether the vehicle does not tell how much of its battery is left.
    track : list of tuple
        Time, position (three values), and whether it was in its guided mode, at each step of an
        armed vehicle and at its end.
    """

    def __init__(
        self,
        system: int = 1,
        *,
        kind: str = "multirotor",
        autopilot: str = "px4",
        home: tuple[float, float] = (8.5, 47.4),
        elevation: float = 0.0,
        quirks: Quirks | None = None,
        speed: float = 5.0,
        acceleration: float = 2.0,
        battery: float = 1200.0,
        low_battery: float = 0.15,
        refuses_to_arm: str = "",
        station_timeout: float | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.parameters = dict(parameters or {})
        self.silent = self.lost_position = False
        self.charge_unknown = False
        self.system, self.kind = system, kind
        numbers = {name.lower(): number for number, name in AUTOPILOTS.items()}
        self.autopilot = numbers[check_choice(autopilot, what="autopilot", choices=numbers)]
        self.home, self.elevation = home, elevation
        self.quirks = check_kind(quirks or Quirks(), Quirks, what="quirks")
        self.speed, self.acceleration = speed, acceleration
        self.battery, self.low_battery, self.charge = battery, low_battery, 1.0
        self.refuses_to_arm, self.station_timeout = refuses_to_arm, station_timeout
        self.track: list[tuple[float, float, float, float, bool]] = []
        self.frame = LocalFrame(
            *check_points([home], what="home", dimensions=2, count=1)[0].tolist()
        )
        self.stored: dict[str, list[MissionItem]] = {MISSION: [], FENCE: [], RALLY: []}
        self.position, self.velocity = np.zeros(3), np.zeros(3)
        self.armed, self.mode, self.current = False, modes.MANUAL, 0
        self.breaches, self.breached = 0, False
        self.armed_at = 0.0
        self._dialect = dialect()
        self._mav = self._dialect.MAVLink(None, system, AUTOPILOT_COMPONENT)
        self._parser = self._dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._out: deque[bytes] = deque()
        self._later: list[tuple[float, Any]] = []
        self._upload: _Upload | None = None
        self._lost_acks, self._mixes = self.quirks.lost_acks, self.quirks.mixes
        self._taken, self._silent_until = 0, -math.inf
        self._now, self._moved_at = 0.0, 0.0
        self._sent_at = {1.0: -math.inf, 0.2: -math.inf}
        self._station_at: float | None = None
        self._stations: dict[int, float] = {}
        self._station_lost, self._lost_at, self._above_home = False, math.inf, False
        self._guided: tuple[NDArray[np.float64], float] | None = None
        self._cruise = speed
        self._metres: dict[tuple[float, float], tuple[float, float]] = {}
        self._fence_areas: list[tuple[Any, bool]] | None = None

    # -- the protocol ---------------------------------------------------------------------------

    def take(self, data: bytes, now: float) -> None:
        """Take bytes that have come at the time ``now``."""
        self._now = max(self._now, now)
        for message in self._parser.parse_buffer(data) or ():
            self._take(message)

    def step(self, now: float) -> list[bytes]:
        """Go on to the time ``now``, and return what is to be sent, a message each."""
        self._now = max(self._now, now)
        self._move()
        for when, message in [entry for entry in self._later if entry[0] <= self._now]:
            self._later.remove((when, message))
            self._send(message)
        self._go_on_with_upload()
        self._report()
        out = [*self._out]
        self._out.clear()
        return out if self._now >= self._silent_until and not self.silent else []

    def _send(self, message: Any) -> None:
        self._out.append(bytes(message.pack(self._mav)))
        self._mav.seq = (self._mav.seq + 1) % 256

    def _take(self, message: Any) -> None:
        name = message.get_type()
        source = message.get_srcSystem(), message.get_srcComponent()
        if name == "HEARTBEAT" and message.autopilot == 8:
            self._station_at = self._stations[source[0]] = self._now
            return
        if getattr(message, "target_system", self.system) not in (0, self.system):
            return
        handler = getattr(self, f"_take_{name.lower()}", None)
        if handler is None:
            return
        if name.startswith("MISSION"):
            self._taken += 1
            if self._taken == self.quirks.silent_after:
                self._silent_until = self._now + self.quirks.silent_for
        if self._now < self._silent_until:
            return
        handler(message, source)

    def _acknowledge(self, kind: str, result: int, partner: tuple[int, int]) -> None:
        message = self._dialect.MAVLink_mission_ack_message(*partner, result, MISSION_TYPES[kind])
        if self.quirks.doubled_acks:
            self._later.append((self._now + 0.4, message))
        if self._lost_acks > 0:
            self._lost_acks -= 1
        elif self.quirks.late_acks:
            self._later.append((self._now + self.quirks.late_acks, message))
        else:
            self._send(message)

    def _kind_of(self, message: Any, partner: tuple[int, int]) -> str | None:
        """Return the kind of items a message is about; refuse one that the vehicle does not have."""
        kind = _KINDS.get(message.mission_type)
        if kind is None or kind in self.quirks.lacking:
            number = message.mission_type if self.quirks.says_lacking == "as asked" else 0
            answer = self._dialect.MAVLink_mission_ack_message(*partner, _UNSUPPORTED, number)
            if self.quirks.says_lacking != "never":
                self._send(answer)
            return None
        return kind

    def _take_mission_count(self, message: Any, partner: tuple[int, int]) -> None:
        kind = self._kind_of(message, partner)
        if kind is None:
            return
        refusal = (self.quirks.refuses or {}).get(kind)
        if refusal is not None:
            self._acknowledge(kind, refusal, partner)
            return
        running = self._upload
        if running is not None and running.partner == partner and self.autopilot == PX4:
            if running.kind == kind and not running.items:
                running.asked_at = -math.inf  # its request was lost
            else:
                self._acknowledge(kind, _ERROR, partner)  # busy
            return
        self._upload = _Upload(kind, message.count, partner, self._now)
        if message.count == 0:
            self._end_upload()

    def _take_mission_item_int(self, message: Any, partner: tuple[int, int]) -> None:
        if not self.quirks.knows_floats_only:
            self._take_item(message, partner, message.x, message.y, exact=True)

    def _take_mission_item(self, message: Any, partner: tuple[int, int]) -> None:
        if self.quirks.asks_floats or self.quirks.knows_floats_only:
            placed = message.frame in (0, 3, 5, 6, 10, 11)
            scale = 1e7 if placed else 1.0
            places = (
                UNSET if math.isnan(value) else round(value * scale)
                for value in (message.x, message.y)
            )
            self._take_item(message, partner, *places, exact=False)

    def _take_item(
        self, message: Any, partner: tuple[int, int], x: int, y: int, *, exact: bool
    ) -> None:
        upload = self._upload
        kind = _KINDS.get(message.mission_type)
        if upload is None or kind != upload.kind or message.seq != self._next_request(upload):
            if self.autopilot == ARDUPILOT and kind is not None:
                self._acknowledge(kind, _OUT_OF_ORDER, partner)
            return
        params = message.param1, message.param2, message.param3, message.param4
        item = MissionItem(
            message.frame, message.command, params, x, y, message.z, message.autocontinue, exact
        )
        upload.items[message.seq] = item
        upload.asked_at, upload.heard_at = -math.inf, self._now
        if len(upload.items) == upload.count:
            self._end_upload()

    def _next_request(self, upload: _Upload) -> int:
        missing = [seq for seq in range(upload.count) if seq not in upload.items]
        return missing[-1 if self.quirks.asks_backwards else 0]

    def _go_on_with_upload(self) -> None:
        upload = self._upload
        if upload is None:
            return
        if self._now - upload.heard_at > _GIVE_UP:
            self._upload = None
            self._acknowledge(upload.kind, 15, upload.partner)
        elif self._now - upload.asked_at >= _REPEAT and upload.count > len(upload.items):
            upload.asked_at = self._now
            floats = self.quirks.asks_floats or self.quirks.knows_floats_only
            make = (
                self._dialect.MAVLink_mission_request_message
                if floats
                else self._dialect.MAVLink_mission_request_int_message
            )
            request = make(*upload.partner, self._next_request(upload), MISSION_TYPES[upload.kind])
            self._send(request)
            if self.quirks.asks_twice:
                self._send(request)

    def _end_upload(self) -> None:
        upload = self._upload
        assert upload is not None
        self._upload = None
        items = [
            self._stored_item(upload.kind, seq, upload.items[seq]) for seq in range(upload.count)
        ]
        if upload.kind == MISSION and self.autopilot == ARDUPILOT:
            items = items[1:]  # its home is its own
        if self._mixes > 0 and items:
            self._mixes -= 1
            half = len(items) // 2
            items = items[:half] + self.stored[upload.kind][half:]
        if not self.quirks.stores_nothing:
            self.stored[upload.kind] = items
        if upload.kind == MISSION:
            self.current = 0
        self._acknowledge(upload.kind, _ACCEPTED, upload.partner)

    def _stored_item(self, kind: str, seq: int, item: MissionItem) -> MissionItem:
        """Return an item as the autopilot keeps it."""
        changes: dict[str, Any] = {}
        if self.autopilot == ARDUPILOT:
            placed = item.frame in (0, 3, 5, 6, 10, 11)
            params = list(item.params)
            if item.command in (WAYPOINT, TAKE_OFF, LAND, RETURN):
                params = [
                    float(round(params[0])) if item.command == WAYPOINT else 0.0,
                    0.0,
                    0.0,
                    0.0,
                ]
            elif item.command == HOLD:
                params = [0.0, 0.0, float(round(params[2])), 0.0]
            height = round(100 * item.z) / 100 if math.isfinite(item.z) else 0.0
            changes = {
                "params": tuple(0.0 if math.isnan(value) else value for value in params),
                "frame": item.frame if placed else 0,
                "z": float(int(height)) if kind == RALLY else height if placed else 0.0,
            }
        elif item.frame in (0, 3):
            changes = {"frame": {0: 5, 3: 6}[item.frame]}
        for of_kind, number, name, more in self.quirks.spoils:
            if (of_kind, number) == (kind, seq):
                before = changes.get(name, getattr(item, name))
                changes[name] = (
                    (before[0] + more, *before[1:])
                    if name == "params"
                    else before + type(before)(more)
                )
        return item._replace(**changes)

    def _items_on_board(self, kind: str) -> list[MissionItem]:
        """Return the items as they are read out: ArduPilot's mission begins with its home."""
        items = self.stored[kind]
        if kind == MISSION and self.autopilot == ARDUPILOT:
            x, y = (round(1e7 * value) for value in self.home[::-1])
            return [MissionItem(0, WAYPOINT, (0.0,) * 4, x, y, self.elevation), *items]
        return items

    def _take_mission_request_list(self, message: Any, partner: tuple[int, int]) -> None:
        kind = self._kind_of(message, partner)
        if kind is None or self.quirks.mute:
            return
        count = len(self._items_on_board(kind))
        self._send(
            self._dialect.MAVLink_mission_count_message(*partner, count, message.mission_type)
        )

    def _take_mission_request_int(self, message: Any, partner: tuple[int, int]) -> None:
        if not self.quirks.knows_floats_only:
            self._tell_item(message, partner, exact=True)

    def _take_mission_request(self, message: Any, partner: tuple[int, int]) -> None:
        self._tell_item(message, partner, exact=False)

    def _tell_item(self, message: Any, partner: tuple[int, int], *, exact: bool) -> None:
        kind = self._kind_of(message, partner)
        if kind is None or self.quirks.mute:
            return
        items = self._items_on_board(kind)
        if message.seq >= len(items):
            self._acknowledge(kind, _OUT_OF_ORDER, partner)
            return
        item = items[message.seq]
        current = int(kind == MISSION and message.seq == self.current)
        header = *partner, message.seq, item.frame, item.command, current, item.autocontinue
        if exact:
            answer = self._dialect.MAVLink_mission_item_int_message(
                *header, *item.params, item.x, item.y, item.z, message.mission_type
            )
        else:
            scale = 1e7 if item.frame in (0, 3, 5, 6, 10, 11) else 1.0
            answer = self._dialect.MAVLink_mission_item_message(
                *header, *item.params, item.x / scale, item.y / scale, item.z, message.mission_type
            )
        self._send(answer)

    def _take_mission_clear_all(self, message: Any, partner: tuple[int, int]) -> None:
        for kind in _KINDS.values() if message.mission_type == 255 else ():
            self.stored[kind] = []
        if message.mission_type == 255:
            self._send(self._dialect.MAVLink_mission_ack_message(*partner, _ACCEPTED, 255))
            return
        of_kind = self._kind_of(message, partner)
        if of_kind is not None:
            self.stored[of_kind] = []
            self._acknowledge(of_kind, _ACCEPTED, partner)

    def _take_mission_ack(self, message: Any, partner: tuple[int, int]) -> None:
        upload = self._upload
        if upload is not None and upload.partner == partner and message.type == 15:
            self._upload = None  # cancelled

    def forget_time(self) -> None:
        """Begin at time 0 again, as after the power was off."""
        self._now = self._moved_at = 0.0
        self._sent_at = dict.fromkeys(self._sent_at, -math.inf)
        self._station_at, self._stations, self._station_lost = None, {}, False
        self._later, self._upload = [], None

    # -- commands -------------------------------------------------------------------------------

    def _take_command_long(self, message: Any, partner: tuple[int, int]) -> None:
        params = [getattr(message, f"param{number}") for number in range(1, 8)]
        self._obey(message.command, params, params[4:6], partner)

    def _take_command_int(self, message: Any, partner: tuple[int, int]) -> None:
        params = [getattr(message, f"param{number}") for number in range(1, 5)]
        places = [message.x / 1e7, message.y / 1e7]
        self._obey(message.command, [*params, *places, message.z], places, partner)

    def _obey(
        self, command: int, params: list[float], places: list[float], partner: tuple[int, int]
    ) -> None:
        result = _ACCEPTED
        if command == _ARM:
            result = self._arm() if params[0] else self._disarm()
        elif command == _SET_MODE:
            number = int(params[1])
            if self.autopilot == PX4:
                number = int(params[1]) << 16 | int(params[2]) << 24
            names = {value: key for key, value in self._modes.items()}
            result = self._set_mode(names[number]) if number in names else _DENIED
        elif command == _START:
            result = self._set_mode(modes.MISSION) if self.armed else _REFUSED_NOW
        elif command == _SET_CURRENT:
            self._set_current(int(params[0]))
        elif command == TAKE_OFF:
            if self.armed and self.mode == modes.GUIDED:
                self._guided = np.array([*self.position[:2], params[6]]), math.inf
            else:
                result = _DENIED
        elif command in (RETURN, LAND):
            result = self._set_mode(modes.RETURN if command == RETURN else modes.LAND)
        elif command == _REPOSITION:
            if not self.lost_position:
                self._guided = (self._local(places[1], places[0], params[6]), math.inf)
            result = self._set_mode(modes.GUIDED)
        elif command not in (_REQUEST_MESSAGE, 511):
            result = _UNKNOWN
        self._send(self._dialect.MAVLink_command_ack_message(command, result, 255, 0, *partner))

    @property
    def _modes(self) -> dict[str, int]:
        return modes.custom_modes(self.autopilot, TYPES[self.kind])

    def _arm(self) -> int:
        if self.armed:
            return _ACCEPTED
        text = self.refuses_to_arm or ("low battery" if self.charge <= self.low_battery else "")
        if text:
            self._say(
                f"PreArm: {text}" if self.autopilot == ARDUPILOT else f"Arming denied: {text}"
            )
            return _FAILED if self.autopilot == ARDUPILOT else _REFUSED_NOW
        self.armed, self.armed_at, self._fence_areas = True, self._now, None
        return _ACCEPTED

    def _disarm(self) -> int:
        if self.armed and self.position[2] > 0.1:
            return _DENIED
        self.armed = False
        self.velocity[:] = 0
        return _ACCEPTED

    def _set_mode(self, mode: str) -> int:
        blind = self.lost_position and mode in (modes.MISSION, modes.GUIDED, modes.RETURN)
        # PX4 changes to offboard only while set-points come
        led = self.autopilot != PX4 or mode != modes.GUIDED or self._is_led
        if blind or not led:
            return _REFUSED_NOW if self.autopilot == PX4 else _FAILED
        if mode == modes.MISSION:
            if not self.stored[MISSION]:
                self._say("Mission rejected: no mission")
                return _REFUSED_NOW if self.autopilot == PX4 else _FAILED
            if self.mode != modes.MISSION and self.current >= self._n_items:
                self.current = 0
        self.mode = mode
        return _ACCEPTED

    @property
    def _n_items(self) -> int:
        return len(self._items_on_board(MISSION))

    def _set_current(self, number: int) -> None:
        self.current = min(max(0, number), max(0, self._n_items - 1))
        self._send(self._dialect.MAVLink_mission_current_message(self.current))

    def _take_mission_set_current(self, message: Any, _partner: tuple[int, int]) -> None:
        self._set_current(message.seq)

    def _take_set_position_target_global_int(self, message: Any, _partner: tuple[int, int]) -> None:
        if self.autopilot == ARDUPILOT and (self.mode != modes.GUIDED or self.on_ground):
            return  # ArduPilot takes set-points in the guided mode alone, and takes off by command
        target = self._local(message.lon_int / 1e7, message.lat_int / 1e7, message.alt)
        # ArduPilot flies to the last position however old it is
        holds = self.parameters.get("COM_OF_LOSS_T", _SETPOINT)
        self._guided = target, self._now + holds if self.autopilot == PX4 else math.inf

    @property
    def _is_led(self) -> bool:
        return self._guided is not None and self._now <= self._guided[1]

    @property
    def on_ground(self) -> bool:
        """Whether the vehicle flies, and is on the ground."""
        return self.kind != "rover" and bool(self.position[2] <= 0.3)

    def _take_param_request_read(self, message: Any, _partner: tuple[int, int]) -> None:
        name = message.param_id.rstrip("\0")
        if name not in self.parameters:
            return
        value = self.parameters[name]
        kind = _INT32 if isinstance(value, int) else _REAL32
        if kind == _INT32 and self.autopilot == PX4:  # the bytes of the integer as those of a float
            value = struct.unpack("<f", struct.pack("<i", value))[0]
        number = [*self.parameters].index(name)
        self._send(
            self._dialect.MAVLink_param_value_message(
                name.encode(), value, kind, len(self.parameters), number
            )
        )

    def _say(self, text: str, severity: int = 3) -> None:
        self._send(self._dialect.MAVLink_statustext_message(severity, text.encode()[:50]))

    # -- motion ---------------------------------------------------------------------------------

    def _local(self, longitude: float, latitude: float, height: float) -> NDArray[np.float64]:
        place = longitude, latitude
        if place not in self._metres:
            x, y = self.frame.to_metres(np.array([place]))[0]
            self._metres[place] = float(x), float(y)
        return np.array([*self._metres[place], height])

    @property
    def return_height(self) -> float:
        """Height above home in metres to which the vehicle climbs before it returns."""
        if self.kind == "rover":
            return 0.0
        parameters = self.parameters
        if self.autopilot == PX4:
            return parameters.get("RTL_RETURN_ALT", 0.0)
        return parameters.get("RTL_ALT_M", parameters.get("RTL_ALT", 0.0) / 100)

    @property
    def hover_height(self) -> float:
        """Height above home in metres at which the vehicle waits after its return; 0 if it lands."""
        parameters = self.parameters
        if self.autopilot == PX4:
            return _HOVER if parameters.get("RTL_LAND_DELAY", 0) < 0 else 0.0
        return parameters.get("RTL_ALT_FINAL_M", parameters.get("RTL_ALT_FINAL", 0.0) / 100)

    @property
    def place(self) -> tuple[float, float]:
        """Longitude and latitude in degrees."""
        x, y = self.frame.to_degrees(self.position[None, :2])[0]
        return float(x), float(y)

    def _move(self) -> None:
        if self._moved_at == 0.0 or not self.armed:
            self._moved_at = self._now
        while self._now - self._moved_at >= _STEP:
            self._moved_at += _STEP
            if not self.armed:
                continue
            self._check_failsafes()
            target, ends = self._target()
            self._fly_to(target)
            if ends is not None and np.linalg.norm(target - self.position) < ends:
                self._reach()
            self.charge = max(0.0, self.charge - _STEP / self.battery)
            x, y, up = self.position.tolist()
            self.track.append((self._moved_at, x, y, up, self.mode == modes.GUIDED))

    def _fly_to(self, target: NDArray[np.float64]) -> None:
        """Change the velocity by no more than the acceleration allows, and move on."""
        offset = target - self.position
        distance = float(np.linalg.norm(offset))
        # v = sqrt(2 a d) stops at the target; the rest of the acceleration corrects the direction
        brake = _BRAKE * self.acceleration
        speed = min(self._cruise, math.sqrt(2 * brake * distance), distance / _STEP)
        target_velocity = offset / distance * speed if distance > 1e-9 else np.zeros(3)
        most = self.acceleration * _STEP
        for axes in (slice(0, 2), slice(2, 3)):  # autopilots limit across and up apart
            change = target_velocity[axes] - self.velocity[axes]
            size = float(np.linalg.norm(change))
            self.velocity[axes] += change if size <= most else change / size * most
        self.position += self.velocity * _STEP
        self.position[2] = max(0.0, self.position[2])

    def _target(self) -> tuple[NDArray[np.float64], float | None]:
        """Return where the vehicle flies to, and how near it must come; None if it stays there."""
        if self.mode == modes.MISSION:
            return self._mission_target()
        if self.mode == modes.GUIDED and self._guided is not None:
            target, until = self._guided
            if self._moved_at <= until:
                return target, None
            self._guided = None
            if self.autopilot == PX4:  # set-points have ended
                self._say("Offboard control lost")
                self._fall_back({3: modes.RETURN, 4: modes.LAND}, "COM_OBL_RC_ACT", 3)
        self._above_home = self._above_home and self.mode == modes.RETURN
        if self.mode == modes.RETURN:
            self._above_home |= bool(np.linalg.norm(self.position[:2]) <= 1.0)
            up = max(self.return_height, float(self.position[2]))
            if not self._above_home:
                across = self.position[:2] if self.position[2] < up - 0.5 else np.zeros(2)
                return np.array([*across, up]), None
            if self.hover_height > 0:
                return np.array([0.0, 0.0, self.hover_height]), None
            return np.zeros(3), 0.2
        if self.mode == modes.LAND:
            return np.array([*self.position[:2], 0.0]), 0.2
        return self.position.copy(), None

    def _mission_target(self) -> tuple[NDArray[np.float64], float | None]:
        shift = int(self.autopilot == ARDUPILOT)
        while True:
            number = self.current - shift
            if number >= len(self.stored[MISSION]):
                return self.position.copy(), None
            if number < 0:
                self.current = shift
                continue
            item = self.stored[MISSION][number]
            height = item.z - (self.elevation if item.frame in (0, 5) else 0.0)
            if item.command == SPEED and item.params[1] > 0:
                self._cruise = item.params[1]
            elif item.command == TAKE_OFF:
                return np.array([*self.position[:2], height]), 0.5
            elif item.command == RETURN:
                self.mode = modes.RETURN
                return self.position.copy(), None
            elif item.command in (WAYPOINT, LAND, HOLD):
                target = self._local(item.y / 1e7, item.x / 1e7, height)
                if item.command != WAYPOINT and not (item.x or item.y):  # without a place: here
                    target[:2] = self.position[:2]
                if item.command == WAYPOINT:
                    return target, item.params[1] or 2.0
                if item.command == HOLD:
                    return target, None
                near = np.linalg.norm(target[:2] - self.position[:2]) < 1.0
                target[2] = 0.0 if near else self.position[2]
                return target, 0.2 if near else None
            self.current += 1

    def _reach(self) -> None:
        """Go on to the next item, or end the flight on the ground."""
        if self.mode == modes.MISSION:
            self._send(self._dialect.MAVLink_mission_item_reached_message(self.current))
            item = self.stored[MISSION][self.current - int(self.autopilot == ARDUPILOT)]
            self.current += 1
            if item.command != LAND:
                return
        self.position[2] = 0.0
        self.velocity[:] = 0
        self.armed = False

    def _check_failsafes(self) -> None:
        self._check_position()
        if self.mode in (modes.RETURN, modes.LAND):
            return
        if self.charge <= self.low_battery:
            self._say("Low battery: return", 4)
            self.mode = modes.RETURN
        self._check_station()
        inside = self._inside_fence()
        if not inside and not self.breached:
            self.breaches += 1
            self._say("Geofence breached", 2)
            if self.autopilot == PX4:
                self._fall_back({2: modes.HOLD, 3: modes.RETURN, 5: modes.LAND}, "GF_ACTION", 3)
            else:
                self._fall_back(
                    {0: self.mode, 2: modes.LAND, 4: modes.LAND}, "FENCE_ACTION", 1, modes.RETURN
                )
        self.breached = not inside

    def _fall_back(
        self, actions: Mapping[int, str], parameter: str, default: int, fallback: str = modes.HOLD
    ) -> None:
        """Change to the mode that a parameter says, or to another one if it says none of these."""
        self.mode = actions.get(int(self.parameters.get(parameter, default)), fallback)
        if self.mode == modes.HOLD and parameter == "GF_ACTION":
            self._guided = None

    def _check_position(self) -> None:
        """Land a while after the position was lost."""
        if not self.lost_position:
            self._lost_at = math.inf
        elif self._lost_at == math.inf:
            self._lost_at = self._moved_at
        elif self._moved_at - self._lost_at > _BLIND and self.mode != modes.LAND:
            self._say("Position lost: land", 2)
            self.mode = modes.LAND

    def _check_station(self) -> None:
        """Act once when the heartbeats of the station have ended that was heard before."""
        parameters, heard, timeout = self.parameters, self._station_at, self.station_timeout
        actions, parameter, default, fallback = dict[int, str](), "", 0, modes.RETURN
        if timeout is None and self.autopilot == PX4 and parameters.get("NAV_DLL_ACT"):
            timeout = parameters.get("COM_DL_LOSS_T", 2 * _TIMEOUT)
            actions = {1: modes.HOLD, 2: modes.RETURN, 3: modes.LAND}
            parameter, fallback = "NAV_DLL_ACT", modes.HOLD
        elif timeout is None and self.autopilot == ARDUPILOT and parameters.get("FS_GCS_ENABLE"):
            timeout = parameters.get("FS_GCS_TIMEOUT", _TIMEOUT)
            heard = self._stations.get(int(parameters.get("SYSID_MYGCS", _STATION)))
            actions = {5: modes.LAND, 7: modes.LAND}
            parameter = "FS_GCS_ENABLE"
        lost = timeout is not None and heard is not None and self._moved_at - heard > timeout
        if lost and not self._station_lost:
            self._say("Ground station lost", 4)
            self._fall_back(actions, parameter, default, fallback)
        self._station_lost = lost

    def _inside_fence(self) -> bool:
        parameters = self.parameters
        if not self.stored[FENCE] or not (
            parameters.get("FENCE_ENABLE", 1) and int(parameters.get("FENCE_TYPE", 4)) & 4
        ):
            return True
        from shapely import Point

        if self._fence_areas is None:
            self._fence_areas = fence_areas(
                self.stored[FENCE],
                lambda x, y: self._local(x, y, 0.0)[:2],
                all_inside=self.autopilot == ARDUPILOT,
            )
        place = Point(self.position[:2])
        return all(area.covers(place) == inside for area, inside in self._fence_areas)

    # -- telemetry ------------------------------------------------------------------------------

    def _report(self) -> None:
        if self.quirks.listens and self._station_at is None:
            self._out.clear()
            return
        make = self._dialect
        if self._now - self._sent_at[1.0] >= 1.0:
            self._sent_at[1.0] = self._now
            base = modes.CUSTOM | (ARMED if self.armed else 0)
            number = self._modes.get(self.mode, 0)
            self._send(
                make.MAVLink_heartbeat_message(
                    TYPES[self.kind], self.autopilot, base, number, 4 if self.armed else 3, 3
                )
            )
            healthy = 0 if self.refuses_to_arm else _PREARM
            self._send(
                make.MAVLink_sys_status_message(
                    _PREARM,
                    _PREARM,
                    healthy,
                    0,
                    15000,
                    -1,
                    -1 if self.charge_unknown else round(100 * self.charge),
                    0,
                    0,
                    0,
                    0,
                    0,
                    0,
                )
            )
            self._send(
                make.MAVLink_gps_raw_int_message(
                    0, 1 if self.lost_position else 3, 0, 0, 0, 65535, 65535, 65535, 65535, 255
                )
            )
            state = _IN_AIR if self.position[2] > 0.3 else _ON_GROUND
            self._send(make.MAVLink_extended_sys_state_message(0, state))
            self._send(make.MAVLink_mission_current_message(self.current))
            if self.stored[FENCE]:
                self._send(
                    make.MAVLink_fence_status_message(int(self.breached), self.breaches, 0, 0)
                )
        # ArduPilot goes on guessing where it is
        has_position = self.autopilot == ARDUPILOT or not self.lost_position
        if self._now - self._sent_at[0.2] >= 0.2 and has_position:
            self._sent_at[0.2] = self._now
            longitude, latitude = self.place
            up = round(1000 * self.position[2])
            speeds = [round(100 * value) for value in self.velocity[[1, 0, 2]]]
            self._send(
                make.MAVLink_global_position_int_message(
                    round(1000 * self._now) % 2**32,
                    round(1e7 * latitude),
                    round(1e7 * longitude),
                    up + round(1000 * self.elevation),
                    up,
                    *speeds[:2],
                    -speeds[2],
                    65535,
                )
            )


class SimulatedLink:
    """A link without a wire between a station and simulated vehicles, on simulated time.

    Parameters
    ----------
    vehicles : sequence of SimulatedVehicle
        Vehicles with addresses of their own.
    loss : float
        Probability that a message is lost, in each direction.
    delay : float
        Time in seconds that a message takes in each direction.
    seed : int
    at_once : int
        Number of vehicles that are served at the same time, in threads; with one, a run is the same
        each time.
    strangers : sequence of callable
        Functions that return bytes that are on the link, too, for a time in seconds.
    """

    def __init__(
        self,
        vehicles: Sequence[SimulatedVehicle],
        *,
        loss: float = 0.0,
        delay: float = 0.0,
        seed: int = 0,
        name: str = "simulated",
        strangers: Sequence[Callable[[float], Sequence[bytes]]] = (),
        at_once: int = 1,
    ) -> None:
        self.at_once = at_once
        self.name, self.vehicles, self.loss, self.delay = name, vehicles, loss, delay
        self.strangers = strangers
        self.sent: list[bytes] = []
        self._random = np.random.default_rng(check_integer(seed, what="seed", least=0))
        self._time = 0.0
        self._to: deque[tuple[float, int, bytes]] = deque()
        self._from: deque[tuple[float, int, bytes]] = deque()

    def now(self) -> float:
        """Return the simulated time in seconds."""
        return self._time

    def send(self, data: bytes, to: Address = None) -> None:
        """Send bytes to a vehicle, or to all."""
        self.sent.append(data)
        for number in range(len(self.vehicles)) if to is None else [to]:
            if self._random.random() >= self.loss and number < len(self.vehicles):
                self._to.append((self._time + self.delay, number, data))

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Let time pass until something comes, at most ``timeout`` seconds."""
        until = self._time + max(0.0, timeout)
        while True:
            while self._to and self._to[0][0] <= self._time:
                _, number, data = self._to.popleft()
                self.vehicles[number].take(data, self._time)
            for number, vehicle in enumerate(self.vehicles):
                self._put(number, vehicle.step(self._time))
            for number, stranger in enumerate(self.strangers, start=len(self.vehicles)):
                self._put(number, stranger(self._time))
            came: list[tuple[bytes, Address]] = []
            while self._from and self._from[0][0] <= self._time:
                _, number, data = self._from.popleft()
                came.append((data, number))
            if came or self._time >= until:
                return came
            self._time = min(until, self._time + _STEP)

    def _put(self, number: int, messages: Sequence[bytes]) -> None:
        for data in messages:
            if self._random.random() >= self.loss:
                self._from.append((self._time + self.delay, number, data))

    def close(self) -> None:
        """Do nothing: there is no wire."""


def run_vehicles(
    vehicles: Sequence[SimulatedVehicle],
    link: VehicleLink,
    *,
    ended: Callable[[], bool] = lambda: False,
    speed_up: float = 1.0,
) -> None:
    """Run vehicles on a real link, one for all, until ``ended`` returns true.

    Parameters
    ----------
    vehicles : sequence of SimulatedVehicle
    link : VehicleLink
        Such as that of ``udpout:127.0.0.1:14550``, where a station waits.
    ended : callable
    speed_up : float
        How many seconds the vehicles live in a second.
    """
    begin = time.monotonic()
    while not ended():
        for data, _ in link.receive(0.02):
            for vehicle in vehicles:
                vehicle.take(data, (time.monotonic() - begin) * speed_up)
        for vehicle in vehicles:
            for data in vehicle.step((time.monotonic() - begin) * speed_up):
                link.send(data)
