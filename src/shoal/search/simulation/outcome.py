"""The bodies of simulated robots, and the outcome of a simulation."""

from __future__ import annotations

from dataclasses import field
from math import inf

from shoal.core.dataclass import dataclass
from shoal.search.protocol.robot import Robot


@dataclass
class SimulatedRobot:
    """The body of a simulated robot: its position, and whether it works."""

    robot: Robot
    place: int  # tour index of its cell
    true_rate: float
    energy: float = inf  # its true remaining energy
    alive: bool = True
    paused_until: float = 0.0
    liar: bool = False
    searching: int | None = None  # the cell that it occupies for its search
    going: int | None = None
    aimed: int | None = None  # the aim of its last movement: `Robot.aim`
    tries: int = 0
    wake: float = inf
    travelled: float = 0.0
    waited: float = 0.0  # waits for other robots to leave a cell
    visits: list[tuple[float, int]] = field(default_factory=list)  # time at which each cell was searched
    passing: tuple[int, ...] = ()  # the cells passed since then
    detours: list[tuple[int, ...]] = field(default_factory=list)  # the passed cells before each visit
    obstructed: list[tuple[float, int]] = field(default_factory=list)  # time at which each obstacle was discovered
    states: list[tuple[float, str]] = field(default_factory=list)


@dataclass(frozen=True)
class SimulationOutcome:
    """The outcome of a simulation.

    Parameters
    ----------
    covered : int
        The cells that robots without the fault liar searched, as a bitset.
    covered_at : float
        Time at which the last reachable cell was searched by a robot that does not lie, or infinity if some cell was never searched
        so.
    declared : dict of int to float
        Time at which each robot declared completion.
    vehicles : dict of int to SimulatedRobot
    sent, lost : int
        Number of messages, counted for each receiver, and number of messages that were lost or damaged.
    takeovers : int
        Number of times that a robot started to search another robot's part.
    time : float
        Time of the last event.
    trace : bytes
        One line of JSON per event, if a trace was requested.
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
