"""Content of a beacon: all new facts, and a part of the older facts that a robot knows.

Several beacons repeat each new fact. Consecutive beacons of a robot contain different parts of its older facts. All facts stay
true, so no message depends on an earlier message. A robot that misses a fact receives it later from any robot that knows this fact.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil

from shoal.search.protocol.messages import LAG_UNIT, Beacon, Heartbeat
from shoal.search.protocol.state import Robot
from shoal.search.tours.bitset import arc_bits

_AGAIN = 4  # number of beacons that repeat a new fact
_ROUND, _LAST_ROUND = 16, 4  # a beacon repeats at most 1/16 of all facts, and at most 1/4 if the robot will soon be silent
_LEAST, _MOST = 8, 1000  # minimum and maximum number of intervals of known facts per beacon
_RELAYED = 6  # minimum number of other robots' heartbeats per beacon; for more than 24 other robots, a beacon has a quarter


def with_beacon(robot: Robot, time: float) -> tuple[Robot, Beacon]:
    """Return the state of a robot that has sent a beacon, and this beacon."""
    n, known = len(robot.brief.tour_cost), (robot.searched, robot.found, robot.closed)
    before: tuple[Mapping[int, int], ...] = robot.told[0] if len(robot.told) == _AGAIN else ({}, {}, {})
    window = _window(robot, n)
    searched, closed = (_sets(now, old, window) for now, old in zip(known[::2], before[::2], strict=True))
    found = tuple((cell, robots) for cell, robots in robot.found.items() if window >> cell & 1 or robots & ~before[1].get(cell, 0))
    beacon = Beacon(robot.number, (_own(robot, time), *_relayed(robot)), searched, found, closed)
    return robot.but(told=(*robot.told[-_AGAIN + 1 :], known), window=(robot.window + window.bit_count()) % n), beacon


def _sets(now: Mapping[int, int], before: Mapping[int, int], window: int) -> tuple[tuple[int, int], ...]:
    """Return, for each robot, a bitset of those cells in ``now`` that are missing in ``before`` or lie in the bitset ``window``."""
    told = ((number, bits & (~before.get(number, 0) | window)) for number, bits in now.items())
    return tuple((number, bits) for number, bits in told if bits)


def _window(robot: Robot, n: int) -> int:
    """Return the section of the tour whose facts the next beacon repeats, as a bitset.

    The section of each beacon begins where the section of the previous beacon ended. A section is as long as the space for facts in
    one beacon allows.
    """
    everything = robot.brief.everything
    total = _intervals(robot, everything)
    share = max(_LEAST, min(ceil(total / (_LAST_ROUND if robot.status == "complete" else _ROUND)), _MOST))
    if total <= share:
        return everything
    width, window = n, everything
    while width > 1 and _intervals(robot, window) > share:
        width = ceil(width / 2)
        window = arc_bits(robot.window, width, n)
    return window


def _intervals(robot: Robot, window: int) -> int:
    """Return the approximate number of intervals in all known sets of cells, inside a window of the tour."""
    sets = [bits & window for bits in (*robot.searched.values(), *robot.closed.values())]
    return sum((bits & ~(bits << 1)).bit_count() for bits in sets) + sum(window >> cell & 1 for cell in robot.found)


def _own(robot: Robot, time: float) -> Heartbeat:
    place = robot.cell if robot.target is None or robot.target < 0 else robot.target
    lag = round(robot.lag_at(time) / LAG_UNIT) * LAG_UNIT
    return Heartbeat(robot.number, robot.count, robot.start, robot.rate, robot.status, robot.width, place, lag)


def _relayed(robot: Robot) -> list[Heartbeat]:
    """Return the heartbeats of some other robots. Successive beacons relay the heartbeats of all other robots in turn."""
    others = sorted(robot.peers)
    count = max(_RELAYED, ceil(len(others) / 4))
    first = robot.count * count % max(len(others), 1) if count < len(others) else 0
    return [robot.peers[number].heartbeat for number in (others[first:] + others[:first])[:count]]
