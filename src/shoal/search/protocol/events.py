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
    """The time has come for which the robot has asked to be woken."""

    time: float


@dataclass(frozen=True, slots=True)
class Heard:
    """A beacon has come."""

    time: float
    beacon: Beacon


@dataclass(frozen=True, slots=True)
class Sensed:
    """The robot has come to the cell that it wanted to search and has searched it; ``found`` if there is something.

    What it has found in cells around, which it sees with a wider footprint, is ``beside``.
    """

    time: float
    cell: int
    found: bool = False
    beside: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Blocked:
    """Another robot is in the cell that it wanted to enter; the robot stands before it."""

    time: float
    cell: int


@dataclass(frozen=True, slots=True)
class Obstructed:
    """A cell on the way cannot be entered by any robot; the robot stands in the cell before it, ``at``."""

    time: float
    cell: int
    at: int


@dataclass(frozen=True, slots=True)
class Recharged:
    """The robot is at its start with all its energy."""

    time: float


Event = Begin | Wake | Heard | Sensed | Blocked | Obstructed | Recharged


@dataclass(frozen=True, slots=True)
class Go:
    """Go to a cell and search it, from cell to cell ``through`` some, itself the last, if there may be obstacles."""

    cell: int
    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class GoHome:
    """Go to the start and recharge, ``through`` cells that are known to be free, if there may be obstacles."""

    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Send:
    """Broadcast."""

    beacon: Beacon


@dataclass(frozen=True, slots=True)
class WakeAt:
    """Be woken at a time; it takes the place of the time asked for before."""

    time: float


@dataclass(frozen=True, slots=True)
class Declare:
    """All is searched."""


Action = Go | GoHome | Send | WakeAt | Declare
