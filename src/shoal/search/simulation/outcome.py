"""What a simulation keeps of each robot, and what it comes to."""

from __future__ import annotations

from dataclasses import field
from math import inf

from shoal.core.dataclass import dataclass
from shoal.search.protocol.robot import Robot


@dataclass
class SimulatedRobot:
    """A robot's body: where it is, and what of it works."""

    robot: Robot
    place: int  # the cell, as a number on the tour
    true_rate: float
    energy: float = inf  # what is left of it in truth
    alive: bool = True
    paused_until: float = 0.0
    liar: bool = False
    searching: int | None = None  # the cell that it is in to search it
    going: int | None = None
    aimed: int | None = None  # what it last went to a cell for: `Robot.aim`
    tries: int = 0
    wake: float = inf
    travelled: float = 0.0
    waited: float = 0.0  # for others to leave a cell
    visits: list[tuple[float, int]] = field(default_factory=list)  # when it had searched which cell
    passing: tuple[int, ...] = ()  # the cells that it has passed since
    detours: list[tuple[int, ...]] = field(default_factory=list)  # the same before each visit
    obstructed: list[tuple[float, int]] = field(default_factory=list)  # when it met which obstacle
    states: list[tuple[float, str]] = field(default_factory=list)


@dataclass(frozen=True)
class SimulationOutcome:
    """What a simulation came to.

    Parameters
    ----------
    covered : int
        The cells searched by robots that do not lie, as bits.
    covered_at : float
        When the last cell that some robot can reach was searched by one that does not lie; infinite if some never were.
    declared : dict of int to float
        When each robot declared the search complete.
    vehicles : dict of int to SimulatedRobot
    sent, lost : int
        Messages, counted by receiver, and how many of them did not arrive whole.
    takeovers : int
        How often a robot began to search another one's part.
    time : float
        Of the last event.
    trace : bytes
        One line of JSON an event, if a trace was asked for.
    """

    covered: int
    covered_at: float
    declared: dict[int, float]
    vehicles: dict[int, SimulatedRobot]
    sent: int
    lost: int
    takeovers: int
    time: float
    trace: bytes
