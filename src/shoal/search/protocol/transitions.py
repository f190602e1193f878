"""State transitions of a robot that arrives in its target cell, or in front of a cell that it cannot enter."""

from __future__ import annotations

from shoal.search.cells.distances import CellDistances
from shoal.search.protocol.events import Sensed
from shoal.search.protocol.state import Robot
from shoal.search.tours.bitset import bitset_of

_AVOIDED = 3.0  # cells: time for which a robot avoids a cell in which it met another robot
LOOK = 1.0  # cells: cost of the way from the centre of a cell to an obstacle in the next cell, and back


def sensed(robot: Robot, event: Sensed) -> Robot:
    """Return the state of a robot after a search. All cells that the robot sees from its cell count as searched."""
    cell, found = event.cell, robot.found
    seen = 1 << cell if robot.width == 1 else bitset_of(robot.brief.tour_cost.seen(cell, robot.width).tolist())
    searched = {**robot.searched, robot.number: robot.mine | seen}
    for one in (*((cell,) if event.found else ()), *event.beside):
        found = {**found, one: found.get(one, 0) | 1 << robot.number}
    free = passed(robot, robot.through)
    left = robot.left - robot.cost
    return robot.but(
        searched=searched, found=found, cell=cell, fresh=False, at_launch=False, target=None, through=(), passed=free, left=left
    )


def blocked(robot: Robot, cell: int, time: float) -> Robot:
    """Return the state of a robot that avoids a cell for a while, because another robot is in this cell.

    Otherwise, two robots could wait for each other forever.
    """
    at = robot.but(cell=cell, fresh=True, at_launch=False, target=None, through=(), left=robot.left - robot.cost)
    free = passed(robot, robot.through)
    return at.but(passed=free, avoided=robot.avoided | 1 << cell, avoided_until=time + _AVOIDED)


def obstructed(robot: Robot, cell: int, at: int) -> Robot:
    """Return the state of a robot that stops in front of an obstacle, and reports the cell of the obstacle as blocked."""
    tour_cost = robot.brief.tour_cost
    way = robot.through[: robot.through.index(at) + 1] if at in robot.through else ()
    left = robot.left - tour_cost.length(robot.cell, at) - robot.way_out(at) - LOOK
    closed = {**robot.closed, robot.number: robot.closed.get(robot.number, 0) | 1 << cell}
    free, fresh = passed(robot, way), robot.fresh or at != robot.cell
    return robot.but(target=None, at_launch=False, through=(), cell=at, fresh=fresh, closed=closed, passed=free, left=left)


def passed(robot: Robot, way: tuple[int, ...]) -> int:
    """Return the bitset of cells known to be free because the robot has passed them, including the cells of the path ``way``."""
    distances = robot.brief.tour_cost.distances
    return robot.passed | distances.crossed(robot.cell, way) if way and isinstance(distances, CellDistances) else robot.passed
