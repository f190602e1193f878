"""Marker objects in place of messages: robots that see where the others have started.

Paper H, footnote 7, lets each robot drop a marker object at its start. A robot that follows the tour
then knows where the next robot has begun, without any message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import inf

from shoal.core.checks import check_integer, check_list
from shoal.search.protocol.robot import Decision, head_for
from shoal.search.protocol.state import Declare, Robot


def marker_rule(markers: Iterable[int], *, stop: bool = True) -> Callable[[Robot, float], Decision]:
    """Return a rule by which robots follow the tour without messages, for the argument ``decide``
    of a `SearchWorld`.

    Parameters
    ----------
    markers : iterable of int
        Tour indices of the cells with a marker. A robot looks only for the marker of the next cell.
    stop : bool
        Whether a robot stops at a marker and declares that it is done. Otherwise, each robot
        searches all cells and stops at its own start, as paper H demands if all communication
        fails.

    Notes
    -----
    With ``stop``, the search of m robots takes as long as the longest arc between two markers. A
    marker says nothing about the robot that has dropped it: if this robot is dead, its arc stays
    unsearched. Without ``stop``, all cells are searched as long as one robot is alive, and at the
    same time if all are alive; but every robot travels the whole tour.
    """
    marked = frozenset(
        check_integer(marker, what="markers", least=0)
        for marker in check_list(markers, what="markers")
    )

    def decide(robot: Robot, time: float) -> Decision:
        n = len(robot.brief.tour_cost)
        cell = robot.start if robot.fresh and robot.cell == robot.start else (robot.cell + 1) % n
        if robot.at_launch:
            cell = robot.start
        elif cell == robot.start or (stop and cell in marked):
            return robot.replaced(status="complete", next_beat=inf, lingering=0), Declare(), inf
        return head_for(robot.replaced(aim=cell), cell, time)

    return decide
