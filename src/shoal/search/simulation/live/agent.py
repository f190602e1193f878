"""The agent of a live robot: it connects the robot's state machine to a radio, a simulated vehicle
and the cell locks.
"""

from __future__ import annotations

import fcntl
import selectors
import time
from collections.abc import Callable
from dataclasses import replace
from math import dist, exp, inf
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.problem.network import true_rate
from shoal.search.protocol.robot import LOOK, advance
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
from shoal.search.simulation.live.radio import LiveTask, Radio
from shoal.search.simulation.scenario import RETRY, TRIES
from shoal.search.tours.masks import members

LAG = 0.1  # time constant of the speed, in cell times of a robot of speed 1
_NEAR = 1e-3  # cells


@dataclass(frozen=True, slots=True)
class MovingPoint:
    """A vehicle on one leg, which first moves in a straight line, and then stands still while it
    turns and searches.

    Parameters
    ----------
    time : float
        Time of the vehicle's present state. The unit of time is the time in which a robot of speed
        1 searches one cell.
    origin, goal : tuple of float
        Start and end point of the leg in cell sides, as in `TourCost.points`.
    way : float
        Length of the vehicle's path in cells. A path around a corner is longer than the straight
        line from ``origin`` to ``goal``.
    length : float
        Length of the leg in cells: the length of the path, plus the cost of turns and search at the
        end of the path.
    done : float
        Completed length of the leg in cells.
    limit : float
        Position on the leg, in cells from its start, at which the vehicle waits until the agent
        raises the limit.
    speed : float
        Current speed of the vehicle, relative to a robot of speed 1.

    Examples
    --------
    >>> start = MovingPoint(0.0, (0.0, 0.0), (4.0, 0.0), way=4.0, length=4.0, limit=4.0)
    >>> later = start.moved(2.0, rate=1.0)
    >>> round(later.done, 3), round(later.speed, 3), [round(x, 3) for x in later.place]
    (1.9, 1.0, [1.9, 0.0])
    """

    time: float
    origin: tuple[float, ...]
    goal: tuple[float, ...]
    way: float = 0.0
    length: float = 0.0
    done: float = 0.0
    limit: float = 0.0
    speed: float = 0.0

    @property
    def place(self) -> tuple[float, ...]:
        """Position of the vehicle in cell sides, as in `TourCost.points`."""
        share = min(1.0, self.done / self.way) if self.way > 0 else 1.0
        return tuple(
            one + share * (other - one) for one, other in zip(self.origin, self.goal, strict=True)
        )

    @property
    def arrived(self) -> bool:
        """Whether the vehicle has reached the position ``limit`` on its leg."""
        return self.done >= self.limit - _NEAR

    def moved(self, time: float, *, rate: float) -> MovingPoint:
        """Return the vehicle at a later time, for the desired speed ``rate``. The motion is exact
        for time steps of any length.

        The vehicle never passes the position ``limit``. At the position ``limit``, `speed` keeps
        its value until `stopped` sets it to 0.
        """
        if self.arrived:
            return replace(self, time=time)
        passed = time - self.time
        decay = exp(-passed / LAG)
        done = self.done + rate * passed + (self.speed - rate) * LAG * (1 - decay)
        return replace(
            self, time=time, done=min(done, self.limit), speed=rate + (self.speed - rate) * decay
        )

    def earliest(self, *, rate: float) -> float:
        """Return a lower bound on the time at which the vehicle reaches the position ``limit``."""
        return self.time + (self.limit - self.done) / max(rate, self.speed)

    def stopped(self) -> MovingPoint:
        """Return the vehicle with the speed 0."""
        return replace(self, speed=0.0)

    def sent(self, goal: tuple[float, ...], *, way: float, length: float) -> MovingPoint:
        """Return the vehicle on a new leg that begins at its position. At first, ``limit`` is one
        cell before the leg's end.

        If the leg is shorter than one cell, ``limit`` is 0, and the vehicle does not move until the
        agent raises the limit.
        """
        return replace(
            self,
            origin=self.place,
            goal=goal,
            way=way,
            length=length,
            done=0.0,
            limit=max(length - 1.0, 0.0),
        )


def enter(file: int, cell: int) -> bool:
    """Lock a cell if no other process holds its lock. Return whether this process now holds the
    lock.

    Parameters
    ----------
    file : int
        Descriptor of the file that all robots share. A process must not close any other descriptor
        of this file, because the operating system would then release all locks of the process.
    cell : int
        Tour index of the cell.
    """
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, cell)
    except (
        BlockingIOError,
        PermissionError,
    ):  # the error for a lock held by another process differs between systems
        return False
    return True


def leave(file: int, cell: int) -> None:
    """Release the lock of a cell."""
    fcntl.lockf(file, fcntl.LOCK_UN, 1, cell)


_LONGEST = 0.5  # seconds: maximum duration of a sleep


@dataclass(frozen=True, slots=True)
class Halt:
    """The end of a path that an unknown obstacle blocks. The vehicle stops in ``at``, the last cell
    before the obstacle.
    """

    obstacle: int
    at: int


class Agent:
    """The program in the process of a live robot.

    Parameters
    ----------
    task : LiveTask
    robot : Robot
    radio : Radio
    ground : int
        File descriptor of the file that contains the cell locks.
    lifeline : int
        File descriptor that becomes readable when the supervisor has ended.
    epoch : float
        Time that the system's monotonic clock showed at the start of the search, in seconds.
    tell : callable
        Function that receives the report of each event before the event has an effect.
    """

    def __init__(
        self,
        task: LiveTask,
        robot: Robot,
        radio: Radio,
        *,
        ground: int,
        lifeline: int,
        epoch: float,
        tell: Callable[[dict[str, Any]], None],
    ) -> None:
        self.task, self.robot, self.radio = task, robot, radio
        self._scenario, self._tour_cost = task.scenario, robot.brief.tour_cost
        self._ground, self._epoch, self._tell = ground, epoch, tell
        place = self._stops_of(robot.start)
        self.vehicle = MovingPoint(0.0, place, place)
        self._cell: int | None = robot.start  # the vehicle is in the centre of this cell
        self._inside: int | None = None  # the cell that the robot occupies for its search
        self._going: Go | GoHome | Halt | None = None
        self._passed: tuple[int, ...] = ()  # the cells passed since the last search
        self._tries = 0
        self._rest = -inf  # time until which the vehicle waits
        self._wake = inf
        self._status = ""
        self._selector = selectors.DefaultSelector()
        self._selector.register(lifeline, selectors.EVENT_READ, "lifeline")
        self._selector.register(radio, selectors.EVENT_READ, "radio")

    @property
    def now(self) -> float:
        """Time since the start of the search, in units of the time in which a robot of speed 1
        searches one cell.
        """
        return (time.monotonic() - self._epoch) * self.task.speed

    def run(self) -> bool:
        """Run the robot until all cells are searched and reported. Return False if the supervisor
        has ended earlier.
        """
        time.sleep(max(0.0, self._epoch - time.monotonic()))
        self._feed(Begin(self.now))
        while self.robot.status != "complete" or self.robot.lingering > 0:
            pause = (min(self._wake, self._due()) - self.now) / self.task.speed
            rest = self.radio.rest_until - time.monotonic()
            if rest > 0:
                time.sleep(min(rest, max(pause, 0.0)))
                pause = 0.0
            ready = {key.data for key, _ in self._selector.select(min(max(pause, 0.0), _LONGEST))}
            if "lifeline" in ready:
                return False
            if "radio" in ready and rest <= 0:
                self._listen()
            self._drive()
            if self._wake <= self.now:
                self._wake = inf
                self._feed(Wake(self.now))
        return True

    def report(self, kind: str, cell: int | None = None, **more: Any) -> None:
        """Report an event to the supervisor."""
        counts = (self.radio.sent, self.radio.heard, self.radio.lost, self.radio.dropped)
        place = [round(x, 3) for x in self.vehicle.place]
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
                obstacle, free = self._scenario.obstacle_on(self.robot.cell, through)
                if obstacle is None:
                    self._set_out(action, cell)
                else:
                    self._set_out_for_obstacle(obstacle, through[:free])
            case GoHome():
                self._go_home(action)
            case Send(beacon):
                self.radio.send(beacon)
            case WakeAt(moment):
                self._wake = moment
            case Declare():
                self.report("declared")

    def _listen(self) -> None:
        for beacon in self.radio.receive():
            try:
                self.task.check(beacon)
            except InvalidInputError:
                self.radio.dropped += 1
            else:
                self._feed(Heard(self.now, beacon))

    # The vehicle.

    @property
    def _rate(self) -> float:
        return true_rate(self.robot.rate, self._scenario.faults, self.robot.number, self.now)

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
                max(dist(self.vehicle.place, self._stops_of(cell)), 1.0) + self._tour_cost.turn_cost
            )
        else:
            length = step_cost(
                self._tour_cost, self._cell, cell, self.robot.fresh
            ) + self.robot.way_out(cell)
        way = length - 1.0 if self.robot.fresh and self._cell is not None else length
        self._drive_to(aim, cell, way, length)
        if length > 1.0 + 1e-12:
            self._leave()  # during the motion the robot occupies no cell

    def _set_out_for_obstacle(self, obstacle: int, way: tuple[int, ...]) -> None:
        """Start a leg to the cell before an obstacle. The leg includes the way to the obstacle and
        back.
        """
        at = way[-1] if way else self.robot.cell
        self._passed += way
        cost = self._scenario.path_length(self.robot.cell, way) + LOOK + self.robot.way_out(at)
        # the vehicle stops one cell before the end of this leg
        self._drive_to(Halt(obstacle, at), at, cost, cost + 1.0)
        self._leave()

    def _go_home(self, aim: GoHome) -> None:
        home = self.robot.start
        away = dist(self.vehicle.place, self._stops_of(home))
        if aim.through:
            away = self._scenario.path_length(self.robot.cell, aim.through)
        away += self.robot.brief.from_launch(self.robot.number, home, self.robot.cell)
        self._passed += aim.through
        self.report("home")
        self._drive_to(aim, home, away, away + 1.0)
        self._leave()

    def _drive_to(self, aim: Go | GoHome | Halt, cell: int, way: float, length: float) -> None:
        self.vehicle = replace(self.vehicle, time=self.now).sent(
            self._stops_of(cell), way=way, length=length
        )
        self._going, self._cell, self._tries, self._rest = aim, None, 0, -inf

    def _due(self) -> float:
        """Return the time at which the agent must update its vehicle next."""
        if self._going is None:
            return inf
        return max(self._rest, self.vehicle.earliest(rate=self._rate))

    def _drive(self) -> None:
        going, now = self._going, self.now
        if going is None or now < self._rest:
            return
        self.vehicle = self.vehicle.moved(now, rate=self._rate)
        if not self.vehicle.arrived:
            return
        if isinstance(going, GoHome):
            self._come_home(now)
        elif isinstance(going, Halt):
            self.vehicle = self.vehicle.stopped()
            self._going, self._cell = None, going.at
            self.report("obstructed", going.obstacle)
            self._feed(Obstructed(self.now, going.obstacle, going.at))
        elif self.vehicle.limit < self.vehicle.length:
            self._come_in(going.cell, now)
        else:
            self._search(going)

    def _search(self, going: Go) -> None:
        cell = self._cell = going.cell
        targets = self._scenario.targets
        around = tuple(
            one for one in members(self._scenario.seen(self.robot.number, cell)) if one != cell
        )
        beside = tuple(one for one in around if one in targets)
        found = cell in targets
        through, self._passed, self._going = self._passed + going.through[:-1], (), None
        more = {
            name: cells
            for name, cells in (("through", through), ("around", around), ("beside", beside))
            if cells
        }
        self.report("searched", cell, found=found, **more)
        self._feed(Sensed(self.now, cell, found, beside))

    def _come_in(self, cell: int, now: float) -> None:
        if enter(self._ground, cell):
            before, self._inside = self._inside, cell
            self.report("enters", cell)
            if before not in (None, cell):
                leave(self._ground, before)
            self.vehicle = replace(self.vehicle, limit=self.vehicle.length)
            return
        self._stand_aside()
        if self._tries < TRIES:
            self._tries += 1
            self._rest = now + RETRY / self._rate
            return
        if isinstance(self._going, Go):
            self._passed += self._going.through
        self._going = None
        self.report("blocked", cell)
        self._feed(Blocked(self.now, cell))

    def _come_home(self, now: float) -> None:
        if self._rest == -inf:
            self.vehicle = self.vehicle.stopped()
            self._rest = now + self.robot.brief.recharge
            if self._rest > now:
                return
        self._going, self._cell = None, self.robot.start
        self.report("recharged")
        self._feed(Recharged(self.now))

    def _stand_aside(self) -> None:
        self.vehicle = self.vehicle.stopped()
        self._leave()

    def _leave(self) -> None:
        if self._inside is not None:
            self.report("leaves", self._inside)
            leave(self._ground, self._inside)
            self._inside = None
