"""Events and actions of the state machine `shoal.search.protocol.robot`."""

from __future__ import annotations

from shoal.core.dataclass import dataclass
from shoal.search.protocol.messages import Beacon


@dataclass(frozen=True, slots=True)
class Begin:
    """Event: the robot is switched on."""

    time: float


@dataclass(frozen=True, slots=True)
class Wake:
    """Event: the time that the robot requested with `WakeAt` has come."""

    time: float


@dataclass(frozen=True, slots=True)
class Heard:
    """Event: the robot received a beacon."""

    time: float
    beacon: Beacon


@dataclass(frozen=True, slots=True)
class Sensed:
    """Event: the robot has searched its target cell, and ``found`` tells whether the robot found something there.

    If the footprint of the robot is wider than one cell, ``beside`` lists the cells around the target cell in which the robot found
    something.
    """

    time: float
    cell: int
    found: bool = False
    beside: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Blocked:
    """Event: the robot stands in front of a cell that it cannot enter, because another robot is in this cell."""

    time: float
    cell: int


@dataclass(frozen=True, slots=True)
class Obstructed:
    """Event: a cell on the robot's path contains an obstacle. The robot stands in ``at``, the last cell before the obstacle."""

    time: float
    cell: int
    at: int


@dataclass(frozen=True, slots=True)
class Recharged:
    """Event: the robot is at its start, with a full battery."""

    time: float


Event = Begin | Wake | Heard | Sensed | Blocked | Obstructed | Recharged


@dataclass(frozen=True, slots=True)
class Go:
    """Action: go to a cell and search it.

    If the region may contain unknown obstacles, ``through`` lists the cells of the path, including the target cell.
    """

    cell: int
    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class GoHome:
    """Action: go to the start and recharge.

    If the region may contain unknown obstacles, ``through`` lists the cells of a path that is known to be free.
    """

    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Send:
    """Action: broadcast a beacon."""

    beacon: Beacon


@dataclass(frozen=True, slots=True)
class WakeAt:
    """Action: wake the robot at a given time. A new `WakeAt` replaces the previous `WakeAt`."""

    time: float


@dataclass(frozen=True, slots=True)
class Declare:
    """Action: declare that all cells are searched."""


Action = Go | GoHome | Send | WakeAt | Declare
