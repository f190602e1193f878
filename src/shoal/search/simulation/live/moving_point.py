"""A simulated vehicle that moves in straight lines from cell to cell, and follows its desired speed with a first-order lag."""

from __future__ import annotations

from dataclasses import replace
from math import exp

from shoal.core.dataclass import dataclass

LAG = 0.1  # time constant of the speed, in cell times of a robot of speed 1
_NEAR = 1e-3  # cells


@dataclass(frozen=True, slots=True)
class MovingPoint:
    """A vehicle on one leg, which first moves in a straight line, and then stands still while it turns and searches.

    Parameters
    ----------
    time : float
        Time of the vehicle's present state. The unit of time is the time in which a robot of speed 1 searches one cell.
    origin, goal : tuple of float
        Start and end point of the leg in cell sides, as in `TourCost.points`.
    way : float
        Length of the vehicle's path in cells. A path around a corner is longer than the straight line from ``origin`` to ``goal``.
    length : float
        Length of the leg in cells: the length of the path, plus the cost of turns and search at the end of the path.
    done : float
        Completed length of the leg in cells.
    limit : float
        Position on the leg, in cells from its start, at which the vehicle waits until the agent raises the limit.
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
        return tuple(one + share * (other - one) for one, other in zip(self.origin, self.goal, strict=True))

    @property
    def arrived(self) -> bool:
        """Whether the vehicle has reached the position ``limit`` on its leg."""
        return self.done >= self.limit - _NEAR

    def moved(self, time: float, *, rate: float) -> MovingPoint:
        """Return the vehicle at a later time, for the desired speed ``rate``. The motion is exact for time steps of any length.

        The vehicle never passes the position ``limit``. At the position ``limit``, `speed` keeps its value until `stopped` sets it
        to 0.
        """
        if self.arrived:
            return replace(self, time=time)
        passed = time - self.time
        decay = exp(-passed / LAG)
        done = self.done + rate * passed + (self.speed - rate) * LAG * (1 - decay)
        return replace(self, time=time, done=min(done, self.limit), speed=rate + (self.speed - rate) * decay)

    def earliest(self, *, rate: float) -> float:
        """Return a lower bound on the time at which the vehicle reaches the position ``limit``."""
        return self.time + (self.limit - self.done) / max(rate, self.speed)

    def stopped(self) -> MovingPoint:
        """Return the vehicle with the speed 0."""
        return replace(self, speed=0.0)

    def sent(self, goal: tuple[float, ...], *, way: float, length: float) -> MovingPoint:
        """Return the vehicle on a new leg that begins at its position. At first, ``limit`` is one cell before the leg's end.

        If the leg is shorter than one cell, ``limit`` is 0, and the vehicle does not move until the agent raises the limit.
        """
        return replace(self, origin=self.place, goal=goal, way=way, length=length, done=0.0, limit=max(length - 1.0, 0.0))
