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
    """The time has come at which the robot wanted to be woken."""

    time: float


@dataclass(frozen=True, slots=True)
class Heard:
    """A beacon was received."""

    time: float
    beacon: Beacon


@dataclass(frozen=True, slots=True)
class Sensed:
    """The robot has reached its target cell and searched it. ``found`` is true if the robot found something there.

    For a footprint wider than one cell, ``beside`` lists the findings in the cells around the target cell.
    """

    time: float
    cell: int
    found: bool = False
    beside: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Blocked:
    """Another robot is in the cell that the robot wanted to enter. The robot stands in front of that cell."""

    time: float
    cell: int


@dataclass(frozen=True, slots=True)
class Obstructed:
    """A cell on the way is blocked for every robot. The robot stands in ``at``, the cell before the blocked cell."""

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
    """Go to the start and recharge. If there may be obstacles, ``through`` lists cells known to be free."""

    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Send:
    """Broadcast a beacon."""

    beacon: Beacon


@dataclass(frozen=True, slots=True)
class WakeAt:
    """The robot wants to be woken at a given time. It replaces the previous request."""

    time: float


@dataclass(frozen=True, slots=True)
class Declare:
    """Declare that all cells are searched."""


Action = Go | GoHome | Send | WakeAt | Declare
