"""A robot's vehicle behind MAVLink: guided set-points, what the autopilot must be set to, and what
happens when something is lost.

The companion computer is a ground station for its autopilot: its heartbeats and set-points are what
the autopilot's own watchdogs wait for. When the companion dies, they end, and the autopilot returns
by itself: ArduPilot by FS_GCS_ENABLE after FS_GCS_TIMEOUT, PX4 by COM_OBL_RC_ACT after
COM_OF_LOSS_T. These settings are read before take-off, and without them no vehicle takes off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import ShoalError
from shoal.robots import modes
from shoal.robots.mavlink import (
    ARDUPILOT,
    PX4,
    STATION,
    HeardVehicle,
    LinkError,
    Station,
    type_text,
)
from shoal.robots.mission_protocol import FENCE, RefusedError, UnansweredError, download_items
from shoal.robots.tasks import RobotTask
from shoal.search.simulation.live.ports import Leg

_ARM, _SET_MODE, _TAKE_OFF = 400, 176, 22  # MAV_CMD
_RELATIVE = 6  # MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
_POSITION_ALONE = 0b110111111000  # set-point without velocity, acceleration and yaw
_EVERY = 0.25  # seconds between two set-points: PX4 needs more than two a second
_AGAIN = 1.0  # seconds between two commands that have no effect yet
_FIX_3D = 3  # GPS_FIX_TYPE
_CHECKS = ("failsafe", "fence", "return")
_NEAR = 0.2  # share of a cell within which a vehicle has arrived
_NEAREST, _FARTHEST = 0.5, 3.0  # metres
_LANDED = 0.5  # metres above home


class Setting(NamedTuple):
    """A setting of an autopilot that must be right before take-off.

    ``names`` are the names of the parameter in several versions, ``allowed`` the values that are
    right or, as a pair with ``between``, the least and the largest.
    """

    check: str
    names: tuple[str, ...]
    allowed: tuple[float, ...]
    why: str
    between: bool = False

    def fits(self, value: float) -> bool:
        """Return whether a value is right."""
        if self.between:
            return self.allowed[0] <= value <= self.allowed[1]
        return any(abs(value - one) < 1e-3 for one in self.allowed)

    @property
    def text(self) -> str:
        """The right values in words."""
        if self.between:
            return f"{self.allowed[0]:g} to {self.allowed[1]:g}"
        return " or ".join(f"{value:g}" for value in self.allowed)


def settings_for(autopilot: int, kind: str, height: float) -> list[Setting]:
    """Return what an autopilot must be set to before a vehicle of a kind takes off.

    Parameters
    ----------
    autopilot : int
        MAV_AUTOPILOT.
    kind : str
        Kind of vehicle.
    height : float
        Height in metres above home at which this robot returns, and no other.
    """
    flies = kind != "rover"
    if autopilot == PX4:
        found = [
            Setting("failsafe", ("COM_OBL_RC_ACT",), (3, 4), "return or land without set-points"),
            Setting("failsafe", ("COM_OF_LOSS_T",), (0.1, 10), "seconds without them", between=True),
            Setting("failsafe", ("NAV_DLL_ACT",), (2, 3), "return or land without a heartbeat"),
            Setting("fence", ("GF_ACTION",), (3, 5), "return or land at the fence"),
        ]
        names, unit = ("RTL_RETURN_ALT",), 1.0
    else:
        enabled = (1, 3, 4, 5) if flies else (1,)
        found = [
            Setting("failsafe", ("FS_GCS_ENABLE",), enabled, "return or land without a heartbeat"),
            Setting("failsafe", ("FS_GCS_TIMEOUT",), (1, 30), "seconds without one", between=True),
            Setting(
                "failsafe",
                ("SYSID_MYGCS", "MAV_GCS_SYSID"),
                (STATION[0],),
                "the companion's heartbeats count, and no other station has its system id",
            ),
            Setting("fence", ("FENCE_ENABLE",), (1,), "the fence is on"),
            Setting("fence", ("FENCE_ACTION",), (1, 2, 3, 4, 5), "it acts"),
        ]
        names, unit = ("RTL_ALT",), 100.0
    if flies:
        least, most = unit * (height - 0.5), unit * (height + 0.5)
        why = "this robot returns at a height of its own"
        found.append(Setting("return", names, (least, most), why, between=True))
    return found


def safe_parameters(autopilot: int, kind: str, height: float) -> dict[str, float]:
    """Return parameters that are right, such as those of simulated autopilots."""
    return {
        one.names[0]: sum(one.allowed) / 2 if one.check == "return" else one.allowed[one.between]
        for one in settings_for(autopilot, kind, height)
    } | ({"COM_OF_LOSS_T": 2.0} if autopilot == PX4 else {"FS_GCS_TIMEOUT": 5.0})


class GuidedVehicle:
    """A vehicle behind MAVLink that a robot's agent moves (`Vehicle`).

    Parameters
    ----------
    station : Station
        The companion's side of the link to the autopilot.
    task : RobotTask
    number : int
        Number of the robot.
    system : int, optional
        MAVLink system id. By default, the only one that is heard.
    arm : bool
        Whether to arm the vehicle. Without it, the robot waits until somebody has armed it.
    accepted : collection of str
        Checks that the operator has made instead: "failsafe", "fence" or "return".
    say : callable
        Function that receives texts for the operator.

    Attributes
    ----------
    fault : str
        Why the vehicle can no longer do what it is told.
    """

    def __init__(
        self,
        station: Station,
        task: RobotTask,
        number: int,
        *,
        system: int | None = None,
        arm: bool = False,
        accepted: Collection[str] = (),
        say: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self.station, self.task, self.number, self._system = station, task, number, system
        self.arms, self.accepted, self._say = arm, accepted, say
        self.fault = ""
        self.height = task.height(number)
        self.size = task.plan.grid.size
        self.near = min(max(_NEAR * self.size, _NEAREST), _FARTHEST)
        self.vehicle: HeardVehicle | None = None
        self.position: NDArray[np.float64] | None = None  # metres: x, y, height above home
        self.battery: float | None = None
        self.on_ground: bool | None = None
        self._position_at = self._fix_at = -math.inf
        self._leg: Leg | None = None
        self._way: list[NDArray[np.float64]] = []  # corners that are still ahead
        self._allowed: list[NDArray[np.float64]] = []  # those after `enter`
        self._target: NDArray[np.float64] | None = None
        self._flying = self._commanded = self._returning = False
        self._told = self._dead = self._safe = False
        self._next_setpoint = self._next_command = -math.inf
        station.on_message = self._take

    # -- before take-off ------------------------------------------------------------------------

    def prepare(self) -> list[str]:
        """Find the autopilot, and check its settings. Return what is wrong, a sentence each.

        Raises
        ------
        LinkError
            If no autopilot is heard, or several are.
        """
        station = self.station
        end = station.now() + station.limits.find_within
        settled: float | None = None
        while station.now() < end and (settled is None or station.now() < settled):
            station.listen(station.now() + 0.1)
            if self._candidates() and settled is None:
                settled = station.now() + station.limits.settle
        found = self._candidates()
        where = f"system {self._system}" if self._system is not None else "an autopilot"
        if not found:
            raise LinkError(
                f"vehicle: expected a heartbeat of {where} on {station.link.name} within"
                f" {station.limits.find_within:g} s, got none"
            )
        if len(found) > 1:
            raise LinkError(
                f"vehicle: expected one autopilot on {station.link.name}, got systems"
                f" {', '.join(str(one.system) for one in found)}: name one with --system"
            )
        self.vehicle = found[0]
        if self.vehicle.autopilot not in (PX4, ARDUPILOT):
            return [f"expected PX4 or ArduPilot, got a {type_text(self.vehicle)}"]
        faults = [
            *self._check_settings(),
            *([] if "fence" in self.accepted else self._check_fence()),
        ]
        end = station.now() + self.task.limits.position_s
        while self.position is None and station.now() < end:
            station.listen(station.now() + 0.1)
        if self.position is None:
            faults.append("expected a position (GLOBAL_POSITION_INT), got none")
        if self.battery is not None and self.battery <= self.task.limits.battery:
            least = 100 * self.task.limits.battery
            faults.append(
                f"expected a battery above {least:.0f} %, got {100 * self.battery:.0f} %"
            )
        return faults

    def _candidates(self) -> list[HeardVehicle]:
        heard = self.station.vehicles
        return [one for one in heard.values() if self._system in (None, one.system)]

    def _check_settings(self) -> list[str]:
        assert self.vehicle is not None
        faults = []
        for one in settings_for(self.vehicle.autopilot, self.task.kind, self.height):
            if one.check in self.accepted:
                continue
            value = next(
                (got for name in one.names if (got := self.parameter(name)) is not None), None
            )
            if value is None or not one.fits(value):
                faults.append(
                    f"{one.check}: expected {one.names[0]} {one.text} ({one.why}), got"
                    f" {'none' if value is None else f'{value:g}'}"
                )
        return faults

    def parameter(self, name: str) -> float | None:
        """Read a parameter of the autopilot; None if it does not have it or does not answer."""
        assert self.vehicle is not None
        address = self.vehicle.system, self.vehicle.component
        request = self.station.dialect.MAVLink_param_request_read_message(
            *address, name.encode(), -1
        )
        for _ in range(4):
            self.station.send(self.vehicle, request)
            until = self.station.now() + self.station.limits.repeat_after
            while (message := self.station.receive(self.vehicle, until)) is not None:
                if message.get_type() == "PARAM_VALUE" and message.param_id.rstrip("\0") == name:
                    return _parameter_value(message, self.vehicle.autopilot)
        return None

    def _check_fence(self) -> list[str]:
        assert self.vehicle is not None
        try:
            items = download_items(self.station, self.vehicle, FENCE, unanswered=4)
        except (RefusedError, UnansweredError) as error:
            return [f"fence: {error}"]
        return [] if items else ["fence: expected a fence on board, got none"]

    # -- the port -------------------------------------------------------------------------------

    def where(self) -> tuple[float, ...]:
        """Return the vehicle's position in cell sides."""
        cells = self.task.plan.tour_cost.points
        if self.position is None:
            return tuple(cells[self.task.scenario.starts[self.number - 1]].tolist())
        place = (self.position[:2] / self.size).tolist()
        return (*place, *cells[self._nearest()][2:].tolist())

    def _nearest(self) -> int:
        assert self.position is not None
        away = np.linalg.norm(self.task.cells[:, :2] - self.position[:2], axis=1)
        return int(away.argmin())

    def go(self, leg: Leg, time: float) -> None:
        """Begin a leg: along the corners of a path that stays inside the region."""
        self._leg = leg
        if leg.home:
            self._returning = True
            return
        self._returning = False
        corners = self._corners(leg)
        # the halt is one cell before the end, or where the vehicle is if that is nearer
        self._allowed = corners
        self._way = _shortened(self._here(), corners, self.size)

    def _corners(self, leg: Leg) -> list[NDArray[np.float64]]:
        cells, here = self.task.cells, self._here()
        if leg.through:
            return [self._raised(cells[cell]) for cell in leg.through]
        goal = cells[leg.cell]
        region = self.task.plan.grid.region
        try:
            way = self.task.plan.paths.way(here[:2], goal[:2])
        except ShoalError:  # from outside the region, as after a launch outside it
            way = np.array([here[:2], goal[:2]])
        del region
        return [self._raised(np.array([*corner[:2], *goal[2:]])) for corner in way[1:]]

    def _raised(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a point with this robot's height. In layers, robots are apart in each of them."""
        up = self.height
        if len(point) > 2:
            up = float(point[2]) + self.height - self.task.height(1)
        return np.array([point[0], point[1], up])

    def _here(self) -> NDArray[np.float64]:
        if self.position is not None:
            return self.position
        return self._raised(self.task.cells[self.task.scenario.starts[self.number - 1]])

    def enter(self) -> None:
        """Go on to the end of the leg."""
        passed = len(self._allowed) - max(1, len(self._way))
        self._way = self._allowed[passed:] if self._way else self._allowed[-1:]

    def step(self, time: float) -> bool:
        """Listen to the autopilot, and send it what is due."""
        if self._dead:
            return False
        try:
            self.station.listen(self.station.now())
        except LinkError as error:
            self._fail(f"autopilot: {error}")
            return False
        self._check()
        if self.fault:
            return False
        if self._returning:
            self._command_mode(modes.RETURN)
            return self.landed
        if self._leg is None and not self._flying:
            return False
        if not self._flying:
            self._take_off()
            return False
        here = self._here()
        while len(self._way) > 1 and self._is_at(here, self._way[0]):
            del self._way[0]
        if self._way:
            self._target = self._way[0]
        self._send_setpoint()
        return self._leg is not None and (not self._way or self._is_at(here, self._way[-1]))

    def _is_at(self, here: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
        across = float(np.linalg.norm(here[:2] - point[:2]))
        return across <= self.near and (
            self.task.kind == "rover" or abs(here[2] - point[2]) <= max(1.0, self.near)
        )

    def due(self, time: float) -> float:
        """Return the time of the next step: soon, because messages come and go all the time."""
        return time + _EVERY / 2 * self.task.speed

    def stop(self, time: float) -> None:
        """Stand still."""
        if self._leg is not None and self._flying and not self._returning:
            self._way = [np.array([*self._here()[:2], self._here()[2]])]
            self._leg = None

    def left(self) -> float | None:
        """Return the fraction of the battery that is left."""
        return self.battery

    @property
    def landed(self) -> bool:
        """Whether the vehicle is on the ground with its motors off."""
        vehicle = self.vehicle
        if vehicle is None or vehicle.armed:
            return False
        self._flying = self._commanded = False
        return True

    def secure(self) -> None:
        """Return; without a position land; without an autopilot fall silent, so that its watchdog
        acts; and leave the vehicle to the pilot if it is the pilot's.
        """
        self._safe = True
        if self.fault.startswith("autopilot"):
            self._dead = True
        elif not self.fault.startswith("pilot") and self._flying:
            self._returning, self._next_command = True, -math.inf
            self._command_mode(self._safe_mode)

    @property
    def _safe_mode(self) -> str:
        return modes.LAND if self.fault.startswith("position") else modes.RETURN

    def rest(self, seconds: float) -> bool:
        """Bring the vehicle down, and return whether it is on the ground within a time."""
        end = self.station.now() + seconds
        if not self._safe:
            self._returning = self._flying
        while not self._dead and self.station.now() < end:
            try:
                self.station.listen(self.station.now() + 0.1)
            except LinkError:
                break
            if self.landed:
                return True
            if self._returning and not self.fault.startswith("pilot"):
                self._command_mode(self._safe_mode)
        return False

    # -- the link -------------------------------------------------------------------------------

    def _take(self, vehicle: HeardVehicle, message: Any) -> None:
        if self.vehicle is not None and vehicle is not self.vehicle:
            return
        if self._system not in (None, vehicle.system):
            return
        now, name = self.station.now(), message.get_type()
        if name == "GLOBAL_POSITION_INT" and (message.lat, message.lon) != (0, 0):
            degrees = np.array([[message.lon / 1e7, message.lat / 1e7]])
            place = self.task.frame.to_metres(degrees)[0]
            self.position = np.array([*place, message.relative_alt / 1000])
            self._position_at = now
        elif name == "GPS_RAW_INT":
            if message.fix_type >= _FIX_3D:
                self._fix_at = math.inf
            elif self._fix_at == math.inf:
                self._fix_at = now
        elif name == "SYS_STATUS" and message.battery_remaining >= 0:
            self.battery = message.battery_remaining / 100
        elif name == "EXTENDED_SYS_STATE" and message.landed_state:
            self.on_ground = message.landed_state == 1

    def _fail(self, text: str) -> None:
        if not self.fault:
            self.fault = text

    def _check(self) -> None:
        """Note a fault if something that the robot needs is lost."""
        assert self.vehicle is not None
        now, limits = self.station.now(), self.task.limits
        silent = now - self.vehicle.heard_at
        if silent > limits.autopilot_s:
            self._fail(f"autopilot: not heard for {silent:.0f} s")
        if not self._flying:
            return
        without = max(
            now - self._position_at, now - self._fix_at if math.isfinite(self._fix_at) else 0.0
        )
        mode = modes.mode_name(
            self.vehicle.autopilot, self.vehicle.type, self.vehicle.custom_mode
        )
        if without > limits.position_s:
            self._fail(f"position: none for {without:.0f} s")
        elif self.battery is not None and self.battery <= limits.battery:
            self._fail(f"battery: {100 * self.battery:.0f} % left")
        elif not self._returning and not self.vehicle.armed:
            self._fail("pilot or autopilot: the vehicle was disarmed")
        elif not self._returning and mode != modes.GUIDED:
            said = f"; the vehicle says {self.vehicle.texts[-1]!r}" if self.vehicle.texts else ""
            self._fail(f"pilot or autopilot: the mode was changed to {mode}{said}")

    def _take_off(self) -> None:
        """Go on with the take-off: the guided mode, armed, and up."""
        assert self.vehicle is not None
        vehicle, now = self.vehicle, self.station.now()
        numbers = modes.custom_modes(vehicle.autopilot, vehicle.type)
        if self.battery is not None and self.battery <= self.task.limits.battery:
            self._fail(f"battery: {100 * self.battery:.0f} % left before take-off")
            return
        here = self._here()
        self._target = np.array([*here[:2], self.height])
        if not self.arms and not vehicle.armed:
            if not self._told:
                self._told = True
                self._say("waiting until somebody arms the vehicle, because --arm was not given")
            return
        guided = vehicle.custom_mode == numbers[modes.GUIDED]
        if vehicle.autopilot == PX4 or (guided and vehicle.armed):
            self._send_setpoint()  # PX4 changes to offboard only while set-points come
        if guided and vehicle.armed and here[2] >= self.height - 1.0:
            self._flying = True
            return
        if now < self._next_command:
            return
        self._next_command = now + _AGAIN
        if not guided:
            self._set_mode(modes.GUIDED)
        elif not vehicle.armed:
            self._command(_ARM, 1)
        elif vehicle.autopilot == ARDUPILOT and self.task.kind != "rover":
            self._command(_TAKE_OFF, 0, 0, 0, 0, 0, 0, self.height)

    def _send_setpoint(self) -> None:
        assert self.vehicle is not None
        now = self.station.now()
        if self._target is None or now < self._next_setpoint:
            return
        self._next_setpoint = now + _EVERY
        longitude, latitude = self.task.frame.to_degrees(self._target[None, :2])[0]
        self.station.send(
            self.vehicle,
            self.station.dialect.MAVLink_set_position_target_global_int_message(
                round(1000 * now) % 2**32,
                self.vehicle.system,
                self.vehicle.component,
                _RELATIVE,
                _POSITION_ALONE,
                round(1e7 * latitude),
                round(1e7 * longitude),
                float(self._target[2]),
                *(0.0,) * 8,
            ),
        )

    def _command_mode(self, mode: str) -> None:
        """Command a mode again and again until the vehicle is in it, or on the ground."""
        assert self.vehicle is not None
        numbers = modes.custom_modes(self.vehicle.autopilot, self.vehicle.type)
        wanted = numbers.get(mode, numbers[modes.RETURN])
        now = self.station.now()
        if self.vehicle.custom_mode != wanted and self.vehicle.armed and now >= self._next_command:
            self._next_command = now + _AGAIN
            self._set_mode(mode if mode in numbers else modes.RETURN)

    def _set_mode(self, mode: str) -> None:
        assert self.vehicle is not None
        number = modes.custom_modes(self.vehicle.autopilot, self.vehicle.type)[mode]
        if self.vehicle.autopilot == PX4:
            self._command(_SET_MODE, modes.CUSTOM, number >> 16 & 255, number >> 24 & 255)
        else:
            self._command(_SET_MODE, modes.CUSTOM, number)

    def _command(self, command: int, *params: float) -> None:
        assert self.vehicle is not None
        filled = [*params, *(0.0,) * (7 - len(params))]
        address = self.vehicle.system, self.vehicle.component
        message = self.station.dialect.MAVLink_command_long_message(*address, command, 0, *filled)
        self.station.send(self.vehicle, message)


def _parameter_value(message: Any, autopilot: int) -> float:
    """Return a parameter's value. PX4 sends the bytes of an integer as those of a float32."""
    if autopilot == PX4 and message.param_type in (5, 6):  # MAV_PARAM_TYPE_UINT32, INT32
        kind = np.int32 if message.param_type == 6 else np.uint32
        return float(np.float32(message.param_value).view(kind))
    return float(message.param_value)


def _shortened(
    here: NDArray[np.float64], corners: Sequence[NDArray[np.float64]], less: float
) -> list[NDArray[np.float64]]:
    """Return the corners of a path that ends ``less`` metres before the last one; none if the whole
    path is not longer.
    """
    points = [here, *corners]
    for number in range(len(points) - 1, 0, -1):
        step = points[number] - points[number - 1]
        length = float(np.linalg.norm(step[:2]))
        if length > less:
            return [*points[1:number], points[number] - step * (less / length)]
        less -= length
    return []
