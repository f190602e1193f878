"""The state of a robot: its initial information, its knowledge of other robots, and its current action."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from math import inf
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.search.allocation.partition import Part
from shoal.search.allocation.tour_cost import TourCost
from shoal.search.cells.transits import WaysOut
from shoal.search.protocol.messages import Heartbeat, Status

_LINGER = 12  # number of beacons that a robot sends after the search is complete


@dataclass(frozen=True, slots=True)
class Brief:
    """The information that every robot has from the beginning.

    Parameters
    ----------
    tour_cost : TourCost
    allocator : str
        Name of the allocator that divides the tour; see `allocate`.
    multiplicity : int
        Number of different robots that must search each cell.
    hello : float
        Time during which robots listen before they start. All times are in units of the time that a robot of speed 1 needs for one
        cell.
    beat : float
        Time between beacons.
    energy : float
        Cost in cells of the movements and searches that a full battery allows. A robot must return to its start before the battery
        is empty.
    recharge : float
        Duration of recharging.
    ways_out : WaysOut, optional
        Distances from launch points outside the region.
    delays : tuple of float
        Departure delay of each robot, by its number from 1. The tuple is empty without delays.
    """

    tour_cost: TourCost
    allocator: str = "hop"
    multiplicity: int = 1
    hello: float = 1.0
    beat: float = 1.0
    energy: float = inf
    recharge: float = 0.0
    ways_out: WaysOut | None = None
    delays: tuple[float, ...] = ()

    def listening(self, number: int) -> float:
        """Return how long a robot listens before it departs."""
        return self.hello + (self.delays[number - 1] if self.delays else 0.0)

    def from_launch(self, number: int, start: int, cell: int) -> float:
        """Return the distance to a cell from the robot's launch point, minus the distance to this cell from the robot's start cell.

        The value can be negative. A robot that moves from cell to cell enters the region at its start cell.
        """
        if self.ways_out is None or number not in self.ways_out:
            return 0.0
        if self.tour_cost.stepwise:
            return self.ways_out.length(number, start)
        return self.ways_out.length(number, cell) - self.tour_cost.length(start, cell)

    @property
    def everything(self) -> int:
        """All cells as a bitset."""
        return (1 << len(self.tour_cost)) - 1


@dataclass(frozen=True, slots=True)
class Peer:
    """What a robot knows about another robot: the latest heartbeat, the time of its arrival, and the lag at two earlier moments.

    ``since`` is the time at which the other robot first reported its destination. ``way`` is the length in cell sides of the other
    robot's path to its destination.
    """

    heartbeat: Heartbeat
    heard: float
    marks: tuple[tuple[float, float], tuple[float, float]]
    since: float
    way: float


@dataclass(frozen=True)
class Robot:
    """The state of a robot.

    Parameters
    ----------
    number : int
        Number of the robot, from 1.
    brief : Brief
    start : int
        Tour index of the robot's start cell.
    rate : float
        Declared speed, at which the robot moves and searches.
    width : int
        Width of the footprint in cells, odd.
    status : str
        "listening", "searching", "waiting", "complete".
    cell : int
        Tour index of the robot's last cell.
    fresh : bool
        Whether the robot has searched nothing since it arrived at ``cell``.
    at_launch : bool
        Whether the robot is at its launch point, which may be outside the region.
    target : int or None
        The cell to which the robot is moving.
    aim : int or None
        The cell that the robot wants to see: the target or, with a footprint wider than one cell, a cell that is visible from the
        target.
    through : tuple of int
        The cells of the path to the target, if there may be obstacles.
    cost : float
        Cost in cells of moving to the target and searching it.
    parts : tuple of Part
        The parts of all robots in the order of the tour.
    own : int
        Index of the robot's own part, or -1 while the robot listens.
    peers : mapping of int to Peer
    searched : mapping of int to int
        For each robot, the cells that it reports as searched, as a bitset.
    found : mapping of int to int
        For each cell with findings, the robots that found something, as a bitset.
    closed : mapping of int to int
        For each robot, the cells that it reports as blocked, as a bitset.
    passed : int
        Bitset of the cells known to be free because the robot has entered them, or has passed one of their corners. The bitset is
        used only if there may be obstacles.
    avoided : int
        Bitset of the cells that the robot avoids until ``avoided_until``, because another robot was in them.
    count : int
        Number of beacons sent.
    next_beat : float
        Time of the next beacon.
    allotted_to : int
        Number of robots among which the tour was last divided.
    allotted_at : float
        Time at which the tour was last divided.
    began : float
        Time at which the robot was switched on.
    deadline : float
        Time at which the search ends if the robot searches all cells alone.
    left : float
        Remaining energy, in the unit of ``Brief.energy``.
    since : float
        Time at which the current action (a movement, or waiting) began.
    lag : float
        Total additional time of all previous paths, compared with their duration at the declared speed.
    lost, got : int
        Number of messages known to be lost, and number of messages received.
    told : tuple of tuple of mapping
        For each of the latest beacons, the searched, found and blocked cells that the robot knew when it sent the beacon.
    window : int
        The cell from which the next beacon repeats known facts.
    lingering : int
        Number of beacons that the robot still sends after the search is complete.
    """

    number: int
    brief: Brief
    start: int
    rate: float = 1.0
    width: int = 1
    status: Status = "listening"
    cell: int = 0
    fresh: bool = True
    at_launch: bool = False
    target: int | None = None
    aim: int | None = None
    through: tuple[int, ...] = ()
    cost: float = 0.0
    parts: tuple[Part, ...] = ()
    own: int = -1
    peers: Mapping[int, Peer] = field(default_factory=dict)
    searched: Mapping[int, int] = field(default_factory=dict)
    found: Mapping[int, int] = field(default_factory=dict)
    closed: Mapping[int, int] = field(default_factory=dict)
    passed: int = 0
    avoided: int = 0
    avoided_until: float = 0.0
    count: int = 0
    next_beat: float = 0.0
    allotted_to: int = 0
    allotted_at: float = 0.0
    began: float = 0.0
    deadline: float = inf
    left: float = inf
    since: float = 0.0
    lag: float = 0.0
    lost: int = 0
    got: int = 0
    told: tuple[tuple[Mapping[int, int], ...], ...] = ()
    window: int = 0
    lingering: int = _LINGER

    @property
    def mine(self) -> int:
        """The cells that the robot itself has searched, as a bitset."""
        return self.searched.get(self.number, 0)

    def way_out(self, cell: int) -> float:
        """Return the extra distance to a cell before the robot's departure (see `from_launch`), or 0 after the departure."""
        return self.brief.from_launch(self.number, self.start, cell) if self.at_launch else 0.0

    def lag_at(self, time: float) -> float:
        """Return the robot's lag behind its declared speed, including the current path."""
        return self.lag if self.target is None else self.lag + max(time - self.since - self.cost / self.rate, 0.0)

    def but(self, **changes: Any) -> Robot:
        """Return a copy of the state in which some fields have other values.

        The method avoids the slower `dataclasses.replace`, because every message needs a copy of the state.
        """
        other = object.__new__(Robot)
        other.__dict__.update(self.__dict__)
        other.__dict__.update(changes)
        return other
