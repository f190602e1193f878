"""Events and actions of the state machine in `shoal.search.protocol.robot`."""

from __future__ import annotations

from shoal.core.dataclass import dataclass
from shoal.search.protocol.messages import Beacon


@dataclass(frozen=True, slots=True)
class Begin:
    """The robot is switched on."""

    time: float


@dataclass(frozen=True, slots=True)
class Wake:
    """The robot wakes at the time that it requested with `WakeAt`."""

    time: float


@dataclass(frozen=True, slots=True)
class Heard:
    """A beacon was received."""

    time: float
    beacon: Beacon


@dataclass(frozen=True, slots=True)
class Sensed:
    """The robot has reached its target cell and searched it. ``found`` is true if the robot found something in the target cell.

    ``beside`` lists the cells around the target in which a robot with a wider footprint found something.
    """

    time: float
    cell: int
    found: bool = False
    beside: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Blocked:
    """The robot stands in front of a cell that it wanted to enter, because another robot is in this cell."""

    time: float
    cell: int


@dataclass(frozen=True, slots=True)
class Obstructed:
    """A cell on the robot's path contains an obstacle. The robot stands in ``at``, the last cell before the obstacle."""

    time: float
    cell: int
    at: int


@dataclass(frozen=True, slots=True)
class Recharged:
    """The robot is at its start with full energy."""

    time: float


Event = Begin | Wake | Heard | Sensed | Blocked | Obstructed | Recharged


@dataclass(frozen=True, slots=True)
class Go:
    """Go to a cell and search it. If there may be obstacles, ``through`` lists the cells of the path, including the target."""

    cell: int
    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class GoHome:
    """Go to the start and recharge. If there may be obstacles, ``through`` lists the cells of a path known to be free."""

    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Send:
    """Broadcast a beacon."""

    beacon: Beacon


@dataclass(frozen=True, slots=True)
class WakeAt:
    """Wake the robot at a given time. A new request replaces the previous request."""

    time: float


@dataclass(frozen=True, slots=True)
class Declare:
    """Declare that all cells are searched."""


Action = Go | GoHome | Send | WakeAt | Declare
