"""Start missions that are on board of vehicles, each at its time, and watch them fly."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import field
from typing import Any

from shoal.core.checks import check_function, check_kind, check_list
from shoal.core.dataclass import dataclass
from shoal.robots import modes
from shoal.robots.mavlink import PX4, HeardVehicle, LinkError, Station, type_text
from shoal.robots.mission_protocol import (
    MISSION,
    UnansweredError,
    compare_items,
    download_items,
)
from shoal.robots.onboard import Cargo, Seat, check_pairs
from shoal.robots.uploading import ORDER, check_type, find_vehicles, items_for

# MAV_CMD
_ARM, _SET_MODE, _START, _SET_CURRENT = 400, 176, 300, 224
_RESULTS = {1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed", 6: "cancelled"}
_IN_PROGRESS = 5  # MAV_RESULT
_PREARM = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
_ON_GROUND = 1  # MAV_LANDED_STATE
_LOWEST_BATTERY = 30  # percent, below which a vehicle is not ready
_SLICE = 0.05  # seconds for which one of several links is listened to

READY, NOT_READY, STARTED, MISSED, UNHEARD = (
    "ready",
    "not ready",
    "started",
    "not started",
    "failed",
)


@dataclass
class Telemetry:
    """What a vehicle has told of itself, as far as it has told anything.

    Parameters
    ----------
    mode : str
    armed : bool
    item, reached : int or None
        Number of the item that it flies, and of the last one that it has reached, as the autopilot
        counts.
    battery : int or None
        Percent left.
    ready : bool or None
        Whether its arming checks pass.
    breaches : int
        Number of breaches of the fence.
    on_ground : bool or None
    longitude, latitude, height : float or None
        Degrees, and metres above home.
    heard_s : float
        Seconds since it was last heard.
    """

    mode: str = "unknown"
    armed: bool = False
    item: int | None = None
    reached: int | None = None
    battery: int | None = None
    ready: bool | None = None
    breaches: int = 0
    on_ground: bool | None = None
    longitude: float | None = None
    latitude: float | None = None
    height: float | None = None
    heard_s: float = 0.0

    def take(self, vehicle: HeardVehicle, message: Any) -> None:
        """Take a message of the vehicle."""
        self.mode = modes.mode_name(vehicle.autopilot, vehicle.type, vehicle.custom_mode)
        self.armed = vehicle.armed
        name = message.get_type()
        if name == "MISSION_CURRENT":
            self.item = message.seq
        elif name == "MISSION_ITEM_REACHED":
            self.reached = message.seq
        elif name == "SYS_STATUS":
            known = message.battery_remaining >= 0
            self.battery = message.battery_remaining if known else None
            if message.onboard_control_sensors_enabled & _PREARM:
                self.ready = bool(message.onboard_control_sensors_health & _PREARM)
        elif name == "FENCE_STATUS":
            self.breaches = max(self.breaches, message.breach_count, message.breach_status)
        elif name == "EXTENDED_SYS_STATE" and message.landed_state:
            self.on_ground = message.landed_state == _ON_GROUND
        elif name == "GLOBAL_POSITION_INT":
            self.longitude, self.latitude = message.lon / 1e7, message.lat / 1e7
            self.height = message.relative_alt / 1000


@dataclass
class Launch:
    """What became of the start of one robot's mission.

    Parameters
    ----------
    robot, system : int
    start : float
        Seconds after the common start time at which it should start.
    items : int
        Number of items of its mission, without home.
    status : str
        "ready", "not ready", "started", "not started" (it missed its time or refused), or "failed"
        (it was not heard or does not answer).
    started_s : float or None
        Seconds after the common start time at which it was seen armed in its mission.
    faults : list of str
        What is wrong, a clause each.
    telemetry : Telemetry
    """

    robot: int
    system: int
    start: float
    items: int
    status: str = UNHEARD
    started_s: float | None = None
    faults: list[str] = field(default_factory=list)
    telemetry: Telemetry = field(default_factory=Telemetry)

    def report(self) -> dict[str, Any]:
        """Return the start as a mapping for JSON."""
        return dict(vars(self)) | {"telemetry": dict(vars(self.telemetry))}

    @property
    def sentence(self) -> str:
        """One sentence about what is wrong."""
        return f"robot {self.robot} (system {self.system}): {'; '.join(self.faults)}"


class Fleet:
    """The vehicles of several robots, with what they tell of themselves.

    Parameters
    ----------
    pairs : sequence of (Cargo, Seat)
    stations : sequence of Station
        Stations without a function ``on_message`` of their own.

    Attributes
    ----------
    launches : dict of int to Launch
        By robot.
    """

    def __init__(self, pairs: Sequence[tuple[Cargo, Seat]], stations: Sequence[Station]) -> None:
        pairs = check_pairs(pairs)
        check_list(stations, Station, what="stations")
        self.cargos = {cargo.robot: cargo for cargo, _ in pairs}
        self.stations = stations
        self.launches = {
            cargo.robot: Launch(
                cargo.robot, seat.system, cargo.mission.start or 0.0, len(cargo.items[MISSION])
            )
            for cargo, seat in pairs
        }
        self.starters: dict[int, _Starter] = {}
        self._by_vehicle: dict[int, Launch] = {}
        for station in stations:
            station.on_message = self._take
        self.vehicles, missing = find_vehicles([seat for _, seat in pairs], stations)
        for robot, (_, vehicle) in self.vehicles.items():
            self._by_vehicle[id(vehicle)] = self.launches[robot]
        for robot, (_, clause) in missing.items():
            self.launches[robot].faults.append(clause)

    def _take(self, vehicle: HeardVehicle, message: Any) -> None:
        launch = self._by_vehicle.get(id(vehicle))
        if launch is not None:
            launch.telemetry.take(vehicle, message)
            if launch.robot in self.starters:
                self.starters[launch.robot].take(message)

    def now(self) -> float:
        """Return the time in seconds, on the clock of the first link."""
        return self.stations[0].now()

    def listen(self, until: float) -> None:
        """Listen to all links until a time on the clock of the first link."""
        while self.now() < until:
            for station in self.stations:
                pause = _SLICE if len(self.stations) > 1 else max(_SLICE, until - self.now())
                station.listen(station.now() + min(pause, 0.5))
        for robot, (station, vehicle) in self.vehicles.items():
            self.launches[robot].telemetry.heard_s = station.now() - vehicle.heard_at


def check_fleet(fleet: Fleet, *, lowest_battery: int = _LOWEST_BATTERY) -> bool:
    """Check that each vehicle has on board what its files say, and that it could be armed.

    Returns
    -------
    bool
        Whether all are ready. The launches have the faults of the others.
    """
    check_kind(fleet, Fleet, what="fleet")
    fleet.listen(fleet.now() + 2.5)  # two reports of each
    for robot, (station, vehicle) in fleet.vehicles.items():
        launch, cargo = fleet.launches[robot], fleet.cargos[robot]
        launch.status = NOT_READY
        unfit = check_type(cargo, vehicle)
        if unfit is not None:
            launch.faults.append(unfit)
            continue
        items = items_for(cargo, vehicle)
        try:
            for kind in ORDER:
                try:
                    onboard = download_items(station, vehicle, kind)
                except LinkError:
                    if items[kind] or kind == MISSION:
                        raise
                    continue  # the vehicle has no such items, and needs none
                result = compare_items(kind, items[kind], onboard, autopilot=vehicle.autopilot)
                launch.faults += result.sentences
        except LinkError as error:
            launch.faults.append(str(error))
            launch.status = UNHEARD if isinstance(error, UnansweredError) else NOT_READY
        telemetry = launch.telemetry
        if telemetry.armed:
            launch.faults.append("expected a disarmed vehicle, got an armed one")
        if telemetry.ready is False:
            texts = "; ".join(vehicle.texts[-3:])
            launch.faults.append(f"its arming checks fail{f': {texts}' if texts else ''}")
        if telemetry.battery is None and lowest_battery > 0:
            launch.faults.append(
                f"expected a battery of {lowest_battery} %, got no report of it (a lowest battery of"
                " 0 asks for none)"
            )
        elif telemetry.battery is not None and telemetry.battery < lowest_battery:
            launch.faults.append(
                f"expected a battery of {lowest_battery} %, got {telemetry.battery} %"
            )
        if not modes.custom_modes(vehicle.autopilot, vehicle.type):
            launch.faults.append(f"expected PX4 or ArduPilot, got a {type_text(vehicle)}")
        if not launch.faults:
            launch.status = READY
    return all(launch.status == READY for launch in fleet.launches.values())


class _Starter:
    """The steps of one vehicle's start: the next one is sent when the last one is accepted."""

    def __init__(
        self, launch: Launch, station: Station, vehicle: HeardVehicle, latest: float
    ) -> None:
        self.launch, self.station, self.vehicle, self.latest = launch, station, vehicle, latest
        numbers = modes.custom_modes(vehicle.autopilot, vehicle.type)
        self.mission_mode = numbers[modes.MISSION]
        # PX4 arms in its mission mode. ArduPilot arms in the guided mode, and the start command
        # then changes the mode: armed in the mode of missions, Copter would wait for the stick.
        before = numbers[modes.MISSION if vehicle.autopilot == PX4 else modes.GUIDED]
        mode: tuple[int, ...] = (modes.CUSTOM, before)
        if vehicle.autopilot == PX4:
            mode = (modes.CUSTOM, before >> 16 & 255, before >> 24 & 255)
        self.steps = [
            (_SET_CURRENT, (0,), True),
            (_SET_MODE, mode, False),
            (_ARM, (1,), False),
            (_START, (0, 0), vehicle.autopilot == PX4),
        ]
        self.tries = 0
        self.due = -1.0
        self.reason = "no answer"
        self.asked_to_arm = False
        self.fault: str | None = None

    @property
    def flying(self) -> bool:
        """Whether the vehicle has told that it is armed in its mission."""
        return self.vehicle.armed and self.vehicle.custom_mode == self.mission_mode

    def take(self, message: Any) -> None:
        """Take an acknowledgement."""
        if message.get_type() != "COMMAND_ACK" or not self.steps:
            return
        command, _, optional = self.steps[0]
        if message.command != command or message.result == _IN_PROGRESS:
            return
        if message.result == 0 or optional:
            self._next()
            return
        self.reason = _RESULTS.get(message.result, f"MAV_RESULT {message.result}")
        if message.result in _FINAL:
            self._fail()

    def _next(self) -> None:
        del self.steps[0]
        self.tries, self.due, self.reason = 0, -1.0, "no answer"

    def _fail(self) -> None:
        texts = "".join(f"; the vehicle says {text!r}" for text in self.vehicle.texts[-2:])
        self.fault = f"{_COMMANDS[self.steps[0][0]]}: {self.reason}{texts}"

    def go_on(self) -> None:
        """Send what is due, and end when the time is over."""
        now = self.station.now()
        if self.steps and now >= self.latest:
            self._fail()
        elif now >= self.latest:
            mode = modes.mode_name(
                self.vehicle.autopilot, self.vehicle.type, self.vehicle.custom_mode
            )
            armed = "armed" if self.vehicle.armed else "disarmed"
            self.fault = f"expected it armed in the mode mission in time, got {armed} in {mode}"
        elif self.steps and now >= self.due:
            command, params, optional = self.steps[0]
            if optional and self.tries >= _OPTIONAL_TRIES:
                self._next()
                return
            self.asked_to_arm = self.asked_to_arm or command == _ARM
            self._send(command, params)
            self.tries += 1
            self.due = now + self.station.limits.repeat_after

    def _send(self, command: int, params: Sequence[float]) -> None:
        filled = [*params, *(0.0,) * (7 - len(params))]
        address = self.vehicle.system, self.vehicle.component
        message = self.station.dialect.MAVLink_command_long_message(
            *address, command, min(self.tries, 255), *filled
        )
        self.station.send(self.vehicle, message)

    def disarm(self) -> None:
        """Disarm a vehicle that was asked to arm and is not known to be in the air."""
        telemetry = self.launch.telemetry
        if self.asked_to_arm and telemetry.on_ground is not False:
            for _ in range(_OPTIONAL_TRIES):
                self._send(_ARM, (0,))


def start_missions(
    fleet: Fleet,
    *,
    begin: float,
    tolerance: float = 10.0,
    on_event: Callable[[str], None] = lambda _text: None,
) -> None:
    """Arm each vehicle and start its mission at its time. This is what ``--arm`` allows.

    A vehicle that cannot start within the tolerance does not start, because the plan keeps
    vehicles apart only if each starts in time; if it was armed by then, it is disarmed again.

    Parameters
    ----------
    fleet : Fleet
        A fleet that `check_fleet` has found ready.
    begin : float
        The common start time, on the fleet's clock.
    tolerance : float
        Seconds by which a start may be late.
    on_event : callable, optional
    """
    check_function(on_event, what="on_event", optional=False)
    waiting = sorted(fleet.launches.values(), key=lambda launch: (launch.start, launch.robot))
    fleet.starters = {}
    while waiting or fleet.starters:
        now = fleet.now()
        while waiting and now >= begin + waiting[0].start:
            launch = waiting.pop(0)
            station, vehicle = fleet.vehicles[launch.robot]
            latest = station.now() + begin + launch.start + tolerance - now
            fleet.starters[launch.robot] = _Starter(launch, station, vehicle, latest)
        for robot, starter in list(fleet.starters.items()):
            if not starter.flying:
                starter.go_on()
            launch = starter.launch
            if starter.flying and starter.fault is None:
                launch.status, launch.started_s = STARTED, round(now - begin, 2)
                on_event(f"robot {robot}: started after {launch.started_s:g} s")
            elif starter.fault is not None:
                starter.disarm()
                launch.status = MISSED
                launch.faults.append(starter.fault)
                on_event(f"robot {robot}: not started: {starter.fault}")
            else:
                continue
            del fleet.starters[robot]
        if waiting or fleet.starters:
            soon = now + (_SLICE if fleet.starters else 1.0)
            fleet.listen(min([soon, *(begin + launch.start for launch in waiting[:1])]))


_COMMANDS = {
    _ARM: "arming",
    _SET_MODE: "the change of mode",
    _START: "the start of the mission",
    _SET_CURRENT: "the choice of the first item",
}
_FINAL = (2, 3)  # MAV_RESULT: denied and unsupported, which do not pass
_OPTIONAL_TRIES = 3


def watch_fleet(
    fleet: Fleet,
    *,
    of: Collection[int] | None = None,
    seconds: float | None = None,
    every: float = 5.0,
    on_report: Callable[[list[Launch]], None] = lambda _launches: None,
) -> None:
    """Listen until all vehicles have flown and are disarmed on the ground, or for a time.

    Parameters
    ----------
    fleet : Fleet
    of : collection of int, optional
        The robots that are flying; by default, all robots.
    seconds : float, optional
        How long at most; by default, until all are back.
    every : float
        Seconds between two reports.
    on_report : callable, optional
        Function that is called with the launches of these robots.
    """
    check_function(on_report, what="on_report", optional=False)
    until = None if seconds is None else fleet.now() + seconds
    launches = [fleet.launches[robot] for robot in fleet.vehicles if of is None or robot in of]
    flown = {launch.robot for launch in launches if launch.telemetry.armed}
    due = fleet.now()
    while launches:
        now = fleet.now()
        if now >= due:
            due = now + every
            on_report(launches)
        flown |= {launch.robot for launch in launches if launch.telemetry.armed}
        if all(launch.robot in flown and not launch.telemetry.armed for launch in launches):
            break
        if until is not None and now >= until:
            break
        fleet.listen(min(due, now + 0.5, *([] if until is None else [until])))
    on_report(launches)
