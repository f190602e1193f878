"""A robot's vehicle behind MAVLink: guided set-points, what is checked before take-off, and what
happens when something is lost.

The companion computer is a ground station for its autopilot: its heartbeats and set-points are what
the autopilot's own watchdogs wait for. When the companion dies, they end, and the autopilot returns
by itself: ArduPilot by FS_GCS_ENABLE after FS_GCS_TIMEOUT, PX4 by COM_OBL_RC_ACT after
COM_OF_LOSS_T. These settings are read before take-off, and without them no vehicle takes off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError, ShoalError
from shoal.robots import modes
from shoal.robots.mavlink import (
    ARDUPILOT,
    KINDS_OF_TYPES,
    PX4,
    HeardVehicle,
    LinkError,
    Station,
    type_text,
)
from shoal.robots.mission_protocol import (
    FENCE,
    RALLY,
    MissionItem,
    RefusedError,
    UnansweredError,
    download_items,
    fence_areas,
)
from shoal.robots.settings import (
    LAST_STATION,
    MY_STATION,
    names_to_read,
    settings_for,
    wrong_settings,
)
from shoal.robots.tasks import RobotTask
from shoal.search.simulation.live.ports import Leg

_ARM, _SET_MODE, _TAKE_OFF = 400, 176, 22  # MAV_CMD
_RELATIVE = 6  # MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
_POSITION_ALONE = 0b110111111000  # set-point without velocity, acceleration and yaw
_EVERY = 0.25  # seconds between two set-points: PX4 needs more than two a second
_PATIENCE = {True: 120.0, False: 900.0}  # seconds for a take-off, and for the pilot to arm
_AGAIN = 1.0  # seconds between two commands that have no effect yet
_GATES = 50  # cells near a launch point by which a way into the region may lead
_ASKED = 12  # times that a parameter is asked for
_FIX_3D = 3  # GPS_FIX_TYPE
_LEVEL = 1.0  # metres: tolerance of the height
_ALOFT = 1.0  # metres above home, from which on a vehicle is in flight

GROUND, CLIMB, FLIGHT, RETURN = "on the ground", "climbing", "in flight", "returning"


class GuidedVehicle:
    """A vehicle behind MAVLink that a robot's agent moves (`RobotVehicle`).

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
    phase : str
        "on the ground", "climbing", "in flight" or "returning".
    position : ndarray of float64, shape (3,), or None
        Metres east, north and above home.
    battery : float or None
        Fraction that is left.
    takes_turns : bool
        Whether the vehicle waits for its turn to take off, as at the beginning of the search.
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
        self.fault, self.phase = "", GROUND
        self.height = task.height(number)
        self.size = task.plan.grid.size
        self.near = task.arrival_m
        self.vehicle: HeardVehicle | None = None
        self.position: NDArray[np.float64] | None = None
        self.battery: float | None = None
        self._charge_known_at = -math.inf
        self.on_ground: bool | None = None
        self._position_at, self._fix_lost_at = -math.inf, math.inf
        self._leg: Leg | None = None
        self._leg_waypoints: list[NDArray[np.float64]] = []  # still ahead, to the end of the leg
        self._waypoints: list[NDArray[np.float64]] = []  # those of them before the halt
        self._target: NDArray[np.float64] | None = None
        self.takes_turns = True
        self._turn: float | None = None  # time from which on it may take off
        self._announced: set[str] = set()
        self._silent = False
        self._alone_at = math.inf  # time at which no other autopilot spoke under the same system id
        self._next_setpoint = self._next_command = -math.inf
        # where it enters the region from a launch point outside
        self._gate: NDArray[np.float64] | None = None
        self._stations: Collection[int] = ()  # whose heartbeats the autopilot waits for
        station.on_message = self._take

    # -- before take-off ------------------------------------------------------------------------

    def prepare(self) -> list[str]:
        """Find the autopilot, and check its settings. Return what is wrong, a sentence each.

        Raises
        ------
        LinkError
            If no autopilot is heard, or several are.
        """
        self.vehicle = vehicle = self._find()
        if vehicle.autopilot not in (PX4, ARDUPILOT):
            return [f"expected PX4 or ArduPilot, got a {type_text(vehicle)}"]
        kind = self.task.kind
        if kind not in ("multirotor", "rover"):
            return [
                f"expected vehicles that can stand still (multirotor or rover), got {kind}: fly"
                " missions instead"
            ]
        if kind not in KINDS_OF_TYPES.get(vehicle.type, ()):
            return [f"expected a {kind} as in the task, got a {type_text(vehicle)}"]
        settings = settings_for(vehicle.autopilot, kind, self.height)
        values = self.read_parameters(*names_to_read(settings))
        faults = wrong_settings(settings, values, self.height, accepted=self.accepted)
        if "failsafe" not in self.accepted and vehicle.autopilot == ARDUPILOT:
            faults += self._become_station(values)
        faults += self._check_items()
        end = self.station.now() + self.task.limits.position_s
        while (self.position is None or self._uncharged) and self.station.now() < end:
            self.station.listen(self.station.now() + 0.1)
        if self.position is None:
            faults.append("expected a position (GLOBAL_POSITION_INT), got none")
        if self._uncharged:
            faults.append(f"expected a battery above {self._reserve_text}, got {self._charge_text}")
        if not faults:
            self._take_over()
        return faults

    def _take_over(self) -> None:
        """Go on with a vehicle that is in flight when the robot's program is started anew."""
        assert self.vehicle is not None
        if not self._aloft:
            return
        if self._mode == modes.GUIDED:
            self.phase = FLIGHT
            self._target = np.array([*self._current_position()[:2], self.height])
        elif self._mode in (modes.RETURN, modes.LAND):
            self.phase = RETURN

    @property
    def _aloft(self) -> bool:
        """Whether the vehicle is armed and in the air, or on its way as a rover."""
        assert self.vehicle is not None
        if not self.vehicle.armed:
            return False
        return (
            self.task.kind == "rover"
            or self._current_position()[2] > _ALOFT
            or self.on_ground is False
        )

    def _find(self) -> HeardVehicle:
        """Return the vehicle, when all that speak on the link have been heard."""
        station = self.station
        end = station.now() + station.limits.find_within
        settled: float | None = None
        while station.now() < end and (settled is None or station.now() < settled):
            station.listen(station.now() + 0.1)
            if self._candidates() and settled is None:
                settled = station.now() + station.limits.settle
        candidates = self._candidates()
        if not candidates:
            who = f"system {self._system}" if self._system is not None else "an autopilot"
            raise LinkError(
                f"vehicle: expected a heartbeat of {who} on {station.link.name} within"
                f" {station.limits.find_within:g} s, got none"
            )
        if len(candidates) > 1:
            raise LinkError(
                f"vehicle: expected one autopilot on {station.link.name}, got systems"
                f" {', '.join(str(vehicle.system) for vehicle in candidates)}: name one with"
                " --system"
            )
        (vehicle,) = candidates
        if addresses := station.duplicates.get(vehicle.system):
            raise LinkError(
                f"vehicle: expected one autopilot with the system id {vehicle.system} on"
                f" {station.link.name}, got heartbeats from {len(addresses)} addresses at the same"
                " time: give each vehicle an id or a port of its own"
            )
        return vehicle

    def _candidates(self) -> list[HeardVehicle]:
        heard = self.station.vehicles
        return [vehicle for vehicle in heard.values() if self._system in (None, vehicle.system)]

    def read_parameters(
        self, names: Iterable[str], needed: Collection[str] = ()
    ) -> Mapping[str, float]:
        """Read parameters of the autopilot, as far as it has them.

        Parameters
        ----------
        names : iterable of str
        needed : collection of str
            Those that every autopilot has: reading goes on until they have come.
        """
        assert self.vehicle is not None
        station, vehicle = self.station, self.vehicle
        missing, values = {*names}, dict[str, float]()
        for tried in range(_ASKED):
            if not missing or (tried >= _ASKED // 2 and not missing & {*needed}):
                break
            for name in sorted(missing):
                station.send(
                    vehicle,
                    station.dialect.MAVLink_param_request_read_message(
                        vehicle.system, vehicle.component, name.encode(), -1
                    ),
                )
            until = station.now() + station.limits.repeat_after
            while missing and (message := station.receive(vehicle, until)) is not None:
                name = message.get_type() == "PARAM_VALUE" and message.param_id.rstrip("\0")
                if name in missing:
                    values[name] = _parameter_value(message, vehicle.autopilot)
                    missing.discard(name)
        return values

    def _become_station(self, values: Mapping[str, float]) -> list[str]:
        """Take the system id whose heartbeats the autopilot waits for. Refuse if another station
        has it: the autopilot would take that station's heartbeats for ours.
        """
        first = next((int(values[name]) for name in MY_STATION if name in values), None)
        if first is None:
            return []
        self.station.take_system(first)
        self._stations = range(first, max(first, int(values.get(LAST_STATION, 0))) + 1)
        until = self.station.now() + 2.5 * self.station.limits.heartbeat
        while self.station.now() < until:
            self.station.listen(until)
        return [
            f"failsafe: expected no other station with the system id {system}, got one: with its"
            f" heartbeats, the autopilot would not notice that this companion is lost. Give one of"
            " them another system id"
            for system in self._stations
            if system in self.station.stations
        ]

    def _check_items(self) -> list[str]:
        """Check that a fence is on board and, as all vehicles would return there, no rally point."""
        assert self.vehicle is not None
        faults = []
        if "fence" not in self.accepted:
            try:
                faults += self._check_fence(download_items(self.station, self.vehicle, FENCE))
            # the last of a fence at another place on Earth
            except (RefusedError, UnansweredError, InvalidInputError) as error:
                faults.append(f"fence: {error}")
        if "return" not in self.accepted:
            try:
                points = len(download_items(self.station, self.vehicle, RALLY))
            except (RefusedError, UnansweredError):
                points = 0  # the autopilot has no such points
            if points:
                faults.append(
                    "return: expected no rally points on board, to which several robots would"
                    f" return, got {points}"
                )
        return faults

    def _check_fence(self, items: Sequence[MissionItem]) -> list[str]:
        """Check that the robot can fly inside a fence: from a launch point outside the region, it
        takes a way into the region that stays inside.
        """
        import shapely

        if not items:
            return ["fence: expected a fence on board, got none"]
        frame, plan = self.task.frame, self.task.plan
        assert self.vehicle is not None
        areas = fence_areas(
            items,
            lambda *place: frame.to_metres(np.array([place]))[0],
            all_inside=self.vehicle.autopilot == ARDUPILOT,
        )
        inside = [area for area, within in areas if within]
        zones = [area for area, within in areas if not within]
        if not inside:
            return ["fence: expected a polygon that vehicles must not leave, got none"]
        free = shapely.difference(shapely.union_all(inside), shapely.union_all(zones))
        cells = self.task.cells[:, :2]
        missed = int((~shapely.covers(free, shapely.points(cells))).sum())
        if missed:
            return [f"fence: expected a fence around all cells, got {missed} cells outside of it"]
        place = plan.places[self.number - 1]
        if plan.grid.region.contains(place[None])[0]:
            return []
        near = np.linalg.norm(cells - place, axis=1).argsort()[:_GATES].tolist()
        for cell in (self.task.scenario.starts[self.number - 1], *near):
            if shapely.covers(free, shapely.LineString(plan.leg(place, cells[cell]))):
                self._gate = cells[cell]
                return []
        return ["fence: expected a way from the launch point to the region inside the fence"]

    # -- the port -------------------------------------------------------------------------------

    def where(self) -> tuple[float, ...]:
        """Return the vehicle's position in cell sides."""
        cells = self.task.plan.tour_cost.points
        if self.position is None:
            return tuple(cells[self.task.scenario.starts[self.number - 1]].tolist())
        distances = np.linalg.norm(self.task.cells[:, :2] - self.position[:2], axis=1)
        layer = cells[int(distances.argmin())][2:]
        return (*(self.position[:2] / self.size).tolist(), *layer.tolist())

    def go(self, leg: Leg, time: float) -> None:
        """Begin a leg: along the corners of a path that stays inside the region."""
        self._leg = leg
        if leg.home:
            path = self._path(self._current_position()[:2], self.task.plan.places[self.number - 1])
            self._waypoints = self._leg_waypoints = [self._at_height(corner) for corner in path[1:]]
            return
        if self.phase == RETURN:  # the autopilot brings it down first
            self._say_once("returns before it searches on")
        self._leg_waypoints = self._plan_waypoints(leg)
        self._waypoints = _shorten_path(self._current_position(), self._leg_waypoints, self.size)
        if (
            self._waypoints
            and math.dist(self._current_position()[:2], self._waypoints[-1][:2]) <= self.near
        ):
            self._waypoints = []  # it stands one cell before the end, as near as it comes

    def _plan_waypoints(self, leg: Leg) -> list[NDArray[np.float64]]:
        cells, position = self.task.cells, self._current_position()
        if leg.through:
            return [self._at_height(cells[cell]) for cell in leg.through]
        goal = cells[leg.cell]
        path = self._path(position[:2], goal[:2])
        return [self._at_height(np.array([*corner, *goal[2:]])) for corner in path[1:]]

    def _path(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a path that stays inside the region, float64, shape (k, 2); from outside, as after
        a gust, it leads to the nearest cell first.
        """
        plan, cells = self.task.plan, self.task.cells[:, :2]
        within = plan.grid.region.contains(np.stack([start, end]))
        try:
            if self._gate is not None and not within.all():  # as the fence allows
                first, second = plan.leg(start, self._gate), plan.leg(self._gate, end)
                return np.vstack([first, second[1:]])
            return plan.leg(start, end)
        except ShoalError:
            entry = cells[int(np.linalg.norm(cells - start, axis=1).argmin())]
            return np.vstack([start, plan.leg(entry, end)])

    def _at_height(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a point with this robot's height. In layers, robots are apart in each of them."""
        up = self.height
        if len(point) > 2:
            up = float(point[2]) + self.height - self.task.height(1)
        return np.array([point[0], point[1], up])

    def _current_position(self) -> NDArray[np.float64]:
        if self.position is not None:
            return self.position
        return self._at_height(self.task.cells[self.task.scenario.starts[self.number - 1]])

    def enter(self) -> None:
        """Go on to the end of the leg."""
        self._waypoints = self._leg_waypoints

    def step(self, time: float) -> bool:
        """Listen to the autopilot, and send it what is due."""
        if not self._listen():
            return False
        if self.phase == RETURN:
            self._return(modes.RETURN)
        elif self.phase == GROUND:
            if self._leg is not None and not self._leg.home:
                self._take_off(self._leg)
        elif self.phase == CLIMB:
            self._climb()
        elif self._leg is None or not self._leg.home:
            return self._fly()
        elif self._fly():
            self.phase, self._next_command = RETURN, -math.inf
        return self._has_arrived()

    def _fly(self) -> bool:
        position = self._current_position()
        while len(self._waypoints) > 1 and self._is_at(position, self._waypoints[0]):
            self._leg_waypoints = self._leg_waypoints[1:]
            self._waypoints = self._waypoints[1:]
        if self._waypoints:
            self._target = self._waypoints[0]
        self._send_setpoint()
        return self._leg is not None and (
            not self._waypoints or self._is_at(position, self._waypoints[-1])
        )

    def _has_arrived(self) -> bool:
        """Return whether the vehicle is where it may go; at home, that is on the ground."""
        if self._leg is None:
            return False
        if self._leg.home:
            return self.phase == GROUND
        arrived = not self._waypoints or self._is_at(self._current_position(), self._waypoints[-1])
        return self.phase == FLIGHT and arrived

    def _is_at(self, position: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
        across = float(np.linalg.norm(position[:2] - point[:2]))
        return across <= self.near and (
            self.task.kind == "rover" or abs(position[2] - point[2]) <= _LEVEL
        )

    def due(self, time: float) -> float:
        """Return the time of the next step: soon, because messages come and go all the time."""
        return time + _EVERY / 2 * self.task.speed

    def stop(self, time: float) -> None:
        """Stand still. A vehicle that waits before its cell may still enter it; on the way, it gives
        up its leg.
        """
        if self._has_arrived():
            return
        if self.phase in (CLIMB, FLIGHT):
            self._target = np.array([*self._current_position()[:2], self._target_height])
        self._leg, self._waypoints, self._leg_waypoints = None, [], []

    @property
    def _target_height(self) -> float:
        return self.height if self._target is None else float(self._target[2])

    def left(self) -> float | None:
        """Return the fraction of the battery that is left."""
        return self.battery

    def secure(self) -> None:
        """Return; without a position land; without an autopilot fall silent, so that its watchdog
        acts; and leave the vehicle to the pilot if it is the pilot's.
        """
        self._leg, self._waypoints, self._leg_waypoints = None, [], []
        if self.fault.startswith("autopilot"):
            self._silent = True
        elif self.phase != GROUND and not self._is_pilots:
            self.phase, self._next_command = RETURN, -math.inf
            self._return(self._safe_mode)

    @property
    def _is_pilots(self) -> bool:
        return self.fault.startswith("pilot")

    @property
    def _safe_mode(self) -> str:
        return modes.LAND if self.fault.startswith("position") else modes.RETURN

    def bring_home(self, seconds: float) -> bool:
        """Bring the vehicle home, and return whether it is on the ground.

        Robots return one after another, the lowest first, so that none crosses below another one
        that descends. They fly along a path around no-go zones, and then command the return, which
        lands. With a fault, a robot commands the return at once, and its autopilot flies straight.

        Parameters
        ----------
        seconds : float
            Time after the robot's turn within which it must be on the ground.
        """
        station = self.station
        turn = station.now() + (self.number - 1) * self.task.limits.apart_s
        if self.fault:
            turn = station.now()
        elif self.phase in (CLIMB, FLIGHT):
            self._target = np.array([*self._current_position()[:2], self._target_height])
        while station.now() < turn + seconds:
            if self._silent:
                return False
            if self._is_pilots:
                return self._wait_for_pilot()
            if self.phase == GROUND:
                return not self._aloft
            heard = self._listen(0.1)
            if self.fault and not self._silent and self.phase != RETURN:
                self.secure()
            elif heard and self.phase == CLIMB:
                self._climb()
            elif heard and self.phase == FLIGHT and station.now() < turn:
                self._send_setpoint()
            elif heard and self.phase == FLIGHT and self._fly_home():
                self.phase, self._next_command = RETURN, -math.inf
            if self.phase == RETURN:
                self._return(self._safe_mode)
        return self.phase == GROUND and not self._aloft

    def _wait_for_pilot(self) -> bool:
        """Send heartbeats, and nothing else, until the pilot has landed: without them, ArduPilot
        would take the vehicle out of the pilot's hands.
        """
        vehicle, station = self.vehicle, self.station
        assert vehicle is not None
        self._say_once("the vehicle is the pilot's; heartbeats go on until it is disarmed")
        while vehicle.armed:
            try:
                station.listen(station.now() + 0.5)
            except LinkError:
                return False
            if station.now() - vehicle.heard_at > self.task.limits.autopilot_s:
                return False
        self.phase = GROUND
        return True

    def _fly_home(self) -> bool:
        """Fly to the launch point, and return whether the vehicle is above it."""
        if self._leg is None or not self._leg.home:
            cell = self.task.scenario.starts[self.number - 1]
            goal = self.task.plan.places[self.number - 1] / self.size
            self.go(Leg(cell, tuple(goal.tolist()), 0.0, 0.0, home=True), 0.0)
        return self._fly()

    # -- the link -------------------------------------------------------------------------------

    def _listen(self, seconds: float = 0.0) -> bool:
        """Listen to the link. Return whether the vehicle does what it is told."""
        if self._silent:
            return False
        try:
            self.station.listen(self.station.now() + seconds)
        except LinkError as error:
            self._fail(f"autopilot: {error}")
            return False
        self._check()
        return not self.fault

    def _take(self, vehicle: HeardVehicle, message: Any) -> None:
        if self.vehicle is not None and vehicle is not self.vehicle:
            return
        if self._system not in (None, vehicle.system):
            return
        now, name = self.station.now(), message.get_type()
        if name == "GLOBAL_POSITION_INT" and (message.lat, message.lon) != (0, 0):
            degrees = np.array([[message.lon / 1e7, message.lat / 1e7]])
            try:
                place = self.task.frame.to_metres(degrees)[0]
            except InvalidInputError:
                return  # far from the region, as after an error: no position
            self.position = np.array([*place, message.relative_alt / 1000])
            self._position_at = now
        elif name == "GPS_RAW_INT":
            if message.fix_type >= _FIX_3D:
                self._fix_lost_at = math.inf
            else:
                self._fix_lost_at = min(self._fix_lost_at, now)
        elif name == "SYS_STATUS":
            known = message.battery_remaining >= 0
            self.battery = message.battery_remaining / 100 if known else None
            self._charge_known_at = now if known else self._charge_known_at
        elif name == "EXTENDED_SYS_STATE" and message.landed_state:
            self.on_ground = message.landed_state == 1

    def _fail(self, text: str) -> None:
        self.fault = self.fault or text

    def _say_once(self, text: str) -> None:
        if text not in self._announced:
            self._announced.add(text)
            self._say(text)

    @property
    def _charge_text(self) -> str:
        return "an unknown charge" if self.battery is None else f"{100 * self.battery:.0f} %"

    @property
    def _uncharged(self) -> bool:
        """Whether the battery is known to be too low for a take-off, or not known at all where the
        limits ask for some charge.
        """
        least = self.task.limits.battery
        return least > 0 if self.battery is None else self.battery <= least

    @property
    def _reserve_text(self) -> str:
        return f"{100 * self.task.limits.battery:.0f} %"

    @property
    def _mode(self) -> str:
        vehicle = self.vehicle
        assert vehicle is not None
        return modes.mode_name(vehicle.autopilot, vehicle.type, vehicle.custom_mode)

    def _check(self) -> None:
        """Note a fault if something that the robot needs is lost."""
        vehicle, limits, now = self.vehicle, self.task.limits, self.station.now()
        assert vehicle is not None
        if (silent := now - vehicle.heard_at) > limits.autopilot_s:
            self._fail(f"autopilot: not heard for {silent:.0f} s")
        for system in self._stations:
            if now - self.station.stations.get(system, -math.inf) < limits.autopilot_s:
                self._say_once(
                    f"another station has the system id {system}: as long as it is heard, the"
                    " autopilot would not notice that this companion is lost"
                )
        alone = len(self.station.addresses(vehicle.system)) < 2
        if alone:
            self._alone_at = now
        elif now - self._alone_at > limits.autopilot_s:
            self._fail(
                f"autopilot: another one has the system id {vehicle.system} for"
                f" {now - self._alone_at:.0f} s"
            )
        waits = self.phase == GROUND and self._leg is not None and not self._leg.home
        without = max(now - self._position_at, now - self._fix_lost_at)
        if waits and without > limits.position_s:
            self._fail(f"position: none for {without:.0f} s")
        elif waits and self._turn is not None and now - self._turn > _PATIENCE[self.arms]:
            message = f"; the vehicle says {vehicle.texts[-1]!r}" if vehicle.texts else ""
            self._fail(f"take-off: not in the air after {now - self._turn:.0f} s{message}")
        if self.phase not in (CLIMB, FLIGHT):
            return
        unknown = vehicle.heard_at - self._charge_known_at  # while it was heard
        low = self.battery is not None and self.battery <= limits.battery
        if limits.battery > 0 and unknown > limits.autopilot_s:
            self._fail(f"battery: its charge has been unknown for {unknown:.0f} s")
        elif without > limits.position_s:
            self._fail(f"position: none for {without:.0f} s")
        elif low:
            self._fail(
                f"battery: {self._charge_text} left, and the robot returns at {self._reserve_text}"
            )
        elif not alone:
            return  # whose mode that is, nobody knows
        elif not vehicle.armed:
            self._fail("pilot or autopilot: the vehicle was disarmed")
        elif self._mode != modes.GUIDED:
            message = f"; the vehicle says {vehicle.texts[-1]!r}" if vehicle.texts else ""
            self._fail(f"pilot or autopilot: the mode was changed to {self._mode}{message}")

    def _take_off(self, leg: Leg) -> None:
        """Go on with the take-off: the guided mode, armed, and up."""
        vehicle, now = self.vehicle, self.station.now()
        assert vehicle is not None
        if self._aloft and self._mode != modes.GUIDED and self.task.kind != "rover":
            self._say_once(f"waits until the vehicle, in the mode {self._mode}, is on the ground")
            return
        if self._turn is None:
            # The highest first: who climbs later stays below all who are up.
            others = len(self.task.scenario.starts) - self.number if self.takes_turns else 0
            self._turn = now + others * self.task.limits.apart_s
        if self.battery is None and self._uncharged:
            self._say_once("waits until the vehicle tells the charge of its battery")
            return
        if self._uncharged:
            self._fail(
                f"battery: {self._charge_text} left before take-off, and {self._reserve_text} are"
                " needed"
            )
            return
        self._target = np.array([*self._current_position()[:2], self.height])
        if not self.arms and not vehicle.armed:
            self._say_once("waiting until somebody arms the vehicle, because --arm was not given")
            return
        if now < self._turn:
            return
        guided = self._mode == modes.GUIDED
        if vehicle.autopilot == PX4:
            self._send_setpoint()  # PX4 changes to offboard only while set-points come
        if guided and vehicle.armed:
            self._begin_flight(leg)
        elif now >= self._next_command:
            self._next_command = now + _AGAIN
            if not guided:
                self._set_mode(modes.GUIDED)
            else:
                self._command(_ARM, 1)

    def _begin_flight(self, leg: Leg) -> None:
        self.phase, self._next_command = CLIMB, -math.inf
        self._target = np.array([*self._current_position()[:2], self.height])
        self.go(leg, 0.0)

    def _climb(self) -> None:
        vehicle, now, position = self.vehicle, self.station.now(), self._current_position()
        assert vehicle is not None
        rises = self.task.kind != "rover"
        if not rises or position[2] >= self.height - _LEVEL:
            self.phase = FLIGHT
        elif vehicle.autopilot == PX4 or position[2] > _ALOFT:
            self._send_setpoint()
        elif now >= self._next_command:
            self._next_command = now + _AGAIN
            self._command(_TAKE_OFF, 0, 0, 0, 0, 0, 0, self.height)

    def _return(self, mode: str) -> None:
        """Command a mode again and again until the vehicle is in it, or on the ground."""
        vehicle, now = self.vehicle, self.station.now()
        assert vehicle is not None
        if not vehicle.armed:
            self.phase, self._turn, self.takes_turns = GROUND, None, False
            return
        numbers = modes.custom_modes(vehicle.autopilot, vehicle.type)
        mode = mode if mode in numbers else modes.RETURN
        if self._mode not in (mode, modes.LAND) and now >= self._next_command:
            self._next_command = now + _AGAIN
            self._set_mode(mode)

    def _send_setpoint(self) -> None:
        vehicle, now = self.vehicle, self.station.now()
        assert vehicle is not None
        if self._target is None or now < self._next_setpoint:
            return
        self._next_setpoint = now + _EVERY
        longitude, latitude = self.task.frame.to_degrees(self._target[None, :2])[0]
        self.station.send(
            vehicle,
            self.station.dialect.MAVLink_set_position_target_global_int_message(
                round(1000 * now) % 2**32,
                vehicle.system,
                vehicle.component,
                _RELATIVE,
                _POSITION_ALONE,
                round(1e7 * latitude),
                round(1e7 * longitude),
                float(self._target[2]),
                *(0.0,) * 8,
            ),
        )

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


def _shorten_path(
    start: NDArray[np.float64], corners: Sequence[NDArray[np.float64]], less: float
) -> list[NDArray[np.float64]]:
    """Return the corners of a path that ends ``less`` metres before the last one; none if the whole
    path is not longer.
    """
    points = [start, *corners]
    for number in range(len(points) - 1, 0, -1):
        step = points[number] - points[number - 1]
        length = float(np.linalg.norm(step[:2]))
        if length > less:
            return [*points[1:number], points[number] - step * (less / length)]
        less -= length
    return []
