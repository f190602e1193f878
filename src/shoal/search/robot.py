"""The robot: a pure state machine, (state, event) -> (state, actions). It knows what it has sensed and heard, and nothing else.

The same machine runs in the deterministic simulation (`shoal.search.world`) and as a process with a radio (`shoal.search.live`).

It listens, allots the tour to all that it has heard of, searches its own part, and then what those ahead of it that have fallen
silent leave, as far as the next live robot's part. While others are at work it waits, but never longer than would let it search all
that it does not know to be searched before it would have gone once round alone. So whatever is lost or dies, one robot that lives
searches everything in that time (paper H, p. 4 to 7: "As long as at least one robot remains alive, the search should complete").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, log
from typing import Any

from shoal.search.allocation import Sweep
from shoal.search.bits import at_least, next_in
from shoal.search.course import Course
from shoal.search.messages import Beacon, Sign, Status
from shoal.search.sharing import Part, cost_of_all, parts_of, previous_in

_SURE = 0.01  # a live robot is taken for dead by as large a share of silences
_BEATS = (3.0, 40.0)  # silences that are always and never taken for death
_LINGER = 12  # beacons that a robot sends when all is done
_HELLOS = 8  # beacons while robots listen
_AVOIDED = 3.0  # cells: how long a robot goes elsewhere after its way was blocked


@dataclass(frozen=True, slots=True)
class Brief:
    """What every robot knows from the beginning.

    Parameters
    ----------
    course : Course
    method : str
        How the tour is allotted; see `allocate`.
    fold : int
        How many robots must search each cell.
    hello : float
        How long robots listen before they go; all times are those that a robot of speed 1 takes for a cell.
    beat : float
        Between beacons.
    energy : float
        How long a robot can move before it must be back at its start to recharge.
    recharge : float
        How long that takes.
    """

    course: Course
    method: str = "hop"
    fold: int = 1
    hello: float = 1.0
    beat: float = 1.0
    energy: float = inf
    recharge: float = 0.0

    @property
    def everything(self) -> int:
        """All cells, as bits."""
        return (1 << len(self.course)) - 1


@dataclass(frozen=True, slots=True)
class Peer:
    """What a robot knows of another one: its latest sign of life, and when it came."""

    sign: Sign
    heard: float


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
    status : str
        "listening", "searching", "waiting", "complete".
    cell : int
        Where it has been last, the number on the tour.
    fresh : bool
        Whether it has searched nothing since it was in ``cell`` without searching it.
    target : int or None
        The cell that it is on the way to.
    parts : tuple of Part
        Who is to search what, in the order of the tour.
    own : int
        Which of them is its own; -1 before it listens no more.
    peers : mapping of int to Peer
    searched : mapping of int to int
        By robot, the cells that it is said to have searched, as bits.
    found : mapping of int to int
        By cell, the robots that have found something there, as bits.
    avoided : int
        Cells where its way was blocked, until ``avoided_until``.
    count : int
        Beacons sent.
    next_beat : float
        When the next beacon is due.
    allotted_to : int
        How many robots the tour was last allotted to.
    began : float
        When it was switched on.
    deadline : float
        When it would have searched everything alone.
    left : float
        Energy.
    lost, got : int
        Messages that it knows to have missed, and others.
    lingering : int
        How many beacons it will still send when all is done.
    """

    number: int
    brief: Brief
    start: int
    rate: float = 1.0
    status: Status = "listening"
    cell: int = 0
    fresh: bool = True
    target: int | None = None
    parts: tuple[Part, ...] = ()
    own: int = -1
    peers: Mapping[int, Peer] = field(default_factory=dict)
    searched: Mapping[int, int] = field(default_factory=dict)
    found: Mapping[int, int] = field(default_factory=dict)
    avoided: int = 0
    avoided_until: float = 0.0
    count: int = 0
    next_beat: float = 0.0
    allotted_to: int = 0
    began: float = 0.0
    deadline: float = inf
    left: float = inf
    lost: int = 0
    got: int = 0
    lingering: int = _LINGER

    @property
    def mine(self) -> int:
        """The cells that it has searched itself, as bits."""
        return self.searched.get(self.number, 0)

    def but(self, **changes: Any) -> Robot:
        """Return the same with other values: `dataclasses.replace`, but quick, as it happens at every message."""
        other = object.__new__(Robot)
        other.__dict__.update(self.__dict__)
        other.__dict__.update(changes)
        return other


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
    """The robot has come to the cell that it wanted to search and has searched it; ``found`` if there is something."""

    time: float
    cell: int
    found: bool = False


@dataclass(frozen=True, slots=True)
class Blocked:
    """Another robot is in the cell that it wanted to enter; the robot stands before it."""

    time: float
    cell: int


@dataclass(frozen=True, slots=True)
class Recharged:
    """The robot is at its start with all its energy."""

    time: float


Event = Begin | Wake | Heard | Sensed | Blocked | Recharged


@dataclass(frozen=True, slots=True)
class Go:
    """Go to a cell and search it."""

    cell: int


@dataclass(frozen=True, slots=True)
class GoHome:
    """Go to the start and recharge."""


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


def advance(robot: Robot, event: Event) -> tuple[Robot, list[Action]]:
    """Return the state after an event, and what the robot does.

    Examples
    --------
    >>> from shoal.search import Course, make_tour
    >>> brief = Brief(Course(make_tour("moore", (2, 2))))
    >>> robot, actions = advance(Robot(7, brief, start=3), Begin(0.0))
    >>> robot.status, [type(action).__name__ for action in actions]
    ('listening', ['Send', 'WakeAt'])
    >>> robot, actions = advance(robot, Wake(1.0))
    >>> actions[0]
    Go(cell=3)
    """
    actions: list[Action] = []
    time = event.time
    match event:
        case Begin():
            robot = robot.but(began=time, next_beat=time, cell=robot.start, left=robot.brief.energy)
        case Heard():
            robot = heard(robot, event.beacon, time)
        case Sensed():
            robot = _sensed(robot, event.cell, event.found)
        case Blocked():
            robot = _blocked(robot, event.cell, time)
        case Recharged():
            robot = robot.but(cell=robot.start, fresh=True, target=None, left=robot.brief.energy)
    if robot.status == "listening" and time >= robot.began + robot.brief.hello - 1e-9:
        robot = _allotted(robot, time)
    wake = inf
    if robot.status in ("searching", "waiting") and robot.target is None:
        robot, action, wake = decided(robot, time)
        if action is not None:
            actions.append(action)
    if robot.status != "complete" or robot.lingering > 0:
        robot = _beaconed(robot, time, actions)
        wake = min(wake, robot.next_beat)
        if robot.status == "listening":
            wake = min(wake, robot.began + robot.brief.hello)
        actions.append(WakeAt(wake))
    return robot, actions


def _beaconed(robot: Robot, time: float, actions: list[Action]) -> Robot:
    """Add the beacon that is due."""
    if time < robot.next_beat - 1e-9:
        return robot
    pause = robot.brief.beat if robot.status != "listening" else min(robot.brief.beat, robot.brief.hello / _HELLOS)
    robot = robot.but(count=robot.count + 1, next_beat=time + pause)
    if robot.status == "complete":
        robot = robot.but(lingering=robot.lingering - 1)
    own = Sign(robot.number, robot.count, robot.start, robot.rate, robot.status)
    signs = (own, *(peer.sign for peer in robot.peers.values()))
    actions.append(Send(Beacon(robot.number, signs, tuple(robot.searched.items()), tuple(robot.found.items()))))
    return robot


def heard(robot: Robot, beacon: Beacon, time: float) -> Robot:
    """Return the state with all that a beacon tells."""
    peers, lost, got = dict(robot.peers), robot.lost, robot.got
    number = robot.number
    for sign in beacon.signs:
        known = peers.get(sign.robot)
        if (known is not None and known.sign.count >= sign.count) or sign.robot == number:
            continue
        if sign.robot == beacon.sender and known is not None:
            lost, got = lost + sign.count - known.sign.count - 1, got + 1
        peers[sign.robot] = Peer(sign, time)
    searched = robot.searched
    for other, told in beacon.searched:
        known_bits = searched.get(other, 0)
        if told != known_bits and other != number:
            more = told & robot.brief.everything & ~known_bits  # what is no cell would never be settled
            if more:
                searched = {**searched, other: known_bits | more}
    found = robot.found
    for cell, witnesses in beacon.found:
        if cell < len(robot.brief.course) and witnesses & ~found.get(cell, 0):
            found = {**found, cell: found.get(cell, 0) | witnesses}
    return robot.but(peers=peers, lost=lost, got=got, searched=searched, found=found)


def _sensed(robot: Robot, cell: int, something: bool) -> Robot:
    cost = move_cost(robot, cell)
    searched = {**robot.searched, robot.number: robot.mine | 1 << cell}
    found = robot.found
    if something:
        found = {**found, cell: found.get(cell, 0) | 1 << robot.number}
    return robot.but(searched=searched, found=found, cell=cell, fresh=False, target=None, left=robot.left - cost)


def _blocked(robot: Robot, cell: int, time: float) -> Robot:
    """Go elsewhere for a while: two robots that want to pass one another would stand there for ever."""
    return robot.but(target=None, avoided=robot.avoided | 1 << cell, avoided_until=time + _AVOIDED)


def _allotted(robot: Robot, time: float) -> Robot:
    """Allot the tour to all robots heard of, if that leaves enough time to search all the rest alone."""
    brief, n = robot.brief, len(robot.brief.course)
    known = {robot.number: (robot.start, robot.rate)}
    known |= {number: (peer.sign.start % n, peer.sign.rate) for number, peer in robot.peers.items()}
    parts = parts_of(brief.course, brief.method, tuple((number, *known[number]) for number in sorted(known)))
    own = next(index for index, part in enumerate(parts) if part.robot == robot.number)
    allotted = robot.but(parts=parts, own=own, status="searching", allotted_to=len(known))
    last = time + _alone(allotted) / robot.rate
    if robot.status == "listening":
        return allotted.but(deadline=last)
    return allotted if last <= robot.deadline + 1e-9 else robot.but(allotted_to=len(known))


def _alone(robot: Robot) -> float:
    """Return what it costs to search its own part, and then all the rest."""
    course, everything = robot.brief.course, robot.brief.everything
    rest = everything & ~(settled(robot, -inf) | robot.mine)
    cost, here, fresh = 0.0, robot.cell, robot.fresh
    for sweep in _sweeps(robot):
        while (cell := sweep.next_of(rest, len(course))) is not None:
            cost += step_cost(course, here, cell, fresh)
            here, fresh, rest = cell, False, rest & ~(1 << cell)
    return cost + cost_of_all(course, rest, here, fresh)


def _sweeps(robot: Robot) -> list[Sweep]:
    """Return its own work, and where cells are searched by several robots that of those ahead, too."""
    return [
        sweep
        for ahead in range(min(robot.brief.fold, len(robot.parts)))
        for sweep in robot.parts[(robot.own + ahead) % len(robot.parts)].sweeps
    ]


def step_cost(course: Course, here: int, cell: int, fresh: bool) -> float:
    """Return what it costs to go from a cell to another and search it; ``fresh`` if the first one was not searched just now."""
    return 1.0 + course.way(here, cell, fresh=fresh)


def move_cost(robot: Robot, cell: int) -> float:
    """Return what it costs a robot to go to a cell and search it."""
    return step_cost(robot.brief.course, robot.cell, cell, robot.fresh)


def patience(robot: Robot) -> float:
    """Return after how long a silence a robot is taken for dead: longer where many messages are lost."""
    share = robot.lost / (robot.lost + robot.got) if robot.got else 0.5
    beats = log(_SURE) / log(share) if 0 < share < 1 else 0.0
    return robot.brief.beat * (min(max(_BEATS[0], beats), _BEATS[1]) + 0.5)


def is_live(robot: Robot, number: int, time: float) -> bool:
    """Tell whether a robot takes another one for alive."""
    peer = robot.peers.get(number)
    return number == robot.number or (peer is not None and time - peer.heard <= patience(robot))


def settled(robot: Robot, time: float) -> int:
    """Return the cells that need no more searching, as bits."""
    everyone = list(robot.searched.values())
    if robot.brief.fold == 1:
        return at_least(everyone, 1)
    mine = robot.mine
    for number in robot.peers:  # what all live ones have searched cannot be searched by more
        if is_live(robot, number, time) and time < 3 * robot.deadline:
            mine &= robot.searched.get(number, 0)
    return at_least(everyone, robot.brief.fold) | mine


def decided(robot: Robot, time: float) -> tuple[Robot, Action | None, float]:
    """Return what to do next, and until when to wait if it is nothing."""
    brief = robot.brief
    if robot.allotted_to <= len(robot.peers):  # it has heard of another one
        robot = _allotted(robot, time)
    done = settled(robot, time)
    if done == brief.everything:
        return robot.but(status="complete", next_beat=time), Declare(), inf
    wanted = brief.everything & ~done & ~robot.mine
    if time < robot.avoided_until and wanted & ~robot.avoided:
        wanted &= ~robot.avoided
    elif robot.avoided:
        robot = robot.but(avoided=0)
    cell = _own_cell(robot, wanted)
    wake = inf
    if cell is None:
        cell, wake = _left_cell(robot, wanted, time)
    if cell is None:
        return robot.but(status="waiting"), None, wake
    need = move_cost(robot, cell) + brief.course.between(cell, robot.start)
    if need > robot.left and not (robot.fresh and robot.cell == robot.start):
        return robot.but(status="searching", target=-1), GoHome(), inf
    return robot.but(status="searching", target=cell), Go(cell), inf


def _own_cell(robot: Robot, wanted: int) -> int | None:
    """Return the next cell of its own work."""
    for sweep in _sweeps(robot):
        cell = sweep.next_of(wanted, len(robot.brief.course))
        if cell is not None:
            return int(cell)
    return None


def _left_cell(robot: Robot, wanted: int, time: float) -> tuple[int | None, float]:
    """Return the next cell that others have left, or until when to wait for them."""
    course = robot.brief.course
    left = 0
    for index, part in enumerate(robot.parts):
        if part.bits & wanted:
            takers = previous_in(robot.parts, index, lambda number: is_live(robot, number, time), robot.brief.fold)
            if robot.number in takers:
                left |= part.bits & wanted
    if left:
        return next_in(left, robot.cell, len(course)), inf
    last = robot.deadline - cost_of_all(course, wanted, robot.cell, robot.fresh) / robot.rate
    if wanted and time >= last - 1e-9:
        return next_in(wanted, robot.cell, len(course)), inf
    silences = [peer.heard + patience(robot) + 1e-6 for peer in robot.peers.values()]
    return None, min([last if wanted else inf, *(moment for moment in silences if moment > time)], default=inf)
