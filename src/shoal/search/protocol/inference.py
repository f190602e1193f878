"""Inference of a robot from what it has sensed and heard: which robots live, what is searched, what can be reached."""

from __future__ import annotations

from math import log

from shoal.search.allocation.tour_cost import TourCost
from shoal.search.cells.distances import CellDistances
from shoal.search.protocol.state import Robot
from shoal.search.tours.bitset import at_least

_FALSE_POSITIVE_RATE = 0.01  # of the failure detector
_SILENCE = (3.0, 40.0)  # beats: the least and the greatest silence after which a robot is presumed dead


def step_cost(tour_cost: TourCost, here: int, cell: int, fresh: bool, closed: int = 0) -> float:
    """Return what it costs to go from a cell to another and search it; ``fresh`` if the first one was not searched just now."""
    return 1.0 + tour_cost.way(here, cell, fresh=fresh, closed=closed)


def obstacles(robot: Robot) -> int:
    """Return the cells, as bits, that it takes for obstructed: what it has found itself, and what enough others say."""
    if not robot.closed:
        return 0
    return robot.closed.get(robot.number, 0) | at_least(list(robot.closed.values()), robot.brief.multiplicity)


def reachable(robot: Robot, time: float) -> tuple[int, int]:
    """Return the cells, as bits, that it can reach, and those that it or another one that it takes for alive can."""
    distances, n = robot.brief.tour_cost.distances, len(robot.brief.tour_cost)
    if not isinstance(distances, CellDistances):
        return robot.brief.everything, robot.brief.everything
    closed = obstacles(robot)
    own = anyone = distances.reach(robot.cell, closed)
    if not _waits_for_others(robot, time):
        return own, own
    for number, peer in robot.peers.items():
        if is_live(robot, number, time):
            anyone |= distances.reach(peer.heartbeat.start % n, closed)
    return own, anyone


def silence_limit(robot: Robot) -> float:
    """Return after how long a silence a robot is taken for dead: longer where many messages are lost."""
    share = robot.lost / (robot.lost + robot.got) if robot.got else 0.5
    beats = log(_FALSE_POSITIVE_RATE) / log(share) if 0 < share < 1 else 0.0
    return robot.brief.beat * (min(max(_SILENCE[0], beats), _SILENCE[1]) + 0.5)


def is_live(robot: Robot, number: int, time: float) -> bool:
    """Tell whether a robot takes another one for alive."""
    peer = robot.peers.get(number)
    return number == robot.number or (peer is not None and time - peer.heard <= silence_limit(robot))


def _waits_for_others(robot: Robot, time: float) -> bool:
    """Tell whether it still hopes for what only others can do; with ``multiplicity`` two might hope for one another for ever."""
    return robot.brief.multiplicity == 1 or time < 3 * robot.deadline


def settled(robot: Robot, time: float) -> int:
    """Return the cells that need no more searching, as bits."""
    seen = robot.searched
    if robot.closed:
        seen = {number: seen.get(number, 0) | robot.closed.get(number, 0) for number in {*seen, *robot.closed}}
    everyone = list(seen.values())
    if robot.brief.multiplicity == 1:
        return at_least(everyone, 1)
    mine = seen.get(robot.number, 0)
    distances, n = robot.brief.tour_cost.distances, len(robot.brief.tour_cost)
    for number, peer in robot.peers.items():  # what all live ones have searched cannot be searched by more
        if is_live(robot, number, time) and _waits_for_others(robot, time):
            theirs = seen.get(number, 0)
            if isinstance(distances, CellDistances):
                theirs |= ~distances.reach(peer.heartbeat.start % n, obstacles(robot))
            mine &= theirs
    return at_least(everyone, robot.brief.multiplicity) | mine


def known_free(robot: Robot) -> int:
    """Return the cells, as bits, that it knows to be free of obstacles: it or another one that sees no farther has been there."""
    wide = {number for number, peer in robot.peers.items() if peer.heartbeat.width > 1}
    if robot.width > 1:
        wide.add(robot.number)
    return robot.passed | at_least([cells for number, cells in robot.searched.items() if number not in wide], 1)
