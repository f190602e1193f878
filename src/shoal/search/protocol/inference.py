"""Conclusions of a robot from sensor data and messages: which robots are alive, and which cells are searched or reachable."""

from __future__ import annotations

from functools import lru_cache
from math import log

from shoal.search.allocation.tour_cost import TourCost
from shoal.search.allocation.viewpoint_selection import gain_of
from shoal.search.cells.distances import CellDistances
from shoal.search.protocol.state import Robot
from shoal.search.tours.bitset import at_least

_FALSE_POSITIVE_RATE = 0.01  # false-positive rate of the failure detector
MARK = 8.0  # beacon periods: minimum observation time for estimating a robot's speed
_TOLERATED, _BEATS = 0.25, 4.0  # tolerated lag: fraction of the elapsed time, plus number of beacon periods
_RELUCTANCE = 1.4  # tolerated lag of the robot itself, divided by the tolerated lag of another robot
_CRAWL = 1e-3  # lower bound of a robot's estimated speed, divided by its declared speed
_SILENCE = (3.0, 40.0)  # beacon periods: minimum and maximum silence after which a robot is presumed dead


def step_cost(tour_cost: TourCost, here: int, cell: int, fresh: bool, closed: int = 0) -> float:
    """Return the cost, in cells, of moving from the cell ``here`` to the cell ``cell`` and searching ``cell``.

    The argument ``fresh`` tells whether the robot has arrived in the cell ``here`` but has not searched it. The bitset ``closed``
    contains the blocked cells.
    """
    return 1.0 + tour_cost.way(here, cell, fresh=fresh, closed=closed)


def obstacles(robot: Robot) -> int:
    """Return the bitset of cells that this robot found blocked, or that at least ``multiplicity`` robots report as blocked."""
    if not robot.closed:
        return 0
    return robot.closed.get(robot.number, 0) | at_least(list(robot.closed.values()), robot.brief.multiplicity)


def reachable(robot: Robot, time: float) -> tuple[int, int]:
    """Return two bitsets: the cells that this robot can reach, and the cells that at least one live robot can reach.

    If this robot no longer waits for other robots, both bitsets contain the cells that this robot can reach.
    """
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
    """Return the time without a message from a robot after which the robot is presumed dead.

    This time grows with the fraction of lost messages.
    """
    return robot.brief.beat * _silent_beats(robot.lost, robot.got)


@lru_cache(maxsize=1024)
def _silent_beats(lost: int, got: int) -> float:
    share = lost / (lost + got) if got else 0.5
    beats = log(_FALSE_POSITIVE_RATE) / log(share) if 0 < share < 1 else 0.0
    return min(max(_SILENCE[0], beats), _SILENCE[1]) + 0.5


def is_live(robot: Robot, number: int, time: float) -> bool:
    """Return whether the robot ``robot`` presumes that the robot with the number ``number`` is alive."""
    peer = robot.peers.get(number)
    return number == robot.number or (peer is not None and time - peer.heard <= silence_limit(robot))


def can_come(robot: Robot, number: int, own: int, time: float) -> bool:
    """Return whether the robot with the number ``number`` is presumed alive, and has its start cell in the bitset ``own``.

    The bitset ``own`` contains the cells that the robot ``robot`` can reach. If the start cell is unknown, the function assumes
    that ``own`` contains the start cell.
    """
    peer = robot.peers.get(number)
    return is_live(robot, number, time) and (peer is None or bool(own >> peer.heartbeat.start % len(robot.brief.tour_cost) & 1))


def speed_of(robot: Robot, number: int, time: float) -> tuple[float, float]:
    """Return two estimates for a robot, in cells per unit of time: the speed at which it moves, and the rate at which it searches.

    The estimates follow from the robot's declared speed, its recent lag and the width of its footprint.
    """
    if number == robot.number:
        gone, behind, rate, width = time - robot.allotted_at, robot.lag_at(time), robot.rate, robot.width
    else:
        peer = robot.peers[number]
        since, lag = peer.marks[0]
        gone, behind = peer.heard - since, peer.heartbeat.lag - lag
        rate, width = peer.heartbeat.rate, peer.heartbeat.width
    if gone >= MARK * robot.brief.beat:
        rate *= min(max(1.0 - behind / gone, _CRAWL), 1.0)
    return rate, rate if width == 1 else rate * gain_of(robot.brief.tour_cost, width)


def is_late(robot: Robot, number: int, time: float) -> bool:
    """Return whether a robot lags so far behind its declared speed that other robots should help it.

    A robot has a higher limit for its own lag than for the lag of another robot, so that other robots notice the lag before the
    late robot does.
    """
    if number == robot.number:
        return robot.lag_at(time) > _RELUCTANCE * _tolerated(robot, time)
    peer = robot.peers.get(number)
    return peer is not None and peer.heartbeat.lag > _tolerated(robot, peer.heard)


def _tolerated(robot: Robot, time: float) -> float:
    return _TOLERATED * max(time - robot.allotted_at, 0.0) + _BEATS * robot.brief.beat


def _waits_for_others(robot: Robot, time: float) -> bool:
    """Return whether the robot still waits for other robots to search cells that only they can search.

    If ``multiplicity`` is above 1, robots could wait for each other forever, so the robot waits only for a limited time.
    """
    return robot.brief.multiplicity == 1 or time < 3 * robot.deadline


def settled(robot: Robot, time: float) -> int:
    """Return the bitset of cells that need no further search."""
    seen = robot.searched
    if robot.closed:
        seen = {number: seen.get(number, 0) | robot.closed.get(number, 0) for number in {*seen, *robot.closed}}
    everyone = list(seen.values())
    if robot.brief.multiplicity == 1:
        return at_least(everyone, 1)
    mine = seen.get(robot.number, 0)
    distances, n = robot.brief.tour_cost.distances, len(robot.brief.tour_cost)
    for number, peer in robot.peers.items():  # no further robot can search a cell that all live robots have searched
        if is_live(robot, number, time) and _waits_for_others(robot, time):
            theirs = seen.get(number, 0)
            if isinstance(distances, CellDistances):
                theirs |= ~distances.reach(peer.heartbeat.start % n, obstacles(robot))
            mine &= theirs
    return at_least(everyone, robot.brief.multiplicity) | mine


def known_free(robot: Robot) -> int:
    """Return the bitset of cells that are known to be free.

    A cell is known to be free if this robot has passed it, or if a robot with a footprint of one cell has searched it.
    """
    wide = {number for number, peer in robot.peers.items() if peer.heartbeat.width > 1}
    if robot.width > 1:
        wide.add(robot.number)
    return robot.passed | at_least([cells for number, cells in robot.searched.items() if number not in wide], 1)
