"""State of a robot: what it is told at the beginning, what it knows of other robots, what it does."""

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

_LINGER = 12  # beacons that a robot sends when all is done


@dataclass(frozen=True, slots=True)
class Brief:
    """What every robot knows from the beginning.

    Parameters
    ----------
    tour_cost : TourCost
    allocator : str
        How the tour is allotted; see `allocate`.
    multiplicity : int
        How many robots must search each cell.
    hello : float
        How long robots listen before they go; all times are those that a robot of speed 1 takes for a cell.
    beat : float
        Between beacons.
    energy : float
        How long a robot can move before it must be back at its start to recharge.
    recharge : float
        How long that takes.
    ways_out : WaysOut, optional
        Of robots that set out outside of the region.
    delays : tuple of float
        How long after the others each sets out, by number from 1; none for none.
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
        """Return how long a robot listens, until it sets out."""
        return self.hello + (self.delays[number - 1] if self.delays else 0.0)

    def from_launch(self, number: int, start: int, cell: int) -> float:
        """Return how much longer the way to a cell is from where a robot sets out than from the cell where it starts.

        Shorter where it is less than 0. A robot that goes from cell to cell comes in where it starts.
        """
        if self.ways_out is None or number not in self.ways_out:
            return 0.0
        if self.tour_cost.stepwise:
            return self.ways_out.length(number, start)
        return self.ways_out.length(number, cell) - self.tour_cost.length(start, cell)

    @property
    def everything(self) -> int:
        """All cells, as bits."""
        return (1 << len(self.tour_cost)) - 1


@dataclass(frozen=True, slots=True)
class Peer:
    """What a robot knows of another one: its latest heartbeat, when it came, and at two earlier moments how far it was behind.

    ``since`` is when it was first heard to be on its way to where it is going, and ``way`` how long that is, in sides of a cell.
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
        Its own, different from all others'.
    brief : Brief
    start : int
        The number on the tour of the cell in which it starts.
    rate : float
        How fast it moves and searches.
    width : int
        How many cells wide its footprint is, odd.
    status : str
        "listening", "searching", "waiting", "complete".
    cell : int
        Where it has been last, the number on the tour.
    fresh : bool
        Whether it has searched nothing since it was in ``cell`` without searching it.
    at_launch : bool
        Whether it is where it sets out, which may be outside of the region.
    target : int or None
        The cell that it is on the way to.
    aim : int or None
        What it goes there for: that cell, or with a wider footprint one that it sees from there.
    through : tuple of int
        The cells of that way, if there may be obstacles.
    cost : float
        Of going there and searching it.
    parts : tuple of Part
        Who is to search what, in the order of the tour.
    own : int
        Which of them is its own; -1 before it listens no more.
    peers : mapping of int to Peer
    searched : mapping of int to int
        By robot, the cells that it is said to have searched, as bits.
    found : mapping of int to int
        By cell, the robots that have found something there, as bits.
    closed : mapping of int to int
        By robot, the cells that it says cannot be entered, as bits.
    passed : int
        The cells that it has been in or come by across a corner, as bits: they are free. Kept where there may be obstacles.
    avoided : int
        Cells where its way was blocked, until ``avoided_until``.
    count : int
        Beacons sent.
    next_beat : float
        When the next beacon is due.
    allotted_to : int
        How many robots the tour was last allotted to.
    allotted_at : float
        When.
    began : float
        When it was switched on.
    deadline : float
        When it would have searched everything alone.
    left : float
        Energy.
    since : float
        When it began to do what it does: to go somewhere, or to wait.
    lag : float
        How much longer than it takes by its rate it has needed for all its ways until then.
    lost, got : int
        Messages that it knows to have missed, and others.
    told : tuple of tuple of mapping
        What it had searched, found and met when it sent its latest beacons.
    window : int
        The cell from which on its next beacon tells what is not new.
    lingering : int
        How many beacons it will still send when all is done.
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
        """The cells that it has searched itself, as bits."""
        return self.searched.get(self.number, 0)

    def way_out(self, cell: int) -> float:
        """Return how much longer its way to a cell is than from the cell where it starts; 0 once it has set out."""
        return self.brief.from_launch(self.number, self.start, cell) if self.at_launch else 0.0

    def lag_at(self, time: float) -> float:
        """Return how far it is behind what it has declared, the way that it is on included."""
        return self.lag if self.target is None else self.lag + max(time - self.since - self.cost / self.rate, 0.0)

    def but(self, **changes: Any) -> Robot:
        """Return the same with other values: `dataclasses.replace`, but quick, as it happens at every message."""
        other = object.__new__(Robot)
        other.__dict__.update(self.__dict__)
        other.__dict__.update(changes)
        return other
