"""What stands behind the ports of a live robot: a simulated vehicle, and a simulated sensor with
cell locks.
"""

from __future__ import annotations

import fcntl
from collections.abc import Callable
from dataclasses import replace
from math import exp, inf

from shoal.core.dataclass import dataclass
from shoal.search.simulation.live.ports import CellFinding, Leg
from shoal.search.simulation.scenario import Scenario
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
    distance : float
        Length of the vehicle's path in cells. A path around a corner is longer than the straight
        line from ``origin`` to ``goal``.
    length : float
        Length of the leg in cells: the length of the path, plus the cost of turns and search at the
        end of the path.
    travelled : float
        Completed length of the leg in cells.
    limit : float
        Position on the leg, in cells from its start, at which the vehicle waits until the agent
        raises the limit.
    speed : float
        Current speed of the vehicle, relative to a robot of speed 1.

    Examples
    --------
    >>> start = MovingPoint(0.0, (0.0, 0.0), (4.0, 0.0), distance=4.0, length=4.0, limit=4.0)
    >>> later = start.at(2.0, rate=1.0)
    >>> round(later.travelled, 3), round(later.speed, 3), [round(x, 3) for x in later.place]
    (1.9, 1.0, [1.9, 0.0])
    """

    time: float
    origin: tuple[float, ...]
    goal: tuple[float, ...]
    distance: float = 0.0
    length: float = 0.0
    travelled: float = 0.0
    limit: float = 0.0
    speed: float = 0.0

    @property
    def place(self) -> tuple[float, ...]:
        """Position of the vehicle in cell sides, as in `TourCost.points`."""
        share = min(1.0, self.travelled / self.distance) if self.distance > 0 else 1.0
        return tuple(
            begin + share * (end - begin) for begin, end in zip(self.origin, self.goal, strict=True)
        )

    @property
    def arrived(self) -> bool:
        """Whether the vehicle has reached the position ``limit`` on its leg."""
        return self.travelled >= self.limit - _NEAR

    def at(self, time: float, *, rate: float) -> MovingPoint:
        """Return the vehicle at a later time, for the desired speed ``rate``. The motion is exact
        for time steps of any length.

        The vehicle never passes the position ``limit``. At the position ``limit``, `speed` keeps
        its value until `halt` sets it to 0.
        """
        if self.arrived:
            return replace(self, time=time)
        passed = time - self.time
        decay = exp(-passed / LAG)
        travelled = self.travelled + rate * passed + (self.speed - rate) * LAG * (1 - decay)
        return replace(
            self,
            time=time,
            travelled=min(travelled, self.limit),
            speed=rate + (self.speed - rate) * decay,
        )

    def earliest(self, *, rate: float) -> float:
        """Return a lower bound on the time at which the vehicle reaches the position ``limit``."""
        return self.time + (self.limit - self.travelled) / max(rate, self.speed)

    def halt(self) -> MovingPoint:
        """Return the vehicle with the speed 0."""
        return replace(self, speed=0.0)

    def start_leg(self, goal: tuple[float, ...], *, distance: float, length: float) -> MovingPoint:
        """Return the vehicle on a new leg that begins at its position. At first, ``limit`` is one
        cell before the leg's end.

        If the leg is shorter than one cell, ``limit`` is 0, and the vehicle does not move until the
        agent raises the limit.
        """
        return replace(
            self,
            origin=self.place,
            goal=goal,
            distance=distance,
            length=length,
            travelled=0.0,
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


class PointVehicle:
    """A vehicle that is a moving point.

    Parameters
    ----------
    place : tuple of float
        Its position at time 0, in cell sides.
    rate : callable
        Function that returns the vehicle's desired speed at a time.
    """

    fault = ""

    def __init__(self, place: tuple[float, ...], rate: Callable[[float], float]) -> None:
        self.point, self._rate = MovingPoint(0.0, place, place), rate
        self._going = False

    def where(self) -> tuple[float, ...]:
        """Return the vehicle's position."""
        return self.point.place

    def go(self, leg: Leg, time: float) -> None:
        """Begin a leg."""
        self.point = replace(self.point, time=time).start_leg(
            leg.goal, distance=leg.distance, length=leg.length
        )
        self._going = True

    def enter(self) -> None:
        """Go on to the end of the leg."""
        self.point = replace(self.point, limit=self.point.length)

    def step(self, time: float) -> bool:
        """Move, and return whether the vehicle is where it may go."""
        if self._going:
            self.point = self.point.at(time, rate=self._rate(time))
        return self._going and self.point.arrived

    def due(self, time: float) -> float:
        """Return the time at which the vehicle arrives at the earliest."""
        return self.point.earliest(rate=self._rate(time)) if self._going else inf

    def stop(self, time: float) -> None:
        """Stand still."""
        self.point = self.point.halt()

    def left(self) -> float | None:
        """Return None: the robot's program computes what is left."""
        return None

    def secure(self) -> None:
        """Do nothing: a point is safe everywhere."""


class ScenarioSensor:
    """A sensor that knows a scenario, and detects robots in the cell ahead by locks.

    Parameters
    ----------
    scenario : Scenario
    number : int
        Number of the robot.
    ground : int
        Descriptor of the file with the cell locks.
    """

    def __init__(self, scenario: Scenario, number: int, ground: int) -> None:
        self._scenario, self._number, self._ground = scenario, number, ground

    def search(self, cell: int) -> CellFinding:
        """Return the targets that are seen from a cell."""
        targets = self._scenario.targets
        visible = members(self._scenario.visible_cells(self._number, cell))
        around = tuple(neighbour for neighbour in visible if neighbour != cell)
        return CellFinding(
            cell in targets,
            around,
            tuple(neighbour for neighbour in around if neighbour in targets),
        )

    def enter(self, cell: int) -> bool:
        """Lock a cell."""
        return enter(self._ground, cell)

    def leave(self, cell: int) -> None:
        """Release the lock of a cell."""
        leave(self._ground, cell)

    def obstacle_on(self, source: int, through: tuple[int, ...]) -> tuple[int | None, int]:
        """Return the first obstacle on a path."""
        return self._scenario.obstacle_on(source, through)
