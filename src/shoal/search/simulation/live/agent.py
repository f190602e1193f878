"""The agent of a robot: it connects the robot's state machine to a vehicle, a radio and a sensor."""

from __future__ import annotations

import selectors
import time
from collections.abc import Callable
from dataclasses import replace
from math import dist, inf
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.kernels.protocol.numbers import LOOK, RETRY, TRIES
from shoal.search.protocol.robot import advance, with_beacon
from shoal.search.protocol.state import (
    Action,
    Begin,
    Blocked,
    Declare,
    Event,
    Go,
    GoHome,
    Heard,
    Obstructed,
    Recharged,
    Robot,
    Send,
    Sensed,
    Wake,
    WakeAt,
    step_cost,
)
from shoal.search.simulation.live.ports import Leg, RobotVehicle, SearchSensor
from shoal.search.simulation.live.radio import LiveTask, Messenger

_LONGEST = 0.5  # seconds: maximum duration of a sleep
_FAREWELLS = 8  # beacons of a robot that gives up, half a period apart
_HOPELESS = float(1 << 30)  # the lag that it reports


@dataclass(frozen=True, slots=True)
class Halt:
    """The end of a path that an unknown obstacle blocks. The vehicle stops in ``at``, the last cell
    before the obstacle.
    """

    obstacle: int
    at: int


class Agent:
    """The program in the process of a robot: it connects the robot's state machine to the ports.

    Parameters
    ----------
    task : LiveTask
    robot : Robot
    messenger : Messenger
    vehicle : RobotVehicle
    sensor : SearchSensor
    clock : callable
        Function that returns the time since the start of the search.
    tell : callable
        Function that receives the report of each event before the event has an effect.
    lifeline : int, optional
        File descriptor that becomes readable when the supervisor has ended.
    record : callable, optional
        Function that receives each event of the state machine before the event has an effect.
    pause : callable, optional
        Function that is called between events, twice a second or more often.
    """

    def __init__(
        self,
        task: LiveTask,
        robot: Robot,
        messenger: Messenger,
        vehicle: RobotVehicle,
        sensor: SearchSensor,
        *,
        clock: Callable[[], float],
        tell: Callable[[dict[str, Any]], None],
        lifeline: int | None = None,
        record: Callable[[Event], None] = lambda _event: None,
        pause: Callable[[], None] = lambda: None,
    ) -> None:
        self.task, self.robot, self.messenger = task, robot, messenger
        self.vehicle, self.sensor = vehicle, sensor
        self._clock, self._tell, self._record, self._pause = clock, tell, record, pause
        self._tour_cost = robot.brief.tour_cost
        self.fault = ""
        self._cell: int | None = robot.start  # the vehicle is in the centre of this cell
        self._inside: int | None = None  # the cell that the robot occupies for its search
        self._going: Go | GoHome | Halt | None = None
        self._entered = False  # the vehicle is on the last cell of its leg
        self._passed: tuple[int, ...] = ()  # the cells passed since the last search
        self._tries = 0
        self._rest = -inf  # time until which the vehicle waits
        self._wake = inf
        self._status = ""
        self._selector = selectors.DefaultSelector()
        if lifeline is not None:
            self._selector.register(lifeline, selectors.EVENT_READ, "lifeline")
        self._selector.register(messenger, selectors.EVENT_READ, "radio")

    @property
    def now(self) -> float:
        """Time since the start of the search, in units of the time in which a robot of speed 1
        searches one cell.
        """
        return self._clock()

    def run(self) -> bool:
        """Run the robot until all cells are searched and reported. Return False if the supervisor
        has ended earlier, or if the vehicle or the radio has a fault.
        """
        if self.robot.count == 0:
            self._feed(Begin(self.now))
        else:
            self._go_on()
        while self.robot.status != "complete" or self.robot.lingering > 0:
            pause = (min(self._wake, self._due()) - self.now) / self.task.speed
            radio_pause = self.messenger.rest_until - time.monotonic()
            if radio_pause > 0:
                time.sleep(min(radio_pause, max(pause, 0.0)))
                pause = 0.0
            ready = {key.data for key, _ in self._selector.select(min(max(pause, 0.0), _LONGEST))}
            if "lifeline" in ready:
                return False
            if "radio" in ready and radio_pause <= 0:
                self._listen()
            self._drive()
            if fault := self.vehicle.fault or self.messenger.fault:
                self._give_up(fault)
                return False
            if self._wake <= self.now:
                self._wake = inf
                self._feed(Wake(self.now))
            self._pause()
        return True

    def _go_on(self) -> None:
        """Go on after a restart: the vehicle is somewhere, and the robot knows what it has done."""
        self._cell, self._wake, self._status = None, self.now, self.robot.status
        self.report("restarted")
        if self.robot.target is not None:
            target = self.robot.target
            self._act(GoHome() if target < 0 else Go(target, self.robot.through))

    def _give_up(self, fault: str) -> None:
        """End the robot's part of the search: bring the vehicle to its safe action, and let others
        know at once that they must do the rest.

        A robot that is late beyond all tolerance, and idle, is helped with everything that it has
        left; silence follows, after which it counts as dead.
        """
        self.fault = fault
        self.vehicle.secure()
        self.report("fault", reason=fault)
        self._leave()
        for _ in range(_FAREWELLS):
            self.robot = self.robot.replaced(count=self.robot.count + 1)
            self.robot, beacon = with_beacon(self.robot, self.now)
            own = replace(beacon.heartbeats[0], status="waiting", lag=_HOPELESS)
            beacon = replace(beacon, heartbeats=(own, *beacon.heartbeats[1:]))
            self.messenger.send(beacon)
            time.sleep(self.robot.brief.beat / self.task.speed / 2)

    def report(self, kind: str, cell: int | None = None, **more: Any) -> None:
        """Report an event to the supervisor."""
        counts = self.messenger.counts
        place = [round(x, 3) for x in self.vehicle.where()]
        self._tell(
            {
                "time": round(self.now, 6),
                "kind": kind,
                "cell": cell,
                "place": place,
                "counts": counts,
                **more,
            }
        )

    # The brain.

    def _feed(self, event: Event) -> None:
        self._record(event)
        self.robot, actions = advance(self.robot, event)
        if self.robot.status != self._status:
            self._status = self.robot.status
            self.report(self._status)
        if self._status in ("waiting", "complete"):
            self._stand_aside()
        for action in actions:
            self._act(action)

    def _act(self, action: Action) -> None:
        match action:
            case Go(cell, through):
                obstacle, free = self.sensor.obstacle_on(self.robot.cell, through)
                if obstacle is None:
                    self._set_out(action, cell)
                else:
                    self._set_out_for_obstacle(obstacle, through[:free])
            case GoHome():
                self._go_home(action)
            case Send(beacon):
                self.messenger.send(beacon)
            case WakeAt(moment):
                self._wake = moment
            case Declare():
                self.report("declared")

    def _listen(self) -> None:
        for beacon in self.messenger.receive():
            try:
                self.task.check(beacon)
            except InvalidInputError:
                self.messenger.refuse("other robots, starts or cells")
            else:
                self._feed(Heard(self.now, beacon))

    # The vehicle.

    def _stops_of(self, cell: int) -> tuple[float, ...]:
        return tuple(float(x) for x in self._tour_cost.points[cell])

    def _set_out(self, aim: Go, cell: int) -> None:
        """Start a leg to a cell.

        The robot estimates the length of the leg. If the robot stands between two cells, the agent
        measures the length from the position of the vehicle.
        """
        if aim.through:
            length = self.robot.cost
        elif self._cell is None:
            length = (
                max(dist(self.vehicle.where(), self._stops_of(cell)), 1.0)
                + self._tour_cost.turn_cost
            )
        else:
            length = step_cost(
                self._tour_cost, self._cell, cell, self.robot.fresh
            ) + self.robot.launch_cost(cell)
        distance = length - 1.0 if self.robot.fresh and self._cell is not None else length
        self._drive_to(aim, cell, distance, length)
        if length > 1.0 + 1e-12:
            self._leave()  # during the motion the robot occupies no cell

    def _set_out_for_obstacle(self, obstacle: int, path: tuple[int, ...]) -> None:
        """Start a leg to the cell before an obstacle. The leg includes the path to the obstacle and
        back.
        """
        at = path[-1] if path else self.robot.cell
        self._passed += path
        cost = (
            self.task.scenario.path_length(self.robot.cell, path)
            + LOOK
            + self.robot.launch_cost(at)
        )
        # the vehicle stops one cell before the end of this leg
        self._drive_to(Halt(obstacle, at), at, cost, cost + 1.0)
        self._leave()

    def _go_home(self, aim: GoHome) -> None:
        home = self.robot.start
        away = dist(self.vehicle.where(), self._stops_of(home))
        if aim.through:
            away = self.task.scenario.path_length(self.robot.cell, aim.through)
        away += self.robot.brief.from_launch(self.robot.number, home, self.robot.cell)
        self._passed += aim.through
        self.report("home")
        self._drive_to(aim, home, away, away + 1.0)
        self._leave()

    def _drive_to(self, aim: Go | GoHome | Halt, cell: int, distance: float, length: float) -> None:
        through = () if isinstance(aim, Halt) else aim.through
        home = isinstance(aim, GoHome)
        self.vehicle.go(Leg(cell, self._stops_of(cell), distance, length, through, home), self.now)
        self._going, self._cell, self._tries, self._rest = aim, None, 0, -inf
        self._entered = False

    def _due(self) -> float:
        """Return the time at which the agent must update its vehicle next."""
        now = self.now
        due = self.vehicle.due(now)
        if self._going is not None and now >= self._rest:
            return due
        # a vehicle that has arrived, and waits, is due all the time, and does nothing then
        later = due if due > now else inf
        return later if self._going is None else min(later, self._rest)

    def _drive(self) -> None:
        going, now = self._going, self.now
        arrived = self.vehicle.step(now)
        if going is None or now < self._rest or not arrived:
            return
        if isinstance(going, GoHome):
            self._come_home(now)
        elif isinstance(going, Halt):
            self.vehicle.stop(now)
            self._going, self._cell = None, going.at
            self.report("obstructed", going.obstacle)
            self._feed(Obstructed(self.now, going.obstacle, going.at))
        elif not self._entered:
            self._come_in(going.cell, now)
        else:
            self._search(going)

    def _search(self, going: Go) -> None:
        cell = self._cell = going.cell
        finding = self.sensor.search(cell)
        around, beside, detected = finding.around, finding.beside, finding.found
        through, self._passed, self._going = self._passed + going.through[:-1], (), None
        more = {
            name: cells
            for name, cells in (("through", through), ("around", around), ("beside", beside))
            if cells
        }
        self.report("searched", cell, found=detected, **more)
        self._feed(Sensed(self.now, cell, detected, beside))

    def _come_in(self, cell: int, now: float) -> None:
        if self.sensor.enter(cell):
            before, self._inside = self._inside, cell
            self.report("enters", cell)
            if before not in (None, cell):
                self.sensor.leave(before)
            self.vehicle.enter()
            self._entered = True
            return
        self._stand_aside()
        if self._tries < TRIES:
            self._tries += 1
            self._rest = now + RETRY / self.robot.rate
            return
        if isinstance(self._going, Go):
            self._passed += self._going.through
        self._going = None
        self.report("blocked", cell)
        self._feed(Blocked(self.now, cell))

    def _come_home(self, now: float) -> None:
        if self._rest == -inf:
            self.vehicle.stop(self.now)
            self._rest = now + self.robot.brief.recharge
            if self._rest > now:
                return
        self._going, self._cell = None, self.robot.start
        self.report("recharged")
        self._feed(Recharged(self.now))

    def _stand_aside(self) -> None:
        self.vehicle.stop(self.now)
        self._leave()

    def _leave(self) -> None:
        if self._inside is not None:
            self.report("leaves", self._inside)
            self.sensor.leave(self._inside)
            self._inside = None
