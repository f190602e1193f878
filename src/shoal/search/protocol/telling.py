"""What a beacon tells: what is new, several times, and of all else a share, so that in some beacons all is told.

All that is told are facts that stay true. So what is new (deltas) needs nothing that came before, and whoever has missed it hears
it when its turn comes, from any robot that knows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil

from shoal.search.protocol.messages import LAG_UNIT, Beacon, Heartbeat
from shoal.search.protocol.state import Robot
from shoal.search.tours.bitset import arc_bits

_AGAIN = 4  # beacons that tell what is new
_ROUND, _LAST_ROUND = 16, 4  # beacons in which all is told, and when the robot is done and will soon be silent
_LEAST, _MOST = 8, 1000  # intervals of what is known already, in a beacon
_RELAYED = 6  # heartbeats of others in a beacon, where there are no more than four times as many robots


def with_beacon(robot: Robot, time: float) -> tuple[Robot, Beacon]:
    """Return the state after a beacon was sent, and the beacon."""
    n, known = len(robot.brief.tour_cost), (robot.searched, robot.found, robot.closed)
    before: tuple[Mapping[int, int], ...] = robot.told[0] if len(robot.told) == _AGAIN else ({}, {}, {})
    window = _window(robot, n)
    searched, closed = (_sets(now, old, window) for now, old in zip(known[::2], before[::2], strict=True))
    found = tuple((cell, robots) for cell, robots in robot.found.items() if window >> cell & 1 or robots & ~before[1].get(cell, 0))
    beacon = Beacon(robot.number, (_own(robot, time), *_relayed(robot)), searched, found, closed)
    return robot.but(told=(*robot.told[-_AGAIN + 1 :], known), window=(robot.window + window.bit_count()) % n), beacon


def _sets(now: Mapping[int, int], before: Mapping[int, int], window: int) -> tuple[tuple[int, int], ...]:
    """Return the cells by robot that are new or within a window of the tour."""
    told = ((number, bits & (~before.get(number, 0) | window)) for number, bits in now.items())
    return tuple((number, bits) for number, bits in told if bits)


def _window(robot: Robot, n: int) -> int:
    """Return a part of the tour, as bits, from where the last beacon's ended: with the share of what is known that it tells."""
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
    """Return about how many intervals within a window of the tour the sets of cells have."""
    sets = [bits & window for bits in (*robot.searched.values(), *robot.closed.values())]
    return sum((bits & ~(bits << 1)).bit_count() for bits in sets) + sum(window >> cell & 1 for cell in robot.found)


def _own(robot: Robot, time: float) -> Heartbeat:
    place = robot.cell if robot.target is None or robot.target < 0 else robot.target
    lag = round(robot.lag_at(time) / LAG_UNIT) * LAG_UNIT
    return Heartbeat(robot.number, robot.count, robot.start, robot.rate, robot.status, robot.width, place, lag)


def _relayed(robot: Robot) -> list[Heartbeat]:
    """Return the heartbeats of some others, in turn."""
    others = sorted(robot.peers)
    count = max(_RELAYED, ceil(len(others) / 4))
    first = robot.count * count % max(len(others), 1) if count < len(others) else 0
    return [robot.peers[number].heartbeat for number in (others[first:] + others[:first])[:count]]
