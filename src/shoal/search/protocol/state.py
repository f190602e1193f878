"""The state of a robot: what it knows from the beginning, what it knows about other robots, and what it does."""

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
    """The data that every robot of a search knows from the beginning.

    Parameters
    ----------
    tour_cost : TourCost
    allocator : str
        Name of the allocator that divides the tour; see `allocate`.
    multiplicity : int
        Number of different robots that must search each cell.
    hello : float
        Time during which robots listen before they start. The unit of time is the time in which a robot of speed 1 searches one
        cell.
    beat : float
        Time between two beacons of a robot.
    energy : float
        Energy of a full battery: the cost, in cells, of the movements and searches that a full battery allows. A robot must return
        to its start before its battery is empty.
    recharge : float
        Time that a robot needs to recharge its battery.
    ways_out : WaysOut, optional
        Distances from launch points outside the region to cells.
    delays : tuple of float
        Departure delay of each robot, in the order of the robots' numbers, or an empty tuple if no departures are planned.
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
        """Return how long the robot with a given number listens before it departs."""
        return self.hello + (self.delays[number - 1] if self.delays else 0.0)

    def from_launch(self, number: int, start: int, cell: int) -> float:
        """Return the distance to a cell from a robot's launch point, minus the distance from its start cell, in cell sides.

        The result can be negative. For a robot that moves only from cell to cell, the result is the distance from the launch point
        to the start cell, where the robot enters the region.
        """
        if self.ways_out is None or number not in self.ways_out:
            return 0.0
        if self.tour_cost.stepwise:
            return self.ways_out.length(number, start)
        return self.ways_out.length(number, cell) - self.tour_cost.length(start, cell)

    @property
    def everything(self) -> int:
        """Bitset of all cells of the tour."""
        return (1 << len(self.tour_cost)) - 1


@dataclass(frozen=True, slots=True)
class Peer:
    """What a robot knows about another robot, its peer.

    The attribute ``heartbeat`` is the peer's latest heartbeat, which arrived at the time ``heard``. The attribute ``marks``
    contains two pairs: an earlier time, and the peer's lag at this time. The attribute ``since`` is the time at which the peer
    first reported its present destination. The attribute ``way`` is the length of the peer's path to its destination, in cell
    sides.
    """

    heartbeat: Heartbeat
    heard: float
    marks: tuple[tuple[float, float], tuple[float, float]]
    since: float
    way: float


@dataclass(frozen=True)
class Robot:
    """The state of a robot during a search.

    Parameters
    ----------
    number : int
        Number of the robot. The numbers of the robots begin with 1.
    brief : Brief
    start : int
        Tour index of the robot's start cell.
    rate : float
        Declared speed, at which the robot moves and searches.
    width : int
        Width of the robot's footprint, as an odd number of cells.
    status : str
        Status of the robot: "listening", "searching", "waiting" or "complete".
    cell : int
        Tour index of the last cell in which the robot stopped.
    fresh : bool
        Whether the robot has not searched the cell ``cell`` since it arrived there.
    at_launch : bool
        Whether the robot is at its launch point, which may be outside the region.
    target : int or None
        The target cell, to which the robot is moving.
    aim : int or None
        The cell that the robot wants to see. A robot with a wide footprint may see the cell ``aim`` from another cell, its target.
    through : tuple of int
        The cells of the path to the target cell, if the region may contain unknown obstacles.
    cost : float
        Cost, in cells, of moving to the target cell and searching it.
    parts : tuple of Part
        The parts of all robots, in the order of the tour.
    own : int
        Index of the robot's own part, or -1 while the robot listens.
    peers : mapping of int to Peer
        What the robot knows about each other robot, by the number of the other robot.
    searched : mapping of int to int
        Bitset of the cells that each robot reports as searched, by the number of the robot.
    found : mapping of int to int
        Bitset of the robots that found something in a cell, by the tour index of the cell.
    closed : mapping of int to int
        Bitset of the cells that each robot reports as blocked, by the number of the robot.
    passed : int
        Bitset of the cells known to be free because the robot has entered them or has passed one of their corners. Robots use the
        bitset ``passed`` only if the region may contain unknown obstacles.
    avoided : int
        Bitset of the cells that the robot avoids until the time ``avoided_until``, because another robot was in them.
    count : int
        Number of beacons that the robot has sent.
    next_beat : float
        Time at which the robot sends its next beacon.
    allotted_to : int
        Number of robots among which the robot last divided the tour.
    allotted_at : float
        Time at which the robot last divided the tour.
    began : float
        Time at which the robot was switched on.
    deadline : float
        Time by which the robot would finish if it searched all cells alone.
    left : float
        Remaining energy of the robot, in the unit of ``Brief.energy``.
    since : float
        Time at which the robot began its current action: a movement, or waiting.
    lag : float
        Real duration of all previous paths of the robot, minus the duration of these paths at the declared speed.
    lost, got : int
        Number of messages known to be lost, and number of messages that the robot has received.
    told : tuple of tuple of mapping
        For each of the latest beacons, the searched, found and blocked cells that the robot knew when it sent the beacon.
    window : int
        The cell at which the next beacon begins to repeat known facts.
    lingering : int
        Number of beacons that the robot still sends after it has declared the search complete.
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
        """Bitset of the cells that the robot itself has searched."""
        return self.searched.get(self.number, 0)

    def way_out(self, cell: int) -> float:
        """Return the extra distance from the launch point to a cell (see `from_launch`), or 0 after the robot's departure."""
        return self.brief.from_launch(self.number, self.start, cell) if self.at_launch else 0.0

    def lag_at(self, time: float) -> float:
        """Return the robot's lag behind its declared speed at a given time, including the lag on its current path."""
        return self.lag if self.target is None else self.lag + max(time - self.since - self.cost / self.rate, 0.0)

    def but(self, **changes: Any) -> Robot:
        """Return a copy of the state in which the given fields have new values.

        Every message needs a copy of the state, and `dataclasses.replace` would be slower than this method.
        """
        other = object.__new__(Robot)
        other.__dict__.update(self.__dict__)
        other.__dict__.update(changes)
        return other
