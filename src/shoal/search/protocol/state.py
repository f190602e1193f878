"""What a robot knows: events, the state that they make, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import lru_cache
from math import inf, log
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.search.allocation.allocate import Part
from shoal.search.allocation.costs import TourCost
from shoal.search.allocation.viewpoints import gain_of
from shoal.search.cells.distances import CellDistances
from shoal.search.cells.routing import LaunchDistances
from shoal.search.kernels.protocol.numbers import (
    BEATS,
    CRAWL,
    FALSE_POSITIVE_RATE,
    LINGER,
    LONGEST_SILENCE,
    MARK,
    RELUCTANCE,
    SHORTEST_SILENCE,
    TOLERATED,
)
from shoal.search.protocol.messages import Beacon, Heartbeat, Status
from shoal.search.tours.masks import at_least


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
        Time during which robots listen before they start. The unit of time is the time in which a
        robot of speed 1 searches one cell.
    beat : float
        Time between two beacons of a robot.
    energy : float
        Energy of a full battery: the cost, in cells, of the movements and searches that a full
        battery allows. A robot must return to its start before its battery is empty.
    recharge : float
        Time that a robot needs to recharge its battery.
    ways_out : LaunchDistances, optional
        Distances from launch points outside the region to cells.
    delays : tuple of float
        Departure delay of each robot, in the order of the robots' numbers, or an empty tuple if no
        departures are planned.
    helping : bool
        Whether robots help late ones, and search what others left until their deadline. Vehicles
        that fly planned missions do neither.
    """

    tour_cost: TourCost
    allocator: str = "hop"
    multiplicity: int = 1
    hello: float = 1.0
    beat: float = 1.0
    energy: float = inf
    recharge: float = 0.0
    launch_distances: LaunchDistances | None = None
    delays: tuple[float, ...] = ()
    helping: bool = True

    def listening(self, number: int) -> float:
        """Return how long the robot with a given number listens before it departs."""
        return self.hello + (self.delays[number - 1] if self.delays else 0.0)

    def from_launch(self, number: int, start: int, cell: int) -> float:
        """Return the distance to a cell from a robot's launch point, minus the distance from its
        start cell, in cell sides.

        The result can be negative. For a robot that moves only from cell to cell, the result is the
        distance from the launch point to the start cell, where the robot enters the region.
        """
        if self.launch_distances is None or number not in self.launch_distances:
            return 0.0
        if self.tour_cost.stepwise:
            return self.launch_distances.length(number, start)
        return self.launch_distances.length(number, cell) - self.tour_cost.length(start, cell)

    @property
    def everything(self) -> int:
        """Bitset of all cells of the tour."""
        return (1 << len(self.tour_cost)) - 1


@dataclass(frozen=True, slots=True)
class Peer:
    """What a robot knows about another robot, its peer.

    The attribute ``heartbeat`` is the peer's latest heartbeat, which arrived at the time ``heard``.
    The attribute ``marks`` contains two pairs: an earlier time, and the peer's lag at this time.
    The attribute ``since`` is the time at which the peer first reported its present destination.
    The attribute ``distance`` is the length of the peer's path to its destination, in cell sides.
    """

    heartbeat: Heartbeat
    heard: float
    marks: tuple[tuple[float, float], tuple[float, float]]
    since: float
    distance: float


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
        The cell that the robot wants to see. A robot with a wide footprint may see the cell ``aim``
        from another cell, its target.
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
        Bitset of the cells known to be free because the robot has entered them or has passed one of
        their corners. Robots use the bitset ``passed`` only if the region may contain unknown
        obstacles.
    avoided : int
        Bitset of the cells that the robot avoids until the time ``avoided_until``, because another
        robot was in them.
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
        Real duration of all previous paths of the robot, minus the duration of these paths at the
        declared speed.
    unheeded : int
        Number of messages that the waiting robot has heard since it last decided.
    waits_until : float
        Time until which the robot waits, as it last decided.
    lost, got : int
        Number of messages known to be lost, and number of messages that the robot has received.
    announced : tuple of tuple of mapping
        For each of the latest beacons, the searched, found and blocked cells that the robot knew
        when it sent the beacon.
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
    unheeded: int = 0
    waits_until: float = inf
    lost: int = 0
    received: int = 0
    announced: tuple[tuple[Mapping[int, int], ...], ...] = ()
    window: int = 0
    lingering: int = LINGER

    @property
    def mine(self) -> int:
        """Bitset of the cells that the robot itself has searched."""
        return self.searched.get(self.number, 0)

    def launch_cost(self, cell: int) -> float:
        """Return the extra distance from the launch point to a cell (see `from_launch`), or 0 after
        the robot's departure.
        """
        return self.brief.from_launch(self.number, self.start, cell) if self.at_launch else 0.0

    def lag_at(self, time: float) -> float:
        """Return the robot's lag behind its declared speed at a given time, including the lag on
        its current path.
        """
        return (
            self.lag
            if self.target is None
            else self.lag + max(time - self.since - self.cost / self.rate, 0.0)
        )

    def replaced(self, **changes: Any) -> Robot:
        """Return a copy of the state in which the given fields have new values.

        Every message needs a copy of the state, and `dataclasses.replace` would be slower than this
        method.
        """
        other = object.__new__(Robot)
        other.__dict__.update(self.__dict__)
        other.__dict__.update(changes)
        return other


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
    """Event: the robot has searched its target cell, and ``found`` tells whether the robot found
    something there.

    If the footprint of the robot is wider than one cell, ``beside`` lists the cells around the
    target cell in which the robot found something.
    """

    time: float
    cell: int
    found: bool = False
    beside: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Blocked:
    """Event: the robot stands in front of a cell that it cannot enter, because another robot is in
    this cell.
    """

    time: float
    cell: int


@dataclass(frozen=True, slots=True)
class Obstructed:
    """Event: a cell on the robot's path contains an obstacle. The robot stands in ``at``, the last
    cell before the obstacle.
    """

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

    If the region may contain unknown obstacles, ``through`` lists the cells of the path, including
    the target cell.
    """

    cell: int
    through: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class GoHome:
    """Action: go to the start and recharge.

    If the region may contain unknown obstacles, ``through`` lists the cells of a path that is known
    to be free.
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


def step_cost(tour_cost: TourCost, source: int, cell: int, fresh: bool, closed: int = 0) -> float:
    """Return the cost, in cells, of moving from the cell ``source`` to the cell ``cell`` and
    searching ``cell``.

    The argument ``fresh`` tells whether the robot has arrived in the cell ``source`` but has not
    searched it. The bitset ``closed`` contains the blocked cells.
    """
    return 1.0 + tour_cost.move_cost(source, cell, fresh=fresh, closed=closed)


def obstacles(robot: Robot) -> int:
    """Return the bitset of cells that this robot found blocked, or that at least ``multiplicity``
    robots report as blocked.
    """
    if not robot.closed:
        return 0
    return robot.closed.get(robot.number, 0) | at_least(
        list(robot.closed.values()), robot.brief.multiplicity
    )


def own_reach(robot: Robot) -> int:
    """Return the bitset of cells that this robot can reach."""
    distances = robot.brief.tour_cost.distances
    if not isinstance(distances, CellDistances):
        return robot.brief.everything
    return distances.reach(robot.cell, obstacles(robot))


def reachable_cells(robot: Robot, time: float) -> tuple[int, int]:
    """Return two bitsets: the cells that this robot can reach, and the cells that at least one live
    robot can reach.

    If this robot no longer waits for other robots, both bitsets contain the cells that this robot
    can reach.
    """
    distances, n = robot.brief.tour_cost.distances, len(robot.brief.tour_cost)
    if not isinstance(distances, CellDistances):
        return robot.brief.everything, robot.brief.everything
    closed = obstacles(robot)
    own = anyone = own_reach(robot)
    if not _waits_for_others(robot, time):
        return own, own
    for number, peer in robot.peers.items():
        if is_live(robot, number, time):
            anyone |= distances.reach(peer.heartbeat.start % n, closed)
    return own, anyone


def silence_limit(robot: Robot) -> float:
    """Return the time without a message from a robot after which the robot is presumed dead.

    This time grows with the fraction of lost messages.
    """
    return robot.brief.beat * _silent_beats(robot.lost, robot.received)


@lru_cache(maxsize=1024)
def _silent_beats(lost: int, received: int) -> float:
    share = lost / (lost + received) if received else 0.5
    beats = log(FALSE_POSITIVE_RATE) / log(share) if 0 < share < 1 else 0.0
    return min(max(SHORTEST_SILENCE, beats), LONGEST_SILENCE) + 0.5


def is_live(robot: Robot, number: int, time: float) -> bool:
    """Return whether the robot ``robot`` presumes that the robot with the number ``number`` is
    alive.
    """
    peer = robot.peers.get(number)
    return number == robot.number or (
        peer is not None and time - peer.heard <= silence_limit(robot)
    )


def can_come(robot: Robot, number: int, own: int, time: float) -> bool:
    """Return whether the robot with the number ``number`` is presumed alive, and has its start cell
    in the bitset ``own``.

    The bitset ``own`` contains the cells that the robot ``robot`` can reach. If the start cell is
    unknown, the function assumes that ``own`` contains the start cell.
    """
    peer = robot.peers.get(number)
    return is_live(robot, number, time) and (
        peer is None or bool(own >> peer.heartbeat.start % len(robot.brief.tour_cost) & 1)
    )


def speed_of(robot: Robot, number: int, time: float) -> tuple[float, float]:
    """Return two estimates for a robot, in cells per unit of time: the speed at which it moves, and
    the rate at which it searches.

    The estimates follow from the robot's declared speed, its recent lag and the width of its
    footprint.
    """
    if number == robot.number:
        gone, behind = time - robot.allotted_at, robot.lag_at(time)
        rate, width = robot.rate, robot.width
    else:
        peer = robot.peers[number]
        since, lag = peer.marks[0]
        gone, behind = peer.heard - since, peer.heartbeat.lag - lag
        rate, width = peer.heartbeat.rate, peer.heartbeat.width
    if gone >= MARK * robot.brief.beat:
        rate *= min(max(1.0 - behind / gone, CRAWL), 1.0)
    return rate, rate if width == 1 else rate * gain_of(robot.brief.tour_cost, width)


def is_late(robot: Robot, number: int, time: float) -> bool:
    """Return whether a robot lags so far behind its declared speed that other robots should help
    it.

    A robot has a higher limit for its own lag than for the lag of another robot, so that other
    robots notice the lag before the late robot does.
    """
    if not robot.brief.helping:
        return False
    if number == robot.number:
        return robot.lag_at(time) > RELUCTANCE * _tolerance(robot, time)
    peer = robot.peers.get(number)
    return peer is not None and peer.heartbeat.lag > _tolerance(robot, peer.heard)


def _tolerance(robot: Robot, time: float) -> float:
    return TOLERATED * max(time - robot.allotted_at, 0.0) + BEATS * robot.brief.beat


def _waits_for_others(robot: Robot, time: float) -> bool:
    """Return whether the robot still waits for other robots to search cells that only they can
    search.

    If ``multiplicity`` is above 1, robots could wait for each other forever, so the robot waits
    only for a limited time.
    """
    return robot.brief.multiplicity == 1 or time < 3 * robot.deadline


def settled_cells(robot: Robot, time: float) -> int:
    """Return the bitset of cells that need no further search."""
    searched_by = robot.searched
    if robot.closed:
        searched_by = {
            number: searched_by.get(number, 0) | robot.closed.get(number, 0)
            for number in {*searched_by, *robot.closed}
        }
    everyone = list(searched_by.values())
    if robot.brief.multiplicity == 1:
        return at_least(everyone, 1)
    mine = searched_by.get(robot.number, 0)
    distances, n = robot.brief.tour_cost.distances, len(robot.brief.tour_cost)
    # no further robot can search a cell that all live robots have searched
    for number, peer in robot.peers.items():
        if is_live(robot, number, time) and _waits_for_others(robot, time):
            theirs = searched_by.get(number, 0)
            if isinstance(distances, CellDistances):
                theirs |= ~distances.reach(peer.heartbeat.start % n, obstacles(robot))
            mine &= theirs
    return at_least(everyone, robot.brief.multiplicity) | mine


def free_cells(robot: Robot) -> int:
    """Return the bitset of cells that are known to be free.

    A cell is known to be free if this robot has passed it, or if a robot with a footprint of one
    cell has searched it.
    """
    wide = {number for number, peer in robot.peers.items() if peer.heartbeat.width > 1}
    if robot.width > 1:
        wide.add(robot.number)
    return robot.passed | at_least(
        [cells for number, cells in robot.searched.items() if number not in wide], 1
    )
