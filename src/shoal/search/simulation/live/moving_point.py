"""A small vehicle: it goes from cell to cell in straight lines, and its speed follows the wanted one with a lag of first order."""

from __future__ import annotations

from dataclasses import replace
from math import exp

from shoal.core.dataclass import dataclass

LAG = 0.1  # the time constant of the speed, in the time that a robot of speed 1 takes for a cell
_NEAR = 1e-3  # cells


@dataclass(frozen=True, slots=True)
class MovingPoint:
    """A vehicle on one leg: it goes so far in a straight line, and then works on the spot as long as the leg is longer than that.

    Parameters
    ----------
    time : float
        When it was here; all times are those that a robot of speed 1 takes for a cell.
    origin, goal : tuple of float
        From where it goes to where, as `TourCost.points`.
    way : float
        The length of the way, in cells; longer than the straight line if it leads round a corner.
    length : float
        The length of the leg, turning and work on the spot included.
    done : float
        How much of the leg lies behind it.
    limit : float
        Where on the leg it must stop for the time being.
    speed : float

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
        """Where it is."""
        share = min(1.0, self.done / self.way) if self.way > 0 else 1.0
        return tuple(one + share * (other - one) for one, other in zip(self.origin, self.goal, strict=True))

    @property
    def arrived(self) -> bool:
        """Whether it is where it must stop."""
        return self.done >= self.limit - _NEAR

    def moved(self, time: float, *, rate: float) -> MovingPoint:
        """Return the vehicle at a later time, driving as fast as ``rate``: exact, however long the time between.

        It is never beyond its limit; the speed that it comes there with, it keeps.
        """
        if self.arrived:
            return replace(self, time=time)
        passed = time - self.time
        decay = exp(-passed / LAG)
        done = self.done + rate * passed + (self.speed - rate) * LAG * (1 - decay)
        return replace(self, time=time, done=min(done, self.limit), speed=rate + (self.speed - rate) * decay)

    def earliest(self, *, rate: float) -> float:
        """Return a time before which it cannot have arrived."""
        return self.time + (self.limit - self.done) / max(rate, self.speed)

    def stopped(self) -> MovingPoint:
        """Return the vehicle at rest."""
        return replace(self, speed=0.0)

    def sent(self, goal: tuple[float, ...], *, way: float, length: float) -> MovingPoint:
        """Return the vehicle on a new leg from where it is; it must stop one cell before the end, which may be at once."""
        return replace(self, origin=self.place, goal=goal, way=way, length=length, done=0.0, limit=max(length - 1.0, 0.0))
