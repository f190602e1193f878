"""Which of two robots may enter a cell, when no sensor sees the other: what the beacons say.

Each heartbeat names the cell that its robot goes to or stands in. A robot that stands one cell
before its own cell has told of it for some time. If another one has told the same, the clearly
earlier one goes on; if both told it at about the same time, the one with the lower number does. The
two margins differ, so that beacons that are lost or late let both wait rather than both go.
"""

from __future__ import annotations

from collections.abc import Callable

from shoal.search.protocol.state import Robot, is_live
from shoal.search.simulation.live.ports import CellFinding

_LATER, _SOONER = 4.0, 10.0  # beats by which a claim is clearly later, or clearly sooner


class RadioSensor:
    """A sensor that finds nothing by itself, and knows of other robots what their beacons say.

    Parameters
    ----------
    robot : callable
        Function that returns the present state of the robot.
    now : callable
        Function that returns the time.
    """

    def __init__(self, robot: Callable[[], Robot], now: Callable[[], float]) -> None:
        self._robot, self._now = robot, now
        self._claims: dict[int, tuple[int, float]] = {}  # cell, and when it was first heard

    def note(self) -> None:
        """Note when each robot has first told of its cell. Call this at each event."""
        for number, peer in self._robot().peers.items():
            cell = peer.heartbeat.place
            if self._claims.get(number, (None, 0.0))[0] != cell:
                self._claims[number] = cell, peer.heard

    def search(self, cell: int) -> CellFinding:
        """Return that nothing was found: what is searched for is on the images."""
        return CellFinding()

    def enter(self, cell: int) -> bool:
        """Return whether the robot may enter a cell before all others that go there."""
        self.note()
        robot, now = self._robot(), self._now()
        for number, peer in robot.peers.items():
            told = peer.heartbeat
            if told.place != cell or told.status != "searching" or not is_live(robot, number, now):
                continue
            margin = _SOONER if number < robot.number else -_LATER
            if self._claims[number][1] - robot.since <= margin * robot.brief.beat:
                return False
        return True

    def leave(self, cell: int) -> None:
        """Do nothing: the next beacon tells where the robot goes."""

    def obstacle_on(self, here: int, through: tuple[int, ...]) -> tuple[int | None, int]:
        """Return that no obstacle is known."""
        return None, len(through)
